"""A periodic orbit: its cross-section in two states, and those states over one period, coloured by mode."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .decimate import Array, finite_range
from .numbers import prefixed, pretty_unit, shorten
from .style import COLORS, hide_spines, label, new_figure, plain_ticks, shared_legend, styled

#: Colours of modes, in the order in which they are visited.
MODES = ("before", "after", "rival", "floor", "nominal")


@dataclass(frozen=True)
class Curve:
    """One state over a period: its name, its unit, its samples (n,)."""

    name: str
    unit: str
    values: Array


@styled
def orbit(
    phase: Array,
    mode: Sequence[str],
    across: Curve,
    up: Curve,
    *,
    others: Sequence[Curve] = (),
    events: Mapping[str, float] | None = None,
) -> Figure:
    """Left: `up` against `across` along the orbit. Right: `across` and `others` over the phase in [0, 1).

    `mode` names the mode at each sample; `events` are names with their phases, marked on the right.
    """
    figure = new_figure(3.7)
    left, right = figure.subplots(1, 2, width_ratios=[1.0, 1.15])
    names = list(dict.fromkeys(mode))
    colors = {name: COLORS[MODES[k % len(MODES)]] for k, name in enumerate(names)}
    labels = np.asarray(mode)
    factor, unit = prefixed(across.unit, float(np.abs(across.values).max()))
    for name in names:
        inside = labels == name
        left.plot(*_parts(across.values * factor, up.values, inside), color=colors[name], lw=1.8, label=shorten(name))
        for k, curve in enumerate((across, *others)):
            style = "-" if k == 0 else (0, (4, 2))
            right.plot(
                *_parts(phase, curve.values * factor, inside), color=colors[name], lw=1.8 - 0.5 * (k > 0), ls=style
            )
    left.set_xlabel(label(shorten(across.name), unit))
    left.set_ylabel(label(shorten(up.name), pretty_unit(up.unit)))
    right.set_xlabel("phase of the cycle")
    drawn = " and ".join([shorten(across.name), *(f"{shorten(curve.name)} (dashed)" for curve in others)])
    right.set_ylabel(label(drawn, unit))
    right.set_xlim(0.0, 1.0)
    low, high = finite_range(*[curve.values * factor for curve in (across, *others)])
    right.set_ylim(low - 0.05 * (high - low), high + 0.18 * (high - low))
    for name, at in (events or {}).items():
        _mark(right, name, at)
    for axes in (left, right):
        hide_spines(axes, "left", "bottom")
        plain_ticks(axes, x=5, y=5)
        axes.tick_params(axis="x", length=0)
    shared_legend(figure, [left])
    return figure


def _parts(x: Array, y: Array, inside: np.ndarray) -> tuple[Array, Array]:
    """The samples of one mode and the one after it, so that pieces meet; NaN elsewhere."""
    keep = inside | np.roll(inside, 1)
    keep[0] = inside[0]  # the last piece does not run back across the figure
    return np.where(keep, x, np.nan), np.where(keep, y, np.nan)


def _mark(axes: Axes, name: str, phase: float) -> None:
    axes.axvline(phase, color=COLORS["muted"], lw=0.8, ls=(0, (2, 2)), zorder=1)
    late = phase > 0.6
    axes.annotate(
        f"{shorten(name, 18)} {phase:.4f}",
        (phase, 1.0),
        xycoords=axes.get_xaxis_transform(),
        xytext=(-4 if late else 4, -3),
        textcoords="offset points",
        fontsize=8,
        ha="right" if late else "left",
        va="top",
        color=COLORS["muted"],
    )
