"""Owns the plan of a proof: which cases are drawn, from which seeds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ltp._ltp import InputError
from ltp.conceal import choices

#: First seed of each range. Cases of one range never share a seed with the other: a base seed takes ten million seeds.
RANGES = {"tuning": 10**15, "score": 2 * 10**15}
_PER_BASE = 10**7
_PER_DIFFICULTY = 10**6

#: Cases by difficulty: the quick run, and the long one that the bars ask for.
QUICK = {"open": 10, "noisy": 10, "masked": 6, "buried": 3, "pair": 3, "clean": 8, "outside": 5}
FULL = {"open": 150, "noisy": 150, "masked": 90, "buried": 48, "pair": 48, "clean": 200, "outside": 60}

#: Systems without a repeated experiment: the drive runs in a loop whose free run drifts.
_NOT_BURIED = ("drive",)


@dataclass(frozen=True)
class Task:
    """One case to be drawn."""

    system: str
    difficulty: str
    seed: int


def plan(
    seeds: str = "score",
    base: int = 0,
    *,
    full: bool = False,
    cases: int | None = None,
    systems: Sequence[str] | None = None,
    difficulties: Sequence[str] | None = None,
) -> list[Task]:
    """Cases, systems in turn within each difficulty.

    seeds: "tuning" or "score", two ranges that share no seed; base: which part of the range. cases: how many
    altogether, in the proportions of the quick run; systems, difficulties: only these. Raises `InputError` for unknown
    names.
    """
    all_systems, all_difficulties = choices()
    systems = _known("system", systems, all_systems)
    difficulties = _known("difficulty", difficulties, all_difficulties)
    if seeds not in RANGES:
        raise InputError(f"--seeds {seeds}: there is no such range; expected one of {', '.join(RANGES)}")
    if not 0 <= base < 10**7:
        raise InputError(f"--seed {base}: expected a whole number from 0 to {10**7 - 1}")
    counts = {d: (FULL if full else QUICK)[d] for d in difficulties}
    if cases is not None:
        if cases < 1:
            raise InputError(f"--cases {cases}: expected at least one case")
        counts = _shared(counts, cases)
    tasks = []
    for d, count in counts.items():
        able = [s for s in systems if d != "buried" or s not in _NOT_BURIED]
        if not able:
            continue
        first = RANGES[seeds] + base * _PER_BASE + all_difficulties.index(d) * _PER_DIFFICULTY
        # The system changes fastest but for clean cases, where the colour of the noise follows the seed's parity.
        turn = 2 if d == "clean" else 1
        # Difficulties begin with different systems, so that a short run meets all; long records with quick systems.
        shift = 0 if d == "buried" else all_difficulties.index(d)
        tasks += [Task(able[(i // turn + shift) % len(able)], d, first + i) for i in range(count)]
    return tasks


def _known(kind: str, given: Sequence[str] | None, known: Sequence[str]) -> list[str]:
    for name in given or ():
        if name not in known:
            raise InputError(f"--{kind} {name}: there is no such {kind}; expected one of {', '.join(known)}")
    return [name for name in known if not given or name in given]


def _shared(counts: dict[str, int], cases: int) -> dict[str, int]:
    """As many cases as asked for, in the proportions of `counts`; the largest remainders round up."""
    total = sum(counts.values())
    exact = {d: cases * n / total for d, n in counts.items()}
    whole = {d: int(x) for d, x in exact.items()}
    by_rest = sorted(counts, key=lambda d: whole[d] - exact[d])
    for d in by_rest[: cases - sum(whole.values())]:
        whole[d] += 1
    return whole
