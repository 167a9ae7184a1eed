"""Owns the cart-pendulum at work: its two models, the references of the thesis, the true orbits, and what settles how.

Everything here is made of the public verbs of ltp; what the thesis prints is in `thesis`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import cache, cached_property

import numpy as np
import numpy.typing as npt

import ltp
from ltp.reproduce.duyul.ode45 import ode45
from ltp.reproduce.duyul.thesis import GAINS, PRESCRIBED, PRINTED_THETA, SPRING, UP, X_UP, Constants, Sine

Array = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]
Progress = Callable[[str, float], None]

TRUNCATION = 2  # of every lift in the thesis: 20 states
HARMONICS = 15  # of true orbits: beyond them nothing is left
WIDE = 0.105  # rad, amplitude of an inverted orbit that is unstable in earnest
DEVIATION = {"down": (0.02, 0.2, 0.0, 0.0), "up": (0.01, 0.05, 0.0, 0.0)}  # from the reference, as in the thesis
#: How far robustness is asked for: shares of the pendulum's length and of its damping.
SPREAD: Mapping[str, float] = {"l_p": 0.01, "B_p": 0.2}


class Rig:
    """The cart-pendulum with the references of the thesis. `quick` leaves out what takes long."""

    def __init__(self, quick: bool = False, progress: Progress | None = None) -> None:
        self.quick = quick
        self.tell: Progress = progress or (lambda message, fraction: None)
        self.hanging = ltp.zoo.cart_pendulum()
        self.inverted = self.hanging.with_parameters(K_s=SPRING)

    def model(self, equation: str) -> ltp.Model:
        """The model an equation's reference belongs to: inverted for (4.5), else hanging."""
        return self.inverted if equation == "4.5" else self.hanging

    def constants(self, equation: str) -> Constants:
        """Numbers of the equations of motion for this reference."""
        return Constants(SPRING if equation == "4.5" else 0.0)

    def printed(self, equation: str) -> tuple[Sine, Sine]:
        """Cart and pendulum as the thesis prints them; the cart of (4.5) within the rounding of its amplitude."""
        if equation == "4.5":
            return Sine(X_UP, UP, -0.0769), PRESCRIBED[equation]
        return PRESCRIBED[equation], PRINTED_THETA[equation]

    def voltage(self, cart: Sine, pendulum: Sine, equation: str) -> Sine:
        """The input of (3.1) along a reference, as the nearest sine."""
        t = np.arange(256) / 256 * (math.tau / cart.omega)
        return Sine.fitted(t, self.constants(equation).voltage(t, cart, pendulum), cart.omega)

    @cache  # noqa: B019  one rig lives as long as one reproduction
    def reference(self, equation: str) -> ltp.Reference:
        """The printed reference with the input that (3.1) asks for: what the thesis' tables were made with."""
        return self.along(equation, dict(zip(("x", "theta"), self.printed(equation), strict=True)))

    def along(self, equation: str, sines: Mapping[str, Sine]) -> ltp.Reference:
        """A reference of sines, whether or not it is an orbit; V from (3.1) if not given."""
        values = {name: (sine.amplitude, sine.phase, sine.offset) for name, sine in sines.items()}
        inputs = {"V": values.pop("V")} if "V" in values else None
        return ltp.Reference.sinusoids(self.model(equation), PRESCRIBED[equation].omega, values, inputs=inputs)

    @cache  # noqa: B019
    def orbit(self, equation: str, amplitude: float | None = None) -> ltp.Reference:
        """The true periodic orbit for the coordinate that an equation prescribes, at its amplitude or another one."""
        sine = PRESCRIBED[equation]
        return ltp.feedforward(
            self.model(equation),
            "theta" if equation == "4.5" else "x",
            amplitude=sine.amplitude if amplitude is None else amplitude,
            omega=sine.omega,
            offset=sine.offset,
            harmonics=HARMONICS,
        )

    @cache  # noqa: B019
    def system(self, equation: str, true: bool = False, amplitude: float | None = None) -> ltp.LtpSystem:
        """The model linearized along the printed reference, or along the true orbit."""
        along = self.orbit(equation, amplitude) if true else self.reference(equation)
        return ltp.linearize(self.model(equation), along)

    @cache  # noqa: B019
    def certificate(self, equation: str, words: str) -> ltp.Certificate:
        """What every witness says of a printed gain around the printed reference."""
        return ltp.certify(
            self.model(equation),
            self.reference(equation),
            gain(words),
            deviations=[self.starts["up" if equation == "4.5" else "down"]],
            truncation=TRUNCATION,
        )

    @cached_property
    def starts(self) -> dict[str, dict[str, float]]:
        """Deviations from the reference that the thesis starts from, by state."""
        names = self.hanging.states
        return {name: dict(zip(names, values, strict=True)) for name, values in DEVIATION.items()}

    def emulated(self, equation: str, end: float = 50.0) -> tuple[Array, Array]:
        """Time and the coordinate that is not prescribed, from rest, as ode45 gives it at its default tolerances."""
        constants, sine = self.constants(equation), PRESCRIBED[equation]
        solve: Callable[[float, Array, Sine], Array] = constants.cart if equation == "4.5" else constants.pendulum
        t, z = ode45(lambda t, z: solve(t, z, sine), np.zeros(2), end)
        return t, z[:, 0]


def gain(name: str) -> Array:
    """A printed gain (1, 4) by the figure or table that shows it."""
    return np.array([GAINS[name]])


def spectrum(matrix: Array | Complex) -> Complex:
    """Eigenvalues of a matrix."""
    return np.asarray(np.linalg.eigvals(matrix), dtype=np.complex128)


def matched(printed: Complex, ours: Complex) -> Complex:
    """Our eigenvalues in the order of the printed ones, each taken once, the nearest pairs first."""
    apart = np.abs(printed[:, np.newaxis] - ours[np.newaxis, :])
    out = np.empty_like(ours)
    for _ in printed:
        row, column = np.unravel_index(np.argmin(apart), apart.shape)
        out[row] = ours[column]
        apart[row, :], apart[:, column] = np.inf, np.inf
    return out


def apart(printed: Complex, ours: Complex) -> float:
    """The largest difference of a real or imaginary part."""
    difference = matched(printed, ours) - printed
    return float(max(np.abs(difference.real).max(), np.abs(difference.imag).max()))
