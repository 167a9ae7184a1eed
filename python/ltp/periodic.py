"""Owns what linear periodic systems are made from and taken apart into: Floquet, lifted modes, transverse."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, cast

import numpy as np
import numpy.typing as npt

from ltp import _ltp
from ltp._ltp import InputError
from ltp.feedback import Array, Complex, Feedback, Gain, gain_coefficients

if TYPE_CHECKING:
    from ltp.linearize import LtpSystem

Matrix = Callable[[float], npt.ArrayLike] | npt.ArrayLike


@dataclass(frozen=True, eq=False)
class LiftedMode:
    """One eigenvalue of a truncated harmonic state space, held against the exact Floquet exponents.

    `value`, 1/s; `exponent` is the place of the nearest in `LtpSystem.exponents`, up to `copy` times `j w`, at
    `distance`, 1/s; `edge` the share of the eigenvector in the outermost blocks, in [0, 1]. `converged`: it is a copy
    of that exponent to five digits; if not, it is an artefact of the edge, and says nothing of stability.
    """

    value: complex
    exponent: int
    copy: int
    distance: float
    edge: float
    converged: bool


@dataclass(frozen=True, eq=False)
class Floquet:
    """`Phi(t, t0) = P(t) e^{A_bar (t - t0)}` with `P` of period T and `P(t0) = I`: in `x = P z` the system is constant.

    `exponents` (nx,), 1/s, largest real part first; `A_bar` (nx, nx), 1/s. Both `A_bar` and `P` are complex when a
    multiplier is a negative real number, and real otherwise. `residual` is the largest entry of `P(t0 + T) - I`.
    """

    exponents: Complex
    A_bar: Complex
    residual: float
    is_real: bool
    warnings: list[str]
    _core: _ltp.Floquet = field(repr=False)

    def P(self, t: float) -> Complex:
        """P(t) (nx, nx) at `t`, s."""
        return self._core.p(float(t))

    @classmethod
    def wrap(cls, core: _ltp.Floquet) -> Floquet:
        """The decomposition that the extension made."""
        _warn(core.warnings)
        return cls(core.exponents, core.a_bar, core.residual, core.is_real, core.warnings, core)


@dataclass(frozen=True, eq=False)
class Transverse:
    """The dynamics across an orbit: `system` of nx - 1 states `xi = Z(t)^T x`, with the phase removed.

    `defect` is the largest share of the tangent's rate that points across the orbit, zero for an orbit without a clock.
    """

    system: LtpSystem
    period: float
    defect: float
    warnings: list[str]
    _core: _ltp.Transverse = field(repr=False)

    def Z(self, t: float) -> Array:
        """The frame (nx, nx - 1) at `t`, s: orthonormal columns across the tangent."""
        values = _value(self._core.frame, self.period, t)
        nx = len(self.system.state_names) + 1
        return values.reshape(nx, nx - 1)

    def tangent(self, t: float) -> Array:
        """The tangent (nx,) at `t`, s."""
        return _value(self._core.tangent, self.period, t)

    def gain(self, transverse: Gain) -> Feedback:
        """The gain on all states, `K(t) = K_perp(t) Z(t)^T`, of a gain (nu, nx - 1) on the transverse ones."""
        inputs, states = self.system.input_names, self.system.state_names
        period, lines = gain_coefficients("Transverse.gain", transverse, inputs, states)
        whole = self._core.gain(period or self.period, lines[:, np.newaxis])
        whole = whole.reshape(-1, len(inputs), len(states) + 1)
        return Feedback.from_harmonics({k: c if k == 0 else 2.0 * c for k, c in enumerate(whole)}, self.period)


def tangent_coefficients(samples: npt.ArrayLike, nx: int) -> Complex:
    """Fourier coefficients (K + 1, 1, nx, 1) of a tangent by even samples (n, nx) over one period."""
    values = _real("tangent", samples)
    if values.ndim != 2 or values.shape[1] != nx:
        raise InputError(f"tangent: found shape {values.shape}, expected (n, {nx}), even samples over one period")
    lines = np.fft.rfft(values, axis=0) / len(values)
    if len(values) % 2 == 0:
        lines = lines[:-1]
    return np.ascontiguousarray(lines.reshape(-1, 1, nx, 1))


def core_from_functions(
    period: float, matrices: Mapping[str, Matrix | None]
) -> tuple[_ltp.LtpSystem, tuple[int, int, int]]:
    """The extension's system from functions of time (or constants) that give A, B, C, D; what is None is zero."""
    first = {name: _real(name, m(0.0) if callable(m) else m) for name, m in matrices.items() if m is not None}
    size, shapes = _shapes({name: value.shape for name, value in first.items()})

    def at(name: str, t: float) -> Array:
        given = matrices[name]
        if given is None:
            return np.zeros(shapes[name])
        value = _real(name, given(t)) if callable(given) else first[name]
        if value.shape != shapes[name]:
            raise InputError(f"{name} at t = {t} s: found shape {value.shape}, expected {shapes[name]}")
        return value

    return _ltp.LtpSystem.from_functions(float(period), size, at), size


def core_from_samples(
    period: float, matrices: Mapping[str, npt.ArrayLike | None]
) -> tuple[_ltp.LtpSystem, tuple[int, int, int]]:
    """The extension's system from even samples (n, rows, columns) of A, B, C, D over one period, or constants."""
    given = {name: _real(name, m) for name, m in matrices.items() if m is not None}
    for name, value in given.items():
        if value.ndim not in (2, 3) or value.size == 0:
            raise InputError(
                f"{name}: found shape {value.shape}, expected (n, rows, columns), even samples of one period"
            )
    given = {name: value if value.ndim == 3 else value[np.newaxis] for name, value in given.items()}
    size, shapes = _shapes({name: value.shape[1:] for name, value in given.items()})
    for name, value in given.items():
        lines = np.abs(np.fft.rfft(value, axis=0))
        top = lines[3 * len(lines) // 4 :].max() if len(value) >= 8 else 0.0
        if top > 1e-6 * lines.max():
            warnings.warn(
                f"{name}: the highest quarter of the harmonics that {len(value)} samples show holds up to "
                f"{top / lines.max():.1e} of the largest; what lies beyond is folded back, take more samples",
                stacklevel=3,
            )
    blocks = [given.get(name, np.zeros((1, *shapes[name])))[:, np.newaxis] for name in "ABCD"]
    return _ltp.LtpSystem.from_samples(float(period), size, blocks), size


def _shapes(found: Mapping[str, tuple[int, ...]]) -> tuple[tuple[int, int, int], dict[str, tuple[int, int]]]:
    """Numbers of states, inputs and outputs, and the shape each matrix has to have."""
    for name, shape in found.items():
        if len(shape) != 2:
            raise InputError(f"{name}: found shape {shape}, expected a matrix (rows, columns)")
    nx = found["A"][0]
    nu = found["B"][1] if "B" in found else found["D"][1] if "D" in found else 0
    ny = found["C"][0] if "C" in found else found["D"][0] if "D" in found else 0
    expected = {"A": (nx, nx), "B": (nx, nu), "C": (ny, nx), "D": (ny, nu)}
    for name, shape in found.items():
        if shape != expected[name]:
            raise InputError(
                f"{name}: found shape {shape}, expected {expected[name]} for {nx} states, {nu} inputs and {ny} outputs"
            )
    return (nx, nu, ny), expected


def _real(name: str, values: npt.ArrayLike) -> Array:
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name}: not an array of real numbers ({error}); convert it") from None


def _value(coefficients: Complex, period: float, t: float) -> Array:
    turn = np.exp(2j * np.pi * float(t) / period * np.arange(len(coefficients)))
    turn[1:] *= 2.0
    return cast(Array, (turn @ coefficients).real)


def _warn(messages: list[str]) -> None:
    for message in messages:
        warnings.warn(message, stacklevel=3)
