"""The experiments that would tell apart what these recordings cannot, the best first."""

from __future__ import annotations

from ltp.plots.numbers import as_number, parse_sentence, significant

from ..markup import Section, table
from ..view import View

#: A difference of deviance that decides.
DECISIVE = 10.0


def section(view: View) -> Section | None:
    """A table of experiments with what they promise; nothing when nothing is ambiguous."""
    if not view.separate and not (view.verdict == "ambiguous" and view.rivals):
        return None
    title = "What would tell them apart"
    if not view.separate:
        return Section("separate", title, "No change of the experiment was found that would tell these apart.")
    rows = [
        [
            parse_sentence(str(row.get("sentence") or "")),
            ", ".join(str(one).replace("@", " at ") for one in row.get("separates") or []),
            significant(as_number(row.get("gain")), 2),
        ]
        for row in view.separate
    ]
    sentence = (
        "Predicted with the fitted rivals: the difference in deviance that each experiment would make between them. "
        f"More than {DECISIVE:g} decides."
    )
    head = ["experiment", "tells apart", "promised difference"]
    return Section("separate", title, sentence, table(head, rows, text_columns=2))
