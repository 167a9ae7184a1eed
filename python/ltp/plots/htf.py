"""Harmonic transfer functions over input frequency: magnitude, phase, and how far an estimate is from a reference."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .decimate import Array, envelope, thin
from .style import COLORS, decade_ticks, hide_spines, label, new_figure, plain_ticks, shared_legend, styled

if TYPE_CHECKING:
    from ltp.htf import Htf

#: Colours of harmonics, in the order in which they are asked for.
SERIES = ("after", "before", "rival", "floor", "nominal")
#: Radius of the disc that holds a circular complex normal error with 95 % probability, in its sd: sqrt(5.9915 / 2).
RADIUS_95 = math.sqrt(5.991464547107979 / 2.0)
#: A logarithmic axis ends at this fraction of the largest value.
DEEPEST = 1e-5
#: No line has more points than this.
LIMIT = 1600


@styled
def htf_figure(
    htf: Htf,
    *,
    exact: Htf | None = None,
    harmonics: Sequence[int] = (0, 1, 2, -1, -2),
    output: int = 0,
    input: int = 0,
    unit: str = "",
) -> Figure:
    """Above magnitude, then phase of `H_k`; with `exact` also the error and the radius of its 95 % disc (dashed).

    Shaded: 95 % of the estimate's own uncertainty. Dashed in ink: the exact functions. Harmonics that `htf` lacks are
    left out, and no more than five are drawn. `unit` is that of output over input.
    """
    most = len(htf.values) // 2
    shown = [k for k in harmonics if -most <= k <= most][: len(SERIES)]
    figure = new_figure(5.6 if exact is None else 7.4)
    panels = figure.subplots(
        2 if exact is None else 3, 1, sharex=True, height_ratios=[1.5, 1.0, 1.1][: 2 + bool(exact)]
    )
    magnitude, phase = panels[0], panels[1]
    for color, k in zip((COLORS[role] for role in SERIES), shown, strict=False):
        values, hz = htf.harmonic(k, output, input), htf.omega / math.tau
        radius = None if htf.sd is None else RADIUS_95 * htf.sd[k + most, :, output, input]
        _magnitude(magnitude, hz, values, radius, color, f"k = {k}".replace("-", "−"))
        _phase(phase, hz, values, radius, color)
        if exact is not None:
            reference = exact.at(k, htf.omega, output, input)
            _dashed(magnitude, hz, np.abs(reference))
            _dashed(phase, *_broken(hz, np.angle(reference, deg=True)))
            _error(panels[2], hz, np.abs(values - reference), radius, color)
    if exact is not None:
        magnitude.plot([], [], color=COLORS["ink"], lw=0.9, ls=(0, (4, 2)), label="exact")
        panels[2].set_ylabel(label("error", unit))
        _logarithmic(panels[2])
    _logarithmic(magnitude)
    magnitude.set_ylabel(label("magnitude", unit))
    phase.set_ylabel("phase (°)")
    phase.set_ylim(-190, 190)
    phase.set_yticks([-180, -90, 0, 90, 180], ["−180", "−90", "0", "90", "180"])
    panels[-1].set_xlabel("input frequency (Hz)")
    panels[-1].set_xlim(float(htf.omega[0]) / math.tau, float(htf.omega[-1]) / math.tau)
    plain_ticks(panels[-1], y=None)
    for axes in panels:
        hide_spines(axes, "left", "bottom")
        axes.tick_params(axis="x", length=0)
        axes.tick_params(axis="y", which="minor", length=0)
    figure.align_ylabels(list(panels))
    shared_legend(figure, [magnitude])
    return figure


def _logarithmic(axes: Axes) -> None:
    """A logarithmic axis over what is drawn, down to a hundred-thousandth of the largest: zeros have no place on it."""
    drawn = np.concatenate([np.asarray(line.get_ydata(), dtype=float) for line in axes.lines])
    drawn = drawn[np.isfinite(drawn) & (drawn > 0)]
    high = float(drawn.max()) if len(drawn) else 1.0
    low = max(float(drawn.min()) if len(drawn) else 0.1, DEEPEST * high)
    decade_ticks(axes, low / 1.5, high * 1.5)


def _magnitude(
    axes: Axes, hz: Array, values: npt.NDArray[np.complex128], radius: Array | None, color: str, name: str
) -> None:
    size = np.abs(values)
    if radius is not None:
        keep = thin(len(hz), LIMIT)
        low = np.maximum(size - radius, 1e-3 * size)[keep]  # a disc around zero has no lower end on a logarithmic axis
        axes.fill_between(hz[keep], low, (size + radius)[keep], color=color, alpha=0.18, lw=0)
    axes.plot(*envelope(hz, size, LIMIT), color=color, lw=1.2, label=name)


def _phase(axes: Axes, hz: Array, values: npt.NDArray[np.complex128], radius: Array | None, color: str) -> None:
    angle = np.angle(values, deg=True)
    if radius is not None:
        keep = thin(len(hz), LIMIT)
        size = np.maximum(np.abs(values), np.finfo(float).tiny)
        half = np.degrees(np.arcsin(np.minimum(radius / size, 1.0)))
        half = np.where(radius >= size, 180.0, half)
        axes.fill_between(hz[keep], (angle - half)[keep], (angle + half)[keep], color=color, alpha=0.18, lw=0)
    axes.plot(*_broken(hz, angle), color=color, lw=1.2)


def _error(axes: Axes, hz: Array, error: Array, radius: Array | None, color: str) -> None:
    axes.plot(*envelope(hz, error, LIMIT), color=color, lw=1.0)
    if radius is not None:
        axes.plot(*envelope(hz, radius, LIMIT), color=color, lw=1.0, ls=(0, (3, 2)))


def _dashed(axes: Axes, hz: Array, values: Array) -> None:
    axes.plot(*envelope(hz, values, LIMIT), color=COLORS["ink"], lw=0.9, ls=(0, (4, 2)), zorder=5)


def _broken(hz: Array, angle: Array) -> tuple[Array, Array]:
    """A phase that is interrupted where it jumps from one end of the circle to the other."""
    keep = thin(len(hz), LIMIT)
    hz, angle = hz[keep], angle[keep]
    jumps = np.flatnonzero(np.abs(np.diff(angle)) > 180.0) + 1
    return np.insert(hz, jumps, np.nan), np.insert(angle, jumps, np.nan)
