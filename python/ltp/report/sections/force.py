"""The missing force: estimated without any law, against what it depends on, with the law that was named over it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ltp.plots import axis_of, force_over_phase, missing_force
from ltp.plots.numbers import as_number, pretty_unit, significant

from ..markup import Section, details, figure, paragraph, table
from ..view import View, dependence


def section(view: View) -> Section | None:
    """One figure for each place at which a missing force, or an error of a sensor or an input, was estimated."""
    if not view.forces:
        return None
    body = "\n".join(_figure(view, at, index) for index, at in enumerate(view.forces))
    kind = next(iter(view.forces.values()))[0].kind
    return Section("force", _PLACES.get(kind, _PORT).title, _sentence(view, kind), body)


@dataclass(frozen=True)
class _Words:
    """How the section speaks of one kind of place."""

    title: str
    place: str
    estimate: str
    lacks: str


_PORT = _Words("The missing force", "port", "missing force", "The force that the nominal equations lack")
_PLACES = {
    "output": _Words(
        "What the sensor is off by", "sensor", "error", "What the sensor adds to what the model would measure"
    ),
    "input": _Words("What the input is off by", "input", "error", "What enters the model beside the recorded input"),
}


def _sentence(view: View, kind: str) -> str:
    text = (
        f"{_PLACES.get(kind, _PORT).lacks}, estimated from the training records by a smoother that knows no "
        "law of friction or stiffness. "
    )
    if not view.added and view.verdict != "unknown":
        return text + "Nothing in it justifies an addition to the model."
    at = next(iter(view.forces))
    depends = f"It depends on {dependence(view.variable(at))}"
    if view.verdict == "unknown" and view.law(at) is None:
        return f"{text}{depends}, but no effect of the library and no law of that variable says what it is."
    if view.verdict == "unknown":
        return f"{text}{depends}, and the law drawn over it is a table, not a named effect."
    return f"{text}{depends}; the line is the law of {view.effect_label}, fitted to the motion."


def _figure(view: View, at: str, index: int) -> str:
    forces, law, variable = view.forces[at], view.law(at), view.variable(at)
    here = [str(e.get("name")) for e in view.effects if e.get("at") == at]
    name = " + ".join(here) if here else "estimated"
    drawing = missing_force(forces, variable, law=law, units=view.units(at), name=name)
    main, words = axis_of(variable), _PLACES.get(forces[0].kind, _PORT)
    place = words.place.capitalize()
    caption = f"{place} {at}. The circles are means of the grey samples over bins and know nothing of the law."
    if law is not None:
        caption += " The band around the law is two sigma."
    caption += f" Over time: record {forces[0].record}."
    seen = f"Estimated {words.estimate} at {words.place} {at} against {forces[0].word(main)}. {caption}"
    out = figure(drawing, f"force{index}", seen, caption)
    clocked = all(f.phase is not None and len(f.phase) for f in forces)
    if clocked or any(len(f.modes) > 1 for f in forces):
        found = [p for place in view.locations if place.get("at") == at for p in _numbers(place.get("phases"))]
        marks = found if clocked else []
        over = "phase of the clock" if clocked else "time since the mode was entered"
        what = "force" if words is _PORT else words.estimate
        text = (
            f"The same {what} at {words.place} {at} over the {over}. Shaded: the middle half of the samples of a bin."
        )
        if marks:
            text += " Dashed: where it acts, as located."
        out += figure(force_over_phase(forces, units=view.units(at), phases=marks), f"phase{index}", text, text)
    if law is not None and view.verdict == "unknown":
        units = view.units(at)
        step = max(1, len(law.grid) // 40)
        rows = [
            [significant(law.grid[i], 4), significant(law.force[i], 4), significant(law.sd[i], 2)]
            for i in range(0, len(law.grid), step)
        ]
        unit = pretty_unit(units.force)
        head = [f"{main} {pretty_unit(units.of(axis_of(law.variable)))}", f"force {unit}", f"sd {unit}"]
        out += details("The law as a table", table(head, rows, text_columns=0))
    if law is None and view.added:
        out += paragraph("No law is drawn here: what was added does not act as a force at this port alone.")
    return out


def _numbers(phases: object) -> list[float]:
    """Phases, and the two ends of intervals of phase, as one list."""
    flat = [
        end
        for p in (phases if isinstance(phases, (list, tuple)) else [])
        for end in (p if isinstance(p, list) else [p])
    ]
    return [value for end in flat if math.isfinite(value := as_number(end))]
