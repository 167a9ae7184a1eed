"""The harmonic map as a picture: cells of harmonic and frequency, bright where the machine is not the model."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.image import AxesImage

from .numbers import minus
from .style import COLORS, hide_spines, new_figure, styled

if TYPE_CHECKING:
    from ltp.harmonic import HarmonicMap

#: From the page (noise) to the colour of what the nominal model leaves.
_SCALE = LinearSegmentedColormap.from_list("above noise", [COLORS["rule"], "#f3c9b4", COLORS["before"], "#5e2207"])
#: The scale ends here, in standard deviations.
TOP = 10.0


@styled
def harmonic_map_figure(found: HarmonicMap) -> Figure:
    """One panel for each output and input; below, when events happen against when they should."""
    pairs = [(y, u) for y in range(len(found.outputs)) for u in range(len(found.inputs))]
    rows = len(found.harmonics)
    heights = [0.5 + 0.26 * rows] * len(pairs) + ([0.45 + 0.28 * len(found.events)] if found.events else [])
    figure = new_figure(0.8 + sum(heights))
    panels = list(np.atleast_1d(figure.subplots(len(heights), 1, height_ratios=heights)))
    image: AxesImage | None = None
    for axes, (y, u) in zip(panels, pairs, strict=False):
        image = _map(axes, found, y, u)
    if image is not None:
        bar = figure.colorbar(image, ax=panels[: len(pairs)], pad=0.01, fraction=0.03, extend="max")
        bar.set_label("standard deviations")
        bar.outline.set_visible(False)
    if found.events:
        _events(panels[-1], found)
    return figure


def _map(axes: Axes, found: HarmonicMap, y: int, u: int) -> AxesImage:
    n = len(found.omega)
    image = axes.imshow(
        found.z[y, u], aspect="auto", origin="lower", cmap=_SCALE, vmin=0.0, vmax=TOP, interpolation="none"
    )
    axes.set_yticks(range(len(found.harmonics)), [minus(f"{k:d}") for k in found.harmonics])
    shown = np.unique(np.linspace(0, n - 1, min(n, 8)).round().astype(int))
    axes.set_xticks(shown, [f"{found.omega[i] / math.tau:.2g}" for i in shown])
    axes.set_ylabel("harmonic k")
    axes.set_xlabel("input frequency (Hz), line by line")
    axes.set_title(f"{found.inputs[u]} to {found.outputs[y]}: recording minus model", loc="left", fontsize=9)
    axes.grid(visible=False)
    axes.tick_params(length=0)
    hide_spines(axes, "left", "bottom")
    return image


def _events(axes: Axes, found: HarmonicMap) -> None:
    """A dot with its 95 % bar for each kind of event in each record; zero is when the model says."""
    for row, event in enumerate(found.events):
        off = abs(event.residual_s) > 4 * event.sd_s
        color = COLORS["before"] if off else COLORS["nominal"]
        axes.errorbar(1e3 * event.residual_s, row, xerr=2e3 * event.sd_s, fmt="o", ms=5, color=color, lw=1.2)
    names = [
        f"{event.name} ({event.record})" + ("" if event.phase is None else f", phase {event.phase:.2f}")
        for event in found.events
    ]
    axes.axvline(0.0, color=COLORS["ink"], lw=0.8, ls=(0, (4, 2)))
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.set_xlabel("event comes later than predicted by (ms); bars: 95 %")
    axes.grid(axis="y", visible=False)
    axes.tick_params(axis="y", length=0)
    hide_spines(axes, "left", "bottom")
