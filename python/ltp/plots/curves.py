"""Measured against simulated on a telling window of one record, with the residuals below."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .decimate import Array, envelope, finite_range
from .numbers import prefixed, shorten
from .style import COLORS, figure_legend, hide_spines, label, new_figure, plain_ticks, styled

#: Oscillations of the measured signal that a window shows, and the fewest samples worth showing.
CYCLES, FEWEST_SAMPLES = 6.0, 120


@dataclass(frozen=True)
class Curves:
    """One output of one record: time (s) and what was measured and simulated, each (n,), in ``unit``.

    ``after`` is ``None`` when no effect was added; NaN marks gaps and simulations that ended early.
    """

    output: str
    unit: str
    t: Array
    measured: Array
    nominal: Array
    before: Array
    after: Array | None

    def window(self) -> tuple[float, float]:
        """Start and end (s) of about six oscillations, where adding the effect changes the error most."""
        start, stop = _window(self.measured, self._relief())
        return float(self.t[start]), float(self.t[stop - 1])

    def best(self) -> Array:
        """The best model there is: with the effect, or else refitted, or else nominal."""
        if self.after is not None and np.isfinite(self.after).any():
            return self.after
        return self.before if np.isfinite(self.before).any() else self.nominal

    def _relief(self) -> Array:
        """Squared error that the effect (or, without one, the refit) removes, sample by sample."""
        worse = self.nominal if self.after is None else self.before
        relief = (self.measured - worse) ** 2 - (self.measured - self.best()) ** 2
        return np.nan_to_num(relief, nan=0.0, posinf=0.0, neginf=0.0)


def _window(measured: Array, relief: Array) -> tuple[int, int]:
    n = len(measured)
    finite = measured[np.isfinite(measured)]
    if n <= 2 * FEWEST_SAMPLES or len(finite) < 2:
        return 0, n
    # Half-cycles counted with hysteresis, so that noise around the mean does not count as motion.
    centred = (finite - finite.mean()) / (finite.std() or 1.0)
    side = np.sign(np.where(np.abs(centred) > 0.3, centred, 0.0))
    turns = int(np.count_nonzero(np.diff(side[side != 0])))
    if turns <= 3 * CYCLES:
        return 0, n
    length = max(FEWEST_SAMPLES, math.ceil(n * 2 * CYCLES / turns))
    if length >= n:
        return 0, n
    total = np.concatenate([[0.0], np.cumsum(relief)])
    start = int(np.argmax(total[length:] - total[:-length]))
    return start, start + length


@styled
def comparison(
    curves: Curves, *, floor: float = math.nan, effect: str = "the effect", whole: bool = False, limit: int = 2000
) -> Figure:
    """Above: measured, nominal, refitted and with the effect. Below: the residuals, and one sigma of the noise floor.

    ``floor`` is relative (rms over the standard deviation of the measured output), as in ``Diagnosis.fit``; ``whole``
    shows the whole record instead of :meth:`Curves.window`; no line has more than ``limit`` points.
    """
    start, end = (float(curves.t[0]), float(curves.t[-1])) if whole else curves.window()
    inside = (curves.t >= start) & (curves.t <= end)
    t, measured = curves.t[inside], curves.measured[inside]
    best, before, nominal = curves.best()[inside], curves.before[inside], curves.nominal[inside]

    figure = new_figure(4.4)
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=[1.5, 1.0])
    low, high = _frame(measured, best, before, nominal)
    factor, unit = prefixed(curves.unit, max(abs(low), abs(high)))

    lines = [("measured", measured, COLORS["ink"], 3.6, "-", 0.33)]
    lines.append(("nominal", nominal, COLORS["nominal"], 1.1, "--", 1))
    if np.isfinite(before).any():
        lines.append(("refitted", before, COLORS["before"], 1.1, "-", 1))
    if curves.after is not None:
        lines.append((f"with {shorten(effect)}", curves.after[inside], COLORS["after"], 1.1, "-", 1))
    for name, y, color, width, style, alpha in lines:
        upper.plot(*envelope(t, y * factor, limit), color=color, lw=width, ls=style, alpha=alpha, label=name)
    margin = 0.05 * (high - low or 1.0)
    upper.set_ylim((low - margin) * factor, (high + margin) * factor)
    upper.set_ylabel(label(shorten(curves.output, 24), unit))
    figure_legend(figure, upper)

    _residuals(lower, curves, inside, floor, limit)
    lower.set_xlabel("time (s)")
    lower.set_xlim(start, end if end > start else start + 1.0)
    for axes in (upper, lower):
        hide_spines(axes, "left", "bottom")
        plain_ticks(axes, y=5 if axes is upper else 4)
    upper.tick_params(axis="x", length=0)
    figure.align_ylabels([upper, lower])
    return figure


def leaves_frame(curves: Curves) -> bool:
    """Whether the nominal curve runs out of the frame that :func:`comparison` draws."""
    start, end = curves.window()
    inside = (curves.t >= start) & (curves.t <= end)
    nominal = curves.nominal[inside]
    low, high = _frame(curves.measured[inside], curves.best()[inside], curves.before[inside], nominal)
    lowest, highest = finite_range(nominal)
    return lowest < low or highest > high


def _frame(measured: Array, best: Array, before: Array, nominal: Array) -> tuple[float, float]:
    """Range that shows the measurement and the best model whole, and the others as far as they stay near."""
    low, high = finite_range(measured, best) if np.isfinite(measured).any() else finite_range(best, before)
    reach = 0.6 * (high - low)
    lowest, highest = finite_range(measured, best, before, nominal)
    return max(low - reach, lowest), min(high + reach, highest)


def _residuals(axes: Axes, curves: Curves, inside: np.ndarray, floor: float, limit: int) -> None:
    t, measured = curves.t[inside], curves.measured[inside]
    rows = [(curves.before, COLORS["before"], 1.0), (curves.after, COLORS["after"], 1.0)]
    if curves.after is None:
        rows.insert(0, (curves.nominal, COLORS["nominal"], 0.9))
    shown = [(measured - y[inside], color, width) for y, color, width in rows if y is not None]
    # The range follows the refitted and the best model; the nominal one is shown as far as it stays near.
    low, high = finite_range(*[residual for residual, color, _ in shown if color != COLORS["nominal"]])
    lowest, highest = finite_range(*[residual for residual, *_ in shown])
    reach = high - low
    low, high = (max(low - reach, lowest), min(high + reach, highest)) if reach else (lowest, highest)
    factor, unit = prefixed(curves.unit, max(abs(low), abs(high)))
    finite = curves.measured[np.isfinite(curves.measured)]
    if math.isfinite(floor) and floor > 0 and len(finite):
        sigma = floor * float(finite.std()) * factor
        for level in (-sigma, sigma):  # above the curves: noisy residuals would hide a band behind them
            axes.axhline(level, color=COLORS["floor"], lw=1.2, ls=(0, (4, 2)), zorder=5)
        low, high = min(low, -sigma / factor), max(high, sigma / factor)
    axes.axhline(0, color=COLORS["muted"], lw=0.7)
    for residual, color, width in shown:
        axes.plot(*envelope(t, residual * factor, limit), color=color, lw=width)
    margin = 0.06 * (high - low or 1.0)
    axes.set_ylim((low - margin) * factor, (high + margin) * factor)
    axes.set_ylabel(label("residual", unit))
