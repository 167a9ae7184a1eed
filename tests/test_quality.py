"""Owns the tests of the quality of data: hopeless recordings end in a sentence, quickly; good ones raise no alarm."""

from __future__ import annotations

import time
import warnings
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import ltp
from ltp.conceal import conceal

Array = npt.NDArray[np.float64]


@pytest.fixture(scope="module")
def case() -> Any:
    return conceal(effect="coulomb_friction", port="cart", duration=4.0, seed=3)


def changed(
    recording: ltp.Recording,
    *,
    y: dict[str, Array] | None = None,
    u: dict[str, Array] | None = None,
    stretch: float = 1.0,
) -> ltp.Recording:
    """The recording with some outputs or inputs replaced, or its time axis stretched."""
    outputs = {name: recording.outputs[:, k] for k, name in enumerate(recording.output_names)} | (y or {})
    inputs = {name: recording.inputs[:, k] for k, name in enumerate(recording.input_names)} | (u or {})
    return ltp.Recording(recording.t * stretch, inputs, outputs, name=recording.name)


def output(recording: ltp.Recording, name: str) -> Array:
    return np.array(recording.outputs[:, recording.output_names.index(name)])


def refused(model: ltp.Model, train: Any, test: Any = ()) -> str:
    """The sentence of the refusal, which must come at once."""
    begun = time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with pytest.raises(ltp.InputError) as refusal:
            ltp.diagnose(model, train, test)
    assert time.perf_counter() - begun < 2.0
    return str(refusal.value)


class TestHopeless:
    def test_constant_outputs(self, case: Any) -> None:
        still = [changed(r, y={n: np.zeros(len(r.t)) for n in r.output_names}) for r in case.train]
        text = refused(case.model, still, case.test)
        assert "nothing moves" in text
        assert "`x` of" in text
        assert "check the sensor" in text

    def test_white_noise_and_no_input(self, case: Any) -> None:
        random = np.random.default_rng(1)
        still = [
            changed(
                r,
                y={n: random.normal(scale=1e-4, size=len(r.t)) for n in r.output_names},
                u={n: np.zeros(len(r.t)) for n in r.input_names},
            )
            for r in case.train
        ]
        text = refused(case.model, still, case.test)
        assert "white noise" in text
        assert "drive the system" in text

    def test_fewer_samples_than_unknowns(self, case: Any) -> None:
        text = refused(case.model, case.train[0].slice(0.0, 0.08))
        assert "uncertain parameters" in text
        assert "at least" in text

    def test_a_saturated_sensor(self, case: Any) -> None:
        limit = {r.name: 0.25 * np.ptp(output(r, "theta")) for r in case.train}
        cut = [changed(r, y={"theta": np.clip(output(r, "theta"), -0.1 * v, 0.1 * v)}) for r, v in
               zip(case.train, limit.values(), strict=True)]  # fmt: skip
        text = refused(case.model, cut, case.test)
        assert "saturated" in text
        assert "`theta`" in text

    @pytest.mark.parametrize(
        ("name", "factor", "unit"), [("theta", 180 / np.pi, "degrees"), ("x", 1e3, "mm"), ("x", 1e2, "cm")]
    )
    def test_an_output_in_another_unit(self, case: Any, name: str, factor: float, unit: str) -> None:
        wrong = [changed(r, y={name: factor * output(r, name)}) for r in case.train]
        text = refused(case.model, wrong, case.test)
        assert f"it looks like {unit} " in text
        assert f"output `{name}`" in text

    def test_an_input_in_another_unit(self, case: Any) -> None:
        wrong = [changed(r, u={"V": 1e3 * r.inputs[:, 0]}) for r in case.train]
        text = refused(case.model, wrong, case.test)
        assert "input `V`" in text
        assert "thousandths of V" in text

    def test_time_in_milliseconds(self, case: Any) -> None:
        text = refused(case.model, [changed(r, stretch=1e3) for r in case.train], case.test)
        assert "time of" in text
        assert "it looks like ms" in text

    def test_a_held_out_record_that_was_fitted(self, case: Any) -> None:
        text = refused(case.model, case.train, case.train[0])
        assert "samples are those of the train recording" in text
        assert "from sample 100 on" in refused(case.model, case.train, case.train[1].slice(1.0, 3.0))

    def test_one_period_of_a_clock(self) -> None:
        model = ltp.zoo.load("hopper")
        run = ltp.simulate(model, t_end=0.3, dt=0.0025)
        noise = np.random.default_rng(1).normal(scale=1e-5, size=len(run.t))
        columns = dict(zip(run.output_names, run.outputs.T, strict=True))
        columns["h"] = columns["h"] + noise
        inputs = dict(zip(run.input_names, run.inputs.T, strict=True))
        text = refused(model, ltp.Recording(run.t, inputs, columns, name="one"))
        assert "periods of the clock" in text


@pytest.mark.filterwarnings("ignore::UserWarning")
class TestDoubtful:
    def test_a_sensor_that_is_at_its_end_now_and_then(self, case: Any) -> None:
        """The clipped samples are left out, and the effect is still named."""
        train = []
        for r in case.train:
            theta = output(r, "theta")
            train.append(changed(r, y={"theta": np.clip(theta, np.quantile(theta, 0.06), np.quantile(theta, 0.94))}))
        found = ltp.diagnose(case.model, train, case.test)
        assert any("saturated" in text for text in found.warnings), found.warnings
        assert [(e.name, e.at) for e in found.effects] == [("coulomb_friction", "cart")]

    def test_a_coarse_sensor_states_its_floor(self, case: Any) -> None:
        step = np.ptp(output(case.train[0], "theta")) / 50
        train = [changed(r, y={"theta": step * np.round(output(r, "theta") / step)}) for r in case.train]
        found = ltp.diagnose(case.model, train, case.test, candidates=["coulomb_friction"])
        (text,) = (text for text in found.warnings if "quantised" in text)
        assert "step/sqrt(12)" in text

    def test_different_sampling(self, case: Any) -> None:
        thin = case.test[0]
        coarse = ltp.Recording(
            thin.t[::2],
            {n: thin.inputs[::2, k] for k, n in enumerate(thin.input_names)},
            {n: thin.outputs[::2, k] for k, n in enumerate(thin.output_names)},
            name="coarse",
        )
        found = ltp.diagnose(case.model, case.train, coarse, candidates=["coulomb_friction"])
        assert any("is sampled every 0.02 s" in text for text in found.warnings)

    def test_a_million_samples_are_bounded_work(self) -> None:
        truth = ltp.zoo.load("drive").attach("coulomb_friction", "drive", {"force": 20.0})

        def recorded(seed: int, t_end: float) -> ltp.Recording:
            run = ltp.simulate(
                truth,
                {"tau": f"60*sin({2.1 + 0.1 * seed}*t)*(1 + 0.6*sin(0.01*t)) + 40*sin(5.3*t + {seed})"},
                t_end=t_end,
                dt=1e-3,
            )
            noise = np.random.default_rng(seed).normal(scale=1e-5, size=len(run.t))
            return ltp.Recording(
                run.t, {"tau": run.inputs[:, 0]}, {"q": run.outputs[:, 0] + noise}, name=f"long {seed}"
            )

        train, test = recorded(1, 1000.0), recorded(2, 20.0)
        found = ltp.diagnose(ltp.zoo.load("drive"), train, test)
        # What is drawn is what was worked on.
        assert sum(len(record["t"]) for record in found.traces["records"] if record["role"] == "train") < 50_000
        (text,) = (text for text in found.warnings if "bounded time" in text and "long 1" in text)
        assert "every" in text or "stretches" in text
        assert [e.name for e in found.effects] == ["coulomb_friction"], found.sentence


def test_good_recordings_raise_no_alarm(case: Any) -> None:
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        ltp.diagnose(case.model, case.train, case.test, candidates=["coulomb_friction"])
    texts = [str(w.message) for w in said]
    assert not any(word in t for t in texts for word in ("saturated", "quantised", "looks like", "sampled every"))
