"""Owns `ltp simulate`: a model document and its inputs to a table of the run."""

from __future__ import annotations

import argparse
import sys
from typing import Any

from ltp.cli import common, text
from ltp.files import check_writable
from ltp.model import Model
from ltp.simulate import Trajectory, simulate

_EVENTS_SHOWN = 5

EXAMPLE = 'ltp simulate zoo:drive --t-end 2 --dt 0.001 --input "tau=40*sin(3*t)" --out run.csv'


def add(commands: common.Commands) -> None:
    """Add the subcommand."""
    parser = commands.add_parser(
        "simulate",
        help="simulate a model",
        description="Simulate a model from t = 0 and write the sampled signals as CSV: t, inputs, outputs, states,\n"
        "mode. A run that ends early (Zeno, escape, step limit) is written as far as it is valid, and says so.",
        epilog=common.epilog(EXAMPLE),
        formatter_class=common.Formatter,
    )
    common.add_model(parser)
    parser.add_argument("--t-end", type=float, required=True, metavar="S", help="end of the run, s")
    parser.add_argument("--dt", type=float, default=1e-3, metavar="S", help="sampling period, s (default 0.001)")
    parser.add_argument(
        "--input",
        action="append",
        default=[],
        metavar="NAME=EXPRESSION",
        help="an input as an expression of t, such as V=2*sin(3*t); may be repeated",
    )
    parser.add_argument(
        "--start",
        action="append",
        default=[],
        metavar="STATE=VALUE",
        help="an initial value, in the state's unit; may be repeated",
    )
    parser.add_argument("--mode", metavar="NAME", help="the mode to start in")
    parser.add_argument("--step", type=float, metavar="S", help="longest integration step, s (default --dt)")
    parser.add_argument("--strict", action="store_true", help="fail (exit code 1) when the run ends before --t-end")
    parser.add_argument("--out", metavar="FILE", help="write the run as CSV")
    common.add_json(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run the subcommand."""
    if arguments.out:
        check_writable(arguments.out)
    model = common.load_model(arguments)
    trajectory = simulate(
        model,
        common.assignments("--input", arguments.input),
        t_end=arguments.t_end,
        dt=arguments.dt,
        step=arguments.step,
        initial_state=common.numbers("--start", arguments.start) or None,
        initial_mode=arguments.mode,
        strict=arguments.strict,
    )
    if trajectory.stop.early:
        print(f"ltp: warning: {trajectory.stop.message}", file=sys.stderr)
    if arguments.out:
        trajectory.save(arguments.out)
    print(common.as_json(_tree(trajectory)) if arguments.json else _summary(model, trajectory, arguments.out))
    return 0


def _tree(run: Trajectory) -> dict[str, Any]:
    """The JSON object: the fields of `Trajectory`, signals by name."""

    def by_name(names: list[str], values: Any) -> dict[str, list[float]]:
        return {name: values[:, k].tolist() for k, name in enumerate(names)}

    return {
        "t": run.t.tolist(),
        "states": by_name(run.state_names, run.states),
        "inputs": by_name(run.input_names, run.inputs),
        "outputs": by_name(run.output_names, run.outputs),
        "mode": run.mode.tolist(),
        "events": [vars(event) for event in run.events],
        "stop": vars(run.stop),
        "stats": run.stats,
    }


def _summary(model: Model, run: Trajectory, out: str | None) -> str:
    where = f", written to {out}" if out else ""
    if not len(run.t):
        return f"{model.name}: no samples{where}; it ended before the first one"
    parts = [f"{model.name}: {len(run.t)} samples from {run.t[0]:g} to {run.t[-1]:g} s{where}", ""]
    rows = [
        [name, model.unit(name), text.number(low), text.number(high), text.number(last)]
        for names, values in ((run.state_names, run.states), (run.output_names, run.outputs))
        for name, low, high, last in zip(names, values.min(0), values.max(0), values[-1], strict=True)
    ]
    unique = list({row[0]: row for row in rows}.values())  # an output often is a state
    parts.append(text.table(["signal", "unit", "least", "largest", "last"], unique, left=2))
    if run.events:
        shown = ", ".join(f"{event.name} at {event.time:.6g} s" for event in run.events[:_EVENTS_SHOWN])
        more = ", ..." if len(run.events) > _EVENTS_SHOWN else ""
        parts += ["", f"{len(run.events)} event{'s' if len(run.events) > 1 else ''}: {shown}{more}"]
    return "\n".join(parts)
