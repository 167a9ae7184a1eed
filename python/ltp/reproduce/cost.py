"""Owns the chapter on cost: seconds from the record to the functions, beside those of the solution alone."""

from __future__ import annotations

import time

from ltp.reproduce.better import floquet
from ltp.reproduce.published import USUAL
from ltp.reproduce.result import Chapter, Row
from ltp.reproduce.rig import Rig


def chapter(rig: Rig) -> Chapter:
    """The paper's identification (n_h 21, smoothness given) by both solvers, and the one with shared poles."""
    rows = []
    cases = {
        "Siddiqi, n_h 21, smoother": {"method": "curvature", "smoothness": USUAL, "solver": "smoother"},
        "Siddiqi, n_h 21, banded": {"method": "curvature", "smoothness": USUAL, "solver": "banded"},
    }
    for words, options in cases.items():
        began = time.perf_counter()
        htf = rig.estimate(rig.chirps, 10, keep=False, **options)
        rows.append(Row(f"{words}: record to functions", time.perf_counter() - began, "s"))
        if "solve_seconds" in htf.figures:
            rows.append(Row(f"{words}: the solution alone", htf.figures["solve_seconds"], "s"))
    began = time.perf_counter()
    floquet(rig, rig.chirps, 21, keep=False)
    rows.append(Row("shared poles, n_h 21: record to functions", time.perf_counter() - began, "s"))
    sentence = "Seconds on this computer, once each: Fourier transforms, the system, its solution, bands and all."
    return Chapter("Cost", sentence, rows)
