"""The ranking: every candidate that was tried, and the set that the recordings cannot tell apart."""

from __future__ import annotations

import math

from ltp.plots import ranking
from ltp.plots.numbers import significant

from ..markup import Section, details, figure, table
from ..view import View

#: More candidates than this are in the table only; the nominal model is always drawn.
MOST_BARS = 14

_STANDING = {"named": "named", "rival": "cannot be told apart", "nothing": "nominal model", "other": ""}


def section(view: View) -> Section | None:
    """Bars of the score above the best."""
    candidates = view.candidates
    if not candidates:
        return None
    ranked = [c for c in candidates if math.isfinite(c.score)] or candidates
    drawn = [c for i, c in enumerate(ranked) if i < MOST_BARS or c.standing != "other"]
    caption = "Score: misfit on training and held-out records plus a charge for each parameter; smaller is better."
    if len(drawn) < len(ranked):
        caption += f" {len(ranked) - len(drawn)} further candidates are in the table."
    if len(ranked) < len(candidates):
        caption += f" {len(candidates) - len(ranked)} have no score; the table says why."
    rows = [
        [c.name, _STANDING[c.standing] or c.note, significant(c.score), significant(c.held_out)] for c in candidates
    ]
    every = table(["candidate", "standing", "score above the best", "held-out score"], rows, text_columns=2)
    body = figure(ranking(drawn), "ranking", f"Ranking of the candidates. {_sentence(view)}", caption)
    return Section("ranking", "What else was tried", _sentence(view), body + details("All candidates", every))


def _sentence(view: View) -> str:
    candidates = view.candidates
    rivals = [c.name for c in candidates if c.standing == "rival"]
    nothing = next((c for c in candidates if c.standing == "nothing"), None)
    best = candidates[0]
    if view.verdict in ("consistent", "parameter"):
        other = next((c for c in candidates if c.standing != "nothing"), None)
        text = "No candidate earned a place in the model"
        return f"{text}; the best of them was {other.name}." if other else f"{text}."
    apart = ""
    if nothing is not None and math.isfinite(nothing.score) and nothing is not best:
        apart = f" The nominal model alone is worse by {significant(nothing.score)}."
    if view.verdict == "unknown":
        return f"No named effect reaches the noise floor; the closest is {best.name}.{apart}"
    if rivals:
        names = rivals[:5] + ([f"{len(rivals) - 5} more"] if len(rivals) > 5 else [])
        text = (
            "These recordings cannot tell these apart: "
            if view.verdict == "ambiguous"
            else (f"{best.name} comes first, but these recordings cannot tell it from ")
        )
        return text + ", ".join(names) + f".{apart}"
    second = next((c for c in candidates[1:] if c.standing == "other"), None)
    text = f"{best.name} explains the recordings best"
    if second is not None:
        text += f"; the next, {second.name}, scores worse by {significant(second.score)}"
    return f"{text}.{apart}"
