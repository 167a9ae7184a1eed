"""The head of the page: the verdict in one sentence, what was left out and where, and the errors at a glance."""

from __future__ import annotations

import math

from ltp.plots.numbers import as_number, parse_sentence, percent, quantity, shorten, significant

from ..markup import escape, paragraph, prose, table
from ..view import Json, View, dependence


def html(view: View) -> str:
    """The head as HTML."""
    kind = view.verdict if view.verdict.isalpha() else "unknown"
    return "\n".join(
        part
        for part in (
            f'<header class="verdict-{kind}">',
            f'<p class="verdict">{escape(view.title)}</p>',
            f"<h1>{prose(parse_sentence(view.sentence))}</h1>",
            f'<p class="facts">{escape(_facts(view))}</p>',
            "</header>",
            _tiles(view),
            _effects(view),
            *[f"<p>{prose(_where(location))}</p>" for location in view.locations],
            _alarm(view),
        )
        if part
    )


def _facts(view: View) -> str:
    facts = [f"Model {view.model_name}"]
    for held_out, word in ((False, "training"), (True, "held-out")):
        names = list(dict.fromkeys(str(e.get("record")) for e in view.fit_entries(held_out)))
        if names:
            shown = ", ".join(shorten(name) for name in names[:4]) + (
                f" and {len(names) - 4} more" if len(names) > 4 else ""
            )
            facts.append(f"{len(names)} {word} record{'s' if len(names) > 1 else ''} ({shown})")
    if math.isfinite(view.seconds):
        facts.append(f"computed in {significant(view.seconds, 2)} s")
    return " · ".join(facts)


def _tiles(view: View) -> str:
    return f'<div class="tiles">{_tile(view, True)}{_tile(view, False)}</div>'


def _tile(view: View, held_out: bool) -> str:
    rows = view.fit_entries(held_out)
    title = "Held-out records: simulation error" if held_out else "Training records: simulation error"
    if not rows:
        text = "None. Nothing on this page has been checked on data that the fit did not see." if held_out else "None."
        return f'<div class="tile"><h3>{title}</h3>{paragraph(text)}</div>'
    figures = (
        [("before", "refitted"), ("after", "with the effect" if view.effects else "with the law")]
        if view.added
        else [("nominal", "nominal"), ("before", "refitted")]
    )
    parts = [
        f'<div><dt>{label}</dt><dd class="{key}">{percent(pooled(rows, key))}</dd></div>'
        for key, label in [*figures, ("floor", "noise floor")]
    ]
    return f'<div class="tile"><h3>{title}</h3><dl>{"".join(parts)}</dl>{paragraph(_below(view, rows))}</div>'


def pooled(rows: list[Json], key: str) -> float:
    """Root mean square of a relative error over all rows; NaN when one of them is unknown."""
    values = [as_number(row.get(key)) for row in rows]
    return math.sqrt(sum(v * v for v in values) / len(values)) if values else math.nan


def _below(view: View, rows: list[Json]) -> str:
    if len(rows) > 1:
        return f"of the motion; root mean square over {len(rows)} outputs of records"
    row = rows[0]
    unit = str(row.get("unit") or "")
    before, after = quantity(row.get("rms_before"), unit), quantity(row.get("rms_after"), unit)
    if not math.isfinite(as_number(row.get("rms_before"))):
        return "of the motion"
    return f"of the motion; rms {before}" + (f" before, {after} after" if view.added else "")


def _effects(view: View) -> str:
    if not view.effects:
        return ""
    rows = []
    for effect in view.effects:
        values = effect.get("parameters")
        values = values if isinstance(values, dict) else {}
        text = ", ".join(
            f"{name} = {quantity(p.get('value'), p.get('unit'), p.get('sd'))}"
            for name, p in values.items()
            if isinstance(p, dict)
        )
        share = as_number(effect.get("share"))
        rows.append([str(effect.get("name")), str(effect.get("at")), text, percent(share)])
    head = [
        "best candidate" if view.verdict == "ambiguous" else "what was left out",
        "at",
        "its parameters",
        "share of the missing motion",
    ]
    return table(head, rows, text_columns=3)


def _alarm(view: View) -> str:
    """What physics forbids, said where nobody can miss it."""
    said = [f"{row.get('parameter')}: {row.get('forbidden')}" for row in view.absorbed if row.get("forbidden")]
    items = "".join(f"<li>{prose(text)}</li>" for text in said)
    return f'<ul class="warnings">{items}</ul>' if said else ""


def _where(location: Json) -> str:
    if location.get("sentence"):
        sentence = parse_sentence(str(location["sentence"])).strip().rstrip(".")
        return f"Where: {sentence}."
    kind, at = str(location.get("kind") or "port"), str(location.get("at") or "")
    parts = [f"Where: {kind} {at}"]
    if location.get("mode"):
        parts.append(f"in mode {location['mode']}")
    text = " ".join(parts)
    if location.get("variable"):
        text += f"; the missing {'force' if kind == 'port' else 'part'} depends on {dependence(location['variable'])}"
    phases = [_phase(p) for p in location.get("phases") or []]
    if phases:
        text += f"; at phase {', '.join(phases)} of the cycle"
    p_value = as_number(location.get("p_value"))
    if math.isfinite(p_value):
        text += f" (p {'< 0.001' if p_value < 0.001 else '= ' + significant(p_value, 2)})"
    return text + "."


def _phase(phase: object) -> str:
    """A phase of the cycle, or an interval of two."""
    ends = phase if isinstance(phase, (list, tuple)) else [phase]
    return " to ".join(significant(end, 2) for end in ends)
