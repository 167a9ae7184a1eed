"""Owns the experiment on the hopper: the machine, its records, its test signals, and the errors of a prediction.

Everything here is made of the public verbs of ltp. Deviations are `y = h - h_lc`: the height less the one on the limit
cycle, both simulated. Records hold whole periods, so that multiples of the pumping frequency stand on lines.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

import ltp
from ltp import metrics, signals

Array = npt.NDArray[np.float64]
Progress = Callable[[str, float], None]

DT = 1e-3  # s, sampling of every record, as in the paper
AMPLITUDE = 0.1  # N, of chirps and test sines, as in the paper
STEP = 0.01  # N, of the test step: small enough for its own distortion not to matter
SETTLING = 100  # periods until a transient has decayed to 7e-8 of itself
EVALUATED = 100  # periods over which an error is taken
MARGIN = 1.05  # lines go past the band in which the estimate is used
PERIODS = 1272  # of a multisine: 419.8 s, as long as the paper's chirps
MOST_HARMONICS = 160  # of the exact functions: further ones are below the accuracy of the simulation
DECIMATION = 5  # errors are taken every 5 ms: 66 samples in a period

#: Frequencies (Hz) of test sines that tables quote: the resonances are 2.364 and 3.7, the pumping frequency 1/T.
QUOTED = (0.1, 0.5, 1.0, 2.0, 2.364, 2.4, 3.0, 1 / 0.33, 3.1, 3.7, 5.0, 8.0, 10.0, 15.0, 20.0)


@dataclass(frozen=True, eq=False)
class Record:
    """An experiment: input `u` (n,), N, and deviation `y` (n,), m, every millisecond over `periods` periods."""

    name: str
    u: Array
    y: Array

    def recording(self) -> ltp.Recording:
        """The record as `identify` takes it: no model, no orbit, two columns."""
        t = np.arange(len(self.u)) * DT
        return ltp.Recording(t, {"u": self.u}, {"y": self.y}, self.name)

    def plus(self, y: Array | float, u: Array | float = 0.0) -> Record:
        """The same experiment with something added to what was measured."""
        return Record(self.name, self.u + u, self.y + y)


class Rig:
    """The hopper at work. `quick` leaves out what takes long; the figures that remain are the same."""

    def __init__(self, quick: bool = False, progress: Progress | None = None) -> None:
        self.quick = quick
        self.tell: Progress = progress or (lambda message, fraction: None)
        self.model = ltp.zoo.hopper()
        self.cycle = ltp.cycle(self.model)
        self.system = ltp.linearize(self.model, self.cycle)
        self.period = self.cycle.period
        self.per_period = round(self.period / DT)
        self._sines: dict[tuple[float, float], Array] = {}
        self._estimates: dict[tuple[object, ...], ltp.Htf] = {}
        self._errors: WeakKeyDictionary[ltp.Htf, dict[tuple[float, float], float]] = WeakKeyDictionary()

    def parameter(self, name: str) -> float:
        """The value of a parameter of the hopper, in its unit."""
        return float(next(each["value"] for each in self.model.parameters if each["name"] == name))

    @cached_property
    def orbit(self) -> Array:
        """Height on the limit cycle over one period from t = 0, m."""
        return self._height(0.0, 20, 2.5e-4)[-self.per_period :]

    def deviation(self, u: Array | str, periods: int, step: float = 5e-4) -> Array:
        """Deviation (n,) of the height from the limit cycle under the input, from t = 0 on the cycle.

        u: samples (n,) or an expression of t; step: of integration, s.
        """
        return self._height(u, periods, step) - np.tile(self.orbit, periods)

    def _height(self, u: Array | str | float, periods: int, step: float) -> Array:
        n = periods * self.per_period
        if isinstance(u, np.ndarray):
            u = np.append(u, 0.0)  # the run includes its end
        run = ltp.simulate(self.model, {"u_c": u}, t_end=n * DT, dt=DT, step=step, hold="cubic", strict=True)
        return run.outputs[:n, 0]

    @cached_property
    def chirps(self) -> Record:
        """The paper's record: 21 chirps of 20 s from 0 to 5 Hz, shifted by T/21, and rest up to 1400 periods."""
        return self._chirps("paper's chirps, 0 to 5 Hz", 5.0, 20.0, 1400)

    @cached_property
    def fast_chirps(self) -> Record:
        """The paper's other record: 21 chirps of 40 s from 0 to 10 Hz."""
        return self._chirps("paper's chirps, 0 to 10 Hz", 10.0, 40.0, 2673)

    def _chirps(self, name: str, top_hz: float, duration: float, periods: int) -> Record:
        n = periods * self.per_period
        band = math.tau * top_hz
        u = signals.phase_shifted_chirps(
            self.period, band, duration, amplitude=AMPLITUDE, repetitions=21, t_end=(n - 1) * DT, dt=DT
        )
        return Record(name, u, self.deviation(u, periods))

    @cached_property
    def flat(self) -> Record:
        """The odd multisine up to 5 Hz with all amplitudes alike."""
        return self.multisine()

    def multisine(self, weights: Callable[[Array], Array] | None = None) -> Record:
        """An odd multisine of the length and rms of the paper's record, after 100 periods of settling.

        weights: relative amplitudes at angular frequencies (rad/s); all alike by default.
        """
        found = signals.multisine(
            self.period, MARGIN * math.tau * 5.0, PERIODS, rms=AMPLITUDE / math.sqrt(2), weights=weights, seed=1
        )
        u = found.samples(t_end=PERIODS * self.period - DT, dt=DT)
        settling = SETTLING * self.per_period
        y = self.deviation(np.concatenate([u[-settling:], u]), SETTLING + PERIODS)[settling:]
        return Record("odd multisine" if weights is None else "odd multisine, shaped", u, y)

    def estimate(self, record: Record, harmonics: int, *, keep: bool = True, **options: Any) -> ltp.Htf:
        """`ltp.identify` on a record with options of its own; with `keep`, the same question is answered once."""
        key = (record, harmonics, *sorted(options.items()))
        if not keep or key not in self._estimates:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", UserWarning)  # they are kept in the result
                htf = ltp.identify(record.recording(), period=self.period, harmonics=harmonics, **options)
            if not keep:
                return htf
            self._estimates[key] = htf
        return self._estimates[key]

    # --- tests of a prediction ---------------------------------------------------------------------------------------

    def times(self) -> tuple[slice, Array]:
        """The samples at which errors are taken, as a slice of a run of 200 periods, and their times, s."""
        start = SETTLING * self.per_period
        chosen = slice(start, start + EVALUATED * self.per_period, DECIMATION)
        t: Array = np.arange(start, chosen.stop, DECIMATION, dtype=np.float64) * DT
        return chosen, t

    def sine(self, hz: float, amplitude: float = AMPLITUDE) -> Array:
        """Deviation under `amplitude * sin(2 pi hz t)`, settled, at :meth:`times`."""
        key = (hz, amplitude)
        if key not in self._sines:
            step = 5e-4 if amplitude > 0.05 else 2.5e-4
            text = f"{amplitude!r}*sin({math.tau * hz!r}*t)"
            self._sines[key] = self.deviation(text, SETTLING + EVALUATED, step)[self.times()[0]]
        return self._sines[key]

    def prepare(self, frequencies: Iterable[float]) -> None:
        """Run the test sines of these frequencies (Hz), two at a time."""
        with ThreadPoolExecutor(2) as pool:
            list(pool.map(self.sine, [hz for hz in frequencies if (hz, AMPLITUDE) not in self._sines]))

    def sine_error(self, htf: ltp.Htf, hz: float, amplitude: float = AMPLITUDE) -> float:
        """Error (20) in percent of the prediction of a sine of `hz`."""
        known = self._errors.setdefault(htf, {})
        if (hz, amplitude) not in known:
            predicted = htf.steady_state(math.tau * hz, amplitude, self.times()[1], phase=-math.pi / 2)
            known[hz, amplitude] = metrics.e_rms(self.sine(hz, amplitude), predicted[:, 0])
        return known[hz, amplitude]

    def sweep(self, htf: ltp.Htf, frequencies: Sequence[float]) -> Array:
        """Errors in percent over test sines (Hz)."""
        self.prepare(frequencies)
        return np.array([self.sine_error(htf, hz) for hz in frequencies])

    @cached_property
    def step_response(self) -> Array:
        """Deviation under a step of :data:`STEP` newtons at t = 0, over 200 periods."""
        return self.deviation(repr(STEP), SETTLING + EVALUATED, 2.5e-4)

    def step_error(self, htf: ltp.Htf) -> float:
        """Error (20) in percent of the prediction of the step once it has settled."""
        chosen, t = self.times()
        return metrics.e_rms(self.step_response[chosen], htf.steady_state(0.0, STEP, t)[:, 0])

    def transient_error(self, htf: ltp.Htf) -> float:
        """Error (20) in percent over the first 100 periods of the step, transient included."""
        n = EVALUATED * self.per_period
        u = np.full(len(self.step_response), STEP)
        u[0] /= 2.0  # the value of a jump, half way up
        return metrics.e_rms(self.step_response[:n], predicted(htf, u)[:n])

    # --- references ---------------------------------------------------------------------------------------------------

    @cached_property
    def exact(self) -> ltp.Htf:
        """The exact functions up to harmonic 160, on a grid that resolves the resonances and holds every test sine."""
        hz = np.unique(
            np.round([*np.arange(0.0, 6.0, 0.01), *np.arange(6.0, 21.0, 0.02), *QUOTED, *self.frequencies], 9)
        )
        return self.system.htf(math.tau * hz, MOST_HARMONICS)

    def exact_with(self, harmonics: int) -> ltp.Htf:
        """The exact functions cut off at a harmonic: the floor of every estimate that has as many."""
        exact, drop = self.exact, MOST_HARMONICS - harmonics
        return ltp.Htf(exact.values[drop:-drop], exact.omega, exact.period, method="exact, cut off")

    @cached_property
    def frequencies(self) -> list[float]:
        """Frequencies (Hz) of the test sines of a sweep."""
        if self.quick:
            return list(QUOTED)
        fine = [*np.arange(0.1, 5.05, 0.1), *np.arange(5.5, 20.1, 0.5)]
        return sorted({round(float(hz), 9) for hz in fine} | set(QUOTED))

    def function_error(self, htf: ltp.Htf, top_hz: float = 5.0) -> float:
        """Relative error of the functions themselves, all harmonics together, over (0, top] Hz."""
        inside = (self.exact.omega > 0) & (self.exact.omega <= math.tau * top_hz)
        omega = self.exact.omega[inside]
        most = len(htf.values) // 2
        truth = self.exact_with(most).values[:, inside, 0, 0]
        found = np.array([htf.at(k, omega) for k in htf.harmonics])
        return float(np.linalg.norm(found - truth) / np.linalg.norm(truth))


def predicted(htf: ltp.Htf, u: Array) -> Array:
    """The response (n,) to an input (n,) as the functions predict it; what lies beyond their band is left out."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        return htf.predict(u, DT)[:, 0]
