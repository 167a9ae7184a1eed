"""Owns the chapter on the lift (tables 4.1 to 4.5, figures 4.1, 4.6, 4.25, 4.30): eigenvalues, copies and edges."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.figure import Figure

import ltp
from ltp.plots.eigenvalues import Cloud, Plane, eigenvalues
from ltp.reproduce.duyul.rig import TRUNCATION, Complex, Rig, apart, gain, matched, spectrum
from ltp.reproduce.duyul.thesis import PRESCRIBED, PRINTED_V, PRINTED_V_UP, TABLES, Sine
from ltp.reproduce.result import Chapter, Picture, Row, Table

#: Reference and gain behind each table, the bound of its largest difference, and how often print rounding that is.
SOURCES: dict[str, tuple[str, str | None, float]] = {
    "4.1": ("4.1", None, 5.5e-5),
    "4.2": ("4.5", None, 1.05e-4),
    "4.3": ("4.5", "table 4.3", 5e-3),
    "4.4": ("4.5", "table 4.4", 1.05e-4),
    "4.5": ("4.5", "fig 4.33", 5e-3),
}
DEEPEST = 20  # harmonics of the largest lift


def chapter(rig: Rig) -> Chapter:
    """All printed eigenvalues, and which eigenvalues of a truncated lift may decide a design."""
    rows, tables = [], []
    for number, (equation, words, bound) in SOURCES.items():
        printed, rounding = TABLES[number]
        ours = _closed(rig.system(equation), words)
        rows.append(
            Row(
                f"Table {number}: largest difference of 20 eigenvalues",
                apart(printed, ours),
                "1/s",
                f"printed to {2 * rounding:g}",
                high=bound,
            )
        )
        tables.append(_side_by_side(number, printed, ours))
    for number, printed_input in (("4.1", PRINTED_V), ("4.2", PRINTED_V_UP)):
        equation = SOURCES[number][0]
        spoiled = ltp.linearize(rig.model(equation), _with_input(rig, equation, printed_input))
        rows.append(
            Row(
                f"  Table {number} with the printed voltage",
                apart(TABLES[number][0], _closed(spoiled, None)),
                "1/s",
                low=0.01,
            )
        )
    rows += [*_halves(rig), *_copies(rig)]
    sentence = (
        "All 100 printed eigenvalues come out. Those in the middle of a truncated lift are copies of the exact Floquet "
        "exponents from two harmonics on; those at its edge are not at any truncation, and the thesis lets them decide."
    )
    notes = [
        "Eigenvalues at the edge come from blocks whose neighbours were cut off. They are told from copies by their "
        "distance to the exact exponents, `LtpSystem.lifted_modes`, and are left out of a design with modes='central'."
    ]
    return Chapter("The lift (tables 4.1 to 4.5)", sentence, rows, _pictures(rig), notes, tables)


def _closed(system: ltp.LtpSystem, words: str | None, truncation: int = TRUNCATION) -> Complex:
    closed = system if words is None else system.closed(gain(words))
    return spectrum(closed.lift(truncation))


def _with_input(rig: Rig, equation: str, voltage: Sine) -> ltp.Reference:
    cart, pendulum = rig.printed(equation)
    return rig.along(equation, {"x": cart, "theta": pendulum, "V": voltage})


def _halves(rig: Rig) -> list[Row]:
    """Only even harmonics: the lift falls into two, and one is the lift at twice the pumping frequency."""
    system = rig.system("4.5")
    lift = system.lift(TRUNCATION)
    nx = lift.shape[0] // (2 * TRUNCATION + 1)
    parts = [np.concatenate([np.arange(nx) + nx * block for block in blocks]) for blocks in ((0, 2, 4), (1, 3))]
    halves = np.concatenate([spectrum(lift[np.ix_(part, part)]) for part in parts])
    whole = spectrum(lift)
    short = spectrum(system.shortened().lift(1))
    return [
        Row(
            "eigenvalues of order 20 against those of orders 12 and 8 together", apart(whole, halves), "1/s", high=1e-10
        ),
        Row(
            "  order 12 against twice the pumping frequency, one harmonic",
            apart(spectrum(lift[np.ix_(parts[0], parts[0])]), short),
            "1/s",
            high=1e-10,
        ),
    ]


def _copies(rig: Rig) -> list[Row]:
    """Central modes against exact exponents, and the edge, with the gain of Table 4.3 on the true orbit."""
    closed = rig.system("4.5", true=True).closed(gain("table 4.3"))
    exact = closed.exponents
    worst = 0.0
    edges = []
    for truncation in range(2, DEEPEST + 1, 3 if rig.quick else 1):
        modes = closed.lifted_modes(truncation)
        central = [mode for mode in modes if mode.copy == 0]
        worst = max(worst, max(mode.distance / abs(mode.value) for mode in central))
        edges.append((max(mode.value.real for mode in modes), max(m.value.real for m in modes if m.converged)))
    every, trusted = (max(pair) for pair in zip(*edges, strict=True))
    least = min(pair[0] for pair in edges)
    return [
        Row(f"central modes against exact exponents, N = 2 to {DEEPEST}, relative", worst, high=5e-5),
        Row("largest real part, gain of Table 4.3 on the true orbit: exact", float(exact.real.max()), "1/s",
            low=-0.02205, high=-0.02195, digits=4),
        Row("  of the modes that are copies, all N", trusted, "1/s", low=-0.02205, high=-0.02195, digits=4),
        Row("  of all modes, the most over N", every, "1/s", low=-0.01305, high=-0.01295, digits=4),
        Row("  of all modes, the least over N", least, "1/s", low=-0.01305, high=-0.01295, digits=4),
    ]  # fmt: skip


def _side_by_side(number: str, printed: Complex, ours: Complex) -> Table:
    places = 4 if TABLES[number][1] < 1e-3 else 2
    cells = [
        [_text(a, places), _text(b, places + 2), f"{max(abs((a - b).real), abs((a - b).imag)):.1e}"]
        for a, b in zip(printed, matched(printed, ours), strict=True)
    ]
    return Table(f"Table {number}", ["thesis", "ltp", "difference"], cells)


def _text(value: complex, places: int) -> str:
    return f"{value.real:.{places}f} {'-' if value.imag < 0 else '+'} {abs(value.imag):.{places}f}i"


def _pictures(rig: Rig) -> list[Picture]:
    def plane(equation: str, words: str | None, title: str) -> Plane:
        system = rig.system(equation)
        closed = system if words is None else system.closed(gain(words))
        t = np.arange(64) / 64 * closed.period
        mean = spectrum(np.mean([closed.A(s) for s in t], axis=0))
        modes = closed.lifted_modes(TRUNCATION)
        copies = np.array([mode.value for mode in modes if mode.converged], dtype=np.complex128)
        edges = np.array([mode.value for mode in modes if not mode.converged], dtype=np.complex128)
        return Plane(
            title,
            [
                Cloud("copies of exact exponents", copies, "after"),
                Cloud("not converged at N = 2", edges, "before", "s"),
                Cloud("of the mean alone", mean, "ink", "x"),
            ],
            0.5 * PRESCRIBED[equation].omega,
        )

    def down() -> Figure:
        return eigenvalues(
            [plane("4.1", None, "open loop (figure 4.1)"), plane("4.1", "fig 4.3", "closed (figure 4.6)")]
        )

    def up() -> Figure:
        return eigenvalues(
            [plane("4.5", None, "open loop (figure 4.25)"), plane("4.5", "fig 4.27", "closed (figure 4.30)")]
        )

    band = math.pi
    return [
        Picture(
            "fig4_1_hanging",
            f"Figures 4.1 and 4.6: the hanging pendulum. The primary strip of {band:.2f} rad/s is shaded.",
            down,
        ),
        Picture("fig4_25_inverted", "Figures 4.25 and 4.30: the inverted pendulum.", up),
    ]
