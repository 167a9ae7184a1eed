"""Owns `ltp reproduce`: published work, computed anew and set beside what was printed."""

from __future__ import annotations

import argparse
import sys
import textwrap

from ltp.cli import common, text
from ltp.progress import Progress

OUT = "ltp-hopper"


def add(commands: common.Commands) -> None:
    """Add the subcommand."""
    parser = commands.add_parser(
        "reproduce",
        help="reproduce a published work figure by figure",
        description="Reproduce Uyanik et al. 2015, a hopping robot and its harmonic transfer functions, figure by\n"
        "figure: the paper's figures beside those of ltp, beside the exact ones, with the bounds in which they have\n"
        "to lie. Writes a page that opens offline, hopper.html, and its figures as PNG. A figure out of bounds is\n"
        "exit code 1.",
        epilog=common.epilog("ltp reproduce hopper --quick --out hopper"),
        formatter_class=common.Formatter,
    )
    parser.add_argument("work", choices=("hopper",), metavar="WORK", help="what to reproduce: hopper")
    parser.add_argument("--out", metavar="DIR", default=OUT, help=f"folder of page and figures (default {OUT})")
    parser.add_argument("--quick", action="store_true", help="fewer sines, sizes and seeds")
    common.add_json(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run the subcommand."""
    from ltp.reproduce import Chapter, hopper  # only loaded when it is asked for
    from ltp.reproduce.result import HEAD

    say = sys.stderr if arguments.json else sys.stdout

    def tell(chapter: Chapter) -> None:
        progress.clear()
        print(chapter.title, file=say)
        print(textwrap.indent(textwrap.fill(chapter.sentence, 110), "  "), end="\n\n", file=say)
        print(text.table(HEAD, [row.cells() for row in chapter.rows], left=2), end="\n\n", file=say)
        for note in chapter.notes:
            print(textwrap.indent(textwrap.fill(note, 110), "  "), end="\n\n", file=say)
        say.flush()

    with Progress() as progress:
        done = hopper(arguments.out, arguments.quick, progress=progress, say=tell)
    if arguments.json:
        print(common.as_json(done.tree()))
    else:
        count = sum(row.passed is not None for row in done.rows)
        print(f"{count - len(done.missed)} of {count} figures within their bounds, {done.seconds:.0f} s")
        print(f"page and figures written to {arguments.out}")
    return 0 if done.passed else 1
