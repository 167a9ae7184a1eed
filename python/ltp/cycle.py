"""Owns `ltp.cycle` and the noun `LimitCycle` in Python: periodic orbits through events, and what lies around them."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from ltp import _ltp
from ltp._ltp import InputError
from ltp.model import Model
from ltp.simulate import Trajectory, wrap_trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class CycleEvent:
    """One event of a periodic orbit: its transition, its time (s) and phase in [0, 1) after the start of the period."""

    name: str
    time: float
    phase: float
    mode_before: str
    mode_after: str


@dataclass(frozen=True)
class Domain:
    """From how far an orbit attracts: of `probes` starts around it `returned` came back.

    `radius` is the largest distance within which all of them did, in ranges of the orbit's states.
    """

    probes: int
    returned: int
    radius: float


@dataclass(frozen=True)
class Other:
    """Another orbit that a survey ended on, and how many of its starts did."""

    cycle: LimitCycle
    starts: int


@dataclass(frozen=True, eq=False)
class LimitCycle:
    """A periodic orbit of a model.

    `period` in s, time zero is that of the clock; `events` in order; `multipliers` (nx,) are the eigenvalues of the
    `monodromy` (nx, nx), saltation included, largest first; `stable` says whether disturbances die out. `autonomous`
    orbits have no clock: their period was found, and one multiplier is one. `domain`, `others` and `lost` (starts that
    ended on no periodic orbit, with the reason) come from `probes`. `stats` says how the orbit was found: periods
    `settled` first, Newton `iterations`, the relative gap that is left (`residual`), and how far the orbit moves when
    the integration step is halved (`integration_error`).
    """

    period: float
    autonomous: bool
    events: list[CycleEvent]
    multipliers: npt.NDArray[np.complex128]
    monodromy: Array
    stable: bool
    start: dict[str, float]
    found_from: dict[str, float]
    domain: Domain | None
    others: list[Other]
    lost: list[tuple[dict[str, float], str]]
    stats: dict[str, float]
    warnings: list[str]
    model: Model = field(repr=False)
    _core: _ltp.LimitCycle = field(repr=False)

    @cached_property
    def trajectory(self) -> Trajectory:
        """One period from time zero, sampled evenly, both ends included."""
        return wrap_trajectory(self.model, self._core.trajectory())

    def plot(self, across: str, up: str, *, others: Sequence[str] = ()) -> Figure:
        """The cross-section of two states, and `across` with `others` over one period, coloured by mode.

        Raises `InputError` for a state that the model does not have.
        """
        from ltp.plots.orbit import Curve, orbit  # drawing is slow to import

        run = self.trajectory

        def curve(name: str) -> Curve:
            if name not in run.state_names:
                known = ", ".join(run.state_names)
                raise InputError(f"LimitCycle.plot: {self.model.name!r} has no state {name!r}; it has {known}")
            return Curve(name, self.model.unit(name), run.states[:, run.state_names.index(name)])

        events = {event.name: event.phase for event in self.events}
        phase = (run.t - run.t[0]) / self.period
        return orbit(
            phase, run.mode.tolist(), curve(across), curve(up), others=[curve(n) for n in others], events=events
        )


def cycle(
    model: Model,
    *,
    start: Mapping[str, float] | None = None,
    mode: str | None = None,
    period: float | None = None,
    inputs: Mapping[str, float] | None = None,
    settle: int | None = None,
    steps: int | None = None,
    probes: int = 0,
    seed: int = 0,
) -> LimitCycle:
    """The periodic orbit that a start leads to or lies near: by shooting, through events, stable or not.

    start: values that replace those of the document, in the states' units; mode: in which to start.
    period: s; by default that of the model's clock. Without a clock and explicit time it is a first guess of the
        unknown period, found with the orbit.
    inputs: constant values, by default those of the document, or zero.
    settle: periods simulated before Newton's method; by default none when the start nearly comes back to itself.
    steps: integration steps in a period.
    probes: starts around the orbit that are followed to see from how far it attracts and which orbits there are beside
        it; `seed` draws them.

    Where an orbit is found depends on the start: a machine may have several. Doubts are warned of and kept in
    `warnings`. Raises `ConvergenceError` when there is no periodic orbit to be found, `InputError` for a name, period
    or value that cannot be.
    """
    if probes < 0:
        raise InputError(f"cycle: probes is {probes}, expected a number of starts from 0 on; correct it")
    core = _ltp.cycle(
        model._core,
        start=None if start is None else dict(start),
        mode=mode,
        period=period,
        inputs=None if inputs is None else dict(inputs),
        settle=settle,
        steps=steps,
        probes=probes,
        seed=seed,
    )
    found = _wrap(model, core)
    for text in found.warnings:
        warnings.warn(f"{model.name}: {text}", stacklevel=2)
    return found


def _wrap(model: Model, core: _ltp.LimitCycle) -> LimitCycle:
    def state(values: Sequence[float] | Array) -> dict[str, float]:
        return {name: float(value) for name, value in zip(model.states, values, strict=True)}

    return LimitCycle(
        period=core.period,
        autonomous=core.autonomous,
        events=[CycleEvent(*event) for event in core.events],
        multipliers=core.multipliers,
        monodromy=core.monodromy,
        stable=core.stable,
        start=state(core.start),
        found_from=state(core.found_from),
        domain=None if core.domain is None else Domain(*core.domain),
        others=[Other(_wrap(model, other), starts) for other, starts in core.others],
        lost=[(state(values), reason) for values, reason in core.lost],
        stats=core.stats,
        warnings=core.warnings,
        model=model,
        _core=core,
    )
