"""The ranking of the candidates: how much worse than the best one each explains the recordings."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from .numbers import minus, shorten, significant
from .style import COLORS, figure_legend, hide_spines, new_figure, styled

#: Scores below this are drawn on a linear axis, above it on a logarithmic one.
LINEAR_UP_TO = 10.0


@dataclass(frozen=True)
class Candidate:
    """One candidate: its label, its score above the best, its held-out figure, and its standing.

    ``standing`` is ``"named"`` (the verdict names it), ``"rival"`` (the data cannot tell it from the best),
    ``"nothing"`` (the nominal model alone) or ``"other"``. ``note`` says why it has no score, where it has none.
    """

    name: str
    score: float
    held_out: float
    converged: bool
    standing: str
    note: str = ""


_LOOK = {
    "named": (COLORS["after"], "named"),
    "rival": (COLORS["rival"], "cannot be told apart from the best"),
    "nothing": (COLORS["ink"], "nominal model, nothing added"),
    "other": (COLORS["nominal"], "other candidates"),
}


@styled
def ranking(candidates: Sequence[Candidate]) -> Figure:
    """One bar for each candidate, best first: the difference of its score to the best; right, its held-out figure."""
    rows = len(candidates)
    figure = new_figure(0.95 + 0.25 * max(rows, 2))
    axes = figure.subplots()
    finite = [c.score for c in candidates if math.isfinite(c.score)]
    top = max([*finite, LINEAR_UP_TO]) * 1.15
    axes.set_xscale("symlog", linthresh=LINEAR_UP_TO, linscale=1.0)
    drawn: dict[str, str] = {}
    for row, candidate in enumerate(candidates):
        color, meaning = _LOOK[candidate.standing]
        drawn[meaning] = color
        length = candidate.score if math.isfinite(candidate.score) else top
        axes.barh(row, length, height=0.56, color=color, alpha=1.0 if candidate.converged else 0.35)
        if length < 0.1:  # the best candidate has no bar to speak of
            axes.plot([0], [row], "o", ms=6.5, color=color, clip_on=False, zorder=4)
        if not candidate.converged:
            note = " did not converge"
            axes.annotate(
                note,
                (length, row),
                va="center",
                fontsize=8,
                color=COLORS["muted"],
                xytext=(3, 0),
                textcoords="offset points",
            )
        held_out = significant(candidate.held_out, 4)
        axes.text(1.02, row, held_out, transform=axes.get_yaxis_transform(), va="center", ha="left", fontsize=8.5)
    axes.text(
        1.02,
        -1.0,
        "held-out score",
        transform=axes.get_yaxis_transform(),
        va="center",
        fontsize=8.5,
        color=COLORS["muted"],
    )
    axes.set_yticks(range(rows), [shorten(c.name, 44) for c in candidates])
    axes.set_ylim(rows - 0.4, -0.7)
    axes.set_xlim(0, top)
    decades = [10.0**k for k in range(1, 1 + max(1, math.floor(math.log10(top))))]
    axes.xaxis.set_major_locator(FixedLocator([0.0, 5.0, *decades]))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: _tick(value)))
    axes.set_xlabel("score above the best (linear up to 10, then logarithmic)")
    axes.grid(axis="y", visible=False)
    hide_spines(axes, "left", "bottom")
    axes.tick_params(axis="x", length=0)
    axes.tick_params(axis="y", pad=7)
    figure_legend(figure, axes, drawn)
    return figure


def _tick(value: float) -> str:
    return minus(f"{value:g}") if value < 1e5 else significant(value, 1)
