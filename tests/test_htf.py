"""Owns the tests of the noun `Htf` in Python: what it holds, what it refuses, its file, its picture."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ltp

PERIOD = 0.5
OMEGA = np.linspace(0.0, 30.0, 61)


def parts() -> dict[str, Any]:
    """A system with closed form: `y = (1 + cos(w_p t)) x`, where x is the input through a mass on a damped spring."""
    values = np.stack([0.5 * resonance(OMEGA), resonance(OMEGA), 0.5 * resonance(OMEGA)])
    return {"values": values, "omega": OMEGA, "period": PERIOD}


def resonance(omega: np.ndarray) -> np.ndarray:
    return 1.0 / (100.0 - omega**2 + 2.0j * omega)


def estimate() -> ltp.Htf:
    given = parts()
    sd = np.full(given["values"].shape, 1e-4)
    coherence = np.full(len(OMEGA), 0.99)
    figures = {"smoothness": 3.0, "gcv": 1e-9}
    return ltp.Htf(
        **given,
        sd=sd,
        coherence=coherence,
        method="by hand",
        figures=figures,
        warnings=["few periods: 12; record more"],
    )


class TestHolds:
    def test_what_was_given(self) -> None:
        htf = ltp.Htf(**parts())
        assert htf.values.shape == (3, 61, 1, 1)
        assert htf.values.dtype == np.complex128
        np.testing.assert_array_equal(htf.harmonics, [-1, 0, 1])
        np.testing.assert_array_equal(htf.omega, OMEGA)
        np.testing.assert_array_equal(htf.harmonic(1), parts()["values"][2])
        assert (htf.period, htf.sd, htf.coherence, htf.figures, htf.warnings) == (PERIOD, None, None, {}, [])

    def test_an_estimate_has_its_uncertainty(self) -> None:
        htf = estimate()
        assert htf.sd is not None
        assert htf.coherence is not None
        assert (htf.sd.shape, htf.coherence.shape) == ((3, 61, 1, 1), (61, 1))
        assert (htf.method, htf.figures["smoothness"]) == ("by hand", 3.0)

    def test_arrays_cannot_be_written_to(self) -> None:
        htf = estimate()
        for array in (htf.values, htf.omega, htf.sd, htf.coherence):
            assert array is not None
            with pytest.raises(ValueError, match="read-only"):
                array[0] = 0.0

    @pytest.mark.parametrize("order", ["C", "F"])
    def test_any_layout(self, order: Any) -> None:
        values = np.random.default_rng(0).normal(size=(3, 61, 2, 4)) + 0j
        htf = ltp.Htf(np.asarray(values, order=order), OMEGA, PERIOD)
        np.testing.assert_array_equal(htf.values, values)
        np.testing.assert_array_equal(htf.harmonic(-1, output=1, input=3), values[0, :, 1, 3])


class TestRefuses:
    @pytest.mark.parametrize(
        ("name", "value", "message"),
        [
            ("values", np.ones((2, 61)), "an odd number, 2K"),
            ("values", np.ones((3, 60)), "beside omega"),
            ("values", np.ones((3, 61, 1)), "4-D array of complex128"),
            ("values", np.full((3, 61), np.nan), "values"),
            ("values", "high", "not an array of numbers"),
            ("omega", OMEGA[::-1], "omega"),
            ("omega", OMEGA - 1.0, "from zero upwards"),
            ("omega", OMEGA + 1j, "complex"),
            ("period", 0.0, "period"),
            ("period", math.nan, "period"),
            ("sd", np.ones((3, 60)), "sd: axis 1"),
            ("coherence", np.ones((61, 2)), "coherence: outputs"),
            ("coherence", np.ones(60), "coherence: frequencies"),
        ],
    )
    def test_one_thing_that_cannot_be(self, name: str, value: Any, message: str) -> None:
        with pytest.raises(ltp.InputError, match=message):
            ltp.Htf(**(parts() | {name: value}))

    def test_a_harmonic_that_is_not_there(self) -> None:
        with pytest.raises(ltp.InputError, match="harmonic 2 is asked for, but these go from -1 to 1"):
            estimate().harmonic(2)


class TestPredicts:
    """The closed form: `y = (1 + cos(w_p t)) x`, so `H_0 = X` and `H_1 = H_-1 = X/2` with X the resonance."""

    W_P = math.tau / PERIOD

    def test_between_the_grid(self) -> None:
        """Six points make the error fall by about 2^6 when the grid is halved, also on the resonance."""
        omega = np.array([7.13, 9.87, 21.4])
        errors = []
        for step in (0.25, 0.125):
            grid = np.arange(0.0, 30.1, step)
            htf = ltp.Htf(np.stack([resonance(grid)] * 3), grid, PERIOD)
            errors.append(np.abs(htf.at(1, omega) - resonance(omega)).max())
        assert errors[0] / errors[1] > 40
        assert errors[1] < 1e-5 * abs(resonance(np.array([10.0]))[0])

    def test_negative_frequencies_and_beyond(self) -> None:
        htf, omega = ltp.Htf(**parts()), np.array([7.13, 9.87])
        np.testing.assert_allclose(htf.at(-1, -omega), np.conj(htf.at(1, omega)), rtol=1e-14)
        np.testing.assert_array_equal(htf.at(1, [OMEGA[-1] + 1.0]), [0.0])
        np.testing.assert_array_equal(htf.at(2, [1.0]), [0.0])

    def test_a_settled_sine(self) -> None:
        htf = ltp.Htf(**parts())
        t = np.linspace(0.0, 3.0, 200)
        x = np.real(resonance(np.array([8.0])) * 0.3 * np.exp(1j * (8.0 * t + 0.4)))
        expected = (1.0 + np.cos(self.W_P * t)) * x
        found = htf.steady_state(8.0, 0.3, t, phase=0.4)
        assert found.shape == (200, 1)
        np.testing.assert_allclose(found[:, 0], expected, atol=1e-15)

    def test_a_pulse_with_its_transient(self) -> None:
        omega = np.arange(0.0, 80.0, 0.05)
        values = np.stack([0.5 * resonance(omega), resonance(omega), 0.5 * resonance(omega)])
        dt, n = 0.0025, 8000
        t = np.arange(n) * dt
        u = np.exp(-(((t - 1.0) / 0.15) ** 2))
        # The oscillator by its own impulse response, summed.
        ring = math.sqrt(99.0)
        x = np.convolve(u, np.exp(-t) * np.sin(ring * t) / ring)[:n] * dt
        found = ltp.Htf(values, omega, PERIOD).predict(u, dt)[:, 0]
        expected = (1.0 + np.cos(self.W_P * t)) * x
        assert ltp.metrics.e_rms(expected, found) < 0.01  # percent

    def test_what_lies_beyond_the_grid_is_said(self) -> None:
        noise = np.random.default_rng(0).normal(size=400)
        with pytest.warns(UserWarning, match="where the transfer functions end"):
            ltp.Htf(**parts()).predict(noise, 0.005)

    def test_one_thing_that_cannot_be(self) -> None:
        htf = ltp.Htf(**parts())
        for call, message in (
            (lambda: htf.at(0, [1.0], output=1), "output"),
            (lambda: htf.at(0, ["low"]), "not an array of numbers"),
            (lambda: htf.steady_state(1.0, 1.0, [0.0], input=2), "input"),
            (lambda: htf.predict(np.zeros((5, 2)), 0.1), "columns"),
            (lambda: htf.predict([0.0, math.nan], 0.1), "input"),
            (lambda: htf.predict([0.0, 1.0], -0.1), "dt"),
        ):
            with pytest.raises(ltp.InputError, match=message):
                call()


class TestPicture:
    def test_panels_and_bands(self) -> None:
        htf = estimate()
        figure = htf.plot(unit="m/N")
        assert [axes.get_ylabel() for axes in figure.axes] == ["magnitude (m/N)", "phase (°)"]
        assert len(figure.axes[0].collections) == 3  # one band for each of the harmonics -1, 0, 1
        assert not ltp.Htf(**parts()).plot().axes[0].collections

    def test_the_error_against_a_reference(self) -> None:
        figure = estimate().plot(exact=ltp.Htf(**parts()))
        assert [axes.get_ylabel() for axes in figure.axes] == ["magnitude", "phase (°)", "error"]
        assert "exact" in [text.get_text() for text in figure.legends[0].get_texts()]


class TestFile:
    def test_comes_back_bit_for_bit(self, tmp_path: Path) -> None:
        htf = estimate()
        again = ltp.Htf.load(htf.save(tmp_path / "htf.npz"))
        for name in ("values", "omega", "sd", "coherence"):
            np.testing.assert_array_equal(getattr(again, name), getattr(htf, name))
        for name in ("period", "method", "figures", "warnings"):
            assert getattr(again, name) == getattr(htf, name)

    def test_exact_ones_have_no_sd(self, tmp_path: Path) -> None:
        again = ltp.Htf.load(ltp.Htf(**parts()).save(tmp_path / "htf.npz"))
        assert (again.sd, again.coherence) == (None, None)

    def test_nothing_is_left_half_written(self, tmp_path: Path) -> None:
        with pytest.raises(ltp.InputError, match="does not exist"):
            estimate().save(tmp_path / "nowhere" / "htf.npz")
        estimate().save(tmp_path / "htf.npz")
        assert [path.name for path in tmp_path.iterdir()] == ["htf.npz"]

    def test_refuses_another_file(self, tmp_path: Path) -> None:
        other = tmp_path / "run.npz"
        np.savez(other, t=np.arange(3.0))
        text = tmp_path / "run.csv"
        text.write_text("t,u\n0,1\n", encoding="utf-8")
        later = tmp_path / "later.npz"
        np.savez(later, about=np.array(json.dumps({"format": "ltp htf 9"})))
        for path, message in (
            (other, "about"),
            (text, "Htf.save"),
            (later, "'ltp htf 9'"),
            (tmp_path / "no", "no such"),
        ):
            with pytest.raises(ltp.InputError, match=message):
                ltp.Htf.load(path)
