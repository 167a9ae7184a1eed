"""Owns `ltp.reproduce.hopper`: all of Uyanik et al. 2015, figure by figure, and what the paper calls out of reach.

I. Uyanik, M. M. Ankarali, N. J. Cowan, U. Saranli, O. Morgul, "Identification of a vertical hopping robot model via
harmonic transfer functions", Trans. Inst. Meas. Control, 2015, doi 10.1177/0142331215583327.
"""

from __future__ import annotations

import os
from collections.abc import Callable

from ltp.reproduce.page import Front
from ltp.reproduce.result import Chapter, Reproduction
from ltp.reproduce.uyanik import better, cost, exact, limit_cycle, noise, published
from ltp.reproduce.uyanik.rig import Rig
from ltp.reproduce.work import Progress, Work

WORK = Work[Rig](
    Front(
        page="hopper.html",
        title="The vertical hopper, reproduced",
        lead="Uyanik, Ankarali, Cowan, Saranli and Morgul (2015) identified a hopping robot model from recordings, and "
        "called its exact harmonic transfer functions out of reach. This page prints their figures beside those of "
        "ltp, and beside the exact ones, which no estimate with as many harmonics can beat.",
        facts="Errors are those of equation (20), in percent: test sines have 0.1 N, steps 0.01 N, both settled for "
        "100 periods and compared over 100 more.",
    ),
    (
        ("limit cycle", limit_cycle.chapter),
        ("exact functions", exact.chapter),
        ("the paper's procedure", published.chapter),
        ("better estimates", better.chapter),
        ("noise", noise.chapter),
        ("cost", cost.chapter),
    ),
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
    return WORK.perform(Rig(quick, progress), out, progress, say)
