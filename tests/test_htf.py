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
