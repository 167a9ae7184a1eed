"""Owns `ltp linearize`: a model to its exact harmonic transfer functions."""

from __future__ import annotations

import argparse
import math
from typing import Any

import numpy as np

from ltp._ltp import InputError
from ltp.cli import common, text, transfer
from ltp.cycle import cycle
from ltp.files import check_writable, write_text
from ltp.htf import Htf
from ltp.linearize import LtpSystem, linearize

EXAMPLE = "ltp linearize zoo:hopper --frequencies 0:5:0.01 --harmonics 10 --out exact.npz --plot exact.svg"


def add(commands: common.Commands) -> None:
    """Add the subcommand."""
    parser = commands.add_parser(
        "linearize",
        help="linearize a model around its orbit and write its harmonic transfer functions",
        description="Linearize a model around its periodic orbit, through its events, and evaluate the exact harmonic\n"
        "transfer functions: an input exp(jwt) gives the sum over k of H_k(w) exp(j(w + 2 pi k/T)t).",
        epilog=common.epilog(EXAMPLE),
        formatter_class=common.Formatter,
    )
    common.add_model(parser)
    common.add_orbit(parser)
    parser.add_argument("--inputs", metavar="NAME,...", help="inputs to keep (default: all)")
    parser.add_argument("--outputs", metavar="NAME,...", help="outputs to keep (default: all)")
    parser.add_argument("--harmonics", type=int, default=10, metavar="K", help="largest harmonic (default 10)")
    parser.add_argument(
        "--frequencies",
        default="0:5:0.01",
        metavar="HZ",
        help="input frequencies in Hz, as FIRST:LAST:STEP or separated by commas (default 0:5:0.01)",
    )
    parser.add_argument("--out", metavar="FILE", help="write the harmonic transfer functions (.npz)")
    parser.add_argument("--plot", metavar="FILE", help="draw magnitude and phase as SVG")
    common.add_json(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run the subcommand."""
    for path in (arguments.out, arguments.plot):
        if path:
            check_writable(path)
    hz = _frequencies(arguments.frequencies)
    model = common.load_model(arguments)
    orbit = cycle(model, **common.orbit_options(arguments))
    chosen = {name: _names(getattr(arguments, name)) for name in ("inputs", "outputs")}
    system = linearize(model, orbit, inputs=chosen["inputs"], outputs=chosen["outputs"])
    htf = system.htf(math.tau * np.array(hz), arguments.harmonics)
    if arguments.out:
        htf.save(arguments.out)
    if arguments.plot:
        write_text(arguments.plot, common.as_svg(htf.plot(), f"Harmonic transfer functions of {model.name}"))
    print(common.as_json(_tree(system, htf)) if arguments.json else _summary(model.name, system, htf))
    if not arguments.json:
        for what, path in (("harmonic transfer functions", arguments.out), ("figure", arguments.plot)):
            if path:
                print(f"{what} written to {path}")
    return 0


def _frequencies(word: str) -> list[float]:
    """`FIRST:LAST:STEP` with both ends, or a list, in Hz."""
    try:
        if ":" not in word:
            return [float(part) for part in word.split(",")]
        first, last, step = (float(part) for part in word.split(":"))
        count = math.floor((last - first) / step + 1e-9) + 1 if step > 0 and last >= first else 0
    except ValueError:
        count = 0
    if not 0 < count <= 1_000_000:
        raise InputError(f"--frequencies {word}: expected FIRST:LAST:STEP in Hz, as 0:5:0.01, or a list, as 1,2.5,3")
    return [first + i * step for i in range(count)]


def _names(word: str | None) -> list[str] | None:
    return None if word is None else [name.strip() for name in word.split(",") if name.strip()]


def _tree(system: LtpSystem, htf: Htf) -> dict[str, Any]:
    return {
        "period": system.period,
        "multipliers": [[z.real, z.imag] for z in system.multipliers.tolist()],
        "jumps": [
            {"name": j.name, "time": j.time, "state": j.state.tolist(), "input": j.input.tolist()} for j in system.jumps
        ],
        "htf": transfer.tree(htf),
    }


def _summary(name: str, system: LtpSystem, htf: Htf) -> str:
    rows = [[f"{z.real:+.9f}", f"{z.imag:+.9f}", f"{abs(z):.9f}"] for z in system.multipliers.tolist()]
    parts = [
        f"{name}: linear periodic system, period {system.period:.10g} s, {len(system.jumps)} jumps",
        "",
        text.table(["multiplier", "imaginary", "magnitude"], rows, left=0),
        "",
        transfer.summary(htf, system.input_names, system.output_names),
    ]
    return "\n".join(parts)
