"""Owns `ltp demo`: the whole walk on a recording with concealed physics, made on the spot."""

from __future__ import annotations

import argparse

from ltp.cli import common
from ltp.files import check_writable

REPORT = "ltp-demo.html"
SEED = 5  # dry friction in a pivot, larger near rest than in motion: its law can be seen at a glance


def add(commands: common.Commands) -> None:
    """Add the subcommand."""
    parser = commands.add_parser(
        "demo",
        help="see the whole walk on a recording with concealed physics",
        description="Record a machine with a piece of physics that its model lacks, seal what it was, and let ltp\n"
        "find it from the model and the recordings alone: where the mismatch is, what was left out, how far the\n"
        "held-out error falls. Then the seal is opened. A seal is the SHA-256 of the label and a fresh salt, printed\n"
        "before the diagnosis begins.",
        epilog=common.epilog("ltp demo --seed 1 --report demo.html"),
        formatter_class=common.Formatter,
    )
    parser.add_argument("--seed", type=int, default=SEED, metavar="N", help=f"seed of the recording (default {SEED})")
    parser.add_argument(
        "--report", metavar="FILE", default=REPORT, help=f"where to write the HTML report (default {REPORT})"
    )
    common.add_json(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run the subcommand."""
    report = check_writable(arguments.report)
    from ltp import demo  # the demonstration is only loaded when it is asked for

    demo.run(seed=arguments.seed, report=report, as_json=arguments.json)
    return 0
