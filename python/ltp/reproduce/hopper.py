"""Owns `ltp.reproduce.hopper`: all of Uyanik et al. 2015, figure by figure, and what the paper calls out of reach.

I. Uyanik, M. M. Ankarali, N. J. Cowan, U. Saranli, O. Morgul, "Identification of a vertical hopping robot model via
harmonic transfer functions", Trans. Inst. Meas. Control, 2015, doi 10.1177/0142331215583327.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import replace

from ltp.reproduce import better, cost, exact, limit_cycle, noise, published
from ltp.reproduce.page import prepare, write
from ltp.reproduce.result import Chapter, Reproduction
from ltp.reproduce.rig import Progress, Rig

#: In the order of the page; the share of the whole that each takes is for the progress bar.
CHAPTERS: tuple[tuple[str, Callable[[Rig], Chapter]], ...] = (
    ("limit cycle", limit_cycle.chapter),
    ("exact functions", exact.chapter),
    ("the paper's procedure", published.chapter),
    ("better estimates", better.chapter),
    ("noise", noise.chapter),
    ("cost", cost.chapter),
)


def hopper(
    out: str | os.PathLike[str] | None = None,
    quick: bool = False,
    *,
    progress: Progress | None = None,
    say: Callable[[Chapter], None] | None = None,
) -> Reproduction:
    """Reproduce the paper, and beat it: limit cycle, exact functions, estimates, predictions, noise, cost.

    out: a folder for the page `hopper.html` and its figures as PNG; made if it is not there. None writes nothing.
    quick: fewer test sines, sizes and figures, one seed instead of ten, in a third of the time.
    progress: called with a message and the finished fraction; say: called with each chapter when it is done.

    Nothing random is left: noise has its seeds. Raises `InputError` when `out` cannot be written to.
    """
    folder = None if out is None else prepare(out)
    began = time.perf_counter()
    rig = Rig(quick, progress)
    chapters: list[Chapter] = []
    for number, (words, make) in enumerate(CHAPTERS):
        rig.tell(words, number / len(CHAPTERS))
        start = time.perf_counter()
        made = make(rig)
        chapters.append(replace(made, seconds=time.perf_counter() - start))
        if say is not None:
            say(chapters[-1])
    if folder is not None:
        rig.tell("figures", 1.0)
        write(folder, Reproduction(chapters, time.perf_counter() - began))
    return Reproduction(chapters, time.perf_counter() - began)
