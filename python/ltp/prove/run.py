"""Owns the walk of a proof: draw, seal, diagnose from files alone, open, score."""

from __future__ import annotations

import io
import json
import sys
import time
import warnings
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, TextIO

from ltp._ltp import ConvergenceError, InputError
from ltp.conceal import draw
from ltp.diagnose import diagnose
from ltp.files import write_bytes, write_text
from ltp.progress import Progress
from ltp.prove.folder import Folder, read_case
from ltp.prove.mark import Mark, mark
from ltp.prove.plan import Task
from ltp.prove.score import Score, confusion, score

#: Seeds after that of the task that are tried when a draw is given up.
_SPARE = 100_000
_DRAWERS = 2  # cases drawn at once


def prove(
    tasks: list[Task],
    out: Path,
    say: Callable[[str], None] | None = None,
    progress: Progress | None = None,
    *,
    jobs: int = 1,
) -> Score:
    """Draw the cases of a plan into a folder, seal their labels, diagnose each from its files, open the labels, score.

    A folder that holds a part of this plan is continued: cases that are drawn stay, diagnoses that are made stay. `say`
    is told what a reader must see when it happens; the seal is told before the first diagnosis. `jobs` cases are
    diagnosed at once: one by one each has all cores, several share them and the whole is done sooner.
    """
    say = say or (lambda _: None)
    tell = progress or (lambda _m, _f: None)
    folder = Folder(out, tasks)
    begun = time.perf_counter()
    _draw_all(folder, tell)
    seal = folder.seal()
    say(f"{len(tasks)} cases drawn in {time.perf_counter() - begun:.0f} s; SHA-256 of labels and salt:\n  {seal}")
    open_cases = [k for k in range(len(tasks)) if folder.result(k) is None]

    def one(k: int) -> None:
        folder.write_result(k, diagnosed(folder.case(k), threads=0 if jobs == 1 else 1))

    with ThreadPoolExecutor(jobs) as pool:
        # Alone, a diagnosis runs in the main thread, where Ctrl-C reaches it.
        each = map(one, open_cases) if jobs == 1 else pool.map(one, open_cases)
        for done, _ in enumerate(each, len(tasks) - len(open_cases) + 1):
            tell(f"diagnosing, {done} of {len(tasks)}", 0.2 + 0.8 * done / len(tasks))
    # Only now are the labels read again.
    opened = score(marks(folder))
    write_text(out / "score.json", json.dumps(opened.tree(), indent=1))
    _figure(out, opened)
    return opened


def diagnosed(case: Path, *, threads: int = 0) -> str:
    """The JSON of the diagnosis of the files in a folder; an error, with what it says, is a result too."""
    begun = time.perf_counter()
    try:
        model, train, test = read_case(case)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # they stand in the result
            return diagnose(model, train, test, threads=threads).to_json()
    except (InputError, ConvergenceError) as error:
        return json.dumps({"error": str(error), "seconds": time.perf_counter() - begun})


def marks(folder: Folder) -> list[Mark]:
    """Marks of all cases that are diagnosed."""
    found = []
    for k in range(len(folder.tasks)):
        result = folder.result(k)
        if result is not None:
            found.append(mark(folder.label(k), result))
    return found


def _draw_all(folder: Folder, tell: Callable[[str, float], Any]) -> None:
    missing = [k for k in range(len(folder.tasks)) if not folder.label_file(k).exists()]

    def one(k: int) -> None:
        task = folder.tasks[k]
        for spare in range(5):
            try:
                drawn = draw(task.system, task.difficulty, task.seed + spare * _SPARE)
            except ConvergenceError:
                continue
            folder.write_case(k, drawn)
            return
        raise ConvergenceError(f"no case of {task.system}, {task.difficulty} could be drawn from seed {task.seed}")

    with ThreadPoolExecutor(_DRAWERS) as pool:
        for done, _ in enumerate(pool.map(one, missing), 1):
            tell(f"drawing cases, {done} of {len(missing)}", 0.2 * done / max(len(missing), 1))


def _figure(out: Path, opened: Score) -> None:
    from ltp.plots.confusion import confusion as draw_matrix  # drawing is slow to import
    from ltp.plots.svg import to_svg

    table = confusion(opened.marks)
    if not table:
        return
    figure = draw_matrix(table)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=130, facecolor="white")
    write_bytes(out / "confusion.png", buffer.getvalue())
    head, _, body = to_svg(figure, "confusion", "What was concealed (rows) and what was said (columns).").partition(">")
    write_text(
        out / "confusion.svg",
        f'<?xml version="1.0" encoding="utf-8"?>\n{head} style="background:#ffffff">{body}\n',
    )


def stream(as_json: bool) -> TextIO:
    """Where people read: standard error when standard output is for machines."""
    return sys.stderr if as_json else sys.stdout
