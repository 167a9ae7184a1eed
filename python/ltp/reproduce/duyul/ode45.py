"""Owns an emulation of MATLAB's ode45 at its default tolerances, which the thesis' references come from.

The pair of J. R. Dormand and P. J. Prince (J. Comput. Appl. Math. 6 (1980) 19-26) with the step control documented
for the MATLAB ODE suite (L. F. Shampine, M. W. Reichelt, SIAM J. Sci. Comput. 18 (1997) 1-22): RelTol 1e-3, AbsTol
1e-6, each step cut into four by the continuous extension. Loose on purpose; `ltp.simulate` is what to use for anything
else.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

RELATIVE, ABSOLUTE, REFINE = 1e-3, 1e-6, 4

_TIMES = np.array([0.0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0])
_STAGES = (
    np.array([]),
    np.array([1 / 5]),
    np.array([3 / 40, 9 / 40]),
    np.array([44 / 45, -56 / 15, 32 / 9]),
    np.array([19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729]),
    np.array([9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656]),
)
_WEIGHTS = np.array([35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84])
_ERROR = np.array([71 / 57600, 0.0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40])
# of the continuous extension: weight of stage i is the sum over j of entry (i, j) s^(j + 1)
_DENSE = np.array(
    [
        [1.0, -183 / 64, 37 / 12, -145 / 128],
        [0.0, 0.0, 0.0, 0.0],
        [0.0, 1500 / 371, -1000 / 159, 1000 / 371],
        [0.0, -125 / 32, 125 / 12, -375 / 64],
        [0.0, 9477 / 3392, -729 / 106, 25515 / 6784],
        [0.0, -11 / 7, 11 / 3, -55 / 28],
        [0.0, 3 / 2, -4.0, 5 / 2],
    ]
)


def ode45(rates: Callable[[float, Array], Array], start: Array, end: float) -> tuple[Array, Array]:
    """Times (n,) and states (n, nx) from time zero to `end`, as ode45 returns them by default."""
    t, y = 0.0, np.asarray(start, dtype=np.float64)
    first = rates(t, y)
    threshold = ABSOLUTE / RELATIVE
    most = 0.1 * end
    rate = float(np.max(np.abs(first / np.maximum(np.abs(y), threshold)))) / (0.8 * RELATIVE**0.2)
    step = min(most, end) if rate * most <= 1.0 else 1.0 / rate
    times, states = [t], [y]
    while t < end:
        least = 16 * np.spacing(t)
        step = min(most, max(least, step))
        if 1.1 * step >= end - t:
            step = end - t
        failed = False
        while True:
            stages = [first]
            for at, row in zip(_TIMES[1:], _STAGES[1:], strict=True):
                stages.append(rates(t + at * step, y + step * (row @ np.array(stages))))
            new = y + step * (_WEIGHTS @ np.array(stages))
            stages.append(rates(t + step, new))
            scale = np.maximum(np.maximum(np.abs(y), np.abs(new)), threshold)
            error = step * float(np.max(np.abs(_ERROR @ np.array(stages)) / scale))
            if error <= RELATIVE or step <= least:
                break
            shrunk = 0.5 if failed else max(0.1, 0.8 * (RELATIVE / error) ** 0.2)
            step, failed = max(least, step * shrunk), True
        for part in range(1, REFINE):
            share = part / REFINE
            weights = _DENSE @ share ** np.arange(1, 5)
            times.append(t + share * step)
            states.append(y + step * (weights @ np.array(stages)))
        t, y, first = t + step, new, stages[-1]
        times.append(t)
        states.append(y)
        if not failed:
            grown = 1.25 * (error / RELATIVE) ** 0.2
            step = step / grown if grown > 0.2 else 5.0 * step
    return np.array(times), np.array(states)
