"""Owns `ltp.close`, `ltp.certify`, `ltp.track`, `ltp.simulation_cost` in Python, and the noun `Certificate`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from ltp import _ltp
from ltp._ltp import InputError
from ltp.feedback import Feedback, Gain, gain_coefficients
from ltp.feedforward import Reference
from ltp.model import Model

Array = npt.NDArray[np.float64]
Complexes = npt.NDArray[np.complex128]


@dataclass(frozen=True)
class Lifted:
    """Eigenvalues of the lift truncated at `truncation`: largest real part of `all`, and of the `central` ones, 1/s.

    Central are those nearest to the exact exponents; `distance` is how far they are from these, relative to the larger
    of exponent and pumping frequency. `all` includes the edge that the truncation cuts, and is biased by it.
    """

    truncation: int
    all: float
    central: float
    distance: float


@dataclass(frozen=True, eq=False)
class ClosedOrbit:
    """The periodic orbit that the nonlinear closed loop really has.

    `exponents` (nx,) in 1/s, largest real part first; `error` is per state the largest distance from the reference as a
    share of its amplitude; `coefficients` (K + 1, nx) are the Fourier coefficients of its states.
    """

    exponents: Complexes
    error: dict[str, float]
    coefficients: Complexes = field(repr=False)

    @property
    def slowest(self) -> float:
        """Largest real part, 1/s."""
        return float(np.nanmax(self.exponents.real))


@dataclass(frozen=True)
class Run:
    """The closed loop simulated from a deviation over `horizon` s.

    `settled`: per state the last time (s) its error exceeds 2 % of the reference's amplitude, None where it still does
    in the last period; `steady`: the largest error in the last period as a share of the amplitude; `feedback`: per
    input the largest `|K (z - z_ref)|`; `growth`: largest distance from the loop's orbit over the one at the start, in
    amplitudes; `returns`: whether it comes back to the orbit; `ended`: why the simulation ended early. `tolerated` is
    the largest multiple of the deviation that comes back (`at_least`: larger ones were not tried).
    """

    deviation: dict[str, float]
    horizon: float
    settled: dict[str, float | None]
    steady: dict[str, float]
    feedback: dict[str, float]
    growth: float
    returns: bool
    ended: str | None
    tolerated: float | None
    at_least: bool


@dataclass(frozen=True)
class Case:
    """Other parameters: relative `changes`, `slowest` exponent of the loop's orbit (None: no orbit found), `error`."""

    changes: dict[str, float]
    slowest: float | None
    error: dict[str, float]


@dataclass(frozen=True, eq=False)
class Certificate:
    """What every witness says of a closed loop, and the verdict: "stable", "neutral", "unstable" or "disagree".

    `sentence` says it with numbers, `reasons` what disagrees and why (reference is not an orbit, truncation, basin,
    transient growth, not robust). `open` and `exponents` (nx,) are the exact Floquet exponents along the reference
    without and with feedback, 1/s; `lifted` the truncated lifts at N and 2N; `orbit` that of the nonlinear loop, or
    None and `no_orbit` says why; `runs` one per deviation; `cases` all corners and middles of the parameters' ranges.
    """

    verdict: str
    sentence: str
    reasons: list[str]
    defect: dict[str, float]
    open: Complexes
    exponents: Complexes
    lifted: list[Lifted]
    orbit: ClosedOrbit | None
    no_orbit: str | None
    runs: list[Run]
    cases: list[Case]

    @property
    def slowest(self) -> float:
        """Largest real part of the exact exponents along the reference, 1/s."""
        return float(np.nanmax(self.exponents.real))

    @property
    def worst(self) -> Case | None:
        """The case with the largest real part; one without an orbit is worse than all. None without a spread."""
        if not self.cases:
            return None
        return max(self.cases, key=lambda case: np.inf if case.slowest is None else case.slowest)

    @property
    def worst_alone(self) -> Case | None:
        """As `worst`, with one parameter changed at a time."""
        alone = [case for case in self.cases if sum(change != 0 for change in case.changes.values()) <= 1]
        return max(alone, key=lambda case: np.inf if case.slowest is None else case.slowest, default=None)

    @property
    def worst_error(self) -> dict[str, float]:
        """Largest error of each state over all cases that have an orbit, as a share of the reference's amplitude."""
        errors = [case.error for case in self.cases if case.error]
        return {name: max(error[name] for error in errors) for name in (errors[0] if errors else {})}


@dataclass(frozen=True)
class StageOutcome:
    """One stage, from `start` to `until` (s): `settled` (s from its start), `steady` and `feedback` as in `Run`."""

    start: float
    until: float
    settled: dict[str, float | None]
    steady: dict[str, float]
    feedback: dict[str, float]


@dataclass(frozen=True, eq=False)
class Tracked:
    """A motion through stages: `t` (n,), `states` and `references` (n, nx), `inputs` (n, nu), one outcome per stage."""

    t: Array
    states: Array
    references: Array
    inputs: Array
    stages: list[StageOutcome]
    ended: str | None
    state_names: list[str]
    input_names: list[str]


def close(model: Model, reference: Reference, feedback: Gain) -> Model:
    """The closed loop as an ordinary model: `u = u_ref(t) - K(t) (z - z_ref(t))` in the place of the inputs.

    feedback: a gain (nu, nx), {k: gain} by harmonics with `K(t) = K_0 + Re sum_{k>0} K_k e^{j k w t}`, or a `Feedback`.

    The inputs become outputs named "input NAME"; one on which neither the gain nor the reference acts stays an input.
    Change parameters before closing the loop: its numbers carry the units of the inputs and are not checked again.
    Raises `InputError` for a gain that does not fit the model.
    """
    return Model.wrap(_ltp.close(model._core, reference._core, _gain("close", model, reference, feedback)))


def certify(
    model: Model,
    reference: Reference,
    feedback: Gain,
    *,
    deviations: Mapping[str, float] | Sequence[Mapping[str, float]] = (),
    spread: Mapping[str, float] | None = None,
    truncation: int = 5,
    horizon: float | None = None,
    tolerated: bool = True,
) -> Certificate:
    """Ask every witness there is whether the loop of `model` around `reference` is stable, and weigh them.

    deviations: states off the reference to start runs from, such as `{"x": 0.02, "theta": 0.2}`, one or several.
    spread: relative half ranges of parameters, such as `{"l_p": 0.01}`: corners and middles are tried, at most five.
    truncation: N of the lift; 2N is asked as well.
    horizon: time that runs last, s; by default eight time constants, within 10 to 500 periods.
    tolerated: whether to look for the largest multiple of each deviation that comes back (64 at most).

    Raises `InputError` for a gain, name or number that cannot be.
    """
    if truncation < 1:
        raise InputError(f"certify: truncation is {truncation}, expected at least 1; correct it")
    given = [deviations] if isinstance(deviations, Mapping) else list(deviations)
    rows = np.array([_deviation("certify", model, d) for d in given]).reshape(len(given), len(model.states))
    found = _ltp.certify(
        model._core,
        reference._core,
        _gain("certify", model, reference, feedback),
        truncation=truncation,
        deviations=rows,
        spread=dict(spread or {}),
        horizon=None if horizon is None else float(horizon),
        tolerated=tolerated,
    )
    orbit = found["orbit"]
    return Certificate(
        verdict=found["verdict"],
        sentence=found["sentence"],
        reasons=found["reasons"],
        defect=_states(model, found["defect"]),
        open=found["open"],
        exponents=found["exponents"],
        lifted=[Lifted(*lifted) for lifted in found["lifted"]],
        orbit=None if orbit is None else ClosedOrbit(orbit[0], _states(model, orbit[1]), orbit[2]),
        no_orbit=found["no_orbit"],
        runs=[_run(model, run) for run in found["runs"]],
        cases=[
            Case(dict(zip(spread or {}, changes, strict=True)), slowest, _states(model, error) if error else {})
            for changes, slowest, error in found["spread"] or []
        ],
    )


def track(
    model: Model, stages: Sequence[tuple[Reference, Gain, float]], *, deviation: Mapping[str, float] | None = None
) -> Tracked:
    """Run through stages of (reference, feedback, end in s) one after another, from the first reference.

    A position step is `reference.shifted(x=-0.1)`, a phase change `reference.ahead(phase=...)`, a change of amplitude
    another reference; `with_inputs_of` keeps an input. `deviation` is added to the first state. Samples lie a hundredth
    of a period apart. Raises `InputError` for stages that end before they start and gains that do not fit.
    """
    given = [
        (reference._core, _gain("track", model, reference, gain), float(until)) for reference, gain, until in stages
    ]
    found = _ltp.track(model._core, given, _deviation("track", model, deviation or {}))

    def outcome(stage: dict[str, Any]) -> StageOutcome:
        return StageOutcome(
            start=stage["start"],
            until=stage["until"],
            settled=dict(zip(model.states, stage["settled"], strict=True)),
            steady=_states(model, stage["steady"]),
            feedback=dict(zip(model.inputs, stage["feedback"], strict=True)),
        )

    return Tracked(
        t=found["t"],
        states=found["states"],
        references=found["references"],
        inputs=found["inputs"],
        stages=[outcome(stage) for stage in found["stages"]],
        ended=found["ended"],
        state_names=model.states,
        input_names=model.inputs,
    )


@dataclass(frozen=True, eq=False)
class SimulationCost:
    """A design objective by simulation, compiled once: call it with a gain, or `many` with several at a time.

    `J = sum w_i sqrt(int e_i^2 dt) + sum w'_i sqrt(int_steady e_i^2 dt)`; infinite where the motion is lost.
    """

    harmonics: tuple[int, ...]
    shape: tuple[int, int]
    period: float
    _core: _ltp.SimulationCost = field(repr=False)

    def __len__(self) -> int:
        """Numbers in a gain: per harmonic (nu, nx), above zero first the real and then the imaginary part."""
        return len(self._core)

    def __call__(self, gain: npt.ArrayLike) -> float:
        """The cost of one gain, as its numbers (nu, nx) or flat."""
        return float(self.many(np.asarray(gain, dtype=np.float64).reshape(1, -1))[0])

    def many(self, gains: npt.ArrayLike) -> Array:
        """Costs (n,) of gains (n, numbers), evaluated side by side."""
        return self._core.evaluate(np.ascontiguousarray(gains, dtype=np.float64))

    def design(
        self,
        *,
        limit: float,
        particles: int = 10,
        rounds: int = 50,
        descent: int = 40,
        budget: int = 4000,
        seed: int = 0,
    ) -> Feedback:
        """The gain of least cost with a norm up to `limit`: the particle swarm of Duyul 2018, Algorithm 1.

        particles, rounds: of the swarm; `descent` evaluations of the local solver inside each (0 leaves it out), and
        `budget` evaluations at most. `figures` has cost, norm and evaluations. Raises `ConvergenceError` when every
        motion was lost.
        """
        whole = {"particles": particles, "rounds": rounds, "descent": descent, "budget": budget, "seed": seed}
        for name, value in whole.items():
            if value < 0:
                raise InputError(f"SimulationCost.design: {name} is {value}, expected a number from 0 on; correct it")
        lines, figures = self._core.design(limit=float(limit), **whole)
        gains = {k: lines[k].reshape(self.shape) * (1 if k == 0 else 2) for k in self.harmonics}
        gains.setdefault(0, np.zeros(self.shape, dtype=np.complex128))
        return replace(Feedback.from_harmonics(gains, self.period), method="simulation", figures=dict(figures))


def simulation_cost(
    model: Model,
    reference: Reference,
    *,
    deviation: Mapping[str, float],
    weights: Mapping[str, float],
    steady_weights: Mapping[str, float] | None = None,
    steady_from: float = 0.0,
    t_end: float,
    dt: float,
    harmonics: Sequence[int] = (0,),
) -> SimulationCost:
    """The cost of gains by simulating the nonlinear closed loop from a deviation (Duyul 2018, eqs 4.4 and 4.6).

    weights: of the root of each state's integrated squared error, zero where not given; steady_weights: of the same
    from `steady_from` (s) on. `dt` (s) is the step of integration and integral. Raises `InputError` for a name or
    number that cannot be.
    """
    named = (deviation, weights, steady_weights or {})
    off, whole, steady = (_deviation("simulation_cost", model, values).tolist() for values in named)
    chosen = [int(k) for k in harmonics]
    if any(k < 0 for k in chosen):
        raise InputError(f"simulation_cost: harmonics are {chosen}, expected numbers from 0 on; correct them")
    core = _ltp.SimulationCost(
        model._core, reference._core, off, whole, steady, float(steady_from), float(t_end), float(dt), chosen
    )
    shape = (len(model.inputs), len(model.states))
    return SimulationCost(tuple(chosen), shape, reference.period, core)


def _run(model: Model, run: dict[str, Any]) -> Run:
    named = {
        "deviation": _states(model, run["deviation"]),
        "settled": dict(zip(model.states, run["settled"], strict=True)),
        "steady": _states(model, run["steady"]),
        "feedback": dict(zip(model.inputs, run["feedback"], strict=True)),
    }
    return Run(**{**run, **named})


def _states(model: Model, values: Sequence[float]) -> dict[str, float]:
    return dict(zip(model.states, values, strict=True))


def _deviation(verb: str, model: Model, given: Mapping[str, float]) -> Array:
    out = np.zeros(len(model.states))
    for name, value in given.items():
        if name not in model.states:
            raise InputError(f"{verb}: {model.name!r} has no state {name!r}; it has {', '.join(model.states)}")
        out[model.states.index(name)] = float(value)
    return out


def _gain(verb: str, model: Model, reference: Reference, gain: Gain) -> Complexes:
    """Fourier coefficients (K + 1, nu, nx, 1) of a gain."""
    period, out = gain_coefficients(verb, gain, model.inputs, model.states)
    if len(out) > 1 and period is not None and abs(period - reference.period) > 1e-9 * reference.period:
        raise InputError(
            f"{verb}: the gain has the period {period:g} s, the reference {reference.period:g} s; they must be the same"
        )
    return out[..., np.newaxis]
