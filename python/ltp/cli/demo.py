"""Owns `ltp demo`: the whole walk on a recording with concealed physics, made on the spot."""

from __future__ import annotations

import argparse

from ltp.cli import common
from ltp.files import check_writable


def add(commands: common.Commands) -> None:
    """Add the subcommand."""
    parser = commands.add_parser(
        "demo",
        help="see the whole walk on a recording with concealed physics",
        description="Simulate a machine with a piece of physics that its model does not know, add noise, and let\n"
        "ltp find it: where the mismatch is, what was left out, and how far the held-out error falls.",
        epilog=common.epilog("ltp demo --seed 1 --report demo.html"),
        formatter_class=common.Formatter,
    )
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="seed of the recording (default 1)")
    parser.add_argument("--report", metavar="FILE", help="write the HTML report")
    common.add_json(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run the subcommand."""
    report = check_writable(arguments.report) if arguments.report else None
    from ltp import demo  # the demonstration is only loaded when it is asked for

    demo.run(seed=arguments.seed, report=report, as_json=arguments.json)
    return 0
