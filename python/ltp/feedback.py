"""Owns the noun `Feedback`, and what counts as a gain: an array, gains by harmonic, or anything that has them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from ltp import _ltp
from ltp._ltp import InputError

Array = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]


class PeriodicGain(Protocol):
    """Anything with `harmonics` {k: (nu, nx)}, such as a `Feedback`: `K(t) = K_0 + Re sum_{k>0} K_k e^{j k w t}`."""

    @property
    def harmonics(self) -> Mapping[int, Any]:
        """Complex gains by harmonic, from 0 up."""
        ...


#: A gain: constant (nu, nx), or (nx,) for one input; by harmonics; or a `Feedback`.
Gain = npt.ArrayLike | Mapping[int, npt.ArrayLike] | PeriodicGain


@dataclass(frozen=True, eq=False)
class Feedback:
    """State feedback `u = -K(t) x` with `K(t) = harmonics[0] + sum_k Re(harmonics[k] e^{j k w t})` and `period` (s).

    `harmonics` holds complex (nu, nx) matrices by their harmonic, in units of the input per unit of the state; `method`
    says where the gain is from, `figures` what it does (largest real parts in 1/s), `warnings` what is doubtful.
    """

    period: float
    harmonics: dict[int, Complex]
    method: str
    figures: dict[str, float]
    warnings: list[str]
    _core: _ltp.Feedback = field(repr=False)

    @classmethod
    def constant(cls, gain: npt.ArrayLike, period: float) -> Feedback:
        """A constant gain (nu, nx), or (nx,) for one input, for a system of `period`, s.

        Raises `InputError` for another shape, numbers that are not finite or a period that is not positive.
        """
        return cls.from_harmonics({0: np.atleast_2d(numbers("gain", gain))}, period)

    @classmethod
    def from_harmonics(cls, harmonics: Mapping[int, npt.ArrayLike], period: float) -> Feedback:
        """A periodic gain from its complex matrices (nu, nx) by harmonic, from 0 up; raises as `constant`."""
        matrices = {int(k): np.atleast_2d(np.asarray(v, dtype=np.complex128)) for k, v in harmonics.items()}
        shapes = {m.shape for m in matrices.values()}
        if not matrices or len(shapes) != 1 or any(m.ndim != 2 for m in matrices.values()) or min(matrices) < 0:
            raise InputError(
                f"harmonics: found keys {sorted(matrices)} with shapes {sorted(shapes)}, expected matrices of one "
                "shape (nu, nx) by harmonics from 0 up; correct them"
            )
        block = np.zeros((max(matrices) + 1, *shapes.pop(), 1), dtype=np.complex128)
        for k, matrix in matrices.items():
            block[k, :, :, 0] = matrix
        return cls.wrap(_ltp.Feedback.of_harmonics(float(period), block))

    @classmethod
    def wrap(cls, core: _ltp.Feedback) -> Feedback:
        """The Python side of a feedback of the core."""
        harmonics = {k: matrix for k, matrix in enumerate(core.harmonics) if k == 0 or np.any(matrix)}
        return cls(
            period=core.period,
            harmonics=harmonics,
            method=core.method,
            figures=dict(core.figures),
            warnings=core.warnings,
            _core=core,
        )

    @property
    def gain(self) -> Array:
        """The mean of K(t), (nu, nx): all of a constant gain."""
        return np.ascontiguousarray(self.harmonics[0].real)

    def at(self, t: npt.ArrayLike) -> Array:
        """K(t) at a time, (nu, nx), or at times (n,), (n, nu, nx); s."""
        times = numbers("t", t)
        values = self._core.at(np.atleast_1d(times))
        return values if times.ndim else values[0]

    def __repr__(self) -> str:
        figures = "".join(f"; {name}: {value:.6g}" for name, value in self.figures.items())
        return f"<ltp.Feedback {self.gain.shape} by {self.method}, harmonics {list(self.harmonics)}{figures}>"


def numbers(name: str, values: npt.ArrayLike) -> Array:
    """Real numbers as an array; `InputError` names them where they are none."""
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name}: not an array of real numbers ({error}); convert it") from None


def gain_coefficients(
    verb: str, gain: Gain, inputs: Sequence[str], states: Sequence[str]
) -> tuple[float | None, Complex]:
    """Period, s, of a gain that has one, and its Fourier coefficients (K + 1, nu, nx).

    Raises `InputError`, led by `verb`, for another shape, a harmonic below zero, or what is no array of numbers.
    """
    shape = (len(inputs), len(states))
    lines = getattr(gain, "harmonics", gain)
    given: Mapping[int, Any] = lines if isinstance(lines, Mapping) else {0: lines}
    out = np.zeros((max(given, default=0) + 1, *shape), dtype=np.complex128)
    for k, values in given.items():
        try:
            array = np.asarray(values, dtype=np.complex128)
        except (TypeError, ValueError) as error:
            raise InputError(f"{verb}: the gain is not an array of numbers ({error}); convert it") from None
        if array.ndim == 1 and shape[0] == 1:
            array = array[np.newaxis]
        if array.shape != shape:
            raise InputError(
                f"{verb}: the gain has shape {array.shape}, expected {shape}: a row per input "
                f"({', '.join(inputs)}), a column per state ({', '.join(states)})"
            )
        if k < 0:
            raise InputError(f"{verb}: the gain has a harmonic {k}; give those from 0 on, the others are conjugates")
        out[k] = array if k == 0 else 0.5 * array
    period = getattr(gain, "period", None)
    return (None if period is None else float(period)), out
