"""Owns closed loops in time: a gain around a reference, changes of the reference, and how well it is followed.

Settling is the last time at which an error exceeds 2 % of the reference's amplitude; an error in percent is its peak over
the last period, relative to the amplitude of the reference (the new one after a change).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

import ltp
from ltp.plots.tracking import Curve, Run

Array = npt.NDArray[np.float64]

DT = 2e-3  # s, of what is kept
BAND = 0.02  # of the amplitude: settled within it
SHOWN = ("x", "theta")
UNITS = {"x": "m", "theta": "rad", "V": "V"}


@dataclass(frozen=True, eq=False)
class Loop:
    """A run of a closed loop: `t` (n,), s, `states` and the `followed` ones (n, nx), the input `voltage` (n,)."""

    t: Array
    states: Array
    followed: Array
    voltage: Array
    amplitude: Array
    names: Sequence[str]
    since: float

    def error(self, name: str) -> Array:
        """What a state is off its reference (n,)."""
        column = self.names.index(name)
        return self.states[:, column] - self.followed[:, column]

    def settled(self, name: str) -> float:
        """Seconds after the last change of the reference until the error stays within the band."""
        outside = np.abs(self.error(name)) > BAND * self.amplitude[self.names.index(name)]
        return float(self.t[outside][-1] - self.since) if outside.any() else 0.0

    def percent(self, name: str, period: float) -> float:
        """Peak error over the last period, in percent of the amplitude."""
        late = self.t > self.t[-1] - period
        return 100 * float(np.abs(self.error(name)[late]).max()) / float(self.amplitude[self.names.index(name)])

    def panels(self, words: str, marks: dict[str, float] | None = None) -> list[list[Run]]:
        """Coordinates above, errors below, cart to the left and pendulum to the right."""
        above, below = [], []
        for name in SHOWN:
            column = self.names.index(name)
            curves = [
                Curve("closed loop", self.states[:, column], "after"),
                Curve("reference", self.followed[:, column], "ink", dashed=True),
            ]
            above.append(Run(words, self.t, curves, name, UNITS[name], marks or {}))
            error = [Curve("error", self.error(name), "before")]
            below.append(Run("", self.t, error, f"error of {name}", UNITS[name], marks or {}))
        return [above, below]


def follow(
    model: ltp.Model,
    stages: Sequence[tuple[ltp.Reference, float]],
    gain: ltp.Feedback | Array,
    deviation: Mapping[str, float] | None = None,
) -> Loop:
    """One reference after the other under one gain; `stages` hold a reference and the seconds it is followed.

    Starts on the first reference, off by `deviation`; stages last whole periods, so that the clock goes on.
    """
    names = model.states
    start = dict(zip(names, stages[0][0].states(0.0)[0], strict=True))
    for name, amount in (deviation or {}).items():
        start[name] += amount
    parts: list[list[Array]] = [[], [], [], []]
    began = 0.0
    for reference, seconds in stages:
        closed = ltp.close(model, reference, gain)
        run = ltp.simulate(closed, t_end=seconds, dt=DT, initial_state=start, strict=True)
        voltage = run.outputs[:, closed.outputs.index("input V")]
        for part, values in zip(parts, (run.t + began, run.states, reference.states(run.t), voltage), strict=True):
            part.append(values)
        start = dict(zip(names, run.states[-1], strict=True))
        began += seconds
    amplitude = np.array([stages[-1][0].amplitudes[name] for name in names])
    t, states, followed, volts = (np.concatenate(part) for part in parts)
    return Loop(t, states, followed, volts, amplitude, names, began - stages[-1][1])
