"""Owns the noun `ltp.Htf` in Python: harmonic transfer functions, their files, and what they predict."""

from __future__ import annotations

import io
import json
import os
import warnings
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ltp import _ltp
from ltp._ltp import InputError
from ltp.files import read_bytes, write_bytes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]

_FORMAT = "ltp htf 1"  # what `save` writes first, so that another archive is not taken for one of these


class Htf:
    """Harmonic transfer functions of a real linear time-periodic system, on a grid of input frequencies.

    An input `exp(j w t)` gives `sum_k H_k(w) exp(j (w + k w_p) t)` with `w_p = 2 pi / period`: values stand at the
    *input* frequency. `values` (2K+1, n_omega, ny, nu), harmonics -K to K; `omega` (n_omega,), rad/s, from zero up;
    `period` in s. Negative frequencies follow from `H_-k(-w) = conj H_k(w)`. `sd` has the shape of the values, with
    `sd^2 = E |estimate - truth|^2`; `coherence` (n_omega, ny) is the fraction of the output's power near that output
    frequency that is explained. Both are None for exact functions.

    `values` may leave out the last two axes for one input and one output. Raises `InputError` for shapes that do not
    agree, frequencies that do not increase, and values that are not finite.
    """

    def __init__(
        self,
        values: npt.ArrayLike,
        omega: npt.ArrayLike,
        period: float,
        *,
        sd: npt.ArrayLike | None = None,
        coherence: npt.ArrayLike | None = None,
        method: str = "given",
        figures: Mapping[str, float] | None = None,
        warnings: Sequence[str] = (),
    ) -> None:
        self._core: _ltp.Htf = _ltp.Htf(
            _block("values", values, np.complex128),
            _array("omega", omega, np.float64),
            float(period),
            None if sd is None else _block("sd", sd, np.float64),
            None if coherence is None else _columns("coherence", coherence),
            method,
            dict(figures or {}),
            list(warnings),
        )

    @classmethod
    def wrap(cls, core: _ltp.Htf) -> Htf:
        """The Python face of harmonic transfer functions of the extension."""
        htf = cls.__new__(cls)
        htf._core = core
        return htf

    @property
    def values(self) -> Complex:
        """Values (2K+1, n_omega, ny, nu), harmonics from -K to K; read-only."""
        return self._core.values

    @property
    def omega(self) -> Array:
        """Input frequencies (n_omega,), rad/s; read-only."""
        return self._core.omega

    @property
    def period(self) -> float:
        """Period T, s."""
        return self._core.period

    @property
    def harmonics(self) -> npt.NDArray[np.int64]:
        """Harmonics (2K+1,), from -K to K."""
        most = len(self.values) // 2
        return np.arange(-most, most + 1)

    @property
    def sd(self) -> Array | None:
        """Standard deviations of the complex values, shape as theirs; None for exact ones."""
        return self._core.sd

    @property
    def coherence(self) -> Array | None:
        """Fraction of the output's power that is explained, (n_omega, ny), by output frequency; None where unknown."""
        return self._core.coherence

    @property
    def method(self) -> str:
        """How the values were found, in words."""
        return self._core.method

    @property
    def figures(self) -> dict[str, float]:
        """Named figures of the estimation, such as its smoothness, its poles or the noise it found."""
        return self._core.figures

    @property
    def warnings(self) -> list[str]:
        """What is doubtful, with numbers and advice."""
        return self._core.warnings

    def harmonic(self, k: int, output: int = 0, input: int = 0) -> Complex:
        """`H_k` (n_omega,) at the frequencies `omega`. Raises `InputError` beyond the largest harmonic."""
        most = len(self.values) // 2
        if not -most <= k <= most:
            raise InputError(f"Htf: harmonic {k} is asked for, but these go from {-most} to {most}; take one of them")
        chosen: Complex = self.values[k + most, :, output, input]
        return chosen

    def at(self, k: int, omega: npt.ArrayLike, output: int = 0, input: int = 0) -> Complex:
        """`H_k` at any frequencies `omega` (n,), rad/s, of both signs: between the grid by polynomials, zero beyond it.

        Raises `InputError` for an output or input that is not there.
        """
        return self._core.at(int(k), np.atleast_1d(_array("omega", omega, np.float64)), output, input)

    def steady_state(
        self, omega: float, amplitude: float, t: npt.ArrayLike, *, phase: float = 0.0, input: int = 0
    ) -> Array:
        """Outputs (n, ny) at times `t` (n,), s, settled under `amplitude * cos(omega t + phase)` on one input.

        With `omega = 0`, the response to a constant.
        """
        times = np.atleast_1d(_array("t", t, np.float64))
        return self._core.steady_state(float(omega), float(amplitude), float(phase), input, times)

    def predict(self, u: npt.ArrayLike, dt: float, *, t0: float = 0.0) -> Array:
        """Outputs (n, ny) under the input `u`, (n,) or (n, nu), sampled every `dt` seconds from the clock's time `t0`.

        The input is zero before and after, and band-limited between its samples; transients are included. What it has
        beyond the grid of frequencies cannot be predicted, and is warned of. Raises `InputError` for an input that is
        not finite or has another number of columns.
        """
        outputs, doubts = self._core.predict(_columns("u", u), float(t0), float(dt))
        for text in doubts:
            warnings.warn(f"Htf.predict: {text}", stacklevel=2)
        return outputs

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write everything to an `.npz` archive, in one step; returns the path.

        Raises `InputError` when it cannot be written there.
        """
        arrays: dict[str, Any] = {"values": self.values, "omega": self.omega, "period": np.float64(self.period)}
        arrays |= {name: part for name, part in (("sd", self.sd), ("coherence", self.coherence)) if part is not None}
        words = {"format": _FORMAT, "method": self.method, "figures": self.figures, "warnings": self.warnings}
        stream = io.BytesIO()
        np.savez_compressed(stream, about=np.array(json.dumps(words)), **arrays)
        return write_bytes(path, stream.getvalue())

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Htf:
        """Read what `save` wrote. Raises `InputError` when the file is missing or something else."""
        data = read_bytes(path)
        try:
            archive = np.load(io.BytesIO(data), allow_pickle=False)
            if not isinstance(archive, np.lib.npyio.NpzFile):
                raise ValueError("it holds a single array without a name")
            with archive:
                parts = {name: archive[name] for name in archive.files}
            words = json.loads(str(parts["about"]))
            if words["format"] != _FORMAT:
                raise ValueError(f"its format is {words['format']!r}, expected {_FORMAT!r}")
            return cls(
                parts["values"],
                parts["omega"],
                float(parts["period"]),
                sd=parts.get("sd"),
                coherence=parts.get("coherence"),
                method=words["method"],
                figures=words["figures"],
                warnings=words["warnings"],
            )
        except (zipfile.BadZipFile, zlib.error, EOFError, OSError, ValueError, KeyError, TypeError) as error:
            raise InputError(
                f"{path}: no harmonic transfer functions can be read here ({error}); write the file with Htf.save"
            ) from None

    def plot(self, *, exact: Htf | None = None, harmonics: Sequence[int] = (0, 1, 2, -1, -2), unit: str = "") -> Figure:
        """Magnitude and phase of `H_k` over input frequency, with 95 % bands and an exact reference if given."""
        from ltp.plots.htf import htf_figure  # drawing is slow to import

        return htf_figure(self, exact=exact, harmonics=harmonics, unit=unit)

    def __repr__(self) -> str:
        rows, width, outputs, inputs = self.values.shape
        omega = self.omega
        return (
            f"<ltp.Htf {self.method}; harmonics -{rows // 2} to {rows // 2}, {width} frequencies "
            f"{omega[0]:g} to {omega[-1]:g} rad/s, period {self.period:g} s; inputs: {inputs}, outputs: {outputs}>"
        )


def _array(name: str, values: npt.ArrayLike, kind: type[Any]) -> npt.NDArray[Any]:
    try:
        with np.errstate(all="ignore"):
            array: npt.NDArray[Any] = np.asarray(values)
            if kind is np.float64 and np.iscomplexobj(array):
                raise TypeError("they are complex")
            return np.ascontiguousarray(array, dtype=kind)
    except (TypeError, ValueError) as error:
        raise InputError(f"Htf: {name} is not an array of numbers ({error}); correct it") from None


def _block(name: str, values: npt.ArrayLike, kind: type[Any]) -> npt.NDArray[Any]:
    """Four axes, the last two added for one input and one output."""
    array = _array(name, values, kind)
    return array[:, :, np.newaxis, np.newaxis] if array.ndim == 2 else array


def _columns(name: str, values: npt.ArrayLike) -> Array:
    array = _array(name, values, np.float64)
    return array[:, np.newaxis] if array.ndim == 1 else array
