"""Owns what the subcommands share: how models, recordings and assignments are written on a command line."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

from ltp._ltp import InputError
from ltp.jobs import read_model, read_recording
from ltp.model import Model

if TYPE_CHECKING:
    from matplotlib.figure import Figure

EXIT_CODES = """\
exit codes:
  0    fine
  1    a method did not reach its goal (no convergence)
  2    wrong usage, or an input that cannot be right
  130  interrupted with Ctrl-C; no file is left half written"""

HOLDS = ("first-order", "zero-order", "cubic")

# a recording from `FILE` or `FILE@START:END`
load_recording = read_recording

# What `add_subparsers` returns; argparse keeps the name of the class to itself.
Commands: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"


class Formatter(argparse.RawDescriptionHelpFormatter):
    """Keeps the line breaks of descriptions and examples, and leaves room for long option names."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog, max_help_position=32)


def epilog(*examples: str) -> str:
    """The end of a help text: examples that run in the order they stand, then the exit codes."""
    lines = "\n".join(f"  {example}" for example in examples)
    return f"example{'s' if len(examples) > 1 else ''}:\n{lines}\n\n{EXIT_CODES}"


def add_model(parser: argparse.ArgumentParser) -> None:
    """The argument MODEL, `--set` for its parameters, and `--effects` for what may be missing or attached."""
    parser.add_argument("model", metavar="MODEL", help="model document (.toml), or zoo:NAME for a reference model")
    parser.add_argument(
        "--set",
        metavar="NAME=VALUE",
        action="append",
        default=[],
        dest="parameters",
        help="replace the value of a parameter, in its own unit; may be repeated",
    )
    parser.add_argument(
        "--effects",
        metavar="FILE",
        action="append",
        default=[],
        help="a document (.toml) of a piece of physics of your own, called by the name of the file; may be repeated",
    )


def add_reading(parser: argparse.ArgumentParser) -> None:
    """Add how recordings are read in the terms of a model: `--columns` and `--dt`."""
    parser.add_argument(
        "--columns",
        action="append",
        default=[],
        metavar="NAME=COLUMN,...",
        help="names of the model and their columns in the files, such as q=qm,tau=u or "
        '"theta=angle [deg]"; an empty right side: not recorded',
    )
    parser.add_argument("--dt", type=float, metavar="S", help="sampling period, s, for files without a time column")


def add_json(parser: argparse.ArgumentParser) -> None:
    """The option `--json`."""
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else on standard output")


def add_orbit(parser: argparse.ArgumentParser) -> None:
    """The options that say which periodic orbit is meant."""
    parser.add_argument(
        "--start",
        action="append",
        default=[],
        metavar="STATE=VALUE",
        help="start here, in the state's unit, instead of where the document does; may be repeated",
    )
    parser.add_argument("--mode", metavar="NAME", help="the mode to start in")
    parser.add_argument("--period", type=float, metavar="S", help="period, s (default: that of the clock)")
    parser.add_argument("--settle", type=int, metavar="N", help="periods to simulate first (default: as needed)")


def orbit_options(arguments: argparse.Namespace) -> dict[str, Any]:
    """What :func:`add_orbit` was given, as keyword arguments of `ltp.cycle`."""
    start = numbers("--start", arguments.start) or None
    return {"start": start, "mode": arguments.mode, "period": arguments.period, "settle": arguments.settle}


def as_svg(figure: Figure, description: str) -> str:
    """A figure as the text of an SVG file of its own, on white."""
    from ltp.plots.svg import to_svg  # drawing is slow to import

    head, _, body = to_svg(figure, "ltp", description).partition(">")
    return f'<?xml version="1.0" encoding="utf-8"?>\n{head} style="background:#ffffff">{body}\n'


def load_model(arguments: argparse.Namespace) -> Model:
    """The model of MODEL, `--effects` and `--set`."""
    model = read_model(arguments.model, arguments.effects)
    values = numbers("--set", arguments.parameters)
    return model.with_parameters(values) if values else model


def column_mapping(words: Sequence[str]) -> dict[str, str | None]:
    """`--columns q=qm,tau=u` as a mapping; an empty right side says that the signal is not in the file."""
    pairs = _pairs("--columns", [part for word in words for part in word.split(",") if part.strip()])
    return {name: text or None for name, text in pairs.items()}


def assignments(option: str, words: Sequence[str]) -> dict[str, str]:
    """Repeated `NAME=TEXT` as a dict; both sides must be there."""
    pairs = _pairs(option, words)
    for name, text in pairs.items():
        if not text:
            raise InputError(f"{option} {name}=: nothing stands after the equals sign; write {option} {name}=VALUE")
    return pairs


def numbers(option: str, words: Sequence[str]) -> dict[str, float]:
    """Repeated `NAME=NUMBER` as a dict."""
    values = {}
    for name, text in assignments(option, words).items():
        value = _number(text)
        if value is None:
            raise InputError(f"{option} {name}={text}: {text!r} is not a finite number; write {option} {name}=0.5")
        values[name] = value
    return values


def as_json(tree: Any) -> str:
    """One JSON object; what is not finite becomes null, because JSON has no NaN."""
    return json.dumps(_finite(tree), allow_nan=False)


def _pairs(option: str, words: Sequence[str]) -> dict[str, str]:
    pairs: dict[str, str] = {}
    for word in words:
        name, equals, text = word.partition("=")
        name = name.strip()
        if not equals or not name:
            raise InputError(f"{option} {word}: expected NAME=VALUE; write it without spaces, or in quotation marks")
        if name in pairs:
            raise InputError(f"{option}: {name!r} is given twice ({pairs[name]!r} and {text.strip()!r}); remove one")
        pairs[name] = text.strip()
    return pairs


def _number(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _finite(tree: Any) -> Any:
    if isinstance(tree, dict):
        return {key: _finite(value) for key, value in tree.items()}
    if isinstance(tree, (list, tuple)):
        return [_finite(value) for value in tree]
    if isinstance(tree, float) and not math.isfinite(tree):
        return None
    return tree
