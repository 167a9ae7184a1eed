"""The look that all figures share: colours by role, type sizes, quiet axes.

Figures are matplotlib ``Figure`` objects made without pyplot, so nothing is registered globally and no window opens.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from functools import wraps
from typing import Any, ParamSpec, TypeVar

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, MaxNLocator

from .decimate import Array
from .numbers import SUPERSCRIPT, minus

#: Colour of each role on a light page. No two roles share a value: the report turns each into a CSS variable of the
#: same name, and so the same figure is readable on a dark page. Chosen to stay apart for colour-blind readers.
COLORS = {
    "ink": "#1b1f24",
    "muted": "#646d77",
    "rule": "#e2e6ea",
    "nominal": "#98a0a8",
    "before": "#c4501a",
    "after": "#0b62b4",
    "rival": "#7f56b5",
    "floor": "#3d8a55",
}

RC: Any = {
    "font.family": ["DejaVu Sans"],
    "font.size": 9.0,
    "text.parse_math": False,  # names of users may hold a dollar sign
    "text.color": COLORS["ink"],
    "axes.edgecolor": COLORS["muted"],
    "axes.labelcolor": COLORS["ink"],
    "axes.labelsize": 9.0,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.unicode_minus": True,
    "axes.facecolor": "none",
    "figure.facecolor": "none",
    "grid.color": COLORS["rule"],
    "grid.linewidth": 0.7,
    "xtick.color": COLORS["muted"],
    "ytick.color": COLORS["muted"],
    "xtick.labelcolor": COLORS["ink"],
    "ytick.labelcolor": COLORS["ink"],
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "xtick.major.size": 3.0,
    "ytick.major.size": 0.0,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "lines.solid_joinstyle": "round",
    "path.simplify": True,
    "svg.fonttype": "none",
    "svg.hashsalt": "ltp",
}

#: Width of every figure, in inches.
WIDTH = 9.0

P = ParamSpec("P")
R = TypeVar("R")


def styled(draw: Callable[P, R]) -> Callable[P, R]:
    """Run ``draw`` with the house's settings of matplotlib, and put the caller's settings back afterwards."""

    @wraps(draw)
    def wrapped(*args: P.args, **kwargs: P.kwargs) -> R:
        with matplotlib.rc_context(RC):
            return draw(*args, **kwargs)

    return wrapped


def new_figure(height: float) -> Figure:
    """An empty figure of the common width and ``height`` in inches."""
    return Figure(figsize=(WIDTH, height), layout="constrained")


def label(name: str, unit: str) -> str:
    """Axis label: name and printed unit, e.g. ``velocity (m/s)``."""
    return f"{name} ({unit})" if unit else name


def figure_legend(figure: Figure, axes: Axes, swatches: dict[str, str] | None = None) -> None:
    """The labelled artists of ``axes``, or else ``swatches`` (label to colour), in one row above all panels."""
    handles, labels = axes.get_legend_handles_labels()
    if swatches is not None:
        handles, labels = [Patch(color=color) for color in swatches.values()], list(swatches)
    figure.legend(handles, labels, loc="outside upper left", ncols=4, handlelength=1.6, borderpad=0.1)


def shared_legend(figure: Figure, panels: Iterable[Axes]) -> None:
    """The labelled artists of all panels, each label once, in one row above them."""
    seen: dict[str, Any] = {}
    for axes in panels:
        handles, labels = axes.get_legend_handles_labels()
        seen |= {name: handle for name, handle in zip(labels, handles, strict=True) if name not in seen}
    figure.legend(list(seen.values()), list(seen), loc="outside upper left", ncols=6, handlelength=1.6, borderpad=0.1)


def plain_ticks(axes: Axes, x: int | None = 7, y: int | None = 5) -> None:
    """At most ``x`` and ``y`` intervals with plain decimal labels; ``None`` leaves that axis alone."""
    for axis, count in ((axes.xaxis, x), (axes.yaxis, y)):
        if count is not None:
            axis.set_major_locator(MaxNLocator(nbins=count, steps=[1, 2, 2.5, 5, 10]))
            axis.set_major_formatter(FuncFormatter(lambda value, _: minus(f"{value:.10g}")))


def decade_ticks(axes: Axes, low: float, high: float) -> None:
    """A logarithmic y axis from `low` to `high` with powers of ten in plain text, at most eight of them."""
    first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
    step = max(1, math.ceil((last - first) / 8))
    powers = range(last, first - 1, -step)
    axes.set_yscale("log")
    axes.set_yticks([10.0**k for k in powers], [f"10{str(k).translate(SUPERSCRIPT)}" for k in powers])
    axes.minorticks_off()
    axes.set_ylim(low, high)


def hide_spines(axes: Axes, *names: str) -> None:
    """Remove the named sides of the frame."""
    for name in names:
        axes.spines[name].set_visible(False)


def dots(axes: Axes, x: Array, y: Array, color: str, size: float = 2.2, alpha: float = 0.45) -> Line2D:
    """A cloud of points drawn as one path of dots with round caps: a tenth of the bytes that markers take in SVG."""
    good = np.isfinite(x) & np.isfinite(y)
    x, y = x[good], y[good]
    # A dot has a hundred-thousandth of the width of the panel, since some renderers drop a line of no length at all.
    length = 1e-5 * (float(np.ptp(x)) if len(x) else 1.0)
    across = np.column_stack([x, x + length, np.full(len(x), np.nan)]).ravel()
    up = np.column_stack([y, y, np.full(len(y), np.nan)]).ravel()
    with matplotlib.rc_context({"path.simplify": False}):
        (line,) = axes.plot(across, up, color=color, lw=size, alpha=alpha, solid_capstyle="round")
        line.get_path().should_simplify = False
    return line
