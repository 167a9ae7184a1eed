"""Owns the tests of `ltp.close`, `certify`, `track` and `simulation_cost`: figures of the thesis, bad input."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

import ltp

DOWN, UP = 2 * math.pi, 10 * math.pi
T43 = [397.1, 216.2, 47.5, -17.6]
T44 = [4.36, 4.99, -8.86, 4.87]
OFF = {"x": 0.02, "theta": 0.2}


@pytest.fixture(scope="module")
def hanging() -> ltp.Model:
    return ltp.zoo.cart_pendulum()


@pytest.fixture(scope="module")
def inverted(hanging: ltp.Model) -> ltp.Model:
    return hanging.with_parameters(K_s=0.74)


@pytest.fixture(scope="module")
def down(hanging: ltp.Model) -> ltp.Reference:
    return ltp.Reference.sinusoids(hanging, DOWN, {"x": 0.05, "theta": (-0.2472, 0.6809)})


@pytest.fixture(scope="module")
def up(inverted: ltp.Model) -> ltp.Reference:
    return ltp.Reference.sinusoids(inverted, UP, {"x": (0.03752, -0.0769), "theta": (0.1, 0, math.pi)})


@pytest.fixture(scope="module")
def true_up(inverted: ltp.Model) -> ltp.Reference:
    return ltp.feedforward(inverted, "theta", amplitude=0.1, offset=math.pi, omega=UP)


def test_downward_loop(hanging: ltp.Model, down: ltp.Reference) -> None:
    found = ltp.certify(hanging, down, [69.69, -2.01, 19.62, 6.54], deviations=OFF, horizon=10)
    (run,) = found.runs
    assert found.verdict == "stable", found.sentence
    assert found.slowest == pytest.approx(-7.595, abs=1e-3)
    assert run.settled["x"] == pytest.approx(1.19, abs=0.011)
    assert run.settled["theta"] == pytest.approx(1.08, abs=0.011)
    assert run.returns and run.ended is None and run.tolerated is not None and run.tolerated > 1
    assert [lifted.truncation for lifted in found.lifted] == [5, 10]
    assert found.worst is None and found.worst_error == {}


@pytest.mark.parametrize(("gain", "along", "around"), [(T43, -0.3906, -0.226), (T44, -0.4039, -0.192)])
def test_failing_gains(inverted: ltp.Model, up: ltp.Reference, gain: list[float], along: float, around: float) -> None:
    found = ltp.certify(inverted, up, gain, deviations={"x": 0.01, "theta": 0.05})
    assert found.orbit is not None
    assert found.slowest == pytest.approx(along, abs=6e-4)
    assert found.orbit.slowest == pytest.approx(around, abs=3e-3)
    assert any("not an orbit" in reason for reason in found.reasons)
    assert any("transient growth" in reason for reason in found.reasons)
    assert found.runs[0].returns


def test_true_orbit_and_spread(inverted: ltp.Model, true_up: ltp.Reference) -> None:
    found = ltp.certify(inverted, true_up, T43, spread={"l_p": 0.01})
    assert found.slowest == pytest.approx(-0.0220, abs=6e-5)
    assert found.lifted[0].all == pytest.approx(-0.0130, abs=6e-5)
    assert found.orbit is not None and max(found.orbit.error.values()) < 1e-6
    assert found.verdict == "disagree" and "not robust" in found.sentence
    assert len(found.cases) == 3 and found.worst is not None
    assert found.worst.changes["l_p"] == pytest.approx(0.01)
    assert found.worst.slowest is not None and found.worst.slowest == pytest.approx(0.096, abs=1e-3)


def test_unstable(inverted: ltp.Model) -> None:
    beyond = ltp.feedforward(inverted, "theta", amplitude=0.105, offset=math.pi, omega=UP)
    for gain, slow in (([1000.5, 3.9, 5.4, -0.7], 0.219), ([1093.2, 4.3, 75.6, 2.5], 0.223)):
        found = ltp.certify(inverted, beyond, gain)
        assert found.verdict == "unstable", found.sentence
        assert found.slowest == pytest.approx(slow, abs=6e-4)
    assert np.nanmax(found.open.real) == pytest.approx(0.22, abs=1e-3)


def test_close_is_an_ordinary_model(hanging: ltp.Model, down: ltp.Reference) -> None:
    closed = ltp.close(hanging, down, {0: [[69.69, -2.01, 19.62, 6.54]], 2: np.zeros((1, 4))})
    assert closed.inputs == [] and closed.outputs[-1] == "input V"
    start = dict(zip(hanging.states, down.states(0.0)[0], strict=True))
    run = ltp.simulate(closed, t_end=3, dt=1e-2, initial_state=start)
    assert run.states[-1] == pytest.approx(down.states(run.t[-1])[0], abs=2e-3)


def test_track(hanging: ltp.Model, down: ltp.Reference) -> None:
    gain = [81.75, 6.71, 19.99, 7.11]
    wide = ltp.Reference.sinusoids(hanging, DOWN, {"x": 0.07, "theta": (-0.3387, 0.6691)}).with_inputs_of(down)
    found = ltp.track(hanging, [(down, gain, 10.0), (wide, gain, 20.0)])
    assert found.stages[1].steady["x"] == pytest.approx(0.0809, abs=1e-4)
    assert found.stages[1].steady["theta"] == pytest.approx(0.0859, abs=1e-4)
    gain = [70.24, -1.93, 19.79, 6.6]
    for phase, settled in ((math.pi / 4, 1.21), (math.pi / 2, 1.32), (math.pi, 1.29)):
        found = ltp.track(hanging, [(down, gain, 10.0), (down.ahead(phase=phase), gain, 20.0)])
        assert found.stages[1].settled["x"] == pytest.approx(settled, abs=0.011)
    gain = [70.29, -1.86, 19.78, 6.6]
    found = ltp.track(hanging, [(down, gain, 10.0), (down.shifted(x=-0.1), gain, 20.0)], deviation=OFF)
    assert found.stages[1].settled["x"] is not None and found.stages[1].steady["x"] < 0.01
    assert found.states.shape == found.references.shape == (len(found.t), 4)
    assert found.inputs.shape == (len(found.t), 1)


def test_simulation_cost(hanging: ltp.Model, down: ltp.Reference) -> None:
    weights = {"x": 5.0, "theta": 1.0}
    cost = ltp.simulation_cost(hanging, down, deviation=OFF, weights=weights, t_end=10, dt=2e-3)
    assert len(cost) == 4 and cost.shape == (1, 4)
    many = cost.many([[69.69, -2.01, 19.62, 6.54], [872.59, -8.88, 13.6, 1.2], [-1e6, 0, 0, 0]])
    assert many == pytest.approx([0.2292, 0.1446, math.inf], abs=1e-3)
    assert cost([[69.69, -2.01, 19.62, 6.54]]) == many[0]
    with pytest.raises(ltp.InputError, match="numbers in a gain"):
        cost([1.0, 2.0])


def test_design_by_simulation(hanging: ltp.Model, down: ltp.Reference) -> None:
    weights = {"x": 5.0, "theta": 1.0}
    cost = ltp.simulation_cost(hanging, down, deviation=OFF, weights=weights, t_end=10, dt=1e-2)
    found = cost.design(limit=1000, budget=600, seed=3)
    assert cost(found.gain) == pytest.approx(found.figures["cost"])
    # The last round is finished: one evaluation per particle beyond the budget at most.
    assert found.figures["cost"] < 0.2292 and found.figures["evaluations"] <= 610
    assert ltp.certify(hanging, down, found).verdict == "stable"
    again = cost.design(limit=1000, budget=600, seed=3)
    assert again.figures == found.figures
    with pytest.raises(ltp.InputError, match="limit"):
        cost.design(limit=-1)


def test_bad_input(inverted: ltp.Model, true_up: ltp.Reference, down: ltp.Reference) -> None:
    with pytest.raises(ltp.InputError, match=r"expected \(1, 4\)"):
        ltp.certify(inverted, true_up, [1.0, 2.0, 3.0])
    with pytest.raises(ltp.InputError, match="no state 'y'"):
        ltp.certify(inverted, true_up, T43, deviations={"y": 1.0})
    with pytest.raises(ltp.InputError, match="l_p"):
        ltp.certify(inverted, true_up, T43, spread={"l_q": 0.1})
    with pytest.raises(ltp.InputError, match="truncation"):
        ltp.certify(inverted, true_up, T43, truncation=0)
    with pytest.raises(ltp.InputError, match="harmonic -1"):
        ltp.close(inverted, true_up, {-1: T43})
    with pytest.raises(ltp.InputError, match="until"):
        ltp.track(inverted, [(true_up, T43, 1.0), (true_up, T43, 0.5)])
    with pytest.raises(ltp.InputError, match="stages"):
        ltp.track(inverted, [])
    with pytest.raises(ltp.InputError, match="finite"):
        ltp.close(inverted, true_up, [math.nan, 0, 0, 0])

    other = SimpleNamespace(period=0.3, harmonics={0: np.zeros((1, 4)), 2: np.ones((1, 4))})
    with pytest.raises(ltp.InputError, match="must be the same"):
        ltp.close(inverted, true_up, other)
