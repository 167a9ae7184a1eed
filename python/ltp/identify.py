"""Owns `ltp.identify` in Python: harmonic transfer functions from recordings, without any model."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ltp import _ltp
from ltp._ltp import InputError
from ltp.htf import Htf
from ltp.recording import Recording


def identify(
    recording: Recording | Sequence[Recording],
    *,
    period: float,
    harmonics: int,
    method: str = "floquet",
    band: float | None = None,
    orbit: str = "deviation",
    order: int | None = None,
    reach: float | None = None,
    transients: bool | None = None,
    smoothness: float | None = None,
    solver: str | None = None,
) -> Htf:
    """Harmonic transfer functions of the periodic system that made the recordings, with their uncertainty.

    period: T of the system, s; the times of the recordings are those of its clock. harmonics: the largest, K.
    method: "floquet" (one denominator for all harmonics, whose roots are the Floquet multipliers: any input),
        "curvature" (Siddiqi's least squares with a penalty on curvature: any input) or "lines" (quotients of lines:
        periodic inputs).
    band: largest input frequency of the estimate, rad/s; by default as far as the input has power.
    orbit: "deviation" when the periodic orbit was subtracted from the outputs; "removed" when they still contain it,
        or what is left of it: output lines at multiples of the pumping frequency then carry no information.
    order, reach, transients: of "floquet": the number of multipliers, by default the one with the greatest evidence;
        the input frequency up to which numerators are fitted, rad/s; whether records may begin away from the steady
        state.
    smoothness, solver: of "curvature": the weight of the curvature in units of the input's power, by default the one
        with the best cross-validation; and the route, "smoother" (a Kalman smoother along frequency, the default) or
        "banded" (one system, as published), which find the same.

    Several recordings of the same channels are taken together. Doubts (few cycles, no power in part of the band) are
    warned of and kept in `warnings`. Raises `InputError` when the recordings cannot be used as asked, with the numbers
    and what to do.
    """
    listed = _listed("identify", recording)
    if harmonics < 0:
        raise InputError(f"identify: harmonics is {harmonics}, expected the largest harmonic, from 0 on; correct it")
    core = _ltp.identify(
        [one._core for one in listed],
        period=float(period),
        harmonics=harmonics,
        method=method,
        band=band,
        orbit=orbit,
        order=order,
        reach=reach,
        transients=transients,
        smoothness=smoothness,
        solver=solver,
    )
    htf = Htf.wrap(core)
    for text in htf.warnings:
        warnings.warn(f"identify: {text}", stacklevel=2)
    return htf


@dataclass(frozen=True)
class Rest:
    """What an output shows over `periods` periods of a `recording` in which the input has long been zero.

    A deviation has died away there. The mean that stays is a `bias` of the sensor or of the orbit that was subtracted,
    with its standard error `bias_sd`; `periodic` is the rms of what repeats with the clock beside it, `rms` that of the
    output over the whole recording. All are in the output's unit.
    """

    recording: str
    output: str
    bias: float
    bias_sd: float
    periodic: float
    rms: float
    periods: int


def rests(recording: Recording | Sequence[Recording], *, period: float) -> list[Rest]:
    """What every output shows in the longest rest of each recording; nothing without 20 periods (s) of rest.

    `identify` asks this by itself, and warns of a bias that stands out.
    """
    return [Rest(*found) for found in _ltp.rests([one._core for one in _listed("rests", recording)], float(period))]


def _listed(verb: str, recording: Recording | Sequence[Recording]) -> list[Recording]:
    listed: list[Any] = [recording] if isinstance(recording, Recording) else list(recording)
    for one in listed:
        if not isinstance(one, Recording):
            found = type(one).__name__
            raise InputError(f"{verb}: found a {found}, expected recordings; make them with ltp.Recording")
    return listed
