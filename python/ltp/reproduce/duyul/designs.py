"""Owns the chapter on designs (3.16) and (3.17): what they are optima of, and what was missing from them."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

import ltp
from ltp.plots.landscape import Profile, landscape
from ltp.reproduce.duyul.loops import quiet
from ltp.reproduce.duyul.rig import TRUNCATION, Array, Rig, gain, spectrum
from ltp.reproduce.result import Chapter, Picture, Row, Table

LARGE = 25000.0  # a norm at which (3.16) has run off
FASTEST = 50.0  # 1/s, the bound of (3.16) on the most negative real part
#: Norm of the gain and the largest real part found under it, 1/s: the best of a separate prototype's searches.
LIMITS = {72.7: -7.66, 200.0: -9.2, 1000.0: -11.9}
Q, R = np.diag([10.0, 1.0, 0.0, 0.0]), np.diag([0.0, 1.0, 1.0, 10.0])  # (3.18)
QUADRATIC = [(Q, 1e7, None), (R, None, 50.0)]  # (3.17)
LEFT = 15.0  # 1/s, of the last line of (3.17), read as a bound on the most negative real part
SEEDS = (0, 1, 2)


def chapter(rig: Rig) -> Chapter:
    """The thesis' two problems, solved from any start."""
    rows, cells = [], []
    down, up = rig.system("4.1"), rig.system("4.5")
    seeds = SEEDS[:2] if rig.quick else SEEDS
    for limit, best in LIMITS.items():
        found = [design(down, limit=limit, fastest=FASTEST, seed=seed) for seed in seeds]
        values = [_largest(down, feedback) for feedback in found]
        rows.append(
            Row(
                f"(3.16), norm of K at most {limit:g}: largest real part, worst of {len(seeds)} seeds",
                max(values),
                "1/s",
                "-7.6, no limit stated" if limit < 100 else "",
                high=best + 0.005,
                digits=4,
            )
        )
        rows.append(Row("  apart from the best seed", max(values) - min(values), "1/s", high=1e-3))
        cells.append(_cells(rig, limit, found[0]))
    cells.append(_cells(rig, LARGE, design(down, limit=LARGE, fastest=None, seed=0)))
    volts = float(cells[-1][4].split()[0])
    rows.append(Row(f"(3.16), norm up to {LARGE:g}, the bound of -50 left out: feedback", volts, "V"))
    printed = _largest(down, gain("fig 4.3"))
    rows.append(
        Row("  the printed gain of figure 4.3, of norm 72.7", printed, "1/s", "-7.6", low=-7.597, high=-7.595, digits=4)
    )
    local = [_largest(down, feedback) for feedback in _stalled(rig, down)]
    rows.append(Row("(3.16) by one local descent from random starts: worst", max(local), "1/s", "varies", low=-9.6))
    rows.append(Row("  best", min(local), "1/s", "varies"))
    corrected = [design(up, quadratic=QUADRATIC, slowest=LEFT, seed=seed) for seed in seeds]
    exact = max(float(up.closed(feedback).exponents.real.max()) for feedback in corrected)
    rows.append(
        Row(
            "(3.17) with min for max in its last line: exact exponent",
            exact,
            "1/s",
            "-0.2312",
            low=-0.2314,
            high=-0.2309,
            digits=4,
        )
    )
    rows.append(
        Row(
            "  the printed gain of figure 4.27",
            float(up.closed(gain("fig 4.27")).exponents.real.max()),
            "1/s",
            low=-0.2313,
            high=-0.2311,
            digits=4,
        )
    )
    rows.append(
        Row(
            "(3.17) as typed: the least largest real part, asked to be -15",
            _infeasible(up),
            "1/s",
            "-15",
        )
    )
    random = _drawn(up, 20_000 if rig.quick else 100_000)
    rows.append(Row("  the least of random gains that keep its other constraints", random, "1/s"))
    true = rig.system("4.5", true=True)
    best_true = design(true, quadratic=QUADRATIC, slowest=LEFT, seed=0)
    rows.append(
        Row(
            "(3.17) on the true orbit: exact exponent",
            float(true.closed(best_true).exponents.real.max()),
            "1/s",
            low=-0.0080,
            high=-0.0065,
            digits=4,
        )
    )
    sentence = (
        "The printed gains are good for their size, but (3.16) has no limit on size: as posed it runs off to useless "
        "voltages, and a smooth local solver stops on ridges where eigenvalues meet. With a limit every seed finds the "
        "same optimum. The last line of (3.17) needs a minimum where a maximum is printed; then the printed gain is "
        "its optimum. On the true orbit its constraints leave no freedom over the slow mode."
    )
    head = ["norm of K", "K", "20 eigenvalues", "exact, true orbit", "feedback", "x settles"]
    return Chapter(
        "Designs (3.16) and (3.17)",
        sentence,
        rows,
        _pictures(rig, down, up),
        [],
        [Table("Optima of (3.16)", head, cells)],
    )


def design(system: ltp.LtpSystem, **options: object) -> ltp.Feedback:
    """A constant gain by harmonic balance, truncated as in the thesis; doubts are what this page is about."""
    with quiet():
        return ltp.control(system, truncation=TRUNCATION, **options)  # type: ignore[arg-type]


def _cells(rig: Rig, limit: float, feedback: ltp.Feedback) -> list[str]:
    """A design and what its loop does on the true orbit."""
    certificate = ltp.certify(
        rig.hanging, rig.orbit("4.1"), feedback, deviations=rig.starts["down"], truncation=5, tolerated=False
    )
    run = certificate.runs[0]
    settled = run.settled["x"]
    return [
        f"{limit:g}",
        "  ".join(f"{value:.2f}" for value in feedback.gain[0]),
        f"{_largest(rig.system('4.1'), feedback):.3f}",
        f"{certificate.slowest:.3f}",
        f"{run.feedback['V']:.1f} V",
        "-" if settled is None else f"{settled:.2f} s",
    ]


def _largest(system: ltp.LtpSystem, feedback: ltp.Feedback | Array) -> float:
    """Largest real part of all eigenvalues of the truncated lift: what the thesis minimises."""
    return float(spectrum(system.closed(feedback).lift(TRUNCATION)).real.max())


def _stalled(rig: Rig, system: ltp.LtpSystem) -> list[ltp.Feedback]:
    random = np.random.default_rng(1)
    starts = [random.standard_normal(4) for _ in range(4 if rig.quick else 10)]
    return [
        design(system, limit=1000.0, fastest=FASTEST, search="local", start=np.array([start]), budget=400)
        for start in starts
    ]


def _infeasible(system: ltp.LtpSystem) -> float:
    """The least largest real part under the other two constraints of (3.17), the worst of all seeds."""
    return max(_largest(system, design(system, quadratic=QUADRATIC, seed=seed)) for seed in SEEDS)


def _drawn(system: ltp.LtpSystem, count: int) -> float:
    """The least largest real part among random gains under K Q K^T >= 1e7 and K R K^T <= 50."""
    objective, random = ltp.Objective(system, truncation=TRUNCATION), np.random.default_rng(0)
    least = np.inf
    for _ in range(count):
        inner = random.standard_normal(3)
        inner *= np.sqrt(50.0) * random.random() ** (1 / 3) / np.linalg.norm(inner)
        outer = np.sqrt(1e6) * 50.0 ** random.random() * random.choice([-1.0, 1.0])
        least = min(least, objective([outer, inner[0], inner[1], inner[2] / np.sqrt(10.0)])[0])
    return float(least)


def _pictures(rig: Rig, down: ltp.LtpSystem, up: ltp.LtpSystem) -> list[Picture]:
    def profile(system: ltp.LtpSystem, first: Array, second: Array, title: str, begin: float) -> Profile:
        share = np.linspace(begin, 2.0, 121)
        lifted = np.empty(len(share))
        exact = np.empty(len(share))
        for i, s in enumerate(share):
            closed = system.closed(first + s * (second - first))
            lifted[i] = spectrum(closed.lift(TRUNCATION)).real.max()
            exact[i] = closed.exponents.real.max()
        return Profile(title, share, {"20 eigenvalues": lifted, "exact": exact}, {"first": 0.0, "second": 1.0})

    def draw() -> Figure:
        stiff = design(down, limit=200.0, fastest=FASTEST, seed=0).gain
        return landscape(
            [
                profile(down, gain("fig 4.3"), stiff, "hanging: figure 4.3 to the optimum at norm 200 (3.7)", -1.0),
                profile(up, gain("fig 4.27"), gain("fig 4.33"), "inverted: figure 4.27 to figure 4.33 (3.8)", -0.1),
            ],
            name="largest real part",
        )

    caption = "Figures 3.7 and 3.8: the objective on the line between two gains; kinks stand where eigenvalues meet."
    return [Picture("fig3_7_objective", caption, draw)]
