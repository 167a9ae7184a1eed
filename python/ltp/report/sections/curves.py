"""Measured against simulated, for every held-out record, on the window that tells most."""

from __future__ import annotations

import math

import numpy as np

from ltp.plots import Curves, comparison, leaves_frame
from ltp.plots.numbers import as_number, percent, quantity, significant

from ..markup import Section, escape, figure
from ..view import Trace, View

#: Figures on a page, outputs of one record among them, and points of all their lines together.
MOST_FIGURES, MOST_OUTPUTS, POINT_BUDGET = 8, 4, 36_000


def section(view: View) -> Section | None:
    """One figure for each output of each held-out record; of the training records when none was held out."""
    held_out = [trace for trace in view.traces if trace.held_out]
    shown = held_out or view.traces
    if not shown:
        return None
    outputs = max(1, min(MOST_OUTPUTS, MOST_FIGURES // len(shown)))
    chosen = [(trace, curves) for trace in shown for curves in _worst(view, trace)[:outputs]][:MOST_FIGURES]
    limit = min(2000, POINT_BUDGET // (6 * len(chosen)))
    body = "\n".join(_figure(view, trace, curves, limit, i) for i, (trace, curves) in enumerate(chosen))
    total = sum(len(trace.curves) for trace in shown)
    title = "Measured and simulated, held-out" if held_out else "Measured and simulated, training records"
    return Section("curves", title, _sentence(view, bool(held_out), len(chosen), total), body)


def _sentence(view: View, held_out: bool, shown: int, total: int) -> str:
    text = (
        "These records took no part in the fit; only their initial state was estimated. "
        if held_out
        else ("No record was held out, so these are the records that were fitted. ")
    )
    text += "Each model runs freely over the whole record, driven by the recorded input alone"
    text += f"; the window shows where {view.effect_label} changes the error most." if view.added else "."
    if total > shown:
        text += f" {shown} of {total} outputs are drawn, those with the largest errors; the table above has all."
    return text


def _worst(view: View, trace: Trace) -> list[Curves]:
    """The outputs of a record, the one with the largest error before the effect first."""

    def error(curves: Curves) -> float:
        value = as_number(view.fit_of(trace.record, curves.output, trace.held_out).get("before"))
        return value if math.isfinite(value) else -1.0

    return sorted(trace.curves, key=error, reverse=True)


def _figure(view: View, trace: Trace, curves: Curves, limit: int, index: int) -> str:
    fit = view.fit_of(trace.record, curves.output, trace.held_out)
    floor = as_number(fit.get("floor"))
    drawing = comparison(curves, floor=floor, effect=view.short_effect, limit=limit)
    start, end = curves.window()
    first, last = float(curves.t[0]), float(curves.t[-1])
    whole = math.isclose(start, first) and math.isclose(end, last)
    seconds = (
        f"the whole record, {significant(last - first)} s"
        if whole
        else (f"{significant(start, 4)} to {significant(end, 4)} s of {significant(last - first)} s")
    )
    errors = [f"refitted {_error(fit, 'before', curves.unit)}"]
    if view.added:
        errors.append(f"with {view.short_effect} {_error(fit, 'after', curves.unit)}")
    caption = f"Shown: {seconds}. Error over the whole record: {', '.join(errors)}"
    caption += f", noise floor {percent(floor)} (green dashes: one sigma)." if math.isfinite(floor) else "."
    if leaves_frame(curves):
        caption += " The nominal curve leaves the frame."
    gaps = int(np.count_nonzero(~np.isfinite(curves.measured)))
    if gaps:
        caption += f" {gaps} of {len(curves.t)} samples are missing and count nowhere."
    heading = f"<h3>{escape(trace.record)}, output {escape(curves.output)}</h3>"
    spoken = f"Record {trace.record}, output {curves.output}: measured and simulated over time, residuals below."
    return heading + figure(drawing, f"curves{index}", f"{spoken} {caption}", caption)


def _error(fit: object, key: str, unit: str) -> str:
    row = fit if isinstance(fit, dict) else {}
    absolute = as_number(row.get(f"rms_{key}"))
    text = percent(as_number(row.get(key)))
    return f"{text} ({quantity(absolute, unit)} rms)" if math.isfinite(absolute) else text
