"""Owns `ltp prove`: physics is concealed many times over, diagnosed, and what was said is scored."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from ltp._ltp import InputError
from ltp.cli import common, text
from ltp.progress import Progress

if TYPE_CHECKING:
    from ltp.prove import Bar, Mark, Score

OUT = "ltp-proof"


def add(commands: common.Commands) -> None:
    """Add the subcommand."""
    parser = commands.add_parser(
        "prove",
        help="conceal physics many times over, diagnose, and score what was said",
        description="Draw cases from model, effect, size, difficulty and seed, write recordings through an integrator\n"
        "that shares nothing with the one under test, print a SHA-256 of all labels, diagnose each case from files\n"
        "alone, open the labels, and print the score against the bars. A folder left half done is continued.",
        epilog=common.epilog(
            "ltp prove --cases 4 --difficulty open --system drive --out proof",
            "ltp prove --cases 4 --difficulty open --system drive --out proof --json",
        ),
        formatter_class=common.Formatter,
    )
    parser.add_argument("--full", action="store_true", help="the long run: every bar with the cases that it needs")
    parser.add_argument("--cases", type=int, metavar="N", help="how many cases, in the proportions of the run")
    parser.add_argument("--difficulty", action="append", metavar="NAME", help="only this one; may be repeated")
    parser.add_argument("--system", action="append", metavar="NAME", help="only this one; may be repeated")
    parser.add_argument(
        "--seeds", default="score", metavar="RANGE", help="score (default) or tuning: two ranges that share no seed"
    )
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="which part of the range (default 0)")
    parser.add_argument(
        "--jobs",
        type=int,
        default=1,
        metavar="N",
        help="diagnose N cases at once, each on one core (default 1: all cores)",
    )
    parser.add_argument("--out", default=OUT, metavar="DIR", help=f"folder of cases and results (default {OUT})")
    common.add_json(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run the subcommand."""
    from ltp import prove  # only loaded when it is asked for
    from ltp.prove.run import stream

    if arguments.jobs < 1:
        raise InputError(f"--jobs {arguments.jobs}: expected at least one")
    tasks = prove.plan(
        arguments.seeds,
        arguments.seed,
        full=arguments.full,
        cases=arguments.cases,
        systems=arguments.system,
        difficulties=arguments.difficulty,
    )
    say = stream(arguments.json)
    print(f"{len(tasks)} cases from the {arguments.seeds} seeds, part {arguments.seed}", file=say, flush=True)
    with Progress() as progress:

        def tell(message: str) -> None:
            progress.clear()
            print(message, file=say, flush=True)

        opened = prove.prove(tasks, Path(arguments.out), tell, progress, jobs=arguments.jobs)
    if arguments.json:
        print(common.as_json(opened.tree()))
    else:
        print(page(opened))
        print(f"\ncases, results and confusion matrix in {arguments.out}")
    return 0


def page(opened: Score) -> str:
    """The score as a page of text: bars, groups, and every case that was not right."""
    bars = [["", "measured", "bar", ""]]
    bars += [[bar.what, _measured(bar), _bounds(bar), _verdict(bar)] for bar in opened.bars]
    head = ["", "cases", "top-1", "top-2", "port", "acc. right", "wrong", "95 %", "before", "after", "s"]
    groups = [
        [
            name,
            str(g["cases"]),
            str(g["top1"]),
            str(g["top2"]),
            str(g["port"]),
            str(g["accepted_right"]),
            str(g["accepted_wrong"]),
            str(g["coverage"]),
            _number(g["before"]),
            _number(g["after"]),
            _number(g["seconds"]),
        ]
        for name, g in opened.groups.items()
    ]
    lines = [text.table(bars[0], bars[1:], left=1), "", text.table(head, groups, left=1), ""]
    lines.append("before, after: held-out error over the floor, median; s: median seconds of a diagnosis")
    wrong = [m for m in opened.marks if not fine(m)]
    if wrong:
        lines += ["", f"not right ({len(wrong)} of {len(opened.marks)}):"]
        rows = [[m.system, m.difficulty, str(m.seed), m.truth, _said(m)] for m in wrong]
        lines.append(text.table(["system", "difficulty", "seed", "concealed", "said"], rows, left=5))
    return "\n".join(lines)


def fine(m: Mark) -> bool:
    """Whether a case is as it should be."""
    if m.false_alarm is not None:
        return not m.false_alarm and m.verdict != "error"
    if m.unknown is not None:
        return m.unknown
    return bool(m.top1)


def _said(m: Mark) -> str:
    if m.verdict == "error":
        return f"error: {m.note[:80]}"
    best = f" (ranked {', '.join(m.ranked[:3])})" if m.answer == m.verdict else ""
    return f"{m.verdict}: {m.answer}{best}" if m.answer != m.verdict else f"{m.verdict}{best}"


def _measured(bar: Bar) -> str:
    if bar.measured is None:
        return text.NONE
    return f"{bar.measured:.2f} s" if isinstance(bar.measured, float) else str(bar.measured)


def _bounds(bar: Bar) -> str:
    if bar.unit == "s":
        return f"at most {bar.high:g} s"
    if bar.low <= 0.0:
        return f"at most {bar.high:.1%}"
    return f"at least {bar.low:.0%}" if bar.high >= 1.0 else f"{bar.low:.0%} to {bar.high:.0%}"


def _verdict(bar: Bar) -> str:
    return {True: "PASS", False: "FAIL", None: "no case"}[bar.met]


def _number(value: float | None) -> str:
    return text.NONE if value is None else f"{value:.2f}"
