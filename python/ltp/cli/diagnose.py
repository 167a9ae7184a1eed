"""Owns `ltp diagnose`: a model and recordings to the verdict, as text, JSON and report."""

from __future__ import annotations

import argparse

from ltp.cli import common, text
from ltp.diagnose import Diagnosis, FitRow, diagnose
from ltp.files import check_writable
from ltp.progress import Progress

_RANKING_SHOWN = 5

EXAMPLES = (
    'ltp simulate zoo:drive --t-end 4 --dt 0.01 --input "tau=40*sin(3*t)" --set b=230 --out run.csv',
    'ltp simulate zoo:drive --t-end 4 --dt 0.01 --input "tau=30*sin(5*t)" --set b=230 --out other.csv',
    "ltp diagnose zoo:drive run.csv --test other.csv --report report.html",
)


def add(commands: common.Commands) -> None:
    """Add the subcommand."""
    parser = commands.add_parser(
        "diagnose",
        help="compare a model with recordings and name the physics that was left out",
        description="Compare a model with recordings, locate the mismatch, and name and fit the physics that was left\n"
        "out. Recordings: .csv .tsv .txt (each also .gz), .npz, .mat, .json; columns by the names of the model's\n"
        "inputs and outputs, time as t or time; units in headers, as 'theta [deg]', are converted. FILE@START:END\n"
        "takes a part (seconds).",
        epilog=common.epilog(*EXAMPLES),
        formatter_class=common.Formatter,
    )
    common.add_model(parser)
    parser.add_argument("train", metavar="RUN", nargs="+", help="recordings to fit")
    parser.add_argument(
        "--test",
        action="append",
        default=[],
        metavar="RUN",
        help="a recording that is held out, to judge by; may be repeated",
    )
    common.add_reading(parser)
    parser.add_argument("--candidates", metavar="NAME,...", help="effects to try (default: all of the library)")
    parser.add_argument(
        "--hold",
        choices=common.HOLDS,
        default="first-order",
        help="what inputs do between samples (default first-order)",
    )
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="seed of everything random (default 0)")
    parser.add_argument("--threads", type=int, default=0, metavar="N", help="threads (default: one per core)")
    parser.add_argument("--report", metavar="FILE", help="write a self-contained HTML report")
    parser.add_argument("--save-model", metavar="FILE", help="write the augmented model as TOML")
    common.add_json(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run the subcommand."""
    for path in (arguments.report, arguments.save_model):
        if path:
            check_writable(path)  # before the minutes of work, not after
    model = common.load_model(arguments)
    columns = common.column_mapping(arguments.columns)
    train = [common.load_recording(word, model, columns, arguments.dt) for word in arguments.train]
    test = [common.load_recording(word, model, columns, arguments.dt) for word in arguments.test]
    names = arguments.candidates
    with Progress() as progress:
        diagnosis = diagnose(
            model,
            train,
            test,
            candidates=None if names is None else [name.strip() for name in names.split(",") if name.strip()],
            hold=arguments.hold,
            seed=arguments.seed,
            threads=arguments.threads,
            progress=progress,
        )
    if arguments.save_model:
        diagnosis.model.save(arguments.save_model)
    if arguments.report:
        diagnosis.report(arguments.report)
    if arguments.json:
        print(diagnosis.to_json())
    else:
        print(summary(diagnosis))
        for what, path in (("report", arguments.report), ("model", arguments.save_model)):
            if path:
                print(f"{what} written to {path}")
    return 0


def summary(diagnosis: Diagnosis) -> str:
    """The diagnosis on one screen: the sentence, what was found, the errors, the ranking's top, the parameters."""
    parts = [diagnosis.sentence]
    if diagnosis.effects:
        rows = [
            [f"{effect.name} at {effect.at}", name, text.with_unit(text.estimate(value.value, value.sd), value.unit)]
            for effect in diagnosis.effects
            for name, value in effect.parameters.items()
        ]
        parts += ["", "found", text.table(["effect", "parameter", "value"], rows, left=3)]
    if diagnosis.ambiguous_with:
        parts += ["", f"the data cannot tell it from: {', '.join(diagnosis.ambiguous_with)}"]
    parts += ["", "simulation error, rms over the standard deviation of the signal", _errors(diagnosis)]
    parts += ["", "explanations tried, best first (score: smaller is better)", _ranking(diagnosis)]
    if diagnosis.parameters:
        parts += ["", "nominal parameters", _parameters(diagnosis)]
    parts += ["", f"{diagnosis.seconds:.1f} s"]
    return "\n".join(parts)


def _errors(diagnosis: Diagnosis) -> str:
    def line(role: str, row: FitRow) -> list[str]:
        errors = (row.nominal, row.before, row.after, row.floor)
        return [role, row.record, row.output, *(text.percent(error) for error in errors)]

    rows = [line("train", row) for row in diagnosis.fit.train] + [line("held out", row) for row in diagnosis.fit.test]
    return text.table(["", "record", "output", "nominal", "refitted", "with effect", "noise floor"], rows, left=3)


def _ranking(diagnosis: Diagnosis) -> str:
    rows = [
        [
            f"{entry.name} at {entry.at}" if entry.at else entry.name,
            text.number(entry.score),
            text.number(entry.held_out),
            "" if entry.converged else "did not converge",
        ]
        for entry in diagnosis.candidates
    ]
    shown = rows[:_RANKING_SHOWN]
    header = ["explanation", "score", "held out", ""]
    more = f"\n  and {len(rows) - len(shown)} more (--json lists all)" if len(rows) > len(shown) else ""
    return text.table(header, shown) + more


def _parameters(diagnosis: Diagnosis) -> str:
    rows = [
        [name, text.estimate(p.nominal, p.nominal_sd), text.number(p.before, 5), text.estimate(p.after, p.sd), p.unit]
        for name, p in diagnosis.parameters.items()
    ]
    return text.table(["", "as stated", "refitted", "with effect", "unit"], rows)
