"""For machines with a clock: where in harmonics and frequency recordings and model differ, and which events are off."""

from __future__ import annotations

import math

from ltp.plots.harmonic_map import harmonic_map_figure
from ltp.plots.numbers import as_number, significant

from ..markup import Section, figure
from ..view import View


def section(view: View) -> Section | None:
    """The harmonic map, where the recordings give one."""
    found = view.harmonic
    if found is None:
        return None
    caption = (
        "Each cell compares the answers of the machine and of the refitted nominal model to an input of one frequency: "
        "row k is the part of the answer that the clock shifts by k times its own frequency, "
        f"{significant(1.0 / found.period, 3)} Hz. Colour is their distance in standard deviations, known from "
        "what does not repeat."
    )
    if found.events:
        caption += " Below: when events happen, against when the model has them."
    spoken = f"Harmonic map: cells of harmonic and frequency. {found.sentence}"
    return Section(
        "harmonic",
        "Harmonic by harmonic",
        _sentence(view),
        figure(harmonic_map_figure(found), "harmonic", spoken, caption),
    )


def _sentence(view: View) -> str:
    found = view.harmonic
    assert found is not None
    after = as_number(view.data.get("harmonic_after"))
    if not math.isfinite(after):
        return found.sentence
    rms = f"{significant(math.sqrt(after), 2)} standard deviations on average"
    return f"{found.sentence} With {view.effect_label} attached, {rms} are left (1 is noise alone)."
