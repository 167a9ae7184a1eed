"""Owns what the thesis prints: references, tables of eigenvalues, gains, and the equation that gives the input.

A. D. Duyul, "Control of an underactuated system around a periodic orbit", M.Sc. thesis, Middle East Technical
University, 2018. Angles count from the downward vertical, in rad; amplitudes are those of sines.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]

SPRING = 0.74  # K_s of the inverted pendulum, N m/rad
DOWN = 2 * math.pi  # fundamental frequency of the hanging pendulum's orbit, rad/s
UP = 10 * math.pi  # and of the inverted one's
#: x of (4.5) prints as 0.0375; this number within the rounding of it gives Tables 4.2 to 4.5 to their last digit.
X_UP = 0.03752


@dataclass(frozen=True)
class Sine:
    """`offset + amplitude sin(omega t + phase)`."""

    amplitude: float
    omega: float
    phase: float = 0.0
    offset: float = 0.0

    @property
    def phasor(self) -> complex:
        """Amplitude and phase as one complex number."""
        return self.amplitude * complex(math.cos(self.phase), math.sin(self.phase))

    def at(self, t: Array, order: int = 0) -> Array:
        """Values, or those of a derivative."""
        turned = self.omega * t + self.phase + 0.5 * math.pi * order
        return self.amplitude * self.omega**order * np.sin(turned) + (self.offset if order == 0 else 0.0)

    @staticmethod
    def fitted(t: Array, values: Array, omega: float) -> Sine:
        """The sine of frequency `omega` nearest to samples, phase within a half turn of zero and amplitude positive."""
        columns = np.stack([np.sin(omega * t), np.cos(omega * t), np.ones_like(t)], axis=1)
        (sine, cosine, offset), *_ = np.linalg.lstsq(columns, values, rcond=None)
        return Sine(math.hypot(sine, cosine), omega, math.atan2(cosine, sine), float(offset))

    def flipped(self) -> Sine:
        """The same sine with a negative amplitude, as the thesis prints those of the hanging pendulum."""
        phase = self.phase - math.pi if self.phase > 0 else self.phase + math.pi
        return Sine(-self.amplitude, self.omega, phase, self.offset)


#: Printed references by equation: what is prescribed, and what the thesis found from it.
PRESCRIBED: Mapping[str, Sine] = MappingProxyType(
    {
        "4.1": Sine(0.05, DOWN),
        "4.2": Sine(0.06, 1.6 * math.pi),
        "4.3": Sine(0.07, DOWN),
        "4.5": Sine(0.1, UP, 0.0, math.pi),
    }
)
PRINTED_THETA: Mapping[str, Sine] = MappingProxyType(
    {
        "4.1": Sine(-0.2472, DOWN, 0.6809),
        "4.2": Sine(-0.3706, 1.6 * math.pi, 1.449),
        "4.3": Sine(-0.3387, DOWN, 0.6691),
    }
)
PRINTED_X_UP = Sine(0.0375, UP, -0.0769)
PRINTED_V = Sine(2.2894, DOWN, 2.2095)  # (3.9)
PRINTED_V_UP = Sine(14.0857, UP, 2.6703)  # (4.5)

#: Gains [x theta xd thetad] by the figure or table that shows them.
GAINS: Mapping[str, tuple[float, float, float, float]] = MappingProxyType(
    {
        "fig 4.3": (69.69, -2.01, 19.62, 6.54),
        "fig 4.7": (75.34, 2.01, 19.61, 6.89),
        "fig 4.10": (70.29, -1.86, 19.78, 6.6),
        "fig 4.13": (81.75, 6.71, 19.99, 7.11),
        "fig 4.17": (70.24, -1.93, 19.79, 6.6),
        "fig 4.23": (872.59, -8.88, 13.6, 1.2),
        "fig 4.27": (1000.5, 3.9, 5.4, -0.7),
        "table 4.3": (397.1490, 216.1851, 47.4926, -17.5772),
        "table 4.4": (4.3564, 4.9899, -8.8605, 4.8718),
        "fig 4.33": (1093.2, 4.3, 75.6, 2.5),
    }
)


def _table(text: str) -> Complex:
    return np.array([complex(cell.replace(" ", "").replace("i", "j")) for cell in text.split(",")])


#: Printed eigenvalues of the lift with 20 states, and the half of the last digit they are printed to.
TABLES: Mapping[str, tuple[Complex, float]] = MappingProxyType(
    {
        "4.1": (
            _table(
                "0+12.5664i, -1.1370+7.8612i, -1.1375+17.2709i, -19.3625+12.5658i,"
                "0+6.2832i, -1.1370+1.5780i, -1.1375+10.9877i, -19.3625+6.2826i,"
                "0+0i, -1.1373-4.7049i, -1.1373+4.7049i, -19.3624+0i,"
                "0-6.2832i, -1.1370-1.5780i, -1.1375-10.9877i, -19.3625-6.2826i,"
                "0-12.5664i, -1.1370-7.8612i, -1.1375-17.2709i, -19.3625-12.5658i"
            ),
            5e-5,
        ),
        "4.2": (
            _table(
                "0+62.8319i, -0.2282+62.8312i, -1.7123+62.8325i, -19.8331+62.8318i,"
                "0+31.4159i, -0.2282+31.4152i, -1.7123+31.4165i, -19.8331+31.4159i,"
                "0+0i, -0.2295+0i, -1.7110+0i, -19.8332+0i,"
                "0-31.4159i, -0.2282-31.4152i, -1.7123-31.4165i, -19.8331-31.4159i,"
                "0-62.8319i, -0.2282-62.8312i, -1.7123-62.8325i, -19.8331-62.8318i"
            ),
            5e-5,
        ),
        "4.3": (
            _table(
                "-0.39+62.75i, -0.39+62.91i, -15.56+11.63i, -15.56+114.04i,"
                "-0.39+31.33i, -0.39+31.50i, -15.56-19.79i, -15.56+82.62i,"
                "-0.39-0.11i, -0.39+0.11i, -15.56-51.21i, -15.56+51.21i,"
                "-0.39-31.50i, -0.39-31.33i, -15.56-82.62i, -15.56+19.79i,"
                "-0.39-62.91i, -0.39-62.75i, -15.56-114.04i, -15.56-11.63i"
            ),
            5e-3,
        ),
        "4.4": (
            _table(
                "-0.4039+62.8254i, -0.4056+62.3460i, -0.4041+63.3240i, -29.6538+62.8319i,"
                "-0.4039+31.4094i, -0.4056+30.9301i, -0.4041+31.9081i, -29.6538+31.4160i,"
                "-0.4058+0i, -0.4039-0.4888i, -0.4039+0.4888i, -29.6538+0i,"
                "-0.4039-31.4094i, -0.4041-31.9081i, -0.4056-30.9301i, -29.6538-31.4160i,"
                "-0.4039-62.8254i, -0.4041-63.3240i, -0.4056-62.3460i, -29.6538-62.8319i"
            ),
            5e-5,
        ),
        "4.5": (
            _table(
                "-0.23+62.83i, -1.76+62.83i, -12.94+62.83i, -233.14+62.83i,"
                "-0.23+31.42i, -1.76+31.42i, -12.94+31.42i, -233.14+31.42i,"
                "-0.23+0i, -1.76+0i, -12.94+0i, -233.14+0i,"
                "-0.23-31.42i, -1.76-31.42i, -12.94-31.42i, -233.14-31.42i,"
                "-0.23-62.83i, -1.76-62.83i, -12.94-62.83i, -233.14-62.83i"
            ),
            5e-3,
        ),
    }
)


@dataclass(frozen=True)
class Constants:
    """Table 3.1 with (3.3) and (3.4): what the equations below need."""

    spring: float
    mass: float = 0.57 + 0.21  # M_c + M_p
    coupling: float = 0.21 * 0.3  # M_p l_p
    inertia: float = 0.21 * 0.3**2 * 4 / 3  # I_p + M_p l_p^2
    weight: float = 0.21 * 9.8 * 0.3  # M_p g l_p
    friction: float = 0.05  # B_p
    per_volt: float = 3.71 * 0.00767 / (2.6 * 0.00635)  # N/V
    damping: float = 4.3 + 3.71**2 * 0.00767**2 / (2.6 * 0.00635**2)  # B_eq and the motor's, N s/m

    def pendulum(self, t: float, z: Array, cart: Sine) -> Array:
        """Rates of [theta, thetad] under a prescribed cart, from (3.2)."""
        theta, rate = z
        push = self.coupling * math.cos(theta) * float(cart.at(np.array(t), 2))
        torque = -self.friction * rate - self.spring * (theta - math.pi) - self.weight * math.sin(theta) - push
        return np.array([rate, torque / self.inertia])

    def cart(self, t: float, z: Array, pendulum: Sine) -> Array:
        """Rates of [x, xd] under a prescribed pendulum, from (3.2)."""
        theta, rate, pull = (float(pendulum.at(np.array(t), order)) for order in range(3))
        torque = self.inertia * pull + self.friction * rate + self.spring * (theta - math.pi)
        return np.array([z[1], -(torque + self.weight * math.sin(theta)) / (self.coupling * math.cos(theta))])

    def voltage(self, t: Array, cart: Sine, pendulum: Sine) -> Array:
        """The input that (3.1) with (3.4) asks for along a reference, whether or not that reference obeys (3.2)."""
        theta, rate, pull = (pendulum.at(t, order) for order in range(3))
        force = self.mass * cart.at(t, 2) + self.coupling * (np.cos(theta) * pull - np.sin(theta) * rate**2)
        return (force + self.damping * cart.at(t, 1)) / self.per_volt

    def unbalanced(self, t: Array, cart: Sine, pendulum: Sine) -> float:
        """The torque that (3.2) leaves along a reference, rms, relative to that of the pendulum's inertia."""
        theta, rate, pull = (pendulum.at(t, order) for order in range(3))
        torque = self.coupling * np.cos(theta) * cart.at(t, 2) + self.inertia * pull + self.weight * np.sin(theta)
        left = torque + self.friction * rate + self.spring * (theta - math.pi)
        return float(np.sqrt(np.mean(left**2) / np.mean((self.inertia * pull) ** 2)))
