"""What the nominal parameters absorbed: how far they had to bend to make up for what was missing."""

from __future__ import annotations

import math

from ltp.plots import Shift, absorbed
from ltp.plots.numbers import MISSING, as_number, minus, pretty_unit, quantity, significant, with_unit

from ..markup import Section, figure, table
from ..view import Json, View

#: More parameters than this are in the table only.
MOST_ROWS = 20


def section(view: View) -> Section | None:
    """Shifts in stated sigmas as arrows, and all values in a table."""
    if not view.parameters:
        return None
    shifts = sorted(
        (shift for name, row in view.parameters.items() if (shift := _shift(view, name, row)) is not None),
        key=lambda s: -abs(s.before) if math.isfinite(s.before) else 0.0,
    )
    title = "What the parameters absorbed" if view.added else "The parameters"
    body = ""
    if shifts:
        caption = f"The {MOST_ROWS} largest of {len(shifts)} shifts." if len(shifts) > MOST_ROWS else ""
        drawing = absorbed(shifts[:MOST_ROWS], view.short_effect)
        body = figure(drawing, "absorbed", f"Shifts of the parameters. {_sentence(view, shifts)}", caption)
    return Section("parameters", title, _sentence(view, shifts), body + _table(view))


def _shift(view: View, name: str, row: Json) -> Shift | None:
    """The shift of a parameter, or ``None`` for one that is exact or has no stated uncertainty."""
    sd, nominal = as_number(row.get("nominal_sd")), as_number(row.get("nominal"))
    if not (math.isfinite(sd) and sd > 0 and math.isfinite(nominal)):
        return None
    before, after = (as_number(row.get(key)) for key in ("before", "after"))
    return Shift(
        name, (before - nominal) / sd, (after - nominal) / sd if view.added else math.nan, as_number(row.get("sd")) / sd
    )


def _sentence(view: View, shifts: list[Shift]) -> str:
    if not shifts:
        return "No parameter has a stated uncertainty, so none of them could absorb anything."
    first = shifts[0]
    size = significant(abs(first.before), 2)
    if not view.added:
        if view.verdict == "parameter":
            return f"{first.name} is off: it moved by {size} stated standard deviations, and then the model fits."
        return f"No parameter had to move by more than {size} stated standard deviations."
    soaked = view.absorbed
    if soaked:
        return _alarm(soaked)
    text = f"Without the effect, {first.name} had to move by {size} stated standard deviations to make up for it"
    if math.isfinite(first.after):
        text += f"; with the effect, by {significant(abs(first.after), 2)}"
    return text + "."


def _alarm(soaked: list[Json]) -> str:
    """The absorption alarm in a sentence: what looked like these parameters, and by how much."""
    parts = []
    for row in soaked[:3]:
        unit, sigmas = str(row.get("unit") or ""), significant(as_number(row.get("sigmas")), 2)
        before, after = (quantity(row.get(key), unit, None, 4) for key in ("before", "after"))
        parts.append(f"{row.get('parameter')} ({before} instead of {after}: {sigmas} of its standard deviations)")
    more = f" and {len(soaked) - 3} more" if len(soaked) > 3 else ""
    return f"Before it had a name, what was missing hid in {', '.join(parts)}{more}."


def _table(view: View) -> str:
    rows = []
    for name, row in view.parameters.items():
        unit = str(row.get("unit") or "")
        stated_sd = as_number(row.get("nominal_sd"))
        exact = not (math.isfinite(stated_sd) and stated_sd > 0)
        stated = _exact(row.get("nominal"), unit) if exact else quantity(row.get("nominal"), unit, stated_sd)
        before = quantity(row.get("before"), unit, None, 4)
        final = quantity(row.get("after" if view.added else "before"), unit, row.get("sd"), 4)
        shift = _shift(view, name, row)
        moved = [_sigmas(shift.before if shift else math.nan)]
        if view.added:
            moved.append(_sigmas(shift.after if shift else math.nan))
        rows.append([name, stated, *([before, final] if view.added else [final]), *moved])
    head = ["parameter", "stated", "refitted", *(["with the effect"] if view.added else [])]
    head += ["shift refitted", "shift with it"] if view.added else ["shift"]
    return table(head, rows)


def _exact(value: object, unit: str) -> str:
    number = as_number(value)
    return f"{with_unit(minus(f'{number:.6g}'), pretty_unit(unit))} (exact)" if math.isfinite(number) else MISSING


def _sigmas(value: float) -> str:
    if not math.isfinite(value):
        return MISSING
    return f"{'+' if value > 0 else ''}{significant(value, 2)}\u00a0σ"
