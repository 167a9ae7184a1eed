"""Owns `ltp isolability`: a model and planned inputs to what the set-up could tell apart, before any experiment."""

from __future__ import annotations

import argparse
import math
import re

from ltp import signals
from ltp._ltp import InputError
from ltp.cli import common
from ltp.files import check_writable, write_text
from ltp.isolability import Isolability, isolability
from ltp.progress import Progress
from ltp.simulate import InputLike

EXAMPLE = 'ltp isolability zoo:cart_pendulum --t-end 10 --dt 0.01 --input "V=multisine(2, 0.2:2.5)" --plot matrix.svg'
_MULTISINE = re.compile(r"^multisine\(\s*([^,:]+),\s*([^,:]+):([^,:]+?)\s*(?:,\s*(\d+)\s*)?\)$")


def add(commands: common.Commands) -> None:
    """Add the subcommand."""
    parser = commands.add_parser(
        "isolability",
        help="say which effects a planned experiment could tell apart, and what would help",
        description="Say, before any experiment, which effects of the library a set-up could tell apart at a given\n"
        "noise, as a matrix, and which variation of it would help: another amplitude, a further sensor, slower\n"
        "or faster inputs, longer records, faster sampling. Each is computed, none is canned.",
        epilog=common.epilog(EXAMPLE),
        formatter_class=common.Formatter,
    )
    common.add_model(parser)
    parser.add_argument("--t-end", type=float, required=True, metavar="S", help="length of each record, s")
    parser.add_argument("--dt", type=float, default=0.01, metavar="S", help="sampling period, s (default 0.01)")
    parser.add_argument(
        "--input",
        action="append",
        default=[],
        metavar="NAME=SIGNAL",
        help="an input as an expression of t, such as V=2*sin(3*t), or as multisine(RMS, LOW:HIGH) or "
        "multisine(RMS, LOW:HIGH, SEED) with the band in Hz; the same name again plans a further record",
    )
    parser.add_argument(
        "--sensor",
        action="append",
        default=[],
        metavar="NAME[=SD]",
        help="an output or state that is measured, with its noise in its unit; may be repeated (default: all outputs)",
    )
    parser.add_argument("--noise", type=float, default=0.01, metavar="SHARE", help="noise over motion (default 0.01)")
    parser.add_argument("--size", type=float, default=0.05, metavar="SHARE", help="size of effects (default 0.05)")
    parser.add_argument("--candidates", metavar="NAME,...", help="effects to ask about (default: all of the library)")
    parser.add_argument("--start", action="append", default=[], metavar="STATE=VALUE", help="an initial value")
    parser.add_argument("--hold", choices=common.HOLDS, default="first-order", help="inputs between samples")
    parser.add_argument("--threads", type=int, default=0, metavar="N", help="threads (default: one per core)")
    parser.add_argument("--plot", metavar="FILE", help="draw the matrix as SVG")
    common.add_json(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run the subcommand."""
    if arguments.plot:
        check_writable(arguments.plot)
    model = common.load_model(arguments)
    sensors: dict[str, float | None] = {}
    for word in arguments.sensor:
        name, equals, _ = word.partition("=")
        sensors |= common.numbers("--sensor", [word]) if equals else {name.strip(): None}
    with Progress() as progress:
        found = isolability(
            model,
            _records(arguments.input, arguments.t_end, arguments.dt),
            sensors or None,
            t_end=arguments.t_end,
            dt=arguments.dt,
            noise=arguments.noise,
            size=arguments.size,
            effects=arguments.candidates.split(",") if arguments.candidates else None,
            initial_state=common.numbers("--start", arguments.start) or None,
            hold=arguments.hold,
            threads=arguments.threads,
            progress=progress,
        )
    if arguments.plot:
        write_text(arguments.plot, common.as_svg(found.plot(), f"What a set-up of {model.name} tells apart"))
    print(found.to_json() if arguments.json else str(found))
    return 0


def _records(words: list[str], t_end: float, dt: float) -> list[dict[str, InputLike]]:
    """Inputs record by record: a name that comes again begins the next record of that input."""
    records: list[dict[str, InputLike]] = [{}]
    for word in words:
        ((name, text),) = common.assignments("--input", [word]).items()
        free = next((record for record in records if name not in record), None)
        if free is None:
            free = {}
            records.append(free)
        free[name] = _signal(text, t_end, dt)
    for record in records[1:]:
        for name, signal in records[0].items():
            record.setdefault(name, signal)
    return records


def _signal(text: str, t_end: float, dt: float) -> InputLike:
    if not text.startswith("multisine"):
        return text
    match = _MULTISINE.match(text)
    if match is None:
        raise InputError(
            f"--input: {text!r} is not multisine(RMS, LOW:HIGH) with the band in Hz, as multisine(2, 0.2:2.5)"
        )
    rms, low, high = (float(part) for part in match.groups()[:3])
    band = (math.tau * low, math.tau * high)
    seed = int(match[4] or 0)
    wave = signals.multisine(t_end, band, 1, rms=rms, lines="full", half_pumping="any", seed=seed)
    return wave.samples(t_end=t_end, dt=dt)


__all__ = ["Isolability", "add", "run"]
