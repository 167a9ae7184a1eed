"""Owns the chapter on better estimates: shared Floquet poles on the paper's record, and on a multisine."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.figure import Figure

import ltp
from ltp.plots.sweep import Line, Panel, sweep
from ltp.reproduce.result import Chapter, Picture, Row
from ltp.reproduce.uyanik.published import siddiqi
from ltp.reproduce.uyanik.rig import MARGIN, Record, Rig

TAILS_HZ = 45.0  # the jumps between chirps have power up to here, and what it does has to be explained


def floquet(rig: Rig, record: Record, size: int, tails_hz: float | None = None, *, keep: bool = True) -> ltp.Htf:
    """The estimate with shared Floquet poles and `size` harmonic transfer functions, up to 5 Hz and a margin."""
    reach = None if tails_hz is None else math.tau * tails_hz
    band = MARGIN * math.tau * 5.0
    return rig.estimate(record, (size - 1) // 2, keep=keep, method="floquet", band=band, reach=reach)


def chapter(rig: Rig) -> Chapter:
    """Errors of both, beside what nobody can beat."""
    chirped = {size: floquet(rig, rig.chirps, size, TAILS_HZ) for size in (21, 31)}
    record = rig.flat
    sines = {size: floquet(rig, record, size) for size in ((41,) if rig.quick else (21, 31, 41))}
    best = sines[41]
    rows = [
        *_rows(rig, "chirps, n_h 21", chirped[21], {"1 Hz": 0.6, "1/T": 0.8, "worst": 4.0, "step": 3.0}),
        *_rows(rig, "chirps, n_h 31", chirped[31], {"functions": 3e-3}),
        *(row for size in sines if size != 41 for row in _rows(rig, f"multisine, n_h {size}", sines[size], {})),
        *_rows(
            rig, "multisine, n_h 41", best, {"1 Hz": 0.08, "1/T": 0.25, "worst": 0.6, "step": 0.02, "functions": 1e-4}
        ),
        *_poles(rig, best),
        *_lines(rig, record),
    ]
    sentence = (
        "All harmonics share their denominator, D = 1 - a1 z - a2 z^2, whose coefficients are trace and determinant of "
        "the monodromy matrix. That is worth much on the paper's own record; with a multisine of the same length "
        "and power, what is left is the distortion of the hopper itself and the harmonics that are cut off."
    )
    pictures = [
        Picture(
            "errors_better",
            "Errors of predicted sines: the same record with a better estimate, and a better record.",
            lambda: _draw(rig, chirped[21], best),
        ),
        Picture(
            "htf_estimated",
            "The estimate from the multisine, n_h 41, and the exact functions.",
            lambda: best.plot(exact=rig.exact, unit="m/N"),
        ),
        Picture(
            "htf_published",
            "Siddiqi's estimate from the chirps, n_h 21, and the exact functions.",
            lambda: siddiqi(rig, rig.chirps).plot(exact=rig.exact, unit="m/N"),
        ),
    ]
    return Chapter(
        "Better estimates of the same machine", sentence, rows, pictures, [*chirped[21].warnings, *best.warnings]
    )


def _rows(rig: Rig, words: str, htf: ltp.Htf, bars: dict[str, float]) -> list[Row]:
    floor = rig.exact_with(len(htf.values) // 2)
    band = [hz for hz in rig.frequencies if hz <= 5.0]
    figures = {
        "1 Hz": (rig.sine_error(htf, 1.0), rig.sine_error(floor, 1.0)),
        "1/T": (rig.sine_error(htf, 1 / rig.period), rig.sine_error(floor, 1 / rig.period)),
        "worst": (float(rig.sweep(htf, band).max()), float(rig.sweep(floor, band).max())),
        "step": (rig.step_error(htf), rig.step_error(floor)),
    }
    names = {"worst": "worst sine up to 5 Hz", "step": "settled step"}
    rows = [
        Row(f"{words}: {names.get(key, key)}", ours, "%", floor=least, high=bars.get(key, math.nan))
        for key, (ours, least) in figures.items()
    ]
    wrong = rig.function_error(htf)
    return [*rows, Row(f"{words}: functions over (0, 5] Hz, relative", wrong, high=bars.get("functions", math.nan))]


def _poles(rig: Rig, htf: ltp.Htf) -> list[Row]:
    """Trace and determinant of the monodromy matrix, from the two largest multipliers that were found."""
    figures = htf.figures
    order = round(figures["order"])
    found = [complex(figures[f"multiplier{i}_re"], figures[f"multiplier{i}_im"]) for i in range(1, order + 1)]
    rows = []
    for name, combine in (("a1", sum), ("a2", lambda pair: -np.prod(pair))):
        ours, true = (complex(combine(sorted(each, key=abs)[-2:])).real for each in (found, rig.system.multipliers))
        rows.append(
            Row(
                f"multisine, n_h 41: {name} of the two largest multipliers",
                ours,
                low=true - 3e-5,
                high=true + 3e-5,
                digits=8,
            )
        )
    return rows


def _lines(rig: Rig, record: Record) -> list[Row]:
    """The quotients of lines, which know nothing of poles, and the distortion that the lines left out show."""
    htf = rig.estimate(record, 20, method="lines", band=MARGIN * math.tau * 5.0)
    even, answer = htf.figures["even_distortion"], htf.figures["response"]
    return [
        *_rows(rig, "multisine, n_h 41, line by line", htf, {})[-1:],
        Row("  even distortion over the response, rms", even / answer),
    ]


def _draw(rig: Rig, chirped: ltp.Htf, best: ltp.Htf) -> Figure:
    band = [hz for hz in rig.frequencies if hz <= 5.0]
    hz = np.array(band)

    def line(name: str, htf: ltp.Htf, role: str, dashed: bool = False) -> Line:
        return Line(name, hz, rig.sweep(htf, band), role, dashed)

    lines = [
        line("Siddiqi, chirps", siddiqi(rig, rig.chirps), "before"),
        line("Floquet, chirps, n_h 21", chirped, "rival"),
        line("exact, n_h 21", rig.exact_with(10), "nominal", dashed=True),
        line("Floquet, multisine, n_h 41", best, "after"),
        line("exact, n_h 41", rig.exact_with(20), "ink", dashed=True),
    ]
    return sweep([Panel("", lines, marks={"1/T": 1 / rig.period})])
