"""Simulation error of every output of every record: nominal, refitted, with the effect, against the noise floor."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from .numbers import shorten
from .style import COLORS, figure_legend, hide_spines, new_figure, styled


@dataclass(frozen=True)
class ErrorRow:
    """One output of one record: relative errors (rms of the error over the standard deviation of the measurement).

    ``after`` is NaN when no effect was added; so is any figure that could not be computed.
    """

    name: str
    held_out: bool
    nominal: float
    before: float
    after: float
    floor: float


@styled
def errors(rows: Sequence[ErrorRow], effect: str = "the effect") -> Figure:
    """One line for each row, errors in percent on a logarithmic axis, and the noise floor as a bar across the line."""
    figure = new_figure(0.95 + 0.28 * max(len(rows), 2))
    axes = figure.subplots()
    for place, row in enumerate(rows):
        marks = [
            (row.nominal, COLORS["nominal"], "o", "nominal", "none"),
            (row.before, COLORS["before"], "o", "refitted", COLORS["before"]),
            (row.after, COLORS["after"], "o", f"with {shorten(effect)}", COLORS["after"]),
        ]
        seen = [100 * v for v, *_ in marks if _drawable(v)]
        if len(seen) > 1:
            axes.plot([min(seen), max(seen)], [place, place], color=COLORS["rule"], lw=3, zorder=1)
        if _drawable(row.floor):
            axes.plot([100 * row.floor] * 2, [place - 0.36, place + 0.36], color=COLORS["floor"], lw=2.6, zorder=2)
        for value, color, marker, _, fill in marks:
            if _drawable(value):
                axes.plot(100 * value, place, marker=marker, ms=6.2, mec=color, mfc=fill, mew=1.3, ls="none", zorder=3)
    for name, color, fill, present in (
        ("nominal", COLORS["nominal"], "none", any(_drawable(r.nominal) for r in rows)),
        ("refitted", COLORS["before"], COLORS["before"], any(_drawable(r.before) for r in rows)),
        (f"with {shorten(effect)}", COLORS["after"], COLORS["after"], any(_drawable(r.after) for r in rows)),
    ):
        if present:
            axes.plot([], [], "o", ms=6.2, mec=color, mfc=fill, mew=1.3, label=name)
    if any(_drawable(r.floor) for r in rows):
        axes.plot([], [], color=COLORS["floor"], marker="|", ms=9, mew=2.6, ls="none", label="noise floor")
    _axis(axes, rows)
    figure_legend(figure, axes)
    return figure


def _drawable(value: float) -> bool:
    return math.isfinite(value) and value > 0


def _axis(axes: Axes, rows: Sequence[ErrorRow]) -> None:
    values = [100 * v for r in rows for v in (r.nominal, r.before, r.after, r.floor) if _drawable(v)] or [1.0]
    low, high = min(values) / 1.35, max(values) * 1.35
    axes.set_xscale("log")
    axes.set_xlim(low, high)
    steps = (1, 2, 5) if high / low < 200 else (1,)
    exponents = range(math.floor(math.log10(low)) - 1, math.ceil(math.log10(high)) + 1)
    ticks = [m * 10.0**k for k in exponents for m in steps if low <= m * 10.0**k <= high]
    if len(ticks) > 12:
        ticks = ticks[:: math.ceil(len(ticks) / 12)]
    axes.xaxis.set_major_locator(FixedLocator(ticks))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.set_yticks(range(len(rows)), [shorten(r.name, 50) for r in rows])
    axes.set_ylim(len(rows) - 0.4, -0.6)
    axes.set_xlabel("simulation error, % of the standard deviation of the measured output")
    axes.grid(axis="y", visible=False)
    hide_spines(axes, "left", "bottom")
    axes.tick_params(axis="x", length=0)
