"""Owns the command `ltp`: the list of subcommands, and how each ending becomes a message and an exit code."""

from __future__ import annotations

import argparse
import io
import os
import sys
import warnings
from collections.abc import Sequence
from typing import TextIO

from ltp._ltp import ConvergenceError, InputError
from ltp.cli import (
    control,
    cycle,
    demo,
    diagnose,
    diagnose_many,
    harmonic_map,
    identify,
    isolability,
    linearize,
    prove,
    reproduce,
    simulate,
    zoo,
)
from ltp.cli.common import EXIT_CODES, Formatter

__all__ = ["main"]

_COMMANDS = (
    simulate,
    cycle,
    linearize,
    identify,
    control,
    isolability,
    harmonic_map,
    diagnose,
    diagnose_many,
    prove,
    zoo,
    demo,
    reproduce,
)


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command line (by default the program's own) and return its exit code.

    0 fine, 1 a method did not reach its goal, 2 wrong usage or input, 130 interrupted. Results go to standard output,
    messages to standard error. Wrong usage leaves through `SystemExit(2)`, as argparse does.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # an old terminal must not break on a degree sign
    arguments = _parser().parse_args(argv)
    with warnings.catch_warnings():
        warnings.simplefilter("always", UserWarning)
        warnings.showwarning = _show_warning
        try:
            code: int = arguments.run(arguments)
            sys.stdout.flush()
        except ConvergenceError as error:
            return _fail(str(error), 1)
        except InputError as error:
            return _fail(str(error), 2)
        except KeyboardInterrupt:
            return _fail("interrupted; no file was left half written", 130)
        except BrokenPipeError:
            # The reader, such as `head`, has seen enough. Python would complain again when it closes standard output.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return 0
    return code


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="ltp",
        description="Explains periodic and hybrid mechanical systems from their recordings: simulate a model, find\n"
        "its periodic orbit and transfer functions, compare it with what was measured, and name the physics that was\n"
        "left out.",
        epilog=EXIT_CODES,
        formatter_class=Formatter,
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version and leave")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for command in _COMMANDS:
        command.add(commands)
    return parser


class _Version(argparse.Action):
    """Looks the version up only when asked for: it is kept in the installed package's metadata."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        from ltp import __version__

        print(f"ltp {__version__}")
        parser.exit()


def _fail(message: str, code: int) -> int:
    print(f"ltp: {message}", file=sys.stderr)
    return code


def _show_warning(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    print(f"ltp: warning: {message}", file=sys.stderr)
