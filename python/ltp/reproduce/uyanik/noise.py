"""Owns the chapter on noise (figures 10 and 11): medians over seeds, and how often a 95 % band holds the truth."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

import ltp
from ltp import signals
from ltp.plots.htf import RADIUS_95
from ltp.plots.sweep import Line, Panel, sweep
from ltp.reproduce.result import Chapter, Picture, Row
from ltp.reproduce.uyanik.better import floquet
from ltp.reproduce.uyanik.published import siddiqi
from ltp.reproduce.uyanik.rig import Array, Record, Rig

SNR = 12.5  # (rms of the signal over rms of the noise)^2, on input and output, white at the sampling of 1 kHz
SIDDIQI = 1e3  # smoothness that cross-validation picks with this noise
TESTS = (0.1, 0.3, 0.5, 1.0, 1.5, 2.0, 2.4, 3.0, 1 / 0.33, 3.5, 3.7, 4.0, 4.5)  # Hz

ERRORS = ("one_hz", "pump", "worst", "step")

Estimate = Callable[[Record], ltp.Htf]


@dataclass(frozen=True)
class Median:
    """Medians over seeds, in percent, and the mean fraction of values that lie in their 95 % discs."""

    one_hz: float
    pump: float
    worst: float
    step: float
    coverage: float


def chapter(rig: Rig) -> Chapter:
    """Siddiqi's estimate, and the one with shared poles, on the chirps and on a shaped multisine."""
    seeds = (1, 1) if rig.quick else (5, 10)
    shaped = rig.multisine(by_pilot(rig))
    cases: list[tuple[str, Record, Estimate, int, dict[str, float]]] = [
        ("chirps, Siddiqi", rig.chirps, lambda r: siddiqi(rig, r, smoothness=SIDDIQI, keep=False), seeds[0], {}),
        (
            "chirps, Floquet",
            rig.chirps,
            lambda r: floquet(rig, r, 21, keep=False),
            seeds[1],
            {"1 Hz": 8, "worst": 25, "step": 14},
        ),
        (
            "shaped multisine",
            shaped,
            lambda r: floquet(rig, r, 21, keep=False),
            seeds[1],
            {"1 Hz": 2, "worst": 8, "step": 2},
        ),
    ]
    rows: list[Row] = []
    coverages: list[float] = []
    for words, record, estimate, count, bars in cases:
        found = median(rig, record, estimate, range(count))
        each = f"{words}, median of {count}"
        rows += [
            Row(f"{each}: 1 Hz", found.one_hz, "%", "robust", high=bars.get("1 Hz", math.nan)),
            Row(f"{each}: 1/T", found.pump, "%"),
            Row(f"{each}: worst sine up to 4.5 Hz", found.worst, "%", high=bars.get("worst", math.nan)),
            Row(f"{each}: settled step", found.step, "%", high=bars.get("step", math.nan)),
        ]
        held = 100 * found.coverage
        rows.append(Row(f"{each}: 95 % bands that hold the exact value", held, "%"))
        if bars:
            coverages.append(held)
    rows.append(
        Row(
            "95 % bands of both estimates with shared poles together",
            float(np.mean(coverages)),
            "%",
            low=93.0,
            high=97.0,
        )
    )
    sentence = (
        "Noise at a signal-to-noise ratio of 12.5 on input and output, white at 1 kHz, multiplies the error of the "
        "published estimate. Shared poles keep more of the accuracy on the same record, and a multisine whose "
        "amplitudes follow the response keeps most of it."
    )
    picture = Picture(
        "fig11_noise",
        "Figure 11: errors of predicted sines with noise on input, output and both (one seed).",
        lambda: _draw(rig, shaped),
    )
    notes = ["The shaped multisine moves the output less, so the same ratio means less absolute noise there."]
    return Chapter("Noise (figures 10, 11)", sentence, rows, [] if rig.quick else [picture], notes)


def by_pilot(rig: Rig) -> Callable[[Array], Array]:
    """Amplitudes that make all relative errors alike, from what the noisy chirps say of the response."""
    pilot = floquet(rig, spoil(rig.chirps, 0), 21)

    def weights(omega: Array) -> Array:
        gain = np.sqrt(sum(np.abs(pilot.at(int(k), omega)) ** 2 for k in pilot.harmonics))
        return np.asarray(1.0 / gain)

    return weights


def spoil(record: Record, seed: int, *, on_input: bool = True, on_output: bool = True) -> Record:
    """The record with white noise on what was measured, each signal with its own."""
    u = signals.add_noise(record.u, SNR, seed=2 * seed)[0] if on_input else record.u
    y = signals.add_noise(record.y, SNR, seed=2 * seed + 1)[0] if on_output else record.y
    return Record(record.name, u, y)


def median(rig: Rig, record: Record, estimate: Estimate, seeds: range) -> Median:
    """Medians over the seeds of the noise."""
    found = [_one(rig, estimate(spoil(record, seed))) for seed in seeds]
    middle = {name: float(np.median([getattr(each, name) for each in found])) for name in ERRORS}
    return Median(**middle, coverage=float(np.mean([each.coverage for each in found])))


def _one(rig: Rig, htf: ltp.Htf) -> Median:
    errors = dict(zip(TESTS, rig.sweep(htf, TESTS), strict=True))
    one, pump, worst = errors[1.0], errors[1 / 0.33], max(errors.values())
    return Median(float(one), float(pump), float(worst), rig.step_error(htf), coverage(rig, htf))


def coverage(rig: Rig, htf: ltp.Htf) -> float:
    """Fraction of all values up to 4.5 Hz whose 95 % disc holds the exact one; NaN without bands."""
    if htf.sd is None:
        return math.nan
    inside = (htf.omega > 0) & (htf.omega <= math.tau * 4.5)
    truth = np.array([rig.exact.at(k, htf.omega[inside]) for k in htf.harmonics])
    held = np.abs(htf.values[:, inside, 0, 0] - truth) <= RADIUS_95 * htf.sd[:, inside, 0, 0]
    return float(held.mean())


def _draw(rig: Rig, shaped: Record) -> Figure:
    band = [hz for hz in rig.frequencies if hz <= 4.5]
    cases: tuple[tuple[str, Record, Estimate], ...] = (
        ("chirps, Siddiqi", rig.chirps, lambda r: siddiqi(rig, r, smoothness=SIDDIQI, keep=False)),
        ("chirps, Floquet", rig.chirps, lambda r: floquet(rig, r, 21, keep=False)),
        ("shaped multisine, Floquet", shaped, lambda r: floquet(rig, r, 21, keep=False)),
    )
    panels = []
    for title, record, estimate in cases:
        spoiled = {
            "no noise": (record, "nominal"),
            "on the input": (spoil(record, 0, on_output=False), "floor"),
            "on the output": (spoil(record, 0, on_input=False), "rival"),
            "on both": (spoil(record, 0), "before"),
        }
        lines = [
            Line(name, np.array(band), rig.sweep(estimate(each), band), role) for name, (each, role) in spoiled.items()
        ]
        panels.append(Panel(title, lines))
    return sweep(panels)
