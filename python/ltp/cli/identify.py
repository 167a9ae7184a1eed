"""Owns `ltp identify`: recordings to harmonic transfer functions, without a model."""

from __future__ import annotations

import argparse
import math

from ltp.cli import common, text, transfer
from ltp.files import check_writable, write_text
from ltp.htf import Htf
from ltp.identify import identify

EXAMPLES = (
    "ltp simulate zoo:hopper --t-end 120.45 --input u_c=0 --out orbit.csv",
    'ltp simulate zoo:hopper --t-end 120.45 --input "u_c=0.1*sin(2*pi*t + 2*sin(3*t))" --out run.csv',
    "ltp identify run.csv --minus orbit.csv --period 0.33 --harmonics 5 --band 3 --input u_c --output h "
    "--out htf.npz --plot htf.svg",
)


def add(commands: common.Commands) -> None:
    """Add the subcommand."""
    parser = commands.add_parser(
        "identify",
        help="identify harmonic transfer functions from recordings",
        description="Identify the harmonic transfer functions of a periodic system from recordings of inputs and\n"
        "outputs, with their uncertainty. No model is asked for. Outputs are deviations from the periodic orbit,\n"
        "which --minus subtracts; with --orbit removed they may contain it.",
        epilog=common.epilog(*EXAMPLES),
        formatter_class=common.Formatter,
    )
    parser.add_argument("runs", metavar="RUN", nargs="+", help="recordings (.csv .tsv .txt .npz .mat)")
    parser.add_argument("--period", type=float, required=True, metavar="S", help="period of the system, s")
    parser.add_argument("--harmonics", type=int, default=10, metavar="K", help="largest harmonic (default 10)")
    parser.add_argument("--input", action="append", required=True, metavar="NAME", help="column of an input")
    parser.add_argument("--output", action="append", required=True, metavar="NAME", help="column of an output")
    parser.add_argument("--dt", type=float, metavar="S", help="sampling period, s, for files without a time column")
    parser.add_argument("--minus", metavar="RUN", help="a recording of the undisturbed orbit, to subtract")
    parser.add_argument(
        "--method", choices=transfer.METHODS, default="floquet", help="estimator (default floquet); docs/identify.md"
    )
    parser.add_argument("--band", type=float, metavar="HZ", help="largest input frequency, Hz (default: the input's)")
    parser.add_argument(
        "--orbit",
        choices=("deviation", "removed"),
        default="deviation",
        help="removed: outputs contain the orbit, multiples of 1/T carry no information",
    )
    parser.add_argument(
        "--exact", metavar="FILE", help="harmonic transfer functions (.npz) to draw beside the estimate"
    )
    parser.add_argument("--out", metavar="FILE", help="write the harmonic transfer functions (.npz)")
    parser.add_argument("--plot", metavar="FILE", help="draw magnitude and phase with 95 %% bands as SVG")
    common.add_json(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run the subcommand."""
    for path in (arguments.out, arguments.plot):
        if path:
            check_writable(path)
    exact = Htf.load(arguments.exact) if arguments.exact else None
    recordings = transfer.recordings(arguments.runs, arguments.input, arguments.output, arguments.dt, arguments.minus)
    htf = identify(
        recordings,
        period=arguments.period,
        harmonics=arguments.harmonics,
        method=arguments.method,
        band=None if arguments.band is None else math.tau * arguments.band,
        orbit=arguments.orbit,
    )
    if arguments.out:
        htf.save(arguments.out)
    if arguments.plot:
        write_text(arguments.plot, common.as_svg(htf.plot(exact=exact), "Identified harmonic transfer functions"))
    if arguments.json:
        print(common.as_json(transfer.tree(htf)))
        return 0
    print(transfer.summary(htf, arguments.input, arguments.output))
    rows = [[name, text.number(value, 6)] for name, value in htf.figures.items()]
    if rows:
        print("\n" + text.table(["figure", "value"], rows))
    for what, path in (("harmonic transfer functions", arguments.out), ("figure", arguments.plot)):
        if path:
            print(f"{what} written to {path}")
    return 0
