"""Owns the chapter on the exact harmonic transfer functions, which the paper calls out of reach."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from ltp import metrics
from ltp.plots.responses import Predicted, Response, responses
from ltp.reproduce.result import Chapter, Picture, Row
from ltp.reproduce.uyanik.rig import DT, MOST_HARMONICS, STEP, Rig

SMALL = 1e-4  # N: at this amplitude the hopper is linear to 2e-5


def chapter(rig: Rig) -> Chapter:
    """Theorem of the step, sines and step against the nonlinear simulation, floors of truncation."""
    exact, k = rig.exact, rig.parameter("k")
    constant = exact.values[:, 0, 0, 0]
    others = np.delete(constant, MOST_HARMONICS)
    small = [rig.sine_error(exact, hz, SMALL) / 100 for hz in _small(rig)]
    settled, mean, ripple = _newton(rig)
    rows = [
        Row("H_0(0) k - 1: a constant input shifts h by u/k", abs(constant[MOST_HARMONICS] * k - 1), high=1e-10),
        Row("largest |H_k(0)| k for k other than 0: no ripple", float(np.abs(others).max() * k), high=1e-10),
        Row("settled step of 1 N in the nonlinear simulation, mean k/u - 1", abs(mean - 1), high=1e-8),
        Row("  its ripple, k/u", ripple, paper="spikes", high=1e-7),
        Row("sines of 1e-4 N against the nonlinear simulation, worst", max(small), high=5e-5),
        Row("step of 0.01 N, 200 periods with its transient", _step(rig), high=1e-4),
        *_floors(rig),
    ]
    sentence = (
        "The functions follow from the two flows and the jumps at the events, and agree with the nonlinear simulation. "
        "A constant input shifts the body by u/k and does nothing else, so the steady step response of the printed "
        "model is a constant: the spikes of figure 9B are a transient, or numerical."
    )
    pictures = [
        Picture("exact_htf", "Exact harmonic transfer functions of the hopper.", lambda: exact.plot(unit="m/N")),
        Picture(
            "fig9b_settled_step",
            "Figure 9B: the step response in the nonlinear simulation, its first periods and settled.",
            lambda: _draw(rig, settled),
        ),
    ]
    return Chapter("Exact harmonic transfer functions", sentence, rows, pictures)


def _floors(rig: Rig) -> list[Row]:
    """What truncation to 21 functions and the distortion at 0.1 N leave: no estimate of that size does better."""
    floor = rig.exact_with(10)
    known = {"1 Hz": (1.0, 0.24), "3 Hz": (3.0, 0.66), "1/T": (1 / rig.period, 0.61)}
    return [
        Row(f"cut off at n_h 21, 0.1 N: {words}", rig.sine_error(floor, hz), "%", low=at - 0.02, high=at + 0.02)
        for words, (hz, at) in known.items()
    ]


def _small(rig: Rig) -> list[float]:
    return (
        [0.5, 1.0, 1 / rig.period, 5.0]
        if rig.quick
        else [0.5, 1.0, 2.0, 2.364, 3.0, 1 / rig.period, 3.7, 5.0, 8.0, 15.0, 20.0]
    )


def _step(rig: Rig) -> float:
    """Relative error of the linear periodic system, jumps and all, over the whole step response."""
    y = rig.step_response
    return metrics.e_rms(y, rig.system.simulate(np.full(len(y), STEP), DT)[:, 0]) / 100


def _newton(rig: Rig) -> tuple[np.ndarray, float, float]:
    """The last 20 periods of a step of 1 N, and its mean and half range in units of u/k."""
    y = rig.deviation("1", 300, 2.5e-4)[-20 * rig.per_period :]
    return y, float(y.mean() * rig.parameter("k")), float(np.ptp(y) / 2 * rig.parameter("k"))


def _draw(rig: Rig, settled: np.ndarray) -> Figure:
    """The small step with the linear system beside it, and six settled periods of the large one."""
    n = 30 * rig.per_period
    cycles = np.arange(n) / rig.per_period
    linear = rig.system.simulate(np.full(n, STEP), DT)[:, 0]
    steady = 6 * rig.per_period
    constant = np.full(steady, 1.0 / rig.parameter("k"))
    return responses(
        [
            Response("step of 0.01 N", cycles, rig.step_response[:n], [Predicted("exact, linear", linear, "after")]),
            Response(
                "step of 1 N, settled", cycles[:steady], settled[:steady], [Predicted("u / k", constant, "floor")]
            ),
        ]
    )
