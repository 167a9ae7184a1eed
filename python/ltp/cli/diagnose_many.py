"""Owns `ltp diagnose-many`: a folder of models and recordings to a folder of diagnoses."""

from __future__ import annotations

import argparse
import json
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

from ltp._ltp import InputError
from ltp.cli import common, text
from ltp.diagnose_many import JobResult, diagnose_many
from ltp.jobs import Job
from ltp.progress import Progress

_RECORDINGS = (".csv", ".tsv", ".txt", ".gz", ".npz", ".mat", ".json")
_MODEL = "model.toml"

EXAMPLES = ("ltp diagnose-many machines --results results --workers 2",)


def add(commands: common.Commands) -> None:
    """Add the subcommand."""
    parser = commands.add_parser(
        "diagnose-many",
        help="diagnose every machine of a folder, on several processes, and go on after a kill",
        description="Diagnose every machine of a folder. A machine is a folder in it, with its recordings train*.csv\n"
        "and test*.csv (or any other kind that `ltp diagnose` reads) and its model.toml; one without takes the\n"
        "model.toml beside it. What is in the results folder already, from the same files, is not done again.",
        epilog=common.epilog(*EXAMPLES),
        formatter_class=common.Formatter,
    )
    parser.add_argument("folder", metavar="FOLDER", help="the folder with one folder per machine")
    parser.add_argument("--results", metavar="DIR", required=True, help="the folder that the diagnoses are written to")
    parser.add_argument("--workers", type=int, default=1, metavar="N", help="processes (default 1)")
    common.add_reading(parser)
    parser.add_argument("--candidates", metavar="NAME,...", help="effects to try (default: all of the library)")
    parser.add_argument("--hold", choices=common.HOLDS, default="first-order", help="as for `ltp diagnose`")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="seed of everything random (default 0)")
    common.add_json(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run the subcommand; the exit code is 1 when a job failed."""
    if arguments.workers < 1:
        raise InputError(f"--workers {arguments.workers}: at least one process is needed; give 1 or more")
    names = arguments.candidates
    options = {
        "columns": common.column_mapping(arguments.columns),
        "dt": arguments.dt,
        "candidates": None if names is None else [name.strip() for name in names.split(",") if name.strip()],
        "hold": arguments.hold,
        "seed": arguments.seed,
    }
    jobs = jobs_of(Path(arguments.folder), {name: value for name, value in options.items() if value})
    with Progress() as progress:
        if arguments.workers == 1:
            results = diagnose_many(jobs, results=arguments.results, progress=progress)
        else:  # started afresh: a copy of this process could hold a lock that nobody lets go
            with ProcessPoolExecutor(arguments.workers, mp_context=get_context("spawn")) as pool:
                results = diagnose_many(jobs, pool, results=arguments.results, progress=progress)
    print(common.as_json([_tree(one) for one in results.values()]) if arguments.json else _table(results))
    return 1 if any(one.error for one in results.values()) else 0


def jobs_of(folder: Path, options: dict[str, object]) -> list[Job]:
    """One job for each machine of the folder. Raises `InputError` when there is none, or one lacks files."""
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; give the one that holds a folder for each machine")
    jobs = []
    for machine in sorted(path for path in folder.iterdir() if path.is_dir()):
        files = sorted(path for path in machine.iterdir() if path.suffix.lower() in _RECORDINGS)
        train = [path for path in files if path.name.startswith("train")]
        test = [path for path in files if path.name.startswith("test")]
        if not train:
            continue
        model = next((path for path in (machine / _MODEL, folder / _MODEL) if path.is_file()), None)
        if model is None:
            raise InputError(f"{machine}: recordings, but no {_MODEL} here or in {folder}; write one")
        jobs.append(Job(machine.name, model, train, test, options))
    if not jobs:
        raise InputError(f"{folder}: no folder in it has a recording train*; expected {folder}/MACHINE/train.csv")
    return jobs


def _tree(result: JobResult) -> dict[str, object]:
    return {
        "job": result.name,
        "diagnosis": None if result.diagnosis is None else json.loads(result.diagnosis.to_json()),
        "error": None if result.error is None else {"kind": result.error.kind, "message": result.error.message},
        "seconds": result.seconds,
        "resumed": result.resumed,
    }


def _table(results: dict[str, JobResult]) -> str:
    rows = [
        [
            one.name,
            one.diagnosis.verdict if one.diagnosis else "failed",
            ", ".join(f"{effect.name} at {effect.at}" for effect in one.diagnosis.effects) if one.diagnosis else "",
            "as before" if one.resumed else f"{one.seconds:.1f} s",
        ]
        for one in results.values()
    ]
    lines = [text.table(["machine", "verdict", "effects", ""], rows, left=4)]
    lines += [f"{one.name}: {one.sentence}" for one in results.values() if one.error]
    return "\n".join(lines)
