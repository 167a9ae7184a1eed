"""The harmonic map as a picture: cells of harmonic and frequency, full where the machine is not the model."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path

from .decimate import Array
from .numbers import minus, shorten
from .style import COLORS, figure_legend, hide_spines, new_figure, styled

if TYPE_CHECKING:
    from ltp.harmonic import HarmonicMap

#: Standard deviations from which a cell has a colour, the colour, how much of it, and its word. Noise alone leaves one
#: cell in fifty above two, and hardly any above four.
_LOOK = (
    (0.0, "rule", 0.55, "up to 2 standard deviations: noise"),
    (2.0, "before", 0.22, "2 to 4"),
    (4.0, "before", 0.5, "4 to 10"),
    (10.0, "before", 1.0, "more than 10: physics"),
)
#: More columns than this are drawn by the largest of neighbours.
MOST = 160


@styled
def harmonic_map_figure(found: HarmonicMap) -> Figure:
    """One panel for each output and input; below, when events happen against when they should."""
    pairs = [(y, u) for y in range(len(found.outputs)) for u in range(len(found.inputs))]
    rows = len(found.harmonics)
    heights = [0.5 + 0.24 * rows] * len(pairs) + ([0.45 + 0.28 * len(found.events)] if found.events else [])
    figure = new_figure(1.0 + sum(heights))
    panels = list(np.atleast_1d(figure.subplots(len(heights), 1, height_ratios=heights)))
    for axes, (y, u) in zip(panels, pairs, strict=False):
        _map(axes, found, y, u)
    if found.events:
        _events(panels[-1], found)
    swatches = {word: f"{COLORS[role]}{round(255 * share):02x}" for _, role, share, word in _LOOK}
    figure_legend(figure, panels[0], swatches)
    return figure


def _map(axes: Axes, found: HarmonicMap, y: int, u: int) -> None:
    omega, z = _pooled(np.asarray(found.omega), np.asarray(found.z[y, u]))
    ends = [least for least, *_ in _LOOK[1:]]
    classes = np.searchsorted(ends, np.where(np.isfinite(z), z, 0.0), side="right")
    for index, (_, role, share, _) in enumerate(_LOOK):
        cells = [_cell(column, row) for row, column in np.argwhere(classes == index)]
        if cells:  # one path for each colour keeps a page small
            face = to_rgba(COLORS[role], share)
            axes.add_patch(PathPatch(Path.make_compound_path(*cells), facecolor=face, edgecolor="none"))
    n = len(omega)
    axes.set_xlim(-0.5, n - 0.5)
    axes.set_ylim(-0.5, len(found.harmonics) - 0.5)
    axes.set_yticks(range(len(found.harmonics)), [minus(f"{k:+d}" if k else "0") for k in found.harmonics])
    shown = np.unique(np.linspace(0, n - 1, min(n, 9)).round().astype(int))
    axes.set_xticks(shown, [f"{omega[i] / math.tau:.2g}" for i in shown])
    axes.set_ylabel("harmonic k")
    axes.set_xlabel("input frequency (Hz), line by line")
    title = f"{shorten(found.inputs[u])} to {shorten(found.outputs[y])}: recording minus model, over its noise"
    axes.set_title(title, loc="left", fontsize=9)
    axes.grid(visible=False)
    axes.tick_params(length=0)
    hide_spines(axes, "left", "bottom")


def _pooled(omega: Array, z: Array) -> tuple[Array, Array]:
    """At most ``MOST`` columns, each with the largest value of its neighbours, so that none is lost."""
    n = len(omega)
    step = -(-n // MOST)
    if step <= 1:
        return omega, z
    starts = np.arange(0, n, step)
    filled = np.where(np.isfinite(z), z, 0.0)
    return omega[starts], np.maximum.reduceat(filled, starts, axis=1)


def _cell(column: int, row: int) -> Path:
    left, right, low, high = column - 0.47, column + 0.47, row - 0.44, row + 0.44
    return Path([(left, low), (right, low), (right, high), (left, high), (left, low)], closed=True)


def _events(axes: Axes, found: HarmonicMap) -> None:
    """A dot with its 95 % bar for each kind of event in each record; zero is when the model says."""
    for row, event in enumerate(found.events):
        off = abs(event.residual_s) > 4 * event.sd_s
        color = COLORS["before"] if off else COLORS["nominal"]
        axes.errorbar(1e3 * event.residual_s, row, xerr=2e3 * event.sd_s, fmt="o", ms=5, color=color, lw=1.2)
    names = [
        f"{event.name} ({shorten(event.record)})" + ("" if event.phase is None else f", phase {event.phase:.2f}")
        for event in found.events
    ]
    axes.axvline(0.0, color=COLORS["ink"], lw=0.8, ls=(0, (4, 2)))
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.set_xlabel("event comes later than predicted by (ms); bars: 95 %")
    axes.grid(axis="y", visible=False)
    axes.tick_params(axis="y", length=0)
    hide_spines(axes, "left", "bottom")
