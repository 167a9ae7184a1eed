"""Prediction error over the frequency of a test sine: several estimates, the floor of the exact functions, and what
others have published.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from .decimate import Array, finite_range
from .style import COLORS, hide_spines, new_figure, plain_ticks, shared_legend, styled

#: Errors beyond this, in percent, leave the panel: a prediction of nothing is off by 100.
MOST = 300.0
#: The panel shows errors down to the largest over this.
RANGE = 5e3


@dataclass(frozen=True)
class Line:
    """Errors (n,) in percent at the frequencies `hz` (n,); `role` names a colour of `COLORS`, `dashed` a floor."""

    name: str
    hz: Array
    percent: Array
    role: str
    dashed: bool = False


@dataclass(frozen=True)
class Point:
    """One published figure: frequency (Hz), error (percent), and what is written beside it."""

    hz: float
    percent: float
    text: str


@dataclass(frozen=True)
class Panel:
    """One panel of a sweep; `marks` are frequencies (Hz) with a name at which a thin line stands."""

    title: str
    lines: Sequence[Line]
    points: Sequence[Point] = ()
    marks: dict[str, float] = field(default_factory=dict)


@styled
def sweep(panels: Sequence[Panel], *, height: float = 3.6) -> Figure:
    """Panels side by side on common axes: error in percent, logarithmic, over the frequency of the sine."""
    figure = new_figure(height)
    grid = figure.subplots(1, len(panels), sharey=True, sharex=True, squeeze=False)[0]
    low, high = finite_range(*[_positive(line.percent) for panel in panels for line in panel.lines])
    for axes, panel in zip(grid, panels, strict=True):
        for name, hz in panel.marks.items():
            axes.axvline(hz, color=COLORS["rule"], lw=1.2, zorder=0)
            axes.annotate(
                name, (hz, 1.0), xycoords=axes.get_xaxis_transform(), xytext=(2, -2), textcoords="offset points",
                fontsize=8, color=COLORS["muted"], va="top",
            )  # fmt: skip
        for line in panel.lines:
            style = (0, (4, 2)) if line.dashed else "-"
            width, z = (1.0, 4) if line.dashed else (1.3, 3)
            axes.plot(line.hz, line.percent, color=COLORS[line.role], lw=width, ls=style, label=line.name, zorder=z)
        for point in panel.points:
            axes.plot(point.hz, point.percent, "o", ms=6.5, mec=COLORS["ink"], mfc="none", mew=1.3, zorder=6)
            axes.annotate(
                point.text, (point.hz, point.percent), xytext=(10, 30), textcoords="offset points", fontsize=8,
            )  # fmt: skip
        axes.set_title(panel.title, fontsize=9.0, loc="left", color=COLORS["muted"])
        axes.set_xlabel("frequency of the sine (Hz)")
        plain_ticks(axes, x=5, y=None)
        hide_spines(axes, "left", "bottom")
        axes.tick_params(axis="x", length=0)
    _axes(grid[0], low, high, max(float(line.hz.max()) for panel in panels for line in panel.lines))
    grid[0].set_ylabel("error of the prediction (%)")
    shared_legend(figure, grid)
    return figure


def _positive(values: Array) -> Array:
    return np.where(np.isfinite(values) & (values > 0), values, np.nan)


def _axes(axes: Axes, low: float, high: float, last: float) -> None:
    """Logarithmic percent, and a frequency axis that gives the low band the room it needs."""
    high = min(high, MOST) * 1.3
    low = max(low / 1.3, high / RANGE)
    axes.set_yscale("log")
    axes.set_ylim(low, high)
    steps = (1, 2, 5) if high / low < 300 else (1,)
    exponents = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    axes.yaxis.set_major_locator(FixedLocator([m * 10.0**k for k in exponents for m in steps]))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.set_xlim(0.0, last)
