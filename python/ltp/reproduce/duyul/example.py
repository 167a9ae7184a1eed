"""Owns the chapter on equations (2.18) and (2.19) (figure 2.1): what a periodic system does to one sine."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.figure import Figure

import ltp
from ltp.plots.harmonics import harmonics
from ltp.reproduce.duyul.rig import Array, Complex, Rig
from ltp.reproduce.result import Chapter, Picture, Row

PUMPING = 5.0  # rad/s, omega_0 of (2.19)
INPUT = 2.0  # rad/s, of the sine: figure 2.1 does not say
SECONDS = 2 * math.pi  # after which sine and system repeat together: lines stand a rad/s apart
SAMPLES = 1024  # in that time
SETTLING = 12  # such times, until transients have decayed to 1e-16
#: What straight lines between samples leave of a sine.
HELD = float(np.sinc(0.5 * INPUT * SECONDS / SAMPLES / math.pi)) ** 2
LINES = 24  # rad/s, the last one that is shown


def chapter(rig: Rig) -> Chapter:
    """Lines of the outputs: one for the time-invariant system, one for each harmonic for the periodic one."""
    systems = {"time-invariant (2.18)": _system(0.0), "periodic (2.19)": _system(1.0)}
    lines = {name: _lines(system) for name, system in systems.items()}
    rows = []
    for name, found in lines.items():
        k = np.arange(-8, 9) if "periodic" in name else np.array([0])
        allowed = np.unique(np.abs(INPUT + k * PUMPING).round().astype(int))
        off = np.delete(found, allowed[allowed < len(found)])
        share = float(np.abs(off).max() / np.abs(found).max())
        rows.append(Row(f"{name}: largest line that is no w + k w0, over the largest", share, high=1e-6))
        htf = systems[name].htf([INPUT], 4)
        worst = 0.0
        for h in (-1, 0, 1, 2):
            # sin = Im e^{jwt}: harmonic h answers with |H_h| at |w + h w0|
            line = abs(round(INPUT + h * PUMPING))
            worst = max(worst, abs(HELD * abs(htf.harmonic(h)[0]) - abs(found[line])))
        rows.append(
            Row(
                "  lines against exact harmonic transfer functions, over the largest",
                worst / float(np.abs(found).max()),
                high=1e-6,
            )
        )
    exponents = systems["periodic (2.19)"].exponents
    rows.append(
        Row("exponents of (2.19): real part", float(exponents.real.max()), "1/s", low=-0.5 - 1e-9, high=-0.5 + 1e-9)
    )
    sentence = (
        "One sine at w comes out of a time-invariant system at w alone, and of a periodic one at every w + k w0: that "
        "is why one transfer function is not enough."
    )
    return Chapter("One sine, many lines (figure 2.1)", sentence, rows, _pictures(lines))


def _system(share: float) -> ltp.LtpSystem:
    """(2.19), or (2.18) without the periodic part."""

    def a(t: float) -> Array:
        stiffness = -1.0 + share * math.cos(2 * PUMPING * t)
        return np.array([[0.0, 1.0], [stiffness, -1.0 + share * 3.0 * math.cos(PUMPING * t)]])

    return ltp.LtpSystem.from_functions(2 * math.pi / PUMPING, a, [[0.0], [1.0]], [[1.0, 0.0]])


def _lines(system: ltp.LtpSystem) -> Complex:
    """Amplitudes of the settled output under sin(w t), a line for each rad/s."""
    dt = SECONDS / SAMPLES
    t = np.arange((SETTLING + 1) * SAMPLES) * dt
    settled = system.simulate(np.sin(INPUT * t), dt)[-SAMPLES:, 0]
    lines = np.fft.rfft(settled)[: LINES + 1] * (2.0 / SAMPLES)
    lines[0] *= 0.5
    return np.asarray(lines, dtype=np.complex128)


def _pictures(lines: dict[str, Complex]) -> list[Picture]:
    def draw() -> Figure:
        return harmonics({name: {"output": each} for name, each in lines.items()}, columns=1, axis="rad/s")

    caption = (
        f"Figure 2.1: lines of the outputs under a sine of {INPUT:g} rad/s; the system is pumped at {PUMPING:g} rad/s."
    )
    return [Picture("fig2_1_lines", caption, draw)]
