"""Owns `ltp.metrics`: how far a prediction is from what was measured. Gaps, NaN on either side, do not count."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ltp import _ltp
from ltp._ltp import InputError

Array = npt.NDArray[np.float64]


def e_rms(measured: npt.ArrayLike, predicted: npt.ArrayLike) -> float:
    """`100 rms(measured - predicted) / rms(measured)` in percent, both (n,): equation (20) of Uyanik et al. 2015.

    0 is perfect, 100 no better than zero. Its value for a step or after a transient depends on the window: say which.
    Raises `InputError` when the lengths differ.
    """
    return _ltp.e_rms(*_pair(measured, predicted))


def rms_error(measured: npt.ArrayLike, predicted: npt.ArrayLike) -> float:
    """Root mean square of `measured - predicted`, both (n,), in the unit of the output."""
    return _ltp.rms_error(*_pair(measured, predicted))


def relative_rms(measured: npt.ArrayLike, predicted: npt.ArrayLike) -> float:
    """`rms(measured - predicted) / std(measured)`, both (n,): 0 is perfect, 1 no better than the mean."""
    return _ltp.relative_rms(*_pair(measured, predicted))


def _pair(measured: npt.ArrayLike, predicted: npt.ArrayLike) -> tuple[Array, Array]:
    return _vector("measured", measured), _vector("predicted", predicted)


def _vector(name: str, values: npt.ArrayLike) -> Array:
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"metrics: {name} is not an array of real numbers ({error}); convert it") from None
