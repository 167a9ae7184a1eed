"""The confusion matrix of a proof: what was concealed against what was said, as numbers on shaded squares."""

from __future__ import annotations

from collections.abc import Mapping

from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from .numbers import shorten
from .style import COLORS, hide_spines, new_figure, styled

#: Verdicts stand after the effects, in this order.
_LAST = ("nothing", "parameter", "unknown", "outside the library", "consistent", "error")


@styled
def confusion(table: Mapping[str, Mapping[str, int]]) -> Figure:
    """Rows: what was concealed; columns: what was said, with the counts of cases. The diagonal is right.

    Shades give the share of the row: blue on the diagonal, orange beside it.
    """
    rows = _ordered(list(table))
    said = {answer for cells in table.values() for answer in cells}
    columns = _ordered([*rows, *(a for a in said if a not in rows)])
    columns = [c for c in columns if c in said or c not in _LAST]
    figure = new_figure(1.9 + 0.23 * len(rows))
    axes = figure.subplots()
    for i, truth in enumerate(rows):
        total = sum(table[truth].values())
        for j, answer in enumerate(columns):
            count = table[truth].get(answer, 0)
            right = answer == truth or (truth, answer) in _RIGHT
            if right and not count:
                axes.add_patch(Rectangle((j - 0.5, i - 0.5), 1, 1, fill=False, ec=COLORS["rule"], lw=0.8))
            if not count:
                continue
            color = COLORS["after"] if right else COLORS["before"]
            share = 0.15 + 0.75 * count / total
            axes.add_patch(Rectangle((j - 0.5, i - 0.5), 1, 1, color=color, alpha=share, lw=0))
            axes.text(
                j, i, str(count), ha="center", va="center", fontsize=8, color="white" if share > 0.55 else COLORS["ink"]
            )
        axes.text(len(columns) - 0.2, i, f"{total}", va="center", fontsize=8, color=COLORS["muted"])
    axes.text(len(columns) - 0.2, -1.0, "cases", va="center", fontsize=8, color=COLORS["muted"])
    axes.set_xlim(-0.5, len(columns) + 0.6)
    axes.set_ylim(len(rows) - 0.5, -1.4)
    axes.set_yticks(range(len(rows)), [_words(r) for r in rows])
    axes.set_xticks(range(len(columns)), [_words(c) for c in columns], rotation=60, ha="right", rotation_mode="anchor")
    axes.set_ylabel("concealed")
    axes.set_xlabel("said")
    axes.grid(visible=False)
    axes.tick_params(axis="both", length=0)
    hide_spines(axes, "left", "bottom")
    return figure


_RIGHT = {
    ("nothing", "consistent"),
    ("nothing", "parameter"),
    ("outside the library", "unknown"),
}


def _ordered(names: list[str]) -> list[str]:
    effects = sorted(n for n in names if n not in _LAST)
    return [*effects, *(n for n in _LAST if n in names)]


def _words(name: str) -> str:
    return shorten(name.replace("_", " "), 28)
