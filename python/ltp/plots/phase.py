"""Where in the cycle the missing force acts, one colour for each mode.

Over the phase of the clock; in a model without one, over the time since its mode was entered.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .decimate import Array, thin
from .force import Force, Units, force_range
from .numbers import prefixed, shorten
from .style import COLORS, dots, figure_legend, hide_spines, label, new_figure, plain_ticks, styled

#: One colour for each mode, in the order in which they were passed through; more modes than colours share the last.
MODE_COLORS = (COLORS["after"], COLORS["before"], COLORS["floor"], COLORS["rival"], COLORS["nominal"])

_BINS = 40


@styled
def force_over_phase(
    forces: Sequence[Force], *, units: Units | None = None, phases: Sequence[float] = (), points: int = 2500
) -> Figure:
    """Samples of the missing force over phase, the median and the middle half of each bin; `phases` are marked.

    `forces` must not be empty. A strip below says which mode holds when. Where a force has no `phase`, the time since
    its mode was entered takes its place (s); what comes before the first change of mode is left out.
    """
    units = units or Units()
    figure = new_figure(3.4)
    axes, strip = figure.subplots(2, 1, sharex=True, height_ratios=[12, 1])
    low, high = force_range(list(forces), None)
    factor, unit = prefixed(units.force, max(abs(low), abs(high)))
    clocked = all(f.phase is not None for f in forces)
    phase = np.concatenate([f.phase if clocked and f.phase is not None else since_event(f) for f in forces])
    end = 1.0 if clocked else float(np.nanquantile(phase, 0.98)) if np.isfinite(phase).any() else 1.0
    force = np.concatenate([f.force for f in forces])
    names = list(dict.fromkeys(name for f in forces for name in f.modes))
    mode = np.concatenate([_codes(f, names) for f in forces])
    some = thin(len(phase), points)
    dots(axes, phase[some], force[some] * factor, COLORS["nominal"], size=2.0).set_label("sample by sample")
    for code, name in enumerate(names or [""]):
        color = MODE_COLORS[min(code, len(MODE_COLORS) - 1)] if len(names) > 1 else COLORS["ink"]
        meaning = f"median, {shorten(name)}" if name else "median"
        _bins(axes, phase[mode == code], force[mode == code] * factor, end, color, meaning)
        _strip(strip, phase[mode == code], end, color)
    for at in phases:
        axes.axvline(at, color=COLORS["ink"], lw=1.0, ls=(0, (4, 3)), zorder=5)
    axes.axhline(0, color=COLORS["muted"], lw=0.7, zorder=1)
    axes.set_ylim(low * factor, high * factor)
    axes.set_xlim(0, end)
    axes.set_ylabel(label(forces[0].word("force"), unit))
    hide_spines(axes, "left", "bottom")
    plain_ticks(axes, x=None, y=6)
    axes.tick_params(axis="x", length=0)
    hide_spines(strip, "left", "bottom")
    strip.set_ylim(0, 1)
    strip.set_yticks([])
    strip.grid(visible=False)
    what = "phase of the cycle; the strip shows the mode" if clocked else "time since the mode was entered (s)"
    strip.set_xlabel(what)
    plain_ticks(strip, x=10, y=None)
    figure_legend(figure, axes)
    return figure


def _codes(force: Force, names: list[str]) -> Array:
    """The mode of each sample as its place in `names`; 0 throughout where modes are not known."""
    if force.mode is None or not force.modes:
        return np.zeros(len(force.t))
    places = np.array([names.index(name) for name in force.modes], dtype=np.float64)
    return np.asarray(places[np.clip(force.mode.astype(int), 0, len(places) - 1)])


def since_event(force: Force) -> Array:
    """Time since the mode was entered (n,), s; NaN before the first change."""
    if force.mode is None:
        return np.full(len(force.t), np.nan)
    entered = np.flatnonzero(np.diff(force.mode)) + 1
    last = np.searchsorted(entered, np.arange(len(force.t)), side="right") - 1
    begins = force.t[entered[np.maximum(last, 0)]] if len(entered) else np.zeros(len(force.t))
    return np.asarray(np.where(last >= 0, force.t - begins, np.nan))


def _bins(axes: Axes, phase: Array, force: Array, end: float, color: str, name: str) -> None:
    edges = np.linspace(0, end, _BINS + 1)
    known = np.isfinite(phase) & (phase <= end) & np.isfinite(force)
    where = np.clip(np.digitize(phase[known], edges) - 1, 0, _BINS - 1)
    centre = 0.5 * (edges[:-1] + edges[1:])
    low, middle, high = (np.full(_BINS, np.nan) for _ in range(3))
    for k in range(_BINS):
        inside = force[known][where == k]
        if len(inside) >= 3:
            low[k], middle[k], high[k] = np.percentile(inside, [25, 50, 75])
    axes.fill_between(centre, low, high, color=color, alpha=0.25, lw=0, zorder=3)
    axes.plot(centre, middle, color=color, lw=1.8, zorder=4, label=name)


def _strip(axes: Axes, phase: Array, end: float, color: str) -> None:
    """A bar over the bins in which the mode was seen more than now and then."""
    count, edges = np.histogram(phase[np.isfinite(phase)], bins=100, range=(0, end))
    most = count.max() if len(count) else 0
    for left, n in zip(edges[:-1], count, strict=True):
        if n > 0.05 * most:
            axes.axvspan(left, left + 0.0102 * end, color=color, lw=0)
