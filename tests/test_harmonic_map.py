"""Owns the tests of the harmonic map on the hopper: planted physics stands out; without it nothing is claimed."""

from __future__ import annotations

import math

import numpy as np
import pytest

import ltp

PERIOD = 2 * math.pi / 19.039955476301776
SAMPLES = 132  # in one period
CYCLES, REPEATS, SETTLE = 24, 4, 60
NOISE = 2e-5


def hop(truth: ltp.Model, seed: int) -> tuple[ltp.Recording, ltp.Trajectory]:
    """The hopper on its orbit under a small multisine, only `h` measured; the run as well, for its events."""
    wave = ltp.signals.multisine(PERIOD, (2.0, 30.0), CYCLES, rms=0.5, seed=seed)
    dt = PERIOD / SAMPLES
    n = (SETTLE + CYCLES * REPEATS) * SAMPLES
    run = ltp.simulate(truth, {"u_c": wave.samples(t_end=n * dt, dt=dt)[: n + 1]}, t_end=n * dt, dt=dt, strict=True)
    keep = slice(SETTLE * SAMPLES, n)
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
