"""Owns the tests of `ltp.identify` from Python: what it finds in records of the hopper and of a system in closed form,
what it says about a bias, and what it refuses.
"""

from __future__ import annotations

import math
import warnings

import numpy as np
import numpy.typing as npt
import pytest

import ltp

PERIOD = 0.5
DT = 0.01
BAND = math.tau * 1.6
DAMPING = 1.0  # 1/s


def oscillator(n: int, u: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """`y = (1 + cos(w_p t)) x` with x the answer of a damped oscillator to `u`, straight between its samples."""
    a = np.array([[0.0, 1.0], [-100.0, -DAMPING]])
    # The matrix exponential of the state with the input and its slope, by its series.
    m = np.zeros((4, 4))
    m[:2, :2], m[1, 2], m[2, 3] = a * DT, DT, 1.0
    step, term = np.eye(4), np.eye(4)
    for k in range(1, 30):
        term = term @ m / k
        step += term
    x = np.zeros((n, 2))
    for i in range(n - 1):
        x[i + 1] = step[:2] @ [*x[i], u[i], u[i + 1] - u[i]]
    t = np.arange(n) * DT
    return (1.0 + np.cos(math.tau / PERIOD * t)) * x[:, 0]


def truth(k: int, omega: npt.NDArray[np.float64]) -> npt.NDArray[np.complex128]:
    return (1.0 if k == 0 else 0.5) / (100.0 - omega**2 + 1j * DAMPING * omega)


def record(noise: float = 0.0, bias: float = 0.0, seed: int = 0) -> ltp.Recording:
    """A sum of sines for 80 periods, then rest for 80."""
    n = 160 * 50
    t = np.arange(n) * DT
    random = np.random.default_rng(1)
    lines = np.arange(0.05, 1.55, 0.05)
    u = np.sum([np.cos(math.tau * (f * t + random.random())) for f in lines], axis=0) * (t < 40.0)
    y = oscillator(n, u)
    measured = y + bias + noise * np.random.default_rng(seed).normal(size=n)
    return ltp.Recording(t, {"u": u}, {"y": measured}, "sines")


def identify(recording: ltp.Recording | list[ltp.Recording], **options: object) -> ltp.Htf:
    given = {"period": PERIOD, "harmonics": 2, "band": BAND} | options
    return ltp.identify(recording, **given)  # type: ignore[arg-type]


class TestFinds:
    def test_the_closed_form(self) -> None:
        htf = identify(record())
        for k in htf.harmonics:
            expected = truth(abs(int(k)), htf.omega) if abs(k) <= 1 else np.zeros(len(htf.omega))
            assert np.abs(htf.harmonic(int(k)) - expected).max() < 2e-3 * np.abs(truth(0, htf.omega)).max()

    def test_the_multipliers(self) -> None:
        figures = identify(record()).figures
        rate = 0.5 * DAMPING
        expected = np.exp((-rate + 1j * math.sqrt(100.0 - rate**2)) * PERIOD)
        assert figures["a1"] == pytest.approx(2 * expected.real, abs=2e-3)
        assert figures["a2"] == pytest.approx(-(abs(expected) ** 2), abs=2e-3)

    def test_noise_is_in_the_bands(self) -> None:
        noise = 2e-3
        htf = identify(record(noise))
        assert htf.sd is not None
        assert htf.coherence is not None
        assert htf.figures["noise_sd"] == pytest.approx(noise, rel=0.1)
        error = np.abs(np.array([htf.harmonic(k) - truth(abs(k), htf.omega) for k in (-1, 0, 1)]))
        inside = error <= 1.7308 * htf.sd[1:4, :, 0, 0]
        assert 0.8 < inside.mean() <= 1.0  # one draw of correlated errors

    def test_two_records_are_better_than_one(self) -> None:
        one, two = identify(record(2e-3)), identify([record(2e-3), record(2e-3, seed=7)])
        assert one.sd is not None
        assert two.sd is not None
        assert two.sd.mean() < 0.8 * one.sd.mean()

    def test_same_bits(self) -> None:
        np.testing.assert_array_equal(identify(record()).values, identify(record()).values)


class TestRest:
    def test_a_bias_shows_where_the_input_rests(self) -> None:
        (rest,) = ltp.rests(record(1e-4, bias=3e-3), period=PERIOD)
        assert rest.bias == pytest.approx(3e-3, rel=0.02)
        assert rest.periodic < 0.1 * rest.bias
        assert (rest.recording, rest.output) == ("sines", "y")

    def test_it_is_said(self) -> None:
        with pytest.warns(UserWarning, match="output_bias"):
            identify(record(1e-4, bias=3e-3))

    def test_nothing_planted_nothing_claimed(self) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            identify(record(1e-4), harmonics=1)


class TestRefuses:
    @pytest.mark.parametrize(
        ("options", "message"),
        [
            ({"period": 0.0}, "period"),
            ({"period": math.nan}, "period"),
            ({"harmonics": -1}, "harmonics is -1"),
            ({"harmonics": 40}, "Nyquist"),
            ({"band": -1.0}, "band"),
            ({"band": math.tau * 60.0}, "Nyquist|power"),
            ({"method": "floqet"}, "floquet"),
            ({"orbit": "gone"}, "removed"),
            ({"order": 99}, "order"),
            ({"method": "lines", "order": 2}, "order"),
        ],
    )
    def test_one_thing_that_cannot_be(self, options: dict[str, object], message: str) -> None:
        with pytest.raises(ltp.InputError, match=message):
            identify(record(), **options)

    def test_a_recording_of_something_else(self) -> None:
        with pytest.raises(ltp.InputError, match="found a str, expected recordings"):
            ltp.identify("run.csv", period=PERIOD, harmonics=1)  # type: ignore[arg-type]

    def test_an_input_that_does_nothing(self) -> None:
        n = 4000
        flat = ltp.Recording(np.arange(n) * DT, {"u": np.zeros(n)}, {"y": np.sin(np.arange(n) * DT)})
        with pytest.raises(ltp.InputError, match="u"):
            identify(flat)
