"""Owns `ltp harmonic-map`: where in harmonics and frequency a clock-driven machine differs from its model."""

from __future__ import annotations

import argparse
import math

import numpy as np

from ltp.cli import common, text
from ltp.files import check_writable, write_text
from ltp.harmonic import HarmonicMap, harmonic_map
from ltp.progress import Progress

EXAMPLES = (
    "ltp simulate zoo:hopper --set d=13 --t-end 59.4 --dt 0.005 "
    '--input "u_c=0.3*(sin(2*pi*t/3.96) + sin(2*pi*t/1.98 + 1) + sin(2*pi*t/0.99 + 2))" --out probed.csv',
    "ltp harmonic-map zoo:hopper probed.csv@19.8:59.395 --plot map.svg",
)


def add(commands: common.Commands) -> None:
    """Add the subcommand."""
    parser = commands.add_parser(
        "harmonic-map",
        help="compare a machine that has a clock with its model, harmonic by frequency",
        description="Identify the harmonic transfer functions of recordings, subtract the exact ones of the model,\n"
        "and give the difference in units of its standard deviation; and measure which events come early or late. The\n"
        "model is taken at its own parameters. An input that repeats gives the sharpest map: noise is what does not\n"
        "repeat. Record from the settled orbit on, with times of the model's clock. Recordings as for `ltp diagnose`.",
        epilog=common.epilog(*EXAMPLES),
        formatter_class=common.Formatter,
    )
    common.add_model(parser)
    parser.add_argument("runs", metavar="RUN", nargs="+", help="recordings (.csv .tsv .txt .npz .mat .json)")
    parser.add_argument("--harmonics", type=int, default=3, metavar="K", help="largest harmonic (default 3)")
    parser.add_argument("--band", type=float, metavar="HZ", help="largest input frequency, Hz (default: the input's)")
    common.add_reading(parser)
    parser.add_argument(
        "--hold",
        choices=common.HOLDS,
        default="first-order",
        help="what inputs do between samples (default first-order)",
    )
    parser.add_argument("--plot", metavar="FILE", help="draw the map as SVG")
    common.add_json(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run the subcommand."""
    if arguments.plot:
        check_writable(arguments.plot)
    model = common.load_model(arguments)
    columns = common.column_mapping(arguments.columns)
    recordings = [common.load_recording(word, model, columns, arguments.dt) for word in arguments.runs]
    with Progress() as progress:
        found = harmonic_map(
            model,
            recordings,
            harmonics=arguments.harmonics,
            band=None if arguments.band is None else math.tau * arguments.band,
            hold=arguments.hold,
            progress=progress,
        )
    if arguments.plot:
        write_text(arguments.plot, common.as_svg(found.plot(), found.sentence))
    if arguments.json:
        print(found.to_json())
        return 0
    print(summary(found))
    if arguments.plot:
        print(f"figure written to {arguments.plot}")
    return 0


def summary(found: HarmonicMap) -> str:
    """The map on one screen: the sentence, each harmonic of each pair of signals, and the events."""
    rows = []
    for y, output in enumerate(found.outputs):
        for u, name in enumerate(found.inputs):
            for k, z in zip(found.harmonics, found.z[y, u], strict=True):
                if not np.isfinite(z).any():
                    continue
                largest = int(np.nanargmax(z))
                rms, hertz = math.sqrt(np.nanmean(z**2)), found.omega[largest] / math.tau
                shown = [text.number(value, 3) for value in (rms, z[largest], hertz)]
                rows.append([f"{name} to {output}", f"{k:+d}" if k else "0", *shown])
    head = ["from", "harmonic", "rms", "largest", "at Hz"]
    parts = [found.sentence, "", "difference in standard deviations (noise alone: rms 1)", text.table(head, rows)]
    if found.events:
        events = [
            [event.record, event.name, text.estimate(1e3 * event.residual_s, 1e3 * event.sd_s), f"{event.count}"]
            for event in found.events
        ]
        parts += ["", "events, later than predicted by", text.table(["record", "event", "ms", "count"], events, left=2)]
    return "\n".join(parts)
