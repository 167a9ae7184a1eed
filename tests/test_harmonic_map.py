"""Owns the tests of the harmonic map on the hopper: planted physics stands out; without it nothing is claimed."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

import ltp
from ltp.conceal import conceal, draw
from ltp.results import Store

PERIOD = 2 * math.pi / 19.039955476301776
SAMPLES = 132  # in one period
CYCLES, REPEATS, SETTLE = 24, 4, 60
NOISE = 2e-5


def hop(
    truth: ltp.Model, seed: int, samples: int = SAMPLES, cycles: int = CYCLES
) -> tuple[ltp.Recording, ltp.Trajectory]:
    """The hopper on its orbit under a small multisine, only `h` measured; the run as well, for its events."""
    wave = ltp.signals.multisine(PERIOD, (2.0, 30.0), cycles, rms=0.5, seed=seed)
    dt = PERIOD / samples
    n = (SETTLE + cycles * REPEATS) * samples
    run = ltp.simulate(truth, {"u_c": wave.samples(t_end=n * dt, dt=dt)[: n + 1]}, t_end=n * dt, dt=dt, strict=True)
    keep = slice(SETTLE * samples, n)
    h = run.outputs[keep, run.output_names.index("h")]
    noisy = h + np.random.default_rng(seed).normal(scale=NOISE, size=len(h))
    return ltp.Recording(run.t[keep], {"u_c": run.inputs[keep, 0]}, {"h": noisy}, name=f"run {seed}"), run


def times(run: ltp.Trajectory, name: str) -> np.ndarray:
    """Phases of the events of one name after settling, s after the start of their period."""
    late = np.array([event.time for event in run.events if event.name == name and event.time > SETTLE * PERIOD])
    return late % PERIOD


@pytest.fixture(scope="module")
def nominal() -> ltp.Model:
    return ltp.zoo.load("hopper")


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_where_nothing_is_planted_nothing_is_claimed(nominal: ltp.Model, seed: int) -> None:
    recording, _ = hop(nominal, seed)
    found = ltp.harmonic_map(nominal, recording)
    assert not found.differs, found.sentence
    assert 0.5 < found.mean_square < 1.5
    assert "within their noise" in found.sentence
    assert found.method == "lines"
    for event in found.events:
        assert abs(event.residual_s) < 4 * event.sd_s
        assert event.sd_s < 1e-4


@pytest.mark.parametrize("change", ["friction", "stiffness"])
def test_planted_physics_stands_out(nominal: ltp.Model, change: str) -> None:
    if change == "friction":
        truth = nominal.attach("viscous_friction", "leg", {"damping": 0.6})
    else:
        truth = nominal.with_parameters({"k": 6500.0 * 1.02})
    recording, run = hop(truth, 4)
    found = ltp.harmonic_map(nominal, recording)
    assert found.differs, found.sentence
    assert found.mean_square > 5
    assert "differ from the model's" in found.sentence
    assert found.z.shape == (1, 1, 7, len(found.omega))
    # The times of events are those at which they happened.
    _, planned = hop(nominal, 4)
    for event in found.events:
        true = np.mean(times(run, event.name)) - np.mean(times(planned, event.name))
        assert abs(event.residual_s - true) < 5 * event.sd_s + 0.1 * abs(true), (event, true)
    assert any(abs(event.residual_s) > 4 * event.sd_s for event in found.events)
    assert "early" in found.sentence or "late" in found.sentence
    assert found.plot().axes


def test_a_model_without_a_clock_is_refused() -> None:
    model = ltp.zoo.load("drive")
    run = ltp.simulate(model, {"tau": "40*sin(3*t)"}, t_end=4.0, dt=0.01)
    recording = ltp.Recording(run.t, {"tau": run.inputs[:, 0]}, {"q": run.outputs[:, 0]}, name="drive")
    with pytest.raises(ltp.InputError, match="no \\[clock\\]"):
        ltp.harmonic_map(model, recording)


def test_a_machine_that_is_not_probed_is_refused(nominal: ltp.Model) -> None:
    recording, _ = hop(nominal, 1)
    still = ltp.Recording(
        recording.t, {"u_c": np.zeros(len(recording.t))}, {"h": recording.outputs[:, 0]}, name="still"
    )
    with pytest.raises(ltp.InputError, match="multisine"):
        ltp.harmonic_map(nominal, still)


class TestDiagnosis:
    """A diagnosis of a machine with a clock gives the map of the refitted model, where the recordings give one."""

    @pytest.fixture(scope="class")
    def stiff(self, nominal: ltp.Model) -> ltp.Diagnosis:
        """Of a leg that hardens, which the model does not know; its parameters make up for most of it, not for all."""
        truth = nominal.attach("cubic_stiffness", "leg", {"cubic_stiffness": 3e6})
        train, test = (hop(truth, seed, samples=66, cycles=12)[0] for seed in (4, 5))
        return ltp.diagnose(nominal, train, test, candidates=["cubic_stiffness"])

    def test_what_the_refit_cannot_make_up_for_stands_out_and_is_gone_with_the_effect(
        self, stiff: ltp.Diagnosis
    ) -> None:
        assert [(effect.name, effect.at) for effect in stiff.effects] == [("cubic_stiffness", "leg")]
        found, after = stiff.harmonic, stiff.harmonic_after
        assert found is not None
        assert after is not None
        assert found.differs, found.sentence
        assert found.mean_square > 20
        assert after < 1.5
        assert found.events == stiff.events
        assert isinstance(stiff.location, ltp.Location)
        assert "the harmonic map stands above noise, most at harmonic" in stiff.location.sentence

    def test_the_map_is_drawn_in_the_report(self, stiff: ltp.Diagnosis, tmp_path: Path) -> None:
        page = stiff.report(tmp_path / "report.html").read_text(encoding="utf-8")
        assert "Harmonic by harmonic" in page
        assert "input frequency (Hz), line by line" in page
        assert "data:image" not in page, "cells are paths, so that they follow the page into the dark"

    def test_it_survives_a_results_folder(self, stiff: ltp.Diagnosis, tmp_path: Path) -> None:
        store = Store(tmp_path)
        store.save("leg", "fingerprint", stiff, 1.0)
        loaded = store.load("leg", "fingerprint")
        assert loaded is not None
        again, map_again = loaded[0], loaded[0].harmonic
        assert map_again is not None
        assert stiff.harmonic is not None
        np.testing.assert_array_equal(map_again.z, stiff.harmonic.z)
        assert json.loads(map_again.to_json()) == json.loads(stiff.to_json())["harmonic"]
        assert again.harmonic_after == stiff.harmonic_after

    def test_a_machine_that_is_its_model_shows_none(self, nominal: ltp.Model) -> None:
        train, test = (hop(nominal, seed, samples=66, cycles=12)[0] for seed in (6, 7))
        clean = ltp.diagnose(nominal, train, test, candidates=["cubic_stiffness"])
        assert clean.verdict == "consistent"
        assert clean.harmonic is not None
        assert not clean.harmonic.differs, clean.harmonic.sentence
        assert clean.harmonic_after is None

    @pytest.mark.filterwarnings("ignore::UserWarning")
    def test_lines_on_half_the_clock_mix_the_harmonics(self) -> None:
        # The input of this drawn case repeats every other period of the clock: harmonic k of one line falls where k + 1
        # of another's image does, and no estimate can part them. Nothing is better than a guess.
        case = draw("duffing", "buried", 10**15 + 9_100_000)
        found = ltp.diagnose(case.model, case.train, case.test, candidates=["constant_force"])
        assert (found.harmonic, found.harmonic_after) == (None, None)
        assert not any("harmonic map" in text for text in found.warnings), "nobody asked for one"

    def test_without_a_clock_there_is_none(self) -> None:
        case = conceal(effect="coulomb_friction", port="cart", duration=4.0, seed=3)
        found = ltp.diagnose(case.model, case.train, case.test, candidates=["coulomb_friction"])
        assert found.effects
        assert (found.harmonic, found.harmonic_after) == (None, None)
        assert json.loads(found.to_json())["harmonic"] is None
