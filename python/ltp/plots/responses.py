"""Measured responses and what predictors say of them, over the cycles of a machine, with the differences below."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .decimate import Array, envelope, finite_range
from .numbers import prefixed
from .style import COLORS, hide_spines, label, new_figure, plain_ticks, shared_legend, styled

#: What varies by less than this fraction of itself is a constant to the eye.
FLAT = 1e-3


@dataclass(frozen=True)
class Predicted:
    """One prediction (n,); `role` names a colour of `COLORS`."""

    name: str
    values: Array
    role: str


@dataclass(frozen=True)
class Response:
    """A measured response (n,) over `cycles` (n,), time in periods, and predictions of it."""

    title: str
    cycles: Array
    measured: Array
    predictions: Sequence[Predicted]
    #: Intervals of `cycles` that are shaded, such as the flights of a hopper.
    shaded: Sequence[tuple[float, float]] = ()


@styled
def responses(panels: Sequence[Response], *, name: str = "y", unit: str = "m", height: float = 4.2) -> Figure:
    """Columns, one for each response: above measured and predicted, below predicted less measured."""
    figure = new_figure(height)
    grid = figure.subplots(2, len(panels), squeeze=False, sharex="col", height_ratios=[1.4, 1.0])
    for column, panel in enumerate(panels):
        upper, lower = grid[0][column], grid[1][column]
        low, high = finite_range(panel.measured, *[p.values for p in panel.predictions])
        factor, printed = prefixed(unit, max(abs(low), abs(high)))
        for axes in (upper, lower):
            for start, end in panel.shaded:
                axes.axvspan(start, end, color=COLORS["rule"], alpha=0.45, lw=0, zorder=0)
        _line(upper, panel.cycles, panel.measured * factor, "ink", "measured", width=3.6, alpha=0.33)
        for prediction in panel.predictions:
            _line(upper, panel.cycles, prediction.values * factor, prediction.role, prediction.name)
        if high - low < FLAT * max(abs(low), abs(high)):
            # A constant is shown as one, not as its last digits.
            upper.set_ylim(sorted((0.0, 1.4 * factor * (high if high > 0 else low))))
        upper.set_title(panel.title, fontsize=9.0, loc="left", color=COLORS["muted"])
        upper.set_ylabel(label(name, printed))
        errors = [(p, p.values - panel.measured) for p in panel.predictions]
        low, high = finite_range(*[error for _, error in errors])
        factor, printed = prefixed(unit, max(abs(low), abs(high)))
        for prediction, error in errors:
            _line(lower, panel.cycles, error * factor, prediction.role)
        lower.set_ylabel(label("difference", printed))
        lower.set_xlabel("time (periods)")
        lower.set_xlim(float(panel.cycles[0]), float(panel.cycles[-1]))
        for axes in (upper, lower):
            hide_spines(axes, "left", "bottom")
            plain_ticks(axes, x=6, y=5)
            axes.tick_params(axis="x", length=0)
    figure.align_ylabels([axes for row in grid for axes in row])
    shared_legend(figure, grid[0])
    return figure


def _line(
    axes: Axes, x: Array, y: Array, role: str, name: str | None = None, width: float = 1.2, alpha: float = 1.0
) -> None:
    axes.plot(*envelope(x, np.asarray(y)), color=COLORS[role], lw=width, alpha=alpha, label=name)
