"""Owns the score of a proof: rates with their numbers of cases, the bars set before, and the confusion matrix."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from ltp.prove.mark import Mark, near_floor

_CONCEALED = ("open", "noisy", "masked", "buried", "pair")
_MANY = 50
_CLEAR = ("open", "noisy", "masked")  # 20 dB and above, one effect


@dataclass(frozen=True)
class Rate:
    """How many of how many."""

    hits: int
    of: int

    @property
    def value(self) -> float | None:
        """The share, None of nothing."""
        return self.hits / self.of if self.of else None

    def __str__(self) -> str:
        share = self.value
        return "-" if share is None else f"{self.hits}/{self.of} ({share:.0%})"


@dataclass(frozen=True)
class Bar:
    """A bar: what, the measured rate, the bounds, and whether it is met; None where there is no case to measure."""

    what: str
    measured: Rate | float | None
    low: float
    high: float
    unit: str = "%"

    @property
    def met(self) -> bool | None:
        """Whether the measured value is within the bounds."""
        value = self.measured.value if isinstance(self.measured, Rate) else self.measured
        return None if value is None else self.low <= value <= self.high


@dataclass(frozen=True)
class Score:
    """All marks with what they add up to."""

    marks: list[Mark]
    groups: dict[str, dict[str, Any]]
    bars: list[Bar]

    def tree(self) -> dict[str, Any]:
        """For JSON."""
        bars = []
        for bar in self.bars:
            rate = bar.measured if isinstance(bar.measured, Rate) else None
            value = rate.value if rate else bar.measured
            count = rate.of if rate else None
            bars.append(
                {"what": bar.what, "measured": value, "cases": count, "low": bar.low, "high": bar.high, "met": bar.met}
            )
        groups = {
            name: {k: ({"hits": v.hits, "of": v.of} if isinstance(v, Rate) else v) for k, v in row.items()}
            for name, row in self.groups.items()
        }
        return {"bars": bars, "groups": groups, "cases": [m.tree() for m in self.marks]}


def score(marks: Sequence[Mark]) -> Score:
    """Add up marks: one row for each difficulty, each system, and all; and the bars."""
    groups: dict[str, dict[str, Any]] = {}
    for name in dict.fromkeys(m.difficulty for m in marks):
        groups[name] = row([m for m in marks if m.difficulty == name])
    for name in dict.fromkeys(m.system for m in marks):
        groups[name] = row([m for m in marks if m.system == name])
    groups["all"] = row(marks)
    return Score(list(marks), groups, _bars(marks))


def row(marks: Sequence[Mark]) -> dict[str, Any]:
    """Rates of some cases."""
    seconds = [m.seconds for m in marks]
    return {
        "cases": len(marks),
        "top1": rate(m.top1 for m in marks),
        "top2": rate(m.top2 for m in marks),
        "port": rate(m.port for m in marks),
        "accepted_right": sum(m.accepted == "right" for m in marks),
        "accepted_wrong": sum(m.accepted == "wrong" for m in marks),
        "false_alarms": rate(m.false_alarm for m in marks),
        "unknown": rate(m.unknown for m in marks),
        "coverage": Rate(sum(m.inside[0] for m in marks), sum(m.inside[1] for m in marks)),
        "near_floor": rate(near_floor(m) for m in marks if m.accepted == "right"),
        "before": _median(m.held_out[0] for m in marks if m.held_out),
        "after": _median(m.held_out[1] for m in marks if m.held_out),
        "seconds": _median(seconds),
    }


def rate(values: Iterable[bool | None]) -> Rate:
    """How many are true of those that are known."""
    known = [bool(v) for v in values if v is not None]
    return Rate(sum(known), len(known))


def _median(values: Iterable[float]) -> float | None:
    known = list(values)
    return statistics.median(known) if known else None


def _bars(marks: Sequence[Mark]) -> list[Bar]:
    def of(*names: str) -> list[Mark]:
        return [m for m in marks if m.difficulty in names]

    def top1(name: str, low: float, words: str) -> Bar:
        return Bar(f"top-1, {words}", rate(m.top1 for m in of(name)), low, 1.0)

    clear = of(*_CLEAR)
    wrong = Rate(sum(m.accepted == "wrong" for m in clear), len(clear))
    accepted = [m for m in marks if m.accepted and m.difficulty in _CONCEALED]
    smooth = [m.seconds for m in marks if m.system != "hopper"]
    hopper = [m.seconds for m in marks if m.system == "hopper"]
    inside = Rate(sum(m.inside[0] for m in marks), sum(m.inside[1] for m in marks))
    return [
        top1("open", 0.97, "40 dB"),
        top1("noisy", 0.93, "20 dB"),
        top1("masked", 0.93, "masked"),
        top1("buried", 0.75, "buried"),
        Bar("accepted wrong, 20 dB and above", wrong, 0.0, 0.00999999),
        Bar("false alarms, clean", rate(m.false_alarm for m in of("clean")), 0.0, 1 / 200),
        Bar("right port", rate(m.port for m in of(*_CLEAR)), 0.98, 1.0),
        # With fewer than fifty intervals, none that misses is no sign of wide ones.
        Bar("95 % intervals that hold the truth", inside, 0.90, 0.98 if inside.of >= _MANY else 1.0),
        Bar("held-out error at most 1.1 floors, accepted", rate(near_floor(m) for m in accepted), 0.90, 1.0),
        Bar("unknown said, outside the library", rate(m.unknown for m in of("outside")), 0.80, 1.0),
        Bar("median seconds, smooth systems", _median(smooth), 0.0, 2.0, "s"),
        Bar("median seconds, hopper", _median(hopper), 0.0, 8.0, "s"),
    ]


def confusion(
    marks: Sequence[Mark], name: Callable[[str], str] = lambda a: a.partition("@")[0]
) -> dict[str, dict[str, int]]:
    """Counts by true effect and answer, of cases with one effect or none; right answers stand on the diagonal.

    An answer that counts as the truth by a class is written as the truth. What is no effect stands as the verdict.
    """
    table: dict[str, dict[str, int]] = {}
    for m in marks:
        if " + " in m.truth:
            continue
        truth = name(m.truth)
        if truth.startswith("outside_"):
            truth = "outside the library"
        answer = truth if m.top1 else name(m.answer.partition(" + ")[0])
        if m.answer.startswith("parameter ") and not m.top1:
            answer = "parameter"
        if answer in ("effect", "ambiguous") and m.ranked:
            answer = name(m.ranked[0])
        cells = table.setdefault(truth, {})
        cells[answer] = cells.get(answer, 0) + 1
    return table
