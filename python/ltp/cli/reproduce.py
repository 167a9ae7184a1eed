"""Owns `ltp reproduce`: published work, computed anew and set beside what was printed."""

from __future__ import annotations

import argparse
import sys
import textwrap

from ltp.cli import common, text
from ltp.progress import Progress

#: Works by the word for them on the command line: function of `ltp.reproduce`, and source.
WORKS = {
    "hopper": ("hopper", "Uyanik et al. 2015, a hopping robot and its harmonic transfer functions"),
    "cart-pendulum": ("cart_pendulum", "Duyul 2018, feedback around periodic orbits of a cart with a pendulum"),
}


def add(commands: common.Commands) -> None:
    """Add the subcommand."""
    parser = commands.add_parser(
        "reproduce",
        help="reproduce a published work figure by figure",
        description="Reproduce a published work figure by figure: printed figures beside those of ltp, with the\n"
        "bounds in which they have to lie. Writes a page that opens offline and its figures as PNG. A figure out\n"
        "of bounds is exit code 1.\n\n" + "\n".join(f"  {name:14} {source}" for name, (_, source) in WORKS.items()),
        epilog=common.epilog("ltp reproduce hopper --quick --out hopper"),
        formatter_class=common.Formatter,
    )
    parser.add_argument("work", choices=tuple(WORKS), metavar="WORK", help=f"what to reproduce: {', '.join(WORKS)}")
    parser.add_argument("--out", metavar="DIR", help="folder of page and figures (default ltp-WORK)")
    parser.add_argument("--quick", action="store_true", help="fewer sines, sizes, starts and seeds")
    common.add_json(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run the subcommand."""
    from ltp import reproduce  # only loaded when it is asked for
    from ltp.reproduce import Chapter
    from ltp.reproduce.result import HEAD

    say = sys.stderr if arguments.json else sys.stdout

    def tell(chapter: Chapter) -> None:
        progress.clear()
        print(chapter.title, file=say)
        print(textwrap.indent(textwrap.fill(chapter.sentence, 110), "  "), end="\n\n", file=say)
        print(text.table(HEAD, [row.cells() for row in chapter.rows], left=2), end="\n\n", file=say)
        for table in chapter.tables:
            print(f"  {table.title}", file=say)
            print(text.table(table.head, table.cells, left=2), end="\n\n", file=say)
        for note in chapter.notes:
            print(textwrap.indent(textwrap.fill(note, 110), "  "), end="\n\n", file=say)
        say.flush()

    out = arguments.out or f"ltp-{arguments.work}"
    with Progress() as progress:
        done = getattr(reproduce, WORKS[arguments.work][0])(out, arguments.quick, progress=progress, say=tell)
    if arguments.json:
        print(common.as_json(done.tree()))
    else:
        count = sum(row.passed is not None for row in done.rows)
        print(f"{count - len(done.missed)} of {count} figures within their bounds, {done.seconds:.0f} s")
        print(f"page and figures written to {out}")
    return 0 if done.passed else 1
