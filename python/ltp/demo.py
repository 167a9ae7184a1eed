"""Owns the demonstration: physics is concealed and sealed, a diagnosis works without it, then the seal is opened."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ltp.cli import text
from ltp.cli.common import as_json as one_object
from ltp.cli.diagnose import summary
from ltp.conceal import Case, Label, Seal, conceal
from ltp.diagnose import Diagnosis, Estimate, diagnose
from ltp.progress import Progress

_NEAR = 0.1  # relative error of a size that still counts as right
_SIGMAS = 3.0  # or this many of its standard deviations


@dataclass(frozen=True)
class Marks:
    """What a diagnosis got right: the name, the place, and every number of the effect."""

    name: bool
    place: bool
    size: bool

    def __bool__(self) -> bool:
        """Whether everything was right."""
        return self.name and self.place and self.size


def run(seed: int, report: Path | None = None, as_json: bool = False) -> Diagnosis:
    """Conceal an effect drawn from `seed`, seal it, diagnose from model and recordings alone, open the seal.

    Prints the walk, or one JSON object; writes the report to `report`. Any seed works.
    """
    say = sys.stderr if as_json else sys.stdout
    case = conceal(seed=seed)
    seal = Seal.of(case.label)
    # Told before the diagnosis begins, so that the label cannot be fitted to it afterwards.
    print(_opening(case, seal), file=say, flush=True)
    with Progress() as progress:
        diagnosis = diagnose(case.model, case.train, case.test, seed=seed, progress=progress)
    marks = mark(diagnosis, case.label)
    if report is not None:
        diagnosis.report(report)
    if as_json:
        print(one_object(_tree(case.label, seal, diagnosis, marks)))
        return diagnosis
    print(summary(diagnosis))
    print()
    print(_opened(case.label, seal, diagnosis, marks))
    if report is not None:
        print(f"\nreport written to {report}")
    return diagnosis


def mark(diagnosis: Diagnosis, label: Label) -> Marks:
    """Compare a diagnosis with the label of its case.

    A size is right within three of its standard deviations or a tenth of its value. An ambiguous verdict has the name
    right only if its best candidate is the true one.
    """
    if label.effect == "nothing":
        silent = not diagnosis.effects and diagnosis.verdict in ("consistent", "parameter")
        return Marks(silent, silent, silent)
    found = diagnosis.effects[0] if len(diagnosis.effects) == 1 else None
    if found is None:
        return Marks(False, False, False)
    name, place = found.name == label.effect, found.at == label.at
    sizes = [near(found.parameters.get(key), value) for key, value in label.parameters.items()]
    return Marks(name, place, name and place and all(sizes))


def near(estimate: Estimate | None, true: float) -> bool:
    """Whether an estimate is right: within a tenth of the true value, or three of its standard deviations."""
    if estimate is None:
        return False
    off = abs(estimate.value - true)
    return off <= _NEAR * abs(true) or (estimate.sd is not None and off <= _SIGMAS * estimate.sd)


def _opening(case: Case, seal: Seal) -> str:
    records = ", ".join(f"{record.name!r}" for record in [*case.train, *case.test])
    first = case.train[0]
    return "\n".join(
        [
            "A machine was recorded. Its model lacks a piece of physics; which one, and where, is sealed.",
            "",
            f"  model     {case.model.name}: {case.model.description}",
            f"  records   {records}: {first.t[-1]:g} s each, every {1e3 * first.dt:g} ms",
            f"  sealed    SHA-256 of label and salt: {seal.sha256}",
            "",
            "The diagnosis sees the model and the recordings, nothing else.",
            "",
        ]
    )


def _opened(label: Label, seal: Seal, diagnosis: Diagnosis, marks: Marks) -> str:
    lines = [
        "The seal is opened.",
        "",
        f"  label     {label.text}",
        f"  salt      {seal.salt}",
        f"  SHA-256   {seal.sha256}, " + ("as sealed" if seal.holds(label) else "NOT as sealed"),
        f"  check     printf '%s' '{label.text}{seal.salt}' | sha256sum",
        "",
    ]
    if label.effect == "nothing":
        return "\n".join([*lines, f"  nothing was concealed; {'right' if marks else 'wrong'}: {diagnosis.verdict}"])
    notes = [c.note for c in diagnosis.candidates if (c.name, c.at) == (label.effect, label.at) and c.note]
    if notes:  # out of the race for a reason, such as more of what a nominal parameter says already
        return "\n".join([*lines, f"  {label.effect} at {label.at}: {notes[0]}"])
    found = diagnosis.effects[0] if diagnosis.effects else None
    rows = [
        ["name", label.effect, found.name if found else text.NONE, _word(marks.name)],
        ["place", label.at, found.at if found else text.NONE, _word(marks.place)],
    ]
    for name, true in label.parameters.items():
        estimate = found.parameters.get(name) if found and marks.name and marks.place else None
        rows.append([name, text.number(true), _shown(estimate), _word(near(estimate, true))])
    lines.append(text.table(["", "concealed", "found", ""], rows, left=3))
    if not marks.name and f"{label.effect}@{label.at}" in diagnosis.ambiguous_with:
        lines.append("\n  The diagnosis said that it could not tell the two apart.")
    return "\n".join(lines)


def _shown(estimate: Estimate | None) -> str:
    if estimate is None:
        return text.NONE
    return text.with_unit(text.estimate(estimate.value, estimate.sd), estimate.unit)


def _word(right: bool) -> str:
    return "right" if right else "wrong"


def _tree(label: Label, seal: Seal, diagnosis: Diagnosis, marks: Marks) -> dict[str, Any]:
    return {
        "sealed": {"sha256": seal.sha256, "salt": seal.salt, "label": label.text},
        "right": {"name": marks.name, "place": marks.place, "size": marks.size},
        "diagnosis": json.loads(diagnosis.to_json()),
    }
