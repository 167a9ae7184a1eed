"""Owns `ltp cycle`: a model document to its periodic orbit."""

from __future__ import annotations

import argparse
from typing import Any

from ltp.cli import common, text
from ltp.cycle import LimitCycle, cycle
from ltp.files import check_writable, write_text
from ltp.model import Model

EXAMPLE = "ltp cycle zoo:hopper --probes 20 --plot cycle.svg"


def add(commands: common.Commands) -> None:
    """Add the subcommand."""
    parser = commands.add_parser(
        "cycle",
        help="find the periodic orbit of a model",
        description="Find the periodic orbit that a start leads to or lies near, by shooting through its events:\n"
        "period, events with their phases, Floquet multipliers. Stable or not; a machine may have several orbits,\n"
        "and --probes says which others there are and from how far this one attracts.",
        epilog=common.epilog(EXAMPLE),
        formatter_class=common.Formatter,
    )
    common.add_model(parser)
    common.add_orbit(parser)
    parser.add_argument(
        "--probes", type=int, default=0, metavar="N", help="follow N starts around the orbit and say where they end"
    )
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="seed of these starts (default 0)")
    parser.add_argument("--out", metavar="FILE", help="write one period as CSV")
    parser.add_argument(
        "--plot", metavar="FILE", help="draw the orbit as SVG: the first state and its rate, one period"
    )
    common.add_json(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run the subcommand."""
    for path in (arguments.out, arguments.plot):
        if path:
            check_writable(path)
    model = common.load_model(arguments)
    found = cycle(model, **common.orbit_options(arguments), probes=arguments.probes, seed=arguments.seed)
    if arguments.out:
        found.trajectory.save(arguments.out)
    if arguments.plot:
        write_text(arguments.plot, common.as_svg(found.plot(*_axes(model)), f"Limit cycle of {model.name}"))
    if arguments.json:
        print(common.as_json(tree(found)))
    else:
        print(summary(model, found))
        for what, path in (("period", arguments.out), ("figure", arguments.plot)):
            if path:
                print(f"{what} written to {path}")
    return 0


def _axes(model: Model) -> tuple[str, str]:
    """Two states that make a cross-section: the first, and the one in the unit of its rate, or the second."""
    first, *rest = model.states
    unit = model.unit(first)
    return first, next((name for name in rest if model.unit(name) == f"{unit}/s"), (rest or [first])[0])


def tree(found: LimitCycle) -> dict[str, Any]:
    """The JSON object: the fields of `LimitCycle`."""
    return {
        "period": found.period,
        "autonomous": found.autonomous,
        "stable": found.stable,
        "start": found.start,
        "events": [vars(event) for event in found.events],
        "multipliers": [[z.real, z.imag] for z in found.multipliers.tolist()],
        "domain": None if found.domain is None else vars(found.domain),
        "others": [{"starts": other.starts, **tree(other.cycle)} for other in found.others],
        "stats": found.stats,
        "warnings": found.warnings,
    }


def summary(model: Model, found: LimitCycle) -> str:
    """The orbit on one screen: events, multipliers, what lies around it."""
    kind = "period found" if found.autonomous else "period of the clock"
    state = "stable" if found.stable else "unstable"
    parts = [f"{model.name}: {state} periodic orbit, {kind} {found.period:.10g} s", ""]
    if found.events:
        rows = [[e.name, f"{e.time:.9g}", f"{e.phase:.9f}", f"{e.mode_before} to {e.mode_after}"] for e in found.events]
        parts += [text.table(["event", "time, s", "phase", "mode"], rows), ""]
    rows = [[f"{z.real:+.9f}", f"{z.imag:+.9f}", f"{abs(z):.9f}"] for z in found.multipliers.tolist()]
    parts.append(text.table(["multiplier", "imaginary", "magnitude"], rows, left=0))
    if found.domain is not None:
        d = found.domain
        parts += [
            "",
            f"{d.returned} of {d.probes} starts around it came back, all of those within {d.radius:.2g} of its range",
        ]
    for other in found.others:
        events = ", ".join(dict.fromkeys(event.name for event in other.cycle.events)) or "no event"
        reach = other.cycle.trajectory.states[:, 0]
        name = model.states[0]
        parts.append(
            f"{other.starts} ended on another orbit: {events}, {name} from {reach.min():.4g} to {reach.max():.4g}"
        )
    if found.lost:
        parts.append(f"{len(found.lost)} ended on no periodic orbit: {found.lost[0][1]}")
    return "\n".join(parts)
