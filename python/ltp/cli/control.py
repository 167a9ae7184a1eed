"""Owns `ltp control`: a model and a motion to follow, to feedback around it with its certificate."""

from __future__ import annotations

import argparse
import math
from typing import Any

from ltp._ltp import InputError
from ltp.cli import common, text
from ltp.closed_loop import Certificate, certify
from ltp.control import control
from ltp.feedback import Feedback
from ltp.feedforward import Reference, feedforward
from ltp.linearize import linearize

EXAMPLE = (
    "ltp control zoo:cart_pendulum --follow x=0.05 --hz 1 --limit 200 --fastest 50 "
    "--deviation x=0.02 --deviation theta=0.2"
)
ROBUST = (
    "ltp control zoo:cart_pendulum --set K_s=0.74 --follow theta=0.1 --offset 3.14159265 --hz 5 --method periodic-lqr "
    "--state-weights 1,1,0,0 --input-weights 1e-4 --harmonics 0,2 --spread l_p=0.01 --spread B_p=0.2"
)


def add(commands: common.Commands) -> None:
    """Add the subcommand."""
    parser = commands.add_parser(
        "control",
        help="design feedback around a periodic motion, and certify it",
        description="Design state feedback u = u_ref(t) - K(t) (z - z_ref(t)) around a periodic motion: one state is\n"
        "prescribed as a sine, the others and the input follow by harmonic balance. The certificate asks the lifted\n"
        "eigenvalues, the exact Floquet exponents, the loop's own orbit, runs from deviations and other parameters.",
        epilog=common.epilog(EXAMPLE, ROBUST),
        formatter_class=common.Formatter,
    )
    common.add_model(parser)
    parser.add_argument("--follow", required=True, metavar="STATE=AMPLITUDE", help="the state that is prescribed")
    parser.add_argument("--hz", required=True, type=float, help="its frequency, Hz")
    parser.add_argument("--offset", type=float, default=0.0, help="its mean (default 0)")
    parser.add_argument("--input", metavar="NAME", help="the input that is solved for (default: the first)")
    parser.add_argument(
        "--method",
        choices=("harmonic-balance", "periodic-lqr"),
        default="harmonic-balance",
        help="how the gain is found (default harmonic-balance)",
    )
    parser.add_argument(
        "--harmonics", metavar="K,...", help="of the gain: 0 is constant, 0,2 adds the second (default 0)"
    )
    parser.add_argument("--limit", type=float, metavar="NORM", help="most the norm of the gain may be")
    parser.add_argument("--fastest", type=float, metavar="RATE", help="no real part below -RATE, 1/s")
    parser.add_argument("--exact", action="store_true", help="minimise exact Floquet exponents instead of the lift's")
    parser.add_argument("--state-weights", metavar="Q,...", help="of periodic-lqr, one for each state")
    parser.add_argument("--input-weights", metavar="R,...", help="of periodic-lqr, one for each input")
    parser.add_argument("--shift", type=float, default=0.0, metavar="RATE", help="of periodic-lqr, 1/s (default 0)")
    parser.add_argument("--seed", type=int, default=0, help="of the search (default 0)")
    parser.add_argument(
        "--deviation",
        action="append",
        default=[],
        metavar="STATE=VALUE",
        help="start a run this far off the motion; may be repeated",
    )
    parser.add_argument(
        "--spread",
        action="append",
        default=[],
        metavar="NAME=SHARE",
        help="ask how the loop does when a parameter is off by up to this share; may be repeated",
    )
    common.add_json(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run the subcommand."""
    model = common.load_model(arguments)
    followed = common.numbers("--follow", [arguments.follow])
    ((state, amplitude),) = followed.items()
    reference = feedforward(
        model,
        state,
        amplitude=amplitude,
        omega=math.tau * arguments.hz,
        offset=arguments.offset,
        input=arguments.input,
    )
    options: dict[str, Any] = {"seed": arguments.seed, "limit": arguments.limit, "fastest": arguments.fastest}
    if arguments.exact:
        options["objective"] = "floquet"
    if arguments.method == "periodic-lqr":
        options = {"shift": arguments.shift}
        for name in ("state_weights", "input_weights"):
            word = getattr(arguments, name)
            options[name] = None if word is None else _list(name, word)
    if arguments.harmonics is not None:
        options["harmonics"] = [int(k) for k in _list("harmonics", arguments.harmonics)]
    feedback = control(linearize(model, reference), arguments.method, **options)
    deviation, spread = common.numbers("--deviation", arguments.deviation), common.numbers("--spread", arguments.spread)
    certificate = certify(
        model, reference, feedback, deviations=deviation if deviation else (), spread=spread if spread else None
    )
    if arguments.json:
        print(common.as_json(_tree(reference, feedback, certificate)))
    else:
        print(_summary(reference, feedback, certificate))
    return 0


def _list(name: str, word: str) -> list[float]:
    try:
        return [float(part) for part in word.split(",")]
    except ValueError:
        option = name.replace("_", "-")
        raise InputError(f"--{option} {word}: expected numbers separated by commas, as 1,1,0,0") from None


def _tree(reference: Reference, feedback: Feedback, certificate: Certificate) -> dict[str, Any]:
    worst = certificate.worst
    return {
        "period": reference.period,
        "states": reference.state_names,
        "inputs": reference.input_names,
        "gain": {
            str(k): {"real": matrix.real.tolist(), "imaginary": matrix.imag.tolist()}
            for k, matrix in feedback.harmonics.items()
        },
        "figures": feedback.figures,
        "verdict": certificate.verdict,
        "sentence": certificate.sentence,
        "reasons": certificate.reasons,
        "open": [[z.real, z.imag] for z in certificate.open.tolist()],
        "exponents": [[z.real, z.imag] for z in certificate.exponents.tolist()],
        "orbit": None
        if certificate.orbit is None
        else {
            "exponents": [[z.real, z.imag] for z in certificate.orbit.exponents.tolist()],
            "error": certificate.orbit.error,
        },
        "runs": [
            {
                "deviation": each.deviation,
                "settled": each.settled,
                "steady": each.steady,
                "feedback": each.feedback,
                "growth": each.growth,
                "tolerated": each.tolerated,
            }
            for each in certificate.runs
        ],
        "worst": None if worst is None else {"changes": worst.changes, "slowest": worst.slowest, "error": worst.error},
    }


def _summary(reference: Reference, feedback: Feedback, certificate: Certificate) -> str:
    rows = []
    for k, matrix in feedback.harmonics.items():
        shown = [("", matrix.real)] if k == 0 else [(" real", matrix.real), (" imaginary", matrix.imag)]
        for words, part in shown:
            for name, row in zip(reference.input_names, part, strict=True):
                rows.append([f"{name}, harmonic {k}{words}", *(f"{value:.6g}" for value in row)])
    exponents = [
        [f"{a.real:+.5f} {a.imag:+.5f}j", f"{b.real:+.5f} {b.imag:+.5f}j"]
        for a, b in zip(certificate.open, certificate.exponents, strict=True)
    ]
    parts = [
        f"{reference.model.name}: feedback by {feedback.method} around a motion of {reference.period:.6g} s",
        "",
        text.table(["gain", *reference.state_names], rows),
        "",
        text.table(["open loop, 1/s", "closed loop, 1/s"], exponents, left=0),
    ]
    for each in certificate.runs:
        settled = [
            [n, "-" if s is None else f"{s:.3g} s", f"{100 * each.steady[n]:.3g} %"] for n, s in each.settled.items()
        ]
        peaks = ", ".join(f"{name} {value:.4g}" for name, value in each.feedback.items())
        parts += [
            "",
            text.table(["from the deviation", "settles", "error left"], settled),
            f"  peak of the feedback: {peaks}",
        ]
    worst = certificate.worst
    if worst is not None:
        slowest = "no orbit" if worst.slowest is None else f"{worst.slowest:.4f} 1/s"
        changes = ", ".join(f"{name} {100 * change:+.3g} %" for name, change in worst.changes.items())
        parts += ["", f"worst of the other parameters: {slowest} at {changes}"]
    return "\n".join([*parts, "", certificate.sentence])
