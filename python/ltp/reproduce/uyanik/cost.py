"""Owns the chapter on cost: seconds from the record to the functions, beside those of the solution alone."""

from __future__ import annotations

import math
import time

from ltp.reproduce.result import Chapter, Row
from ltp.reproduce.uyanik.better import floquet
from ltp.reproduce.uyanik.published import USUAL
from ltp.reproduce.uyanik.rig import Rig


def chapter(rig: Rig) -> Chapter:
    """The paper's identification (n_h 21, smoothness given) by both solvers, and the one with shared poles."""
    rows = []
    for solver in ("smoother", "banded"):
        words = f"Siddiqi, n_h 21, by the {solver}"
        began = time.perf_counter()
        htf = rig.estimate(
            rig.chirps, 10, keep=False, method="curvature", smoothness=USUAL, solver=solver, band=math.tau * 5.0
        )
        rows.append(Row(f"{words}: record to functions", time.perf_counter() - began, "s"))
        rows.append(Row("  of it the solution alone", htf.figures["solve_seconds"], "s"))
        if solver == "smoother":
            rows.append(Row("  complex unknowns of both", htf.figures["unknowns"], digits=6))
    began = time.perf_counter()
    floquet(rig, rig.chirps, 21, keep=False)
    rows.append(Row("shared poles, n_h 21: record to functions", time.perf_counter() - began, "s"))
    sentence = "Seconds on this computer, once each: Fourier transforms, the system, its solution, bands and all."
    return Chapter("Cost", sentence, rows)
