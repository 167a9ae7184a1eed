"""Owns the chapter on references (figures 3.2, 3.3, 3.5, 3.6): what is prescribed, what follows, and what is wrong."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.figure import Figure

from ltp.plots.harmonics import harmonics
from ltp.plots.tracking import Curve, Run, tracking
from ltp.reproduce.duyul.rig import Rig
from ltp.reproduce.duyul.thesis import PRESCRIBED, PRINTED_THETA, PRINTED_V, PRINTED_V_UP, PRINTED_X_UP, Sine
from ltp.reproduce.result import Chapter, Picture, Row, Table

#: What accurate integration gives, to five digits: amplitude and phase of theta, from a separate prototype.
ACCURATE = {"4.1": (-0.24716, 0.68050), "4.2": (-0.37072, 1.44844), "4.3": (-0.33862, 0.66859)}
TITLES = {"4.1": "(3.8)", "4.2": "(4.2)", "4.3": "(4.3)"}
FINE = 5e-6
TWICE = np.array([1.0] + 8 * [2.0])  # amplitudes from lines of a Fourier transform, harmonics 0 to 8


def chapter(rig: Rig) -> Chapter:
    """References as printed, as a loose integrator gives them, and as they are."""
    rows: list[Row] = []
    for equation, words in TITLES.items():
        printed = PRINTED_THETA[equation]
        t, theta = rig.emulated(equation)
        late = t >= 0.5 * t[-1]
        loose = Sine.fitted(t[late], theta[late], printed.omega).flipped()
        true = _first(rig, equation, "theta").flipped()
        half = 5e-5 if equation != "4.2" else 2e-4  # (4.2) prints three decimals of its phase
        for name, ours, paper, digits in (
            ("amplitude", loose.amplitude, printed.amplitude, 4),
            ("phase", loose.phase, printed.phase, 4 if equation != "4.2" else 3),
        ):
            bound = 5.1e-5 if name == "amplitude" else half
            rows.append(
                Row(
                    f"{words} theta, {name}, ode45 at its defaults emulated",
                    ours,
                    "rad",
                    f"{paper:.{digits}f}",
                    low=paper - bound,
                    high=paper + bound,
                    digits=5,
                )
            )
        for name, ours, accurate in zip(
            ("amplitude", "phase"), (true.amplitude, true.phase), ACCURATE[equation], strict=True
        ):
            rows.append(
                Row(f"  {name} on the true orbit", ours, "rad", low=accurate - FINE, high=accurate + FINE, digits=6)
            )
    rows += _wrong(rig)
    for equation, share in (("4.1", 0.5), ("4.5", 6.5)):
        cart, pendulum = (PRINTED_X_UP if equation == "4.5" else PRESCRIBED["4.1"]), rig.printed(equation)[1]
        t = np.arange(256) / 256 * (math.tau / cart.omega)
        left = 100 * rig.constants(equation).unbalanced(t, cart, pendulum)
        words = f"({equation}): torque that (3.2) leaves over that of inertia"
        rows.append(Row(f"{words}, printed", left, "%", low=share - 0.1, high=share + 0.1))
        best = float(max(rig.orbit(equation).defect.values()))
        rows.append(Row("  largest defect of a state's rate on the true orbit", 100 * best, "%", high=1e-7))
    sentence = (
        "The printed angles come from a loose integration and are within half a thousandth of the truth. Both printed "
        "voltages are wrong, and so is the cart of (4.5): they do not solve the equations they were made from."
    )
    notes = [
        "The tables of the next chapter were not made with the printed voltages: they come out with the voltage that "
        "(3.1) and (3.4) give on the printed cart and angle, which is what this page uses as the thesis' reference."
    ]
    return Chapter("References (figures 3.2 to 3.6)", sentence, rows, _pictures(rig), notes, [_table(rig)])


def _first(rig: Rig, equation: str, name: str) -> Sine:
    """First harmonic of a coordinate or input on the true orbit, as a sine."""
    orbit = rig.orbit(equation)
    return Sine(*orbit.sinusoid(name)[:1], orbit.omega, orbit.sinusoid(name)[1])


def _wrong(rig: Rig) -> list[Row]:
    """What the thesis prints and its equations do not give."""
    down = rig.voltage(*rig.printed("4.1"), "4.1")
    up = rig.voltage(PRINTED_X_UP, PRESCRIBED["4.5"], "4.5")
    cart, true = _first(rig, "4.5", "x"), _first(rig, "4.5", "V")
    found = [
        ("(3.9) V, amplitude", down.amplitude, PRINTED_V.amplitude, "V", 2.4923, 5.1e-5),
        ("(3.9) V, phase", down.phase, PRINTED_V.phase, "rad", 1.8215, 5.1e-5),
        ("(4.5) V on the printed cart, amplitude", up.amplitude, PRINTED_V_UP.amplitude, "V", 15.6614, 5.1e-5),
        ("(4.5) V on the printed cart, phase", up.phase, PRINTED_V_UP.phase, "rad", 2.4914, 5.1e-5),
        ("(4.5) x, amplitude", cart.amplitude, PRINTED_X_UP.amplitude, "m", 0.04003, 5.1e-6),
        ("(4.5) x, phase", cart.phase, PRINTED_X_UP.phase, "rad", -0.0632, 5.1e-5),
        ("(4.5) V on the true orbit, amplitude", true.amplitude, PRINTED_V_UP.amplitude, "V", 16.8837, 5.1e-5),
        ("(4.5) V on the true orbit, phase", true.phase, PRINTED_V_UP.phase, "rad", 2.5161, 5.1e-5),
    ]
    return [
        Row(what, ours, unit, f"{paper:g}, wrong", low=right - bound, high=right + bound, digits=6)
        for what, ours, paper, unit, right, bound in found
    ]


def _table(rig: Rig) -> Table:
    """How far printed voltages are from right, as phasors."""
    cells = []
    for words, printed, ours in (
        ("(3.9)", PRINTED_V, rig.voltage(*rig.printed("4.1"), "4.1")),
        ("(4.5)", PRINTED_V_UP, rig.voltage(PRINTED_X_UP, PRESCRIBED["4.5"], "4.5")),
    ):
        share = abs(printed.phasor - ours.phasor) / abs(ours.phasor)
        cells.append(
            [
                words,
                f"{printed.amplitude:g} sin(wt + {printed.phase:g})",
                f"{ours.amplitude:.4f} sin(wt + {ours.phase:.4f})",
                f"{100 * share:.0f} %",
            ]
        )
    return Table("Voltages, printed and right", ["equation", "printed", "(3.1) with (3.4)", "apart"], cells)


def _pictures(rig: Rig) -> list[Picture]:
    def solution() -> Figure:
        t, theta = rig.emulated("4.1")
        fit, cart = PRINTED_THETA["4.1"], PRESCRIBED["4.1"]
        shown = t <= 6.0
        return tracking(
            [
                [Run("prescribed", t[shown], [Curve("cart", cart.at(t[shown]), "ink")], "x", "m")],
                [
                    Run(
                        "what follows from (3.2)",
                        t[shown],
                        [
                            Curve("pendulum from rest", theta[shown], "after"),
                            Curve("(3.8)", fit.at(t[shown]), "before", dashed=True),
                        ],
                        "theta",
                        "rad",
                    )
                ],
            ]
        )

    def spectra() -> Figure:
        sets = {}
        for words, equation in (("hanging, (4.1)", "4.1"), ("inverted, (4.5)", "4.5")):
            system = rig.system(equation)
            t = np.arange(32) / 32 * system.period
            a, b = np.array([system.A(s) for s in t]), np.array([system.B(s) for s in t])
            entries = {f"a{r + 1}{c + 1}": a[:, r, c] for r in (2, 3) for c in (1, 2, 3)}
            entries |= {"b3": b[:, 2, 0], "b4": b[:, 3, 0]}
            sets[words] = {name: np.fft.rfft(v)[:9] / len(t) * TWICE for name, v in entries.items()}
        return harmonics(sets)

    return [
        Picture("fig3_2_reference", "Figure 3.2: the pendulum under the prescribed cart, and (3.8).", solution),
        Picture(
            "fig3_5_spectra",
            "Figures 3.5 and 3.6: harmonics of the entries of A(t) and B(t). Only even ones are there, so the pumping "
            "frequency is twice that of the orbit; in a32 and a42 of the inverted case the second is the largest.",
            spectra,
        ),
    ]
