"""The estimated missing force against what it may depend on, with the law that was named drawn over it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .curves import _window
from .decimate import Array, binned_mean, envelope, finite_range, thin
from .numbers import prefixed, shorten
from .style import COLORS, dots, figure_legend, hide_spines, label, new_figure, plain_ticks, styled

#: What a force may be drawn against, in the order of the side panels.
VARIABLES = ("velocity", "position", "time")

#: What the same series are called at a sensor or an input, where nothing moves.
WORDS = {
    "output": {"force": "sensor error", "position": "measured value", "velocity": "rate of the measured value"},
    "input": {"force": "added to the input", "position": "value of the input", "velocity": "rate of the input"},
}


@dataclass(frozen=True)
class Force:
    """The smoothed missing force (n,) at one port along one record, with its sd, the port's motion and the time (s).

    `phase` (n,) is that of the clock in [0, 1), `mode` (n,) the place of each mode in `modes`; None where there
    is none. Of `kind` "output" or "input" it is what is added to a sensor or an input, and `position` and `velocity`
    are the value there and its rate.
    """

    record: str
    t: Array
    position: Array
    velocity: Array
    force: Array
    sd: Array
    phase: Array | None = None
    mode: Array | None = None
    modes: tuple[str, ...] = ()
    kind: str = "port"

    def word(self, series: str) -> str:
        """What `force`, `position` or `velocity` is called at this kind of place."""
        plain = "missing force" if series == "force" else series
        return WORDS.get(self.kind, {}).get(series, plain)

    def against(self, variable: str) -> Array:
        """The samples of ``variable``, one of :data:`VARIABLES`."""
        return {"velocity": self.velocity, "position": self.position}.get(variable, self.t)


@dataclass(frozen=True)
class Law:
    """A law of the missing force over one variable: ``grid``, ``force`` and its one-sigma ``sd``, each (m,)."""

    variable: str
    grid: Array
    force: Array
    sd: Array


@dataclass(frozen=True)
class Units:
    """Units of force, position and velocity at the port; empty where they are unknown."""

    force: str = ""
    position: str = ""
    velocity: str = ""

    def of(self, variable: str) -> str:
        """Unit of one of :data:`VARIABLES`."""
        return {"velocity": self.velocity, "position": self.position}.get(variable, "s")


def axis_of(variable: str) -> str:
    """The axis on which a dependence is drawn: ``"sign of velocity"`` on velocity, ``"phase"`` on time."""
    words = {
        "velocity": "velocity",
        "position": "position",
        "rate of the meas": "velocity",
        "measured value": "position",
    }
    return next((axis for word, axis in words.items() if word in variable.lower()), "time")


@styled
def missing_force(
    forces: list[Force],
    variable: str,
    *,
    law: Law | None = None,
    units: Units | None = None,
    name: str = "law",
    points: int = 1500,
) -> Figure:
    """Left: the missing force against ``variable``, with the law and its two-sigma band. Right: against the others.

    ``forces`` must not be empty. The cloud is thinned to ``points`` samples; the open circles are means over bins of
    the whole record, free of any law. The panel over time shows the first record, in a window where the force varies.
    """
    units = units or Units()
    main = axis_of(variable)
    others = [v for v in VARIABLES if v != main]
    figure = new_figure(4.3)
    grid = figure.add_gridspec(2, 2, width_ratios=[1.55, 1.0])
    low, high = force_range(forces, law)
    factor, unit = prefixed(units.force, max(abs(low), abs(high)))
    big = figure.add_subplot(grid[:, 0])
    panels = [(big, main)] + [(figure.add_subplot(grid[row, 1]), other) for row, other in enumerate(others)]
    for axes, axis in panels:
        same_axis = law is not None and axis_of(law.variable) == axis
        if axis == "time":
            _over_time(axes, forces[0], law, factor)
            scale, x_unit = 1.0, "s"
        else:
            reach = max(abs(b) for b in finite_range(*[f.against(axis) for f in forces]))
            scale, x_unit = prefixed(units.of(axis), reach)
            _cloud(axes, forces, axis, scale, factor, points if axis == main else points // 3, axis == main)
        if law is not None and same_axis:
            _draw_law(axes, law, scale, factor, name)
        axes.axhline(0, color=COLORS["muted"], lw=0.7, zorder=1)
        axes.set_ylim(low * factor, high * factor)
        axes.set_xlabel(label(forces[0].word(axis), x_unit))
        hide_spines(axes, "left", "bottom")
        plain_ticks(axes, x=6 if axis == main else 4, y=6 if axis == main else 4)
        axes.tick_params(axis="x", length=0)
    big.set_ylabel(label(forces[0].word("force"), unit))
    figure_legend(figure, big)
    return figure


def force_range(forces: list[Force], law: Law | None) -> tuple[float, float]:
    """Range of all but the outermost 0.2 % of the samples, so that one spike of the smoother does not rule the page."""
    everything = np.concatenate([f.force[np.isfinite(f.force)] for f in forces])
    ends = [float(v) for v in np.quantile(everything, [0.002, 0.998])] if len(everything) else [0.0, 0.0]
    if law is not None and np.isfinite(law.force).any():
        ends += list(finite_range(law.force))
    low, high = min(*ends, 0.0), max(*ends, 0.0)
    margin = 0.1 * (high - low or 1.0)
    return low - margin, high + margin


def _cloud(
    axes: Axes, forces: list[Force], axis: str, scale: float, factor: float, points: int, with_means: bool
) -> None:
    x = np.concatenate([f.against(axis) for f in forces])
    y = np.concatenate([f.force for f in forces])
    some = thin(len(x), points)
    line = dots(axes, x[some] * scale, y[some] * factor, COLORS["nominal"], size=2.4 if with_means else 1.8)
    line.set_label(f"{forces[0].word('force')}, sample by sample")
    centre, mean = binned_mean(x, y)
    axes.plot(
        centre * scale,
        mean * factor,
        ls="none",
        marker="o",
        ms=4.6 if with_means else 3.2,
        mew=1.0,
        zorder=4,
        mfc="none",
        mec=COLORS["ink"],
        label="mean of each bin",
    )


def _draw_law(axes: Axes, law: Law, scale: float, factor: float, name: str) -> None:
    x, y = law.grid * scale, law.force * factor
    spread = 2.0 * np.nan_to_num(law.sd, nan=0.0) * factor
    axes.fill_between(x, y - spread, y + spread, color=COLORS["after"], alpha=0.22, lw=0, label="± 2 sigma", zorder=3)
    axes.plot(x, y, color=COLORS["after"], lw=1.6, label=f"law: {shorten(name)}", zorder=5)


def _over_time(axes: Axes, force: Force, law: Law | None, factor: float) -> None:
    """The force of one record over time with its two-sigma band, and what the law says along the same motion."""
    start, stop = _window(force.velocity, np.abs(np.nan_to_num(force.force)))
    t, y = force.t[start:stop], force.force[start:stop] * factor
    spread = 2.0 * np.nan_to_num(force.sd[start:stop], nan=0.0) * factor
    some = thin(len(t), 500)
    axes.fill_between(
        t[some], (y - spread)[some], (y + spread)[some], color=COLORS["nominal"], alpha=0.3, lw=0, zorder=2
    )
    axes.plot(*envelope(t, y, 900), color=COLORS["muted"], lw=0.9, zorder=3, label="missing force ± 2 sigma")
    if law is not None and axis_of(law.variable) != "time" and len(law.grid) > 1:
        order = np.argsort(law.grid)
        along = np.interp(force.against(axis_of(law.variable))[start:stop], law.grid[order], law.force[order])
        axes.plot(
            *envelope(t, along * factor, 900),
            color=COLORS["after"],
            lw=1.1,
            zorder=4,
            label="law along the same motion",
        )
    if len(t) and math.isfinite(float(t[0])) and t[-1] > t[0]:
        axes.set_xlim(float(t[0]), float(t[-1]))
