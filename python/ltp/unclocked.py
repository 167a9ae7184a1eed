"""Owns what is read from unclocked rhythmic recordings: phase from events, the cycle average, the periodic ARX model
and the section map, each with its uncertainty and its score on cycles it did not see.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from ltp import _ltp
from ltp._ltp import InputError
from ltp.recording import Recording

Array = npt.NDArray[np.float64]

#: Kinds of the passages of a switch through its level.
_EDGES = {"rising": 0, "falling": 1}


@dataclass(frozen=True)
class Cycle:
    """One cycle: `times` of its start, of the events inside and of its end, s; `run` counts the joins before it.

    `trouble` says why it is used for nothing: "join", "events" (missing or doubled), "gap", "duration"; None if good.
    """

    times: tuple[float, ...]
    run: int
    trouble: str | None


@dataclass(frozen=True)
class Phase:
    """The phase of an unclocked recording.

    `period` is the median duration of the good cycles, s; `marks` are the phases of the events of a cycle, from 0 to 1;
    `warnings` says what was left out.
    """

    cycles: list[Cycle]
    period: float
    marks: tuple[float, ...]
    warnings: list[str]
    _core: _ltp.Phase = field(repr=False, compare=False)

    def at(self, t: npt.ArrayLike) -> Array:
        """Phase in [0, 1) at times (n,), s: linear between events; NaN outside the good cycles."""
        return self._core.at(np.ascontiguousarray(t, dtype=np.float64))


@dataclass(frozen=True)
class CycleAverage:
    """The mean cycle of `channels` at `phase` (m,); arrays are (m, channels).

    `spread` is the standard deviation of single cycles around `mean`, `within` that around the mean of their own run,
    and `standard_error` that of the mean itself, counted by `groups` (runs, or stretches of one), not by `cycles`.
    """

    channels: tuple[str, ...]
    phase: Array
    mean: Array
    spread: Array
    within: Array
    standard_error: Array
    cycles: int
    groups: int


@dataclass(frozen=True)
class Ratio:
    """How many times larger the model's rms error is than its rival's, with a 95 % interval over groups of cycles."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class HeldOut:
    """What a periodic ARX model predicts of groups of cycles that it did not see.

    `prediction` (n, ny) are free runs from the first samples of each segment, NaN where nothing is predicted. `rms`,
    `orbit_rms` and `previous_rms` (ny,) are the errors of the model, of the mean orbit of the other groups, and of the
    cycle before; `by_group`, `orbit_by_group` and `previous_by_group` (groups, ny) are the same group by group.
    """

    prediction: Array
    rms: Array
    orbit_rms: Array
    previous_rms: Array
    by_group: Array
    orbit_by_group: Array
    previous_by_group: Array
    _core: _ltp.HeldOut = field(repr=False, compare=False)

    def ratio(self, rival: str | HeldOut, *, draws: int = 2000, seed: int = 0) -> list[Ratio]:
        """rms over that of a rival, for each output: "orbit", "previous", or another score on the same cycles.

        An interval below 1 says that the model predicts what it did not see better than the rival does. Raises
        `InputError` for a rival that was scored on other segments.
        """
        other = rival._core if isinstance(rival, HeldOut) else rival
        return [Ratio(*entry) for entry in self._core.ratio(other, draws=draws, seed=seed)]


@dataclass(frozen=True)
class StepResponse:
    """Deviations from the orbit after a unit step of an input: `values` (m, ny), `sd` (m, ny), times `t` (m,) in s."""

    t: Array
    values: Array
    sd: Array


@dataclass(frozen=True)
class PeriodicArx:
    """A discrete linear time-periodic model whose coefficients are Fourier series in phase.

    `noise_sd` (ny,) is the standard deviation of the one-step errors; `rows` were fitted for `unknowns` per output;
    `groups` of cycles were drawn for the uncertainty.
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    noise_sd: Array
    rows: int
    unknowns: int
    groups: int
    warnings: list[str]
    _core: _ltp.PeriodicArx = field(repr=False, compare=False)

    def predict(self, recording: Recording, phase: Phase) -> Array:
        """Free run (n, ny) through the good segments, driven by the measured inputs; NaN in their first samples."""
        return self._core.predict(recording._core, phase._core)

    def step_response(self, input: str, *, phase: float, duration: float) -> StepResponse:
        """The outputs after a unit step of `input` at `phase`, for at most `duration` s and up to the next event."""
        step = self._core.step_response(input, phase, duration)
        return StepResponse(step["t"], step["values"], step["sd"])

    def held_out(self, recording: Recording, phase: Phase) -> HeldOut:
        """The score of a model of the same orders, fitted anew with one group of cycles after the other left out."""
        core = self._core.held_out(recording._core, phase._core)
        rms, orbit, previous = (np.array(errors) for errors in core.rms)
        groups = [np.array(errors).T for errors in core.rms_by_group]
        return HeldOut(core.prediction, rms, orbit, previous, groups[0], groups[1], groups[2], core)


@dataclass(frozen=True)
class SectionMap:
    """The map of the state at one phase to the state one cycle later: `z[n+1] = c + matrix z[n]`.

    `states` (cycles, d), NaN for bad cycles; `matrix` (d, d) with `matrix_sd`; `multipliers` (d,), largest first, and
    the 95 % interval of the magnitude of each, (d, 2), from `groups` of the `pairs`. `claims` is whether held-out
    predictions beat both the mean and the cycle before with 95 % confidence; without it the multipliers describe
    nothing that was shown.
    """

    states: Array
    matrix: Array
    matrix_sd: Array
    multipliers: npt.NDArray[np.complex128]
    magnitude: Array
    pairs: int
    groups: int
    against_mean: Ratio
    against_previous: Ratio
    claims: bool
    warnings: list[str]


def phase_from_events(
    recording: Recording,
    channel: str | None = None,
    *,
    times: npt.ArrayLike | None = None,
    kinds: Sequence[int] | None = None,
    level: float | None = None,
    start: int | str = "rising",
    joins: npt.ArrayLike = (),
    tolerance: float = 0.25,
) -> Phase:
    """Phase of an unclocked recording: 0 at each event that starts a cycle, linear in time between events.

    channel: an input or output whose passages through `level` (by default the middle of its range) are the events, a
        contact switch for example; or else `times` (s) of events, with the `kinds` of each (by default all 0).
    start: the events that start a cycle, "rising" or "falling" for a channel, a kind for given times.
    joins: times (s) where one run ends and another begins; no motion passes through them.
    tolerance: how far the logarithm of a cycle's duration may be from that of the median of its run.

    Cycles across a join, with events missing, with gaps or of unusual duration stay in `cycles` with their trouble and
    are used for nothing; a warning counts them. Raises `InputError` when fewer than three good cycles are left.
    """
    if (channel is None) == (times is None):
        given = "neither" if channel is None else "both"
        raise InputError(
            f"phase_from_events: found {given} of `channel` and `times`, expected one; say where events are"
        )
    if channel is not None:
        times, kinds = _ltp.switch_events(recording._core, channel, level)
    when = np.ascontiguousarray([] if times is None else times, dtype=np.float64)
    core = _ltp.phase_from_events(
        recording._core,
        when,
        [0] * len(when) if kinds is None else list(kinds),
        start=_kind(start),
        joins=np.asarray(joins, dtype=np.float64).tolist(),
        tolerance=tolerance,
    )
    for text in core.warnings:
        warnings.warn(f"{recording.name}: {text}", stacklevel=2)
    cycles = [Cycle(tuple(times), run, trouble) for times, run, trouble in core.cycles]
    return Phase(cycles, core.period, tuple(core.marks), core.warnings, core)


def switch_times(
    recording: Recording, channel: str, *, level: float | None = None
) -> tuple[Array, npt.NDArray[np.int64]]:
    """Times (s) at which `channel` passes through `level`, and their kinds: 0 rising, 1 falling."""
    times, kinds = _ltp.switch_events(recording._core, channel, level)
    return times, np.array(kinds, dtype=np.int64)


def cycle_average(
    recording: Recording, phase: Phase, channels: Sequence[str] | None = None, *, points: int = 100
) -> CycleAverage:
    """The mean cycle of `channels` (by default all outputs) at `points` phases, with the spread of cycles.

    No value is carried across an event, where velocities jump. Raises `InputError` for an unknown channel.
    """
    names = list(recording.output_names if channels is None else channels)
    found = _ltp.cycle_average(recording._core, phase._core, names, points)
    return CycleAverage(channels=tuple(names), **found)


def identify_arx(
    recording: Recording,
    phase: Phase,
    *,
    inputs: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
    lags: tuple[int, int] = (3, 3),
    spacing: int = 1,
    harmonics: int = 2,
    offset: int = 8,
    draws: int = 200,
    seed: int = 0,
) -> PeriodicArx:
    """A discrete linear time-periodic model from inputs to outputs, by least squares in the segments between events.

    inputs, outputs: channels that drive and that answer, by default those of the recording.
    lags: of outputs and of inputs, counted in steps of `spacing` samples.
    harmonics: of the coefficients over phase; 0 makes a time-invariant model around the orbit.
    offset: harmonics of the offset, which carries the orbit; with too few the coefficients vary to make up for them.
    draws, seed: of the bootstrap over groups of cycles behind every standard deviation.

    Judge it with `held_out` before believing it. Raises `InputError` when the data are too few for the unknowns,
    `ConvergenceError` when the inputs cannot be told apart from the motion.
    """
    drive = list(recording.input_names if inputs is None else inputs)
    answer = list(recording.output_names if outputs is None else outputs)
    core = _ltp.identify_arx(
        recording._core,
        phase._core,
        drive,
        answer,
        lags=lags,
        spacing=spacing,
        harmonics=harmonics,
        offset=offset,
        draws=draws,
        seed=seed,
    )
    _warn(recording, core.warnings)
    rows, unknowns = core.size
    return PeriodicArx(
        tuple(drive), tuple(answer), np.array(core.noise_sd), rows, unknowns, core.groups, core.warnings, core
    )


def identify_map(
    recording: Recording,
    phase: Phase,
    *,
    at: float,
    coordinates: Sequence[str],
    window: int = 5,
    per_run: bool = False,
    draws: int = 1000,
    seed: int = 0,
) -> SectionMap:
    """The section map at phase `at`, its multipliers with bands, and whether it predicts anything held out.

    coordinates: channels, or `"d(channel)"` for a rate of change, by a parabola over `window` samples on each side.
    per_run: an intercept for each run; see the warnings for what short runs do to either choice.

    Raises `InputError` when there are too few neighbouring cycles, `ConvergenceError` when coordinates depend on each
    other.
    """
    parsed = [
        (name[2:-1], True) if name.startswith("d(") and name.endswith(")") else (name, False) for name in coordinates
    ]
    found = _ltp.identify_map(
        recording._core, phase._core, at, parsed, window=window, per_run=per_run, draws=draws, seed=seed
    )
    _warn(recording, found["warnings"])
    return SectionMap(
        states=found["states"],
        matrix=found["matrix"],
        matrix_sd=found["matrix_sd"],
        multipliers=found["multipliers"],
        magnitude=np.array(found["magnitude"]),
        pairs=found["pairs"],
        groups=found["groups"],
        against_mean=Ratio(*found["against_mean"]),
        against_previous=Ratio(*found["against_previous"]),
        claims=found["claims"],
        warnings=found["warnings"],
    )


def _kind(start: int | str) -> int:
    """The kind of the events that start a cycle."""
    if not isinstance(start, str):
        return start
    if start not in _EDGES:
        raise InputError(f'phase_from_events: start is {start!r}, expected "rising", "falling" or a kind; correct it')
    return _EDGES[start]


def _warn(recording: Recording, texts: Sequence[str]) -> None:
    for text in texts:
        warnings.warn(f"{recording.name}: {text}", stacklevel=3)
