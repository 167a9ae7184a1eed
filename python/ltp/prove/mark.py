"""Owns the mark of one case: what its diagnosis said against what was concealed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from ltp.conceal import Concealed
from ltp.prove.classes import alike, same_port

_Z95 = 1.959964  # two-sided 95 % of a normal distribution
_NEAR_FLOOR = 1.1  # held-out error over the floor
_MOVED = 3.0  # sigmas from its stated value that make a parameter's error


@dataclass(frozen=True)
class Mark:
    """One case: labels as `effect@place`, joined by ` + ` for two; what was right.

    answer: what the diagnosis named, its verdict where it named nothing. top1, top2: the best, or one of the two best
    or of the ambiguous set, is the truth; None where nothing was to be named. port: the located place is right, None
    where the effect has no port or nothing was located. accepted: "right", "wrong" or "" where no single answer was
    given. false_alarm: physics claimed in a clean case. inside: of the 95 % intervals, how many hold the truth, and how
    many there are. held_out: held-out error over the floor, before and after, of the worst output. seconds: of the
    diagnosis.
    """

    system: str
    difficulty: str
    seed: int
    truth: str
    verdict: str
    answer: str
    ranked: list[str]
    top1: bool | None
    top2: bool | None
    port: bool | None
    accepted: str
    false_alarm: bool | None
    unknown: bool | None
    inside: tuple[int, int]
    held_out: tuple[float, float] | None
    seconds: float
    note: str = ""

    def tree(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)


def mark(label: Concealed, result: Mapping[str, Any]) -> Mark:
    """Mark the JSON of a diagnosis; an error in place of a diagnosis is `{"error": text, "seconds": s}`."""
    truths = [f"{e.name}@{e.at}" for e in label.effects]
    common: dict[str, Any] = {
        "system": label.system,
        "difficulty": label.difficulty,
        "seed": label.seed,
        "truth": " + ".join(sorted(truths)) or "nothing",
    }
    clean, outside, pair = not truths, label.difficulty == "outside", len(truths) == 2
    if "error" in result:
        return Mark(
            **common,
            verdict="error",
            answer="error",
            ranked=[],
            top1=None if clean or outside else False,
            top2=None if clean or outside else False,
            port=None,
            accepted="",
            false_alarm=False if clean else None,
            unknown=False if outside else None,
            inside=(0, 0),
            held_out=None,
            seconds=float(result.get("seconds", 0.0)),
            note=str(result["error"]),
        )
    verdict = result["verdict"]
    named = [f"{e['name']}@{e['at']}" for e in result["effects"]]
    ranked = _ranked(result)
    moved = _moved(result)
    same = _same(label, truths)
    parameter = [t.partition("@")[2] for t in truths if t.startswith("parameter_error@")]
    if parameter:
        same = [s | {f"parameter {parameter[0]}"} for s in same]
    answers = named or ([f"parameter {moved[0]}"] if verdict == "parameter" and moved else [])
    first = answers or ranked[:1]
    if pair:
        right = len(answers) == 2 and all(any(a in s for a in answers) for s in same)
        second = right or any(a in s for a in first for s in same)
    else:
        right = bool(same) and len(first) == 1 and first[0] in same[0]
        near = {*first, *ranked[:2], *result.get("ambiguous_with", ())}
        second = bool(same) and any(a in same[0] for a in near)
    accepted = ""
    # A set that holds nothing but one class is one answer.
    one = not pair and bool(same) and all(a in same[0] for a in [*named, *result.get("ambiguous_with", ())])
    if named and (verdict == "effect" or (verdict == "ambiguous" and one)):
        if clean or outside:
            accepted = "wrong"
        elif pair:
            accepted = "right" if all(any(a in s for s in same) for a in named) else "wrong"
        else:
            accepted = "right" if len(named) == 1 and right else "wrong"
    return Mark(
        **common,
        verdict=verdict,
        answer=" + ".join(sorted(answers)) or verdict,
        ranked=ranked[:4],
        top1=None if clean or outside else right,
        top2=None if clean or outside else second,
        port=_port(label, result, same),
        accepted=accepted,
        false_alarm=verdict in ("effect", "ambiguous", "unknown") if clean else None,
        unknown=verdict == "unknown" if outside else None,
        inside=_inside(label, result) if accepted == "right" else (0, 0),
        held_out=_held_out(result),
        seconds=float(result["seconds"]),
    )


def near_floor(m: Mark) -> bool:
    """Whether the held-out error after the diagnosis is at most 1.1 times the floor."""
    return m.held_out is not None and m.held_out[1] <= _NEAR_FLOOR


def _ranked(result: Mapping[str, Any]) -> list[str]:
    """Candidates in the order of their score, without those out of the race; `nothing` is one of them."""
    alive = [c for c in result["candidates"] if c.get("score") is not None]
    order = sorted(alive, key=lambda c: float(c["score"]))
    return [f"{c['name']}@{c['at']}" if c["at"] else str(c["name"]) for c in order]


def _moved(result: Mapping[str, Any]) -> list[str]:
    """Parameters away from their stated values by more than three standard deviations, the furthest first."""
    far = {name: float(p["away"] or 0.0) for name, p in result["parameters"].items()}
    return [name for name in sorted(far, key=lambda n: -far[n]) if far[name] > _MOVED]


def _same(label: Concealed, truths: list[str]) -> list[frozenset[str]]:
    """For each concealed effect, all answers that count as it: its class, and what the label says is alike."""
    own = frozenset(label.alike)
    each = (frozenset({t, *own}) for t in truths)
    return [frozenset().union(*(alike(label.system, label.difficulty, a) for a in answers)) for answers in each]


def _port(label: Concealed, result: Mapping[str, Any], same: list[frozenset[str]]) -> bool | None:
    location = result.get("location")
    if not label.effects or not location:
        return None
    found = [place["at"] for place in (location if isinstance(location, list) else [location])]
    ports = []
    for e, answers in zip(label.effects, same, strict=True):
        if e.name.partition("_")[0] in ("output", "parameter"):
            return None
        places = [(name.partition("_")[0], at) for name, _, at in (a.partition("@") for a in answers)]
        ports.append(any(same_port(label.system, kind, at, f) for kind, at in places for f in found))
    return all(ports) if len(found) == len(ports) else any(ports)


def _inside(label: Concealed, result: Mapping[str, Any]) -> tuple[int, int]:
    """How many 95 % intervals hold the truth, of the effects named exactly as they were concealed."""
    hits = total = 0
    for e in label.effects:
        for found in result["effects"]:
            if (found["name"], found["at"]) != (e.name, e.at):
                continue
            for name, truth in e.parameters.items():
                estimate = found["parameters"].get(name)
                if estimate is None or not estimate.get("sd"):
                    continue
                total += 1
                off = abs(estimate["value"] - truth)
                if name == "phase":
                    off = abs((off + 3.141592653589793) % 6.283185307179586 - 3.141592653589793)
                hits += off <= _Z95 * estimate["sd"]
    return hits, total


def _held_out(result: Mapping[str, Any]) -> tuple[float, float] | None:
    rows = result["fit"]["test"]
    ratios = []
    for row in rows:
        if not row["floor"] or row["before"] is None:
            continue
        after = row["after"] if row["after"] is not None else row["before"]
        ratios.append((row["before"] / row["floor"], after / row["floor"]))
    if not ratios:
        return None
    return max(r[0] for r in ratios), max(r[1] for r in ratios)
