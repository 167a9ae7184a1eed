"""How well the model fits: every output of every record, held-out records first."""

from __future__ import annotations

from ltp.plots import errors
from ltp.plots.numbers import as_number, percent, quantity

from ..markup import Section, details, figure, table
from ..view import View
from .headline import pooled

#: More rows than this are in the table only.
MOST_ROWS = 24


def section(view: View) -> Section | None:
    """Errors before and after against the noise floor."""
    rows = view.error_rows
    if not rows:
        return None
    drawing = errors(rows[:MOST_ROWS], view.short_effect)
    caption = ""
    if len(rows) > MOST_ROWS:
        caption = f"The first {MOST_ROWS} of {len(rows)} outputs of records; all are in the table."
    body = figure(drawing, "errors", f"Simulation errors. {_sentence(view)}", caption)
    return Section("fit", "How well it fits", _sentence(view), body + details("The same as a table", _table(view)))


def _sentence(view: View) -> str:
    held_out = bool(view.fit_entries(True))
    rows = view.fit_entries(held_out)
    where = "On the held-out records" if held_out else "On the training records (there are no held-out ones)"
    nominal, before, after, floor = (percent(pooled(rows, key)) for key in ("nominal", "before", "after", "floor"))
    if view.added:
        text = (
            f"{where}, the nominal structure leaves {before} of the motion unexplained after its parameters have been "
            f"refitted; with {view.effect_label} {after} is left."
        )
    else:
        text = f"{where}, the nominal values leave {nominal} of the motion unexplained, the refitted ones {before}."
    return f"{text} The noise alone accounts for {floor}."


def _table(view: View) -> str:
    rows = []
    for held_out in (True, False):
        for e in view.fit_entries(held_out):
            unit = str(e.get("unit") or "")
            keys = ["nominal", "before", *(["after"] if view.added else []), "floor"]
            absolute = quantity(e.get("rms_after" if view.added else "rms_before"), unit)
            start = quantity(e.get("rms_before"), unit) if view.added else ""
            rows.append(
                [str(e.get("record")), str(e.get("output")), "held-out" if held_out else "training"]
                + [percent(as_number(e.get(key))) for key in keys]
                + ([start, absolute] if view.added else [absolute])
            )
    head = ["record", "output", "role", "nominal", "refitted", *(["with effect"] if view.added else []), "noise floor"]
    head += ["rms refitted", "rms with effect"] if view.added else ["rms refitted"]
    return table(head, rows, text_columns=3)
