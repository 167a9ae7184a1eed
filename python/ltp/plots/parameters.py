"""What the nominal parameters absorbed before the effect was added, in units of their own stated uncertainty."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from matplotlib.figure import Figure

from .numbers import minus, shorten
from .style import COLORS, figure_legend, hide_spines, new_figure, plain_ticks, styled


@dataclass(frozen=True)
class Shift:
    """How far a parameter moved from its stated value, in stated sigmas; ``after`` is NaN when no effect was added.

    ``sd`` is the uncertainty after the fit, in the same sigmas.
    """

    name: str
    before: float
    after: float
    sd: float


@styled
def absorbed(shifts: Sequence[Shift], effect: str = "the effect") -> Figure:
    """Arrows from the stated value to the refitted one, and a dot with one sigma for the value with the effect."""
    rows = len(shifts)
    figure = new_figure(0.95 + 0.3 * max(rows, 2))
    axes = figure.subplots()
    values = [v for s in shifts for v in (s.before, s.after) if math.isfinite(v)]
    low, high = min([*values, -2.0]) * 1.12, max([*values, 2.0]) * 1.12
    reach = max(-low, high)
    if reach > 15:
        # One parameter that moved by a hundred sigmas must not press the others flat.
        axes.set_xscale("symlog", linthresh=3.0, linscale=1.0)
    for sigmas, alpha in ((2.0, 0.35), (1.0, 0.55)):
        axes.axvspan(-sigmas, sigmas, color=COLORS["rule"], alpha=alpha, lw=0, zorder=0)
    axes.axvline(0, color=COLORS["muted"], lw=0.8, zorder=1)
    with_after = any(math.isfinite(s.after) for s in shifts)
    lift = 0.14 if with_after else 0.0
    for row, shift in enumerate(shifts):
        if math.isfinite(shift.before):
            axes.annotate(
                "",
                (shift.before, row - lift),
                (0.0, row - lift),
                arrowprops={
                    "arrowstyle": "-|>,head_length=0.45,head_width=0.2",
                    "color": COLORS["before"],
                    "lw": 1.6,
                    "shrinkA": 0,
                    "shrinkB": 0,
                },
            )
        if math.isfinite(shift.after):
            spread = shift.sd if math.isfinite(shift.sd) else 0.0
            axes.errorbar(shift.after, row + lift, xerr=spread, fmt="o", ms=5, color=COLORS["after"], elinewidth=1.4)
    axes.plot([], [], color=COLORS["before"], lw=1.6, marker=">", ms=4, label="refitted without it")
    if with_after:
        axes.plot([], [], "o", ms=5, color=COLORS["after"], label=f"with {shorten(effect)}")
    axes.set_yticks(range(rows), [shorten(s.name, 30) for s in shifts])
    axes.set_ylim(rows - 0.4, -0.6)
    axes.set_xlim(low, high)
    axes.set_xlabel("shift from the stated value, in stated standard deviations (shaded: 1 and 2)")
    if reach <= 15:
        plain_ticks(axes, x=9, y=None)
    else:
        sizes = [sign * 10.0**k for k in range(math.floor(math.log10(reach)) + 1) for sign in (-1, 1)]
        ticks = sorted(v for v in [*sizes, 0.0] if low <= v <= high)
        axes.set_xticks(ticks, [minus(f"{v:g}") for v in ticks])
        axes.minorticks_off()
    axes.grid(axis="y", visible=False)
    hide_spines(axes, "left", "bottom")
    axes.tick_params(axis="x", length=0)
    if with_after:
        figure_legend(figure, axes)
    return figure
