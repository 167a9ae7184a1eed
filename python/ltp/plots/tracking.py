"""Closed loops in time: coordinates and their references, with the errors or the input below."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .decimate import Array, envelope, finite_range
from .numbers import prefixed
from .style import COLORS, hide_spines, label, new_figure, plain_ticks, shared_legend, styled


@dataclass(frozen=True)
class Curve:
    """One curve (n,) over the panel's time; `role` names a colour of `COLORS`, `dashed` a reference."""

    name: str
    values: Array
    role: str
    dashed: bool = False


@dataclass(frozen=True)
class Run:
    """One panel: curves over `t` (n,), s, of a quantity in a unit; `marks` are instants (s) with a name."""

    title: str
    t: Array
    curves: Sequence[Curve]
    name: str
    unit: str
    marks: dict[str, float] = field(default_factory=dict)


@styled
def tracking(rows: Sequence[Sequence[Run]], *, height: float | None = None) -> Figure:
    """Rows of panels on common time axes, column by column; a row of one panel goes across all columns."""
    figure = new_figure(height if height is not None else 0.7 + 1.65 * len(rows))
    columns = max(len(row) for row in rows)
    grid = figure.add_gridspec(len(rows), columns)
    panels = []
    for i, row in enumerate(rows):
        below = i + 1 == len(rows) or len(rows[i + 1]) != len(row)
        for j, run in enumerate(row):
            axes = figure.add_subplot(grid[i, :] if len(row) == 1 else grid[i, j])
            _panel(axes, run)
            axes.tick_params(axis="x", labelbottom=below)
            if below:
                axes.set_xlabel("time (s)")
            panels.append(axes)
    figure.align_ylabels(panels)
    shared_legend(figure, panels)
    return figure


def _panel(axes: Axes, run: Run) -> None:
    low, high = finite_range(*[curve.values for curve in run.curves])
    factor, printed = prefixed(run.unit, max(abs(low), abs(high)))
    for name, at in run.marks.items():
        axes.axvline(at, color=COLORS["muted"], lw=0.8, ls=(0, (2, 2)), zorder=0)
        axes.annotate(
            name, (at, 1.0), xycoords=axes.get_xaxis_transform(), xytext=(3, -2), textcoords="offset points",
            fontsize=8, color=COLORS["muted"], va="top",
        )  # fmt: skip
    for curve in run.curves:
        style, z = ((0, (4, 2)), 4) if curve.dashed else ("-", 3)
        x, y = envelope(run.t, np.asarray(curve.values) * factor)
        axes.plot(x, y, color=COLORS[curve.role], lw=1.1, ls=style, label=curve.name, zorder=z)
    axes.set_title(run.title, fontsize=9.0, loc="left", color=COLORS["muted"])
    axes.set_ylabel(label(run.name, printed))
    axes.set_xlim(float(run.t[0]), float(run.t[-1]))
    plain_ticks(axes, x=6, y=4)
    hide_spines(axes, "left", "bottom")
    axes.tick_params(axis="x", length=0)
