"""Owns the tests of `ltp._ltp` itself: arrays of every layout, errors with names, threads, Ctrl-C, and the stub.

One good call each; a test spoils one thing of it. That a panic becomes a `RuntimeError` cannot be tested from here: no
input is known that causes one.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from conftest import RIG
from ltp import _ltp

Array = npt.NDArray[np.float64]

N = 20
T: Array = np.arange(N) * 0.1
ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture
def model() -> _ltp.Model:
    return _ltp.Model.from_toml(RIG, "rig.toml")


def record(**spoiled: Any) -> _ltp.Recording:
    """A good recording of two inputs and one output, but for what is spoiled."""
    good: dict[str, Any] = {
        "name": "run",
        "t": T,
        "inputs": np.column_stack([np.sin(T), np.cos(T)]),
        "outputs": np.exp(-T)[:, None],
        "input_names": ["tau", "load"],
        "output_names": ["q"],
    }
    return _ltp.Recording(**{**good, **spoiled})


def spoiled(values: Array, row: int, value: float) -> Array:
    copy = values.copy()
    copy[row] = value
    return copy


def unaligned(values: Array) -> Array:
    """The same values between the addresses where a float64 belongs, as in records of another program."""
    packed = np.zeros(values.shape, dtype=[("flag", "i1"), ("value", "f8")])
    packed["value"] = values
    assert not packed["value"].flags.aligned
    return packed["value"]


LAYOUTS = {
    "C order": np.ascontiguousarray,
    "Fortran order": np.asfortranarray,
    "reversed rows": lambda a: a[::-1].copy()[::-1],
    "reversed columns": lambda a: a[..., ::-1].copy()[..., ::-1],
    "every other row": lambda a: np.repeat(a, 2, axis=0)[::2],
    "unaligned": unaligned,
    "read-only": lambda a: np.broadcast_to(a, a.shape),
}


class TestArrays:
    @pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS)
    def test_layouts_of_a_recording(self, layout: Any) -> None:
        inputs, outputs = np.column_stack([np.sin(T), np.cos(T)]), np.column_stack([np.exp(-T), T**2])
        recording = record(t=layout(T), inputs=layout(inputs), outputs=layout(outputs), output_names=["q", "v"])
        np.testing.assert_array_equal(recording.t, T)
        np.testing.assert_array_equal(recording.inputs, inputs)
        np.testing.assert_array_equal(recording.outputs, outputs)

    @pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS)
    def test_layouts_of_an_input(self, model: _ltp.Model, layout: Any) -> None:
        expected = _ltp.simulate(model, {"tau": np.sin(T)}, T)
        run = _ltp.simulate(model, {"tau": layout(np.sin(T))}, layout(T))
        np.testing.assert_array_equal(run.states, expected.states)

    @pytest.mark.parametrize(
        ("value", "found"),
        [
            (T.astype(np.float32), r"an array of float32 with shape \(20,\)"),
            (T.astype(">f8"), "an array of >f8"),
            (T.astype(complex), "an array of complex128"),
            (np.arange(N), "an array of int64"),
            (T[:, None], r"an array of float64 with shape \(20, 1\)"),
            (np.float64(1.0), "a float64"),
            (T.tolist(), "a list"),
            (None, "a NoneType"),
        ],
    )
    def test_what_is_no_vector(self, model: _ltp.Model, value: Any, found: str) -> None:
        with pytest.raises(_ltp.InputError, match=f"^t: found {found}.*expected a 1-D array of float64; convert it"):
            record(t=value)
        with pytest.raises(_ltp.InputError, match=f"^t: found {found}"):
            _ltp.simulate(model, {"tau": T}, value)
        with pytest.raises(_ltp.InputError, match=f"^input `tau`: found {found}"):
            _ltp.simulate(model, {"tau": value}, T)

    @pytest.mark.parametrize("argument", ["inputs", "outputs"])
    def test_what_is_no_matrix(self, argument: str) -> None:
        with pytest.raises(_ltp.InputError, match=rf"^{argument}: found .* shape \(20,\), expected a 2-D array"):
            record(**{argument: T})

    def test_matrices_without_columns(self) -> None:
        recording = record(inputs=np.empty((N, 0)), input_names=[])
        assert recording.inputs.shape == (N, 0)

    def test_what_a_recording_shows_is_its_own(self) -> None:
        t = T.copy()
        recording = record(t=t)
        t[:] = 0.0
        np.testing.assert_array_equal(recording.t, T)
        for shown in (recording.t, recording.inputs, recording.outputs):
            with pytest.raises(ValueError, match="read-only"):
                shown[0] = 7.0
        assert recording.outputs is recording.outputs

    def test_gaps(self) -> None:
        recording = record(outputs=spoiled(np.exp(-T), 3, np.nan)[:, None])
        assert np.flatnonzero(np.isnan(recording.outputs)).tolist() == [3]


class TestErrors:
    @pytest.mark.parametrize(
        ("change", "message"),
        [
            ({"t": spoiled(T, 4, np.nan)}, r"`run`: row 4 .*column `t`: found NaN"),
            ({"t": spoiled(T, 4, 0.2)}, r"`run`: time must increase.*row 4"),
            ({"t": T[:-1]}, "column `tau` beside t: found 20 values, expected 19"),
            ({"inputs": np.full((N, 2), np.nan)}, "column `tau`: found NaN"),
            ({"outputs": np.full((N, 1), np.inf)}, "column `q`: found inf"),
            ({"input_names": ["tau"]}, "names of inputs for 2 input columns: found 1"),
            ({"input_names": ["tau", "tau"]}, "the input `tau` appears twice"),
            ({"t": T[:3], "inputs": np.zeros((3, 2)), "outputs": np.zeros((3, 1))}, "found 3 samples, at least 8"),
        ],
    )
    def test_recording(self, change: dict[str, Any], message: str) -> None:
        with pytest.raises(_ltp.InputError, match=message):
            record(**change)

    @pytest.mark.parametrize(
        ("change", "message"),
        [
            ({"inputs": {"taw": T}}, "no input `taw`; did you mean `tau`"),
            ({"inputs": {"taw": "t"}}, "no input `taw`; did you mean `tau`"),
            ({"inputs": {"tau": "sin(x)"}}, "rig.toml: signals.tau, line 1, column 5: unknown name `x`"),
            ({"inputs": {}}, r"rig: inputs.tau: nothing is given .* no default"),
            ({"inputs": {"tau": T[1:]}}, "input `tau` beside t: found 19 values, expected 20"),
            ({"inputs": {"tau": spoiled(T, 6, np.nan)}}, "row 6 .*column `tau`: found NaN"),
            ({"t": T[:1]}, "t: found 1 samples, at least 2"),
            ({"t": T[::-1]}, "t: the step between two samples = -0.1"),
            ({"t": 0 * T}, "t: the step between two samples = 0"),
            ({"t": spoiled(T, 5, np.nan)}, r"t\[5\] = NaN: expected 0.5 s"),
            ({"t": spoiled(T, 5, 0.51)}, r"t\[5\] = 0.51: expected 0.5 s"),
            ({"hold": "linear"}, "no hold `linear`; did you mean `first-order` or `zero-order` or `cubic`"),
            ({"step": 0.0}, "step = 0: expected a positive time"),
            ({"step": np.nan}, "step = NaN: expected a positive time"),
            ({"step": 1e-300}, "expected a positive time in s, at least 1e-10 s"),
            ({"initial_state": {"w": 1.0}}, "initial_state: there is no state `w`"),
            ({"initial_state": {"q": np.inf}}, "initial_state `q` = inf: expected a finite number in m"),
            ({"initial_state": {"q": "far"}}, "initial_state: `q` is far, expected a number"),
            ({"initial_mode": "flight"}, "no mode `flight`"),
        ],
    )
    def test_simulate(self, model: _ltp.Model, change: dict[str, Any], message: str) -> None:
        with pytest.raises(_ltp.InputError, match=message):
            _ltp.simulate(model, **{"inputs": {"tau": T}, "t": T, **change})

    def test_names_of_the_rest(self, model: _ltp.Model) -> None:
        calls: list[tuple[Any, str]] = [
            (lambda: model.unit("qq"), "qq"),
            (lambda: model.column("qq"), "no input or output `qq`"),
            (lambda: model.input_default("taw"), "did you mean `tau`"),
            (lambda: model.with_parameters({"M": -1.0}), "parameters.M: value -1"),
            (lambda: model.attach("coulomb_friction", "drve", {}), "no port `drve`; did you mean `drive`"),
            (lambda: _ltp.zoo_text("hoper"), "did you mean `hopper`"),
            (lambda: _ltp.effect_text("coulom_friction"), "did you mean `coulomb_friction`"),
            (lambda: _ltp.unit_factor("V", "m"), "`V` cannot be converted to `m`"),
            (lambda: record().slice(5.0, 6.0), "it covers 0 s to 1.9"),
        ]
        for call, message in calls:
            with pytest.raises(_ltp.InputError, match=message):
                call()

    def test_kinds(self) -> None:
        assert issubclass(_ltp.InputError, ValueError)
        assert issubclass(_ltp.ConvergenceError, RuntimeError)
        assert {_ltp.InputError.__module__, _ltp.ConvergenceError.__module__} == {"ltp"}


class TestModel:
    def test_parameters_of_effects(self, model: _ltp.Model) -> None:
        rubbed = model.attach("coulomb_friction", "drive", {"force": 2.0})
        assert [p["name"] for p in rubbed.parameters] == ["M", "b", "coulomb_friction@drive.force"]
        stronger = rubbed.with_parameters({"coulomb_friction@drive.force": 3.0})
        force = {"force": {"value": 3.0, "sd": None, "unit": "N"}}
        assert stronger.effects == [{"name": "coulomb_friction", "at": "drive", "parameters": force}]

    def test_bounds_that_are_not_stated(self, model: _ltp.Model) -> None:
        mass = {"name": "M", "value": 10.0, "sd": 1.0, "unit": "kg", "min": 0.1, "max": None}
        assert model.parameters[0] == mass

    def test_defaults_and_library(self, model: _ltp.Model) -> None:
        assert (model.input_default("tau"), model.input_default("load")) == (None, 0.5)
        assert _ltp.unit_factor("deg", "rad") == pytest.approx(np.pi / 180, rel=1e-15)
        for name in _ltp.effect_names():
            assert "reference" in _ltp.effect_text(name)


class TestSimulate:
    def test_expressions_and_samples_together(self, model: _ltp.Model) -> None:
        run = _ltp.simulate(model, {"load": np.cos(T), "tau": "2*sin(3*t)"}, T)
        np.testing.assert_allclose(run.inputs, np.column_stack([2 * np.sin(3 * T), np.cos(T)]), rtol=1e-14, atol=1e-14)
        assert run.outputs.shape == (N, 2)
        np.testing.assert_array_equal(run.outputs, run.states)

    def test_expressions_are_exact_between_samples(self, model: _ltp.Model) -> None:
        fine = np.arange(10 * N) * 0.01
        exact = _ltp.simulate(model, {"tau": "20*sin(9*t)"}, fine).states[::10]
        run = _ltp.simulate(model, {"tau": "20*sin(9*t)"}, T, step=0.01)
        np.testing.assert_allclose(run.states, exact, rtol=1e-12, atol=1e-14)
        sampled = _ltp.simulate(model, {"tau": 20 * np.sin(9 * T)}, T, step=0.01)
        assert np.abs(sampled.states - exact).max() > 1e-3

    def test_holds(self, model: _ltp.Model) -> None:
        tau = np.where(T < 1.0, 0.0, 10.0)
        runs = {
            hold: _ltp.simulate(model, {"tau": tau, "load": 0 * T}, T, hold=hold)
            for hold in ("first-order", "zero-order")
        }
        just_before = 10  # the sample at 1 s: a ramp has pushed since 0.9 s, a step has not yet
        assert runs["first-order"].states[just_before, 1] > 0.01
        assert runs["zero-order"].states[just_before, 1] == 0.0

    def test_start_at_another_time(self, model: _ltp.Model) -> None:
        run = _ltp.simulate(model, {"tau": "t"}, T + 1000.0, initial_state={"v": 1.0})
        np.testing.assert_allclose(run.t, T + 1000.0, rtol=1e-15)
        np.testing.assert_allclose(run.inputs[:, 0], run.t, rtol=1e-15)
        assert run.states[0].tolist() == [0.0, 1.0]

    def test_events_modes_and_ending(self) -> None:
        ball = _ltp.Model.from_toml(_ltp.zoo_text("bouncing_ball"), "ball")
        run = _ltp.simulate(ball, {}, T, step=0.01)
        assert run.mode == ["flight"] * N
        name, at, before, after = run.events[0]
        assert (name, before, after) == ("impact", "flight", "flight")
        assert at == pytest.approx(0.451523641, abs=1e-9)
        assert run.stop == {"reason": "finished", "time": run.t[-1], "mode": "flight", "message": "reached the end"}
        assert run.stats["events"] == len(run.events)
        assert isinstance(run.stats["steps"], int)

    def test_what_ended_early(self) -> None:
        text = 'name = "blast"\n[states]\nx = { value = 1.0 }\n[flow]\nx = "x^2"\n[outputs]\nx = "x"\n'
        run = _ltp.simulate(_ltp.Model.from_toml(text, "blast"), {}, T, step=1e-3)
        assert (run.stop["reason"], run.stop["mode"]) == ("escape", "motion")
        assert 1.0 <= run.stop["time"] < 1.1
        assert len(run.t) == len(run.states) == len(run.mode) < N


def spend(model: _ltp.Model, seconds: float) -> float:
    """Simulates for about so long; returns how long it was, s."""
    probe = time.perf_counter()
    _ltp.simulate(model, {"tau": T}, T, step=1e-5)
    share = seconds / (time.perf_counter() - probe)
    start = time.perf_counter()
    _ltp.simulate(model, {"tau": T}, T, step=max(1e-5 / share, 1e-9))
    return time.perf_counter() - start


class TestThreads:
    def test_other_threads_run_meanwhile(self, model: _ltp.Model) -> None:
        beats, over = [0], threading.Event()

        def beat() -> None:
            while not over.wait(0.002):
                beats[0] += 1

        thread = threading.Thread(target=beat)
        thread.start()
        before = beats[0]
        elapsed = spend(model, 0.5)
        during = beats[0] - before
        over.set()
        thread.join()
        assert elapsed > 0.1
        assert during > 10

    def test_one_model_in_many_threads(self, model: _ltp.Model) -> None:
        expected = _ltp.simulate(model, {"tau": np.sin(T)}, T).states
        with ThreadPoolExecutor(8) as pool:
            runs = list(pool.map(lambda _: _ltp.simulate(model, {"tau": np.sin(T)}, T).states, range(64)))
        for states in runs:
            np.testing.assert_array_equal(states, expected)


class TestProgress:
    @pytest.fixture
    def recording(self, model: _ltp.Model) -> _ltp.Recording:
        t = np.arange(200) * 0.02
        run = _ltp.simulate(model.with_parameters({"M": 12.0}), {"tau": "8*sin(2*t)"}, t)
        noise = np.random.default_rng(1).normal(scale=1e-4, size=run.outputs.shape)
        return _ltp.Recording("run", t, run.inputs, run.outputs + noise, model.inputs, model.outputs)

    def test_stages_and_fractions(self, model: _ltp.Model, recording: _ltp.Recording) -> None:
        heard: list[tuple[str, float]] = []
        call = lambda *news: heard.append(news)  # noqa: E731
        found = _ltp.diagnose(model, [recording], [], candidates=["viscous_friction"], progress=call)
        assert found.json().startswith("{")
        assert all(text and 0.0 <= fraction <= 1.0 for text, fraction in heard)
        assert heard[-1][1] == 1.0
        for trace in found.traces()["records"]:
            for name in ("measured", "nominal", "before", "after"):
                assert trace[name].shape == (len(trace["t"]), 2)

    def test_exception_of_the_callback(self, model: _ltp.Model, recording: _ltp.Recording) -> None:
        def refuse(*_: object) -> None:
            raise LookupError("enough")

        with pytest.raises(LookupError, match="enough"):
            _ltp.diagnose(model, [recording], [], progress=refuse)

    def test_hold(self, model: _ltp.Model, recording: _ltp.Recording) -> None:
        with pytest.raises(_ltp.InputError, match="no hold `linear`"):
            _ltp.diagnose(model, [recording], [], hold="linear")


SIMULATE = '_ltp.simulate(model, {"tau": "sin(t)"}, np.arange(20001) * 1.0, step=1e-5)'
DIAGNOSE = """
    t = np.arange(100000) * 1e-3
    run = _ltp.simulate(model, {"tau": "40*sin(3*t) + 20*sin(7.1*t)"}, t)
    outputs = run.outputs + np.random.default_rng(1).normal(scale=1e-3, size=run.outputs.shape)
    record = _ltp.Recording("run", t, run.inputs, outputs, model.inputs, model.outputs)
    _ltp.diagnose(model, [record], [])
"""
LONG = """
import sys, time
import numpy as np
from ltp import _ltp
model = _ltp.Model.from_toml(_ltp.zoo_text("drive"), "drive")
print("ready", flush=True)
try:
    {work}
except KeyboardInterrupt:
    print("interrupted", flush=True)
time.sleep(0.2)                    # the worker takes its leave
before = time.process_time()
time.sleep(0.5)
print(time.process_time() - before, flush=True)
"""


@pytest.mark.skipif(os.name != "posix", reason="Ctrl-C is sent as a POSIX signal")
@pytest.mark.parametrize("work", [SIMULATE, DIAGNOSE], ids=["simulate", "diagnose"])
def test_ctrl_c_ends_long_work(work: str) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", LONG.format(work=work.strip())], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        try:
            assert process.stdout.readline() == "ready\n"
            time.sleep(1.0)
            process.send_signal(signal.SIGINT)
            sent = time.monotonic()
            assert process.stdout.readline() == "interrupted\n"
            assert time.monotonic() - sent < 1.0
            busy = float(process.stdout.readline())
            assert busy < 0.25, "the work went on after the interrupt"
            assert process.wait(timeout=30) == 0
        finally:
            process.kill()


def test_stub_is_true() -> None:
    pytest.importorskip("mypy")
    command = [sys.executable, "-m", "mypy.stubtest", "--mypy-config-file", "pyproject.toml", "ltp._ltp"]
    found = subprocess.run(command, cwd=ROOT, env={**os.environ, "MYPYPATH": "python"}, capture_output=True, text=True)
    assert found.returncode == 0, found.stdout + found.stderr


def test_the_wrapper_that_listens_to_ctrl_c_hides_nothing_of_a_system() -> None:
    """Methods of the trait that have a default would be answered by it: delays were once lost so, in silence."""

    def methods(path: str, after: str) -> set[str]:
        text = (ROOT / path).read_text(encoding="utf-8")
        block = text[text.index(after) :]
        return set(re.findall(r"^    fn (\w+)\(", block[: block.index("\n}\n")], re.MULTILINE))

    trait = methods("crates/ltp-core/src/model/system.rs", "pub trait System")
    assert len(trait) > 20
    assert methods("crates/ltp-py/src/interrupt.rs", "System for Interruptible") == trait
