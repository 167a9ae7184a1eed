"""Owns the tests of unclocked recordings: planted walkers whose truth is known, and the walking Compass-Gait robot.

The robot's recording is public but not ours to commit; it is looked for as in test_real_recordings.
"""

from __future__ import annotations

import os
import warnings
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

import ltp

DATA = Path(os.environ.get("LTP_DATA") or Path(__file__).parents[2] / "shared" / "data")
DT = 0.01

Array = npt.NDArray[np.float64]


class Walker:
    """Runs of cycles of two steps, each of 46 to 54 samples, 50 in the median; the contact is 1 in the first of them.

    `phase` is linear between switches; `elapsed` counts the time since the last one, as a machine may.
    """

    def __init__(self, runs: int, cycles: int, seed: int = 0) -> None:
        rng = np.random.default_rng(seed)
        steps = [rng.integers(46, 55) for _ in range(2 * runs * cycles + 2)]
        part = [1, *([0, 1] * (runs * cycles)), 0]
        self.contact = np.repeat(1.0 - np.array(part), steps)
        self.cycle = np.repeat([-1, *np.repeat(np.arange(runs * cycles), 2), runs * cycles], steps)
        along = np.concatenate([(np.arange(n) + 0.5) / n for n in steps])
        since = np.concatenate([np.minimum((np.arange(n) + 0.5) / 50, 1.0) for n in steps])
        self.phase, self.elapsed = (0.5 * (np.repeat(part, steps) + share) for share in (along, since))
        self.t = np.arange(len(along)) * DT
        begins = np.searchsorted(self.cycle, cycles * np.arange(1, runs))
        self.joins = (begins - 0.5) * DT

    def recording(self, u: Array | None = None, **outputs: Array) -> ltp.Recording:
        inputs = {"contact": self.contact} | ({} if u is None else {"u": u})
        return ltp.Recording(self.t, inputs, outputs, name="walker")


def section_walker(walker: Walker, matrix: Array, rng: np.random.Generator, apart: Array | None = None) -> Array:
    """Deviations z[n+1] = matrix z[n] + e, constant over each cycle, on an orbit; (n, d)."""
    count = walker.cycle.max() + 1
    z = np.zeros((count, len(matrix)))
    for n in range(1, count):
        z[n] = matrix @ z[n - 1] + rng.standard_normal(len(matrix))
    if apart is not None:
        z[:-1] += apart
    return np.sin(2 * np.pi * walker.phase)[:, None] + z[walker.cycle]


def test_phase_is_that_of_the_events() -> None:
    walker = Walker(3, 6)
    walk = walker.recording(y=np.cos(2 * np.pi * walker.phase))
    phase = ltp.phase_from_events(walk, "contact", joins=walker.joins)
    assert [cycle.run for cycle in phase.cycles] == [0] * 6 + [1] * 6 + [2] * 6
    assert all(cycle.trouble is None for cycle in phase.cycles)
    found = phase.at(walker.t)
    inside = (walker.cycle >= 0) & (walker.cycle < 18)
    assert np.array_equal(np.isnan(found), ~inside)
    mark = phase.marks[1]
    planted = np.interp(walker.phase, [0, 0.5, 1], [0, mark, 1])
    assert np.abs(found - planted)[inside].max() < 1e-9
    times, kinds = ltp.switch_times(walk, "contact")
    given = ltp.phase_from_events(walk, times=times, kinds=kinds.tolist(), start=0, joins=walker.joins)
    assert given == phase


def test_a_join_inside_a_cycle_is_no_motion_and_is_warned_of() -> None:
    walker = Walker(1, 8)
    walk = walker.recording(y=np.cos(2 * np.pi * walker.phase))
    join = walker.t[np.flatnonzero(walker.cycle == 3)[20]]
    with pytest.warns(UserWarning, match="1 of 8 cycles are left out: 1 across a join"):
        phase = ltp.phase_from_events(walk, "contact", joins=[join])
    assert [cycle.trouble for cycle in phase.cycles] == [None] * 3 + ["join"] + [None] * 4
    assert np.isnan(phase.at([join + DT])).all()


def test_the_mean_cycle_keeps_its_jump() -> None:
    walker = Walker(4, 10, 1)

    def motion(phase: Array) -> Array:
        return np.asarray(np.sin(2 * np.pi * phase) + np.where(phase < 0.5, 1.0, -2.0))

    walk = walker.recording(y=motion(walker.phase))
    phase = ltp.phase_from_events(walk, "contact", joins=walker.joins)
    orbit = ltp.cycle_average(walk, phase, points=50)
    assert (orbit.channels, orbit.cycles, orbit.mean.shape) == (("y",), 40, (50, 1))
    planted = np.interp(orbit.phase, [0, phase.marks[1], 1], [0, 0.5, 1])
    # Linear between samples 0.011 of a cycle apart: (2 pi 0.011)^2 / 8, and the same beyond the first and last sample.
    assert np.abs(orbit.mean[:, 0] - motion(planted)).max() < 2e-3
    assert orbit.standard_error.max() < 1e-3


def test_planted_multipliers_are_covered_and_claimed() -> None:
    matrix = np.array([[0.5, 0.3], [0.6, -0.2]])  # eigenvalues 0.7 and -0.4
    inside, claims = 0, []
    for seed in range(20):
        walker = Walker(1, 150, seed)
        z = section_walker(walker, matrix, np.random.default_rng(seed))
        walk = walker.recording(a=z[:, 0], b=z[:, 1])
        phase = ltp.phase_from_events(walk, "contact")
        found = ltp.identify_map(walk, phase, at=0.25, coordinates=["a", "b"], draws=300, seed=seed)
        inside += sum(low < truth < high for truth, (low, high) in zip((0.7, 0.4), found.magnitude, strict=True))
        claims.append(found.claims)
        assert found.states.shape == (150, 2)
    assert inside >= 40 - 3 * 2, "95 % of 40 are 38, with a standard deviation of 1.4"
    assert all(claims)


def test_nothing_planted_nothing_claimed() -> None:
    claims = []
    for seed in range(20):
        walker = Walker(1, 60, seed)
        z = section_walker(walker, np.zeros((1, 1)), np.random.default_rng(seed))
        walk = walker.recording(a=z[:, 0])
        phase = ltp.phase_from_events(walk, "contact")
        claims.append(ltp.identify_map(walk, phase, at=0.25, coordinates=["a"], draws=300).claims)
    assert sum(claims) <= 1


def test_runs_that_differ_do_not_pass_for_slow_decay() -> None:
    walker = Walker(12, 5, 3)
    rng = np.random.default_rng(3)
    apart = np.repeat(5 * rng.standard_normal((12, 1)), 5, axis=0)
    z = section_walker(walker, np.array([[0.3]]), rng, apart)
    walk = walker.recording(a=z[:, 0])
    phase = ltp.phase_from_events(walk, "contact", joins=walker.joins)
    with pytest.warns(UserWarning, match="push multipliers towards one"):
        common = ltp.identify_map(walk, phase, at=0.25, coordinates=["a"])
    assert common.multipliers[0].real > 0.8
    assert not common.claims
    with pytest.warns(UserWarning, match="Nickell"):
        own = ltp.identify_map(walk, phase, at=0.25, coordinates=["a"], per_run=True)
    assert own.multipliers[0].real < 0.5


def arx_walker(walker: Walker, depth: float, seed: int) -> tuple[ltp.Recording, ltp.Phase]:
    """y = c + 1.5 y- - 0.7 y-- + b(phase) u- + e under feedback; b varies by `depth` over the cycle."""
    rng = np.random.default_rng(seed)
    y, u = np.zeros_like(walker.t), np.zeros_like(walker.t)
    gain = 0.1 * (1 + depth * np.sin(2 * np.pi * walker.elapsed))
    for i in range(2, len(y)):
        orbit = np.cos(2 * np.pi * walker.elapsed[i])
        y[i] = orbit + 1.5 * y[i - 1] - 0.7 * y[i - 2] + gain[i] * u[i - 1] + 0.02 * rng.standard_normal()
        u[i] = rng.standard_normal() - 0.2 * y[i]
    walk = walker.recording(u, y=y)
    return walk, ltp.phase_from_events(walk, "contact", joins=walker.joins)


def test_a_periodic_gain_is_found_under_feedback_and_confirmed_on_held_out_runs() -> None:
    walk, phase = arx_walker(Walker(12, 5, 5), 0.8, 6)
    model = ltp.identify_arx(walk, phase, inputs=["u"], lags=(2, 1), harmonics=1)
    assert (model.inputs, model.outputs, model.unknowns, model.groups) == (("u",), ("y",), 17 + 9, 12)
    # One sample after the step the answer is the gain itself: 0.1 (1 + 0.8 sin).
    for place, gain in ((0.25, 0.18), (0.75, 0.02)):
        step = model.step_response("u", phase=place, duration=0.05)
        assert step.t == pytest.approx(DT * np.arange(6))
        assert abs(step.values[1, 0] - gain) < 3 * step.sd[1, 0] < 0.02
    score = model.held_out(walk, phase)
    constant = ltp.identify_arx(walk, phase, inputs=["u"], lags=(2, 1), harmonics=0).held_out(walk, phase)
    (ratio,) = score.ratio(constant)
    assert ratio.low < ratio.value < ratio.high < 1
    assert score.ratio("orbit")[0].high < 1
    assert score.by_group.shape == (12, 1)
    assert score.rms[0] == pytest.approx(np.sqrt(np.mean(score.by_group**2)))
    assert np.nanmax(np.abs(model.predict(walk, phase) - score.prediction)) < 1.0
    again = ltp.identify_arx(walk, phase, inputs=["u"], lags=(2, 1), harmonics=1)
    assert np.array_equal(
        again.step_response("u", phase=0.1, duration=0.1).sd, model.step_response("u", phase=0.1, duration=0.1).sd
    )


def test_a_constant_gain_is_not_called_periodic() -> None:
    claims = 0
    for seed in range(10):
        walk, phase = arx_walker(Walker(12, 5, seed), 0.0, seed)
        scores = [
            ltp.identify_arx(walk, phase, inputs=["u"], lags=(2, 1), harmonics=k, draws=0).held_out(walk, phase)
            for k in (1, 0)
        ]
        claims += scores[0].ratio(scores[1])[0].high < 1
    assert claims <= 1


def test_bad_input_says_what_is_wrong() -> None:
    walker = Walker(1, 6)
    walk = walker.recording(y=np.cos(2 * np.pi * walker.phase))
    phase = ltp.phase_from_events(walk, "contact")
    with pytest.raises(ltp.InputError, match="did you mean `contact`"):
        ltp.phase_from_events(walk, "contakt")
    with pytest.raises(ltp.InputError, match="found neither of `channel` and `times`"):
        ltp.phase_from_events(walk)
    with pytest.raises(ltp.InputError, match='expected "rising", "falling" or a kind'):
        ltp.phase_from_events(walk, "contact", start="up")
    with pytest.raises(ltp.InputError, match="at least 3 are needed"):
        ltp.phase_from_events(walk, times=[0.5, 1.5])
    with pytest.raises(ltp.InputError, match="no channel `z`"):
        ltp.cycle_average(walk, phase, ["z"])
    with pytest.raises(ltp.InputError, match="no channel `z`"):
        ltp.identify_map(walk, phase, at=0.1, coordinates=["d(z)"])
    with pytest.raises(ltp.InputError, match="fewer harmonics or lags"):
        ltp.identify_arx(walk, phase, inputs=["contact"], harmonics=50)
    with pytest.raises(ltp.ConvergenceError, match="cannot be told apart"):
        ltp.identify_arx(walk, phase, inputs=["contact"] * 2, harmonics=0)
    walk, phase = arx_walker(Walker(12, 5), 0.5, 1)
    score = ltp.identify_arx(walk, phase, inputs=["u"], draws=0).held_out(walk, phase)
    with pytest.raises(ltp.InputError, match="rival is mean"):
        score.ratio("mean")


def walking_robot() -> tuple[ltp.Recording, ltp.Phase]:
    """The walk with its hip angle in rad; the test is skipped without the file."""
    path = DATA / "sydney_compass_gait" / "SysID_data_12exp_120steps.mat"
    if not path.is_file():
        pytest.skip(f"no recording {path}; docs/recordings says where it comes from, LTP_DATA where it is")
    io = pytest.importorskip("scipy.io")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a MATLAB object in the file
        data = io.loadmat(path)
    column = {name: data[name].ravel().astype(float) for name in ("datatime", "hipangle", "umaxonsatu", "innoutst")}
    inputs = {"motor": column["umaxonsatu"], "outer_stance": column["innoutst"]}
    walk = ltp.Recording(column["datatime"], inputs, {"hip": np.deg2rad(column["hipangle"])})
    switches, _ = ltp.switch_times(walk, "outer_stance")
    assert len(switches) == 119
    return walk, ltp.phase_from_events(walk, "outer_stance", joins=switches[9::10])


def test_the_walking_robot_answers_its_motor_periodically() -> None:
    walk, phase = walking_robot()
    assert len(phase.cycles) == 58
    assert {cycle.run for cycle in phase.cycles} == set(range(12))
    assert phase.period == pytest.approx(1.135, abs=0.005)
    orbit = ltp.cycle_average(walk, phase)
    assert orbit.groups == 12
    # The runs differ more than the strides of a run do.
    assert (orbit.within < orbit.spread).all()
    orders = {"inputs": ["motor"], "lags": (3, 3), "spacing": 6, "offset": 10}
    model = ltp.identify_arx(walk, phase, harmonics=2, **orders)  # type: ignore[arg-type]
    score = model.held_out(walk, phase)
    constant = ltp.identify_arx(walk, phase, harmonics=0, **orders).held_out(walk, phase)  # type: ignore[arg-type]
    assert np.rad2deg(score.rms[0]) < 0.9 < 1.0 < np.rad2deg(constant.rms[0])
    for rival in (constant, "orbit", "previous"):
        assert score.ratio(rival)[0].high < 1
    # The free leg of experiment 1 moves by 1.58 degrees in 0.12 s after 1 V: the size is right, and it varies.
    steps = [model.step_response("motor", phase=p, duration=0.12) for p in (0.05, 0.35, 0.6)]
    moved = np.rad2deg([step.values[-1, 0] for step in steps])
    assert (moved > 0.6 * 1.58).all()
    assert (moved < 1.4 * 1.58).all()
    assert moved[0] - moved[1] > 1.96 * np.rad2deg(np.hypot(steps[0].sd[-1, 0], steps[1].sd[-1, 0]))


@pytest.mark.filterwarnings("ignore:.*intercept:UserWarning")
@pytest.mark.parametrize("per_run", [False, True])
def test_the_walking_robot_gives_no_multipliers(per_run: bool) -> None:
    walk, phase = walking_robot()
    for at in (0.1, 0.2, 0.3, 0.4, 0.6, 0.7, 0.8, 0.9):
        for coordinates in (["hip"], ["hip", "d(hip)"]):
            found = ltp.identify_map(walk, phase, at=at, coordinates=coordinates, per_run=per_run)
            assert not found.claims
