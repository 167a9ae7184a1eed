"""Harmonics of the entries of periodic matrices: which multiples of the pumping frequency carry how much."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from .style import COLORS, decade_ticks, hide_spines, new_figure, shared_legend, styled

#: Roles that tell panels of one figure apart.
ROLES = ("after", "before", "rival")
#: What is smaller than this share of the largest amplitude is rounding, and not drawn.
LEAST = 1e-9


@styled
def harmonics(
    sets: Mapping[str, Mapping[str, npt.NDArray[np.complex128]]],
    *,
    columns: int = 3,
    height: float | None = None,
    axis: str = "harmonic",
) -> Figure:
    """A panel for each entry: amplitude of each harmonic, stems side by side for each set.

    sets: by name of the set, entries by name, each the coefficients (K+1,) of harmonics 0 to K; axis: what these count.
    """
    entries = list(next(iter(sets.values())))
    rows = -(-len(entries) // columns)
    figure = new_figure(height if height is not None else 0.7 + 1.55 * rows)
    grid = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    sizes = [np.abs(values) for each in sets.values() for values in each.values()]
    most = max(float(size.max()) for size in sizes)
    least = LEAST * most
    for number, axes in enumerate(grid.ravel()):
        if number >= len(entries):
            axes.set_visible(False)
            continue
        for place, (name, each) in enumerate(sets.items()):
            size = np.abs(each[entries[number]])
            k = np.flatnonzero(size > least)
            at = k + 0.16 * (place - 0.5 * (len(sets) - 1))
            color = COLORS[ROLES[place % len(ROLES)]]
            axes.vlines(at, least, size[k], color=color, lw=1.6)
            axes.plot(at, size[k], "o", ms=3.6, color=color, label=name, ls="none")
        axes.set_title(entries[number], fontsize=9.0, loc="left", color=COLORS["muted"])
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        hide_spines(axes, "left", "bottom")
        axes.tick_params(axis="x", length=0)
    decade_ticks(grid[0][0], least, 3 * most)
    for number, axes in enumerate(grid.ravel()[: len(entries)]):
        if number + columns >= len(entries):
            axes.set_xlabel(axis)
            axes.tick_params(axis="x", labelbottom=True)
    for across in grid:
        across[0].set_ylabel("amplitude")
    shared_legend(figure, grid.ravel()[: len(entries)])
    return figure
