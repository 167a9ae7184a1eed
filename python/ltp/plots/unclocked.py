"""What an unclocked recording says: its mean cycle, how an input acts at each phase, and what held-out runs confirm."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .decimate import Array, envelope
from .style import COLORS, figure_legend, hide_spines, label, new_figure, plain_ticks, styled

#: Half-width of a band, in standard deviations or errors: about 95 % when many groups are behind it, 90 % with a dozen.
BAND = 2.0


@dataclass(frozen=True)
class MeanCycle:
    """One channel over phase: `mean`, `spread` of single cycles and `standard_error` of the mean, each (m,)."""

    name: str
    unit: str
    phase: Array
    mean: Array
    spread: Array
    standard_error: Array


@dataclass(frozen=True)
class Action:
    """What an input does to an output, by the `phase` (m,) at which it acts: `value` (m,) with `sd` (m,).

    `levels` are values to compare with, by the words of their label.
    """

    name: str
    unit: str
    phase: Array
    value: Array
    sd: Array
    levels: Mapping[str, float]


@dataclass(frozen=True)
class Trial:
    """A held-out stretch: time (s), what was measured, and predictions by their label, all (n,); NaN where none is.

    `errors` holds the rms error in every run, (runs,), by label: first those of the predictions, then of any others.
    The first prediction is the one that is claimed.
    """

    name: str
    unit: str
    t: Array
    measured: Array
    predictions: Mapping[str, Array]
    errors: Mapping[str, Array]


def _marks(axes: Axes, marks: tuple[float, ...]) -> None:
    for mark in marks[1:-1]:
        axes.axvline(mark, color=COLORS["muted"], lw=0.8, ls=(0, (2, 2)), zorder=1)
    axes.set_xlim(0, 1)
    axes.set_xlabel("phase of the cycle")
    hide_spines(axes, "left", "bottom")


@styled
def mean_cycle(cycle: MeanCycle, action: Action, marks: tuple[float, ...]) -> Figure:
    """Left: the mean cycle with the spread of single cycles and the band of the mean. Right: the action of the input.

    Dashed verticals are the events inside a cycle, at their phases in `marks`.
    """
    figure = new_figure(3.1)
    left, right = figure.subplots(1, 2)
    for width, alpha, text in (
        (cycle.spread, 0.13, "single cycles, ± 1 sd"),
        (BAND * cycle.standard_error, 0.33, None),
    ):
        band = text or "95 % band of the mean"
        _filled(left, cycle.phase, cycle.mean, width, marks, alpha=alpha, label=band)
    for part in _parts(cycle.phase, marks):
        left.plot(cycle.phase[part], cycle.mean[part], color=COLORS["after"], lw=1.4)
    left.set_ylabel(label(cycle.name, cycle.unit))
    _marks(left, marks)
    plain_ticks(left)

    _filled(right, action.phase, action.value, BAND * action.sd, marks, alpha=0.33)
    for part in _parts(action.phase, marks):
        right.plot(action.phase[part], action.value[part], color=COLORS["after"], lw=1.4)
    for (text, level), color in zip(action.levels.items(), (COLORS["before"], COLORS["floor"]), strict=False):
        right.axhline(level, color=color, lw=1.3, ls=(0, (4, 2)), label=text)
    right.set_ylim(bottom=0)
    right.set_ylabel(label(action.name, action.unit))
    _marks(right, marks)
    plain_ticks(right)
    left.legend(loc="upper center", borderpad=0.1)
    right.legend(loc="lower center", borderpad=0.1)
    return figure


def _parts(phase: Array, marks: tuple[float, ...]) -> list[np.ndarray]:
    """Indices between neighbouring events: nothing is drawn through a jump."""
    edges = np.searchsorted(phase, marks)
    return [np.arange(a, b) for a, b in pairwise(edges)]


def _filled(axes: Axes, phase: Array, centre: Array, width: Array, marks: tuple[float, ...], **look: Any) -> None:
    for part in _parts(phase, marks):
        low, high = centre[part] - width[part], centre[part] + width[part]
        axes.fill_between(phase[part], low, high, color=COLORS["after"], lw=0, **look)
        look.pop("label", None)


@styled
def held_out_runs(trial: Trial, limit: int = 2000) -> Figure:
    """Left: errors of the predictions on a held-out stretch. Right: the error in every run, by kind of prediction."""
    figure = new_figure(2.9)
    left, right = figure.subplots(1, 2, width_ratios=[1.9, 1.0])
    looks = dict(zip(trial.errors, (COLORS["after"], COLORS["before"], COLORS["nominal"]), strict=True))
    left.axhline(0, color=COLORS["muted"], lw=0.7)
    for text, values in reversed(list(trial.predictions.items())):
        left.plot(*envelope(trial.t, trial.measured - values, limit), color=looks[text], lw=1.3)
    left.set_xlim(float(trial.t[0]), float(trial.t[-1]))
    left.set_xlabel("time (s)")
    left.set_ylabel(label(trial.name, trial.unit))
    runs = np.arange(1, len(next(iter(trial.errors.values()))) + 1)
    for text, values in reversed(list(trial.errors.items())):
        right.plot(runs, values, "o", ms=5.0, color=looks[text])
    right.set_ylim(bottom=0)
    right.set_xlabel("run, held out")
    right.set_ylabel(label("rms error", trial.unit))
    for axes in (left, right):
        hide_spines(axes, "left", "bottom")
        plain_ticks(axes)
    right.set_xticks(runs[:: max(1, -(-len(runs) // 12))])
    figure_legend(figure, left, looks)
    return figure
