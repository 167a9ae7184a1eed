"""The isolability matrix: which pairs of effects a set-up tells apart, and how well each is seen at all."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from matplotlib.colors import to_hex, to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from .numbers import shorten
from .style import COLORS, figure_legend, hide_spines, new_figure, styled

if TYPE_CHECKING:
    from ltp.isolability import Isolability

_LOOK = {
    "separable": ("floor", "told apart (more than 10)"),
    "doubtful": ("before", "doubtful (2 to 10)"),
    "never": ("rival", "not told apart"),
    "unseen": ("rule", "one of the two is not seen"),
}
#: With more effects than this, cells have no room for a number.
WRITTEN = 22


@styled
def isolability_figure(found: Isolability) -> Figure:
    """Left the matrix of gains in deviance, pair by pair; right how far each effect stands above the noise."""
    m = len(found.effects)
    many = m > WRITTEN
    figure = new_figure(1.9 + (0.2 if many else 0.3) * max(m, 4))
    matrix, bars = figure.subplots(1, 2, sharey=True, width_ratios=[3.2, 1.0])
    names = [shorten(effect.label, 34) for effect in found.effects]
    drawn: dict[str, str] = {}
    for i, first in enumerate(found.effects):
        for j, second in enumerate(found.effects):
            if i == j:
                continue
            word = found.words[i][j] if first.detectable and second.detectable else "unseen"
            color, meaning = COLORS[_LOOK[word][0]], _LOOK[word][1]
            face = to_hex(to_rgba(color, 0.4 if word != "unseen" else 0.9), keep_alpha=True)
            drawn[meaning] = face
            matrix.add_patch(Rectangle((j - 0.47, i - 0.44), 0.94, 0.88, facecolor=face, edgecolor="none"))
            if word != "unseen" and not many:
                size = 7.5 if m <= 14 else 5.5
                matrix.text(j, i, _brief(found.separation[i][j]), ha="center", va="center", fontsize=size)
    matrix.set_xlim(-0.5, m - 0.5)
    matrix.set_ylim(m - 0.5, -0.5)
    matrix.set_yticks(range(m), names)
    turn = 90 if many else 40
    matrix.set_xticks(
        range(m), names, rotation=turn, ha="right", va="center" if many else "top", rotation_mode="anchor"
    )
    matrix.grid(visible=False)
    matrix.tick_params(length=0)
    hide_spines(matrix, "left", "bottom")
    threshold = math.sqrt(10.0)
    seen = [max(effect.visible, 1e-2) for effect in found.effects]
    raw = [max(effect.visible, 1e-2) >= threshold for effect in found.effects]
    bars.barh(range(m), seen, height=0.5, color=[COLORS["after"] if r else COLORS["nominal"] for r in raw])
    bars.axvline(threshold, color=COLORS["ink"], lw=0.9, ls=(0, (4, 2)))
    bars.set_xscale("log")
    bars.set_xlim(0.3, max([*seen, 10.0]) * 1.6)
    bars.set_xlabel("what parameters cannot\nimitate, over noise")
    bars.tick_params(axis="y", length=0, labelleft=False)
    bars.grid(axis="y", visible=False)
    hide_spines(bars, "left", "bottom")
    figure_legend(figure, matrix, {meaning: drawn[meaning] for _, meaning in _LOOK.values() if meaning in drawn})
    return figure


def _brief(value: float) -> str:
    """A deviance in at most four characters."""
    if value < 9.95:
        return f"{value:.1f}"
    if value < 9995:
        return f"{value:.0f}"
    exponent = math.floor(math.log10(value))
    return f"{value / 10**exponent:.0f}e{exponent}"
