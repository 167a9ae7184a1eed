"""Owns `ltp.signals`: inputs for experiments on periodic systems, noise for their records, and the design of both.

Samples are those `ltp.simulate` takes: one every `dt` seconds from t = 0 to `t_end`, both included. Frequencies are
angular, in rad/s; a band is its upper end, or a pair. The same seed gives the same bits.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from ltp import _ltp
from ltp._ltp import InputError
from ltp.cycle import cycle
from ltp.htf import Htf
from ltp.linearize import linearize
from ltp.model import Model

Array = npt.NDArray[np.float64]
#: Upper end of a band that begins at zero, or both ends, rad/s.
Band = float | tuple[float, float]
#: A quantity at each line: samples (n_lines,), or a function of the angular frequencies (n_lines,).
AtLines = npt.ArrayLike | Callable[[Array], npt.ArrayLike]

#: Turns of clipping that lower the crest factor; more gain little.
_CREST_TURNS = 200


def chirp(
    band: Band, duration: float, *, amplitude: float = 1.0, t_end: float | None = None, dt: float = 1e-3
) -> Array:
    """A sine that sweeps linearly through `band` (rad/s) in `duration` (s), and zero from there to `t_end`."""
    return _ltp.chirp(amplitude, _band(band), duration, t_end, dt)


def phase_shifted_chirps(
    period: float,
    band: Band,
    duration: float,
    *,
    amplitude: float = 1.0,
    repetitions: int = 21,
    timing: str = "published",
    t_end: float | None = None,
    dt: float = 1e-3,
) -> Array:
    """One chirp after the other, each at another phase of the clock of `period` (s); zero from the last to `t_end`.

    timing: "published" (Uyanik et al. 2015, equations (18) and (19)): slots of `duration`, in which chirp `i` from 0
        begins `i period / repetitions` early, so that its beginning is cut off and it sweeps on past the band. "even":
        slots of whole periods in which it begins `i period / repetitions` late; phases are even and no chirp is cut.

    The record of the paper is `phase_shifted_chirps(0.33, 2 * pi * 5, 20.0, amplitude=0.1, t_end=462.0)`.
    """
    return _ltp.phase_shifted_chirps(amplitude, _band(band), duration, period, repetitions, timing, t_end, dt)


def sine(omega: float, *, amplitude: float = 1.0, phase: float = 0.0, t_end: float, dt: float = 1e-3) -> Array:
    """`amplitude sin(omega t + phase)`."""
    return _ltp.sine(amplitude, omega, phase, t_end, dt)


def step(*, amplitude: float = 1.0, start: float = 0.0, end: float = np.inf, t_end: float, dt: float = 1e-3) -> Array:
    """`amplitude` for `start <= t < end` (s), zero before and after."""
    return _ltp.step(amplitude, start, end, t_end, dt)


def noise(n: int, sd: float, *, seed: int = 0) -> Array:
    """White Gaussian noise (n,) of standard deviation `sd`."""
    return _ltp.noise(n, sd, seed)


def add_noise(x: npt.ArrayLike, snr: float, *, seed: int = 0) -> tuple[Array, float]:
    """`x` (n,) with white Gaussian noise of `sd = rms(x) / sqrt(snr)`, and that `sd`; gaps (NaN) stay gaps.

    The ratio counts noise up to half the sampling frequency fs: in a band B (Hz) it is about `fs / (2 B)` times better.
    Uyanik et al. 2015, equations (21) and (22). Raises `InputError` for a ratio that is not positive or a zero `x`.
    """
    return _ltp.add_noise(_array("x", x), snr, seed)


@dataclass(frozen=True, eq=False)
class Multisine:
    """`u(t) = sum amplitudes cos(omega t + phases)`, repeating after `period` (s).

    `lines` (n,) are whole numbers, line `b` at `omega = 2 pi b / period` rad/s; `amplitudes` in the unit of the input,
    `phases` in rad. Raises `InputError` when lengths differ or lines do not increase from 1.
    """

    period: float
    lines: npt.NDArray[np.int64]
    amplitudes: Array
    phases: Array
    _core: _ltp.Multisine = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Check and freeze what was given."""
        lines = [int(line) for line in self.lines]
        core = _ltp.Multisine(self.period, lines, _array("amplitudes", self.amplitudes), _array("phases", self.phases))
        self._keep(core)

    @classmethod
    def wrap(cls, core: _ltp.Multisine) -> Multisine:
        """The Python face of a multisine of the extension."""
        multisine = cls.__new__(cls)
        multisine._keep(core)
        return multisine

    def _keep(self, core: _ltp.Multisine) -> None:
        lines = np.array(core.lines, dtype=np.int64)
        values = {"period": core.period, "lines": lines, "amplitudes": core.amplitudes, "phases": core.phases}
        for name, value in {**values, "_core": core}.items():
            object.__setattr__(self, name, value)

    @property
    def omega(self) -> Array:
        """Angular frequencies of the lines (n,), rad/s."""
        return self._core.omega

    @property
    def rms(self) -> float:
        """Root mean square over a period."""
        return self._core.rms

    @property
    def crest(self) -> float:
        """Crest factor: largest magnitude over rms."""
        return self._core.crest

    def samples(self, *, t_end: float, dt: float = 1e-3) -> Array:
        """Values every `dt` seconds from 0 to `t_end`, both included."""
        return self._core.samples(t_end, dt)


def multisine(
    period: float,
    band: Band,
    cycles: int,
    *,
    rms: float = 1.0,
    weights: AtLines | None = None,
    lines: str = "distinct",
    half_pumping: str = "avoid",
    count: int | None = None,
    spread: str = "uniform",
    low_crest: bool = True,
    seed: int = 0,
) -> Multisine:
    """A random-phase multisine that repeats after `cycles` periods (of `period` seconds) of a system.

    weights: relative amplitudes at the lines, or a function of their frequencies (rad/s); all alike by default.
    lines: "distinct" (odd lines whose residues modulo an even `cycles` differ up to sign, so that every output line has
        one source), "odd" or "full".
    half_pumping: what to do with multiples of half the pumping frequency, "avoid", "on" (take only them) or "any".
    count: fewer lines than there could be, with a `spread` that is "uniform" or "log".
    low_crest: lower the peaks by repeated clipping; otherwise the phases are random and nothing else.

    Raises `InputError` when the band has no such line, with the spacing of the grid.
    """
    chosen = _ltp.multisine_lines(period, cycles, _band(band), lines, half_pumping, count, spread)
    omega = 2 * np.pi * np.array(chosen, dtype=np.float64) / (cycles * period)
    shape = None if weights is None else _at_lines("weights", weights, omega)
    turns = _CREST_TURNS if low_crest else 0
    return Multisine.wrap(_ltp.Multisine.random(cycles * period, chosen, shape, rms, turns, seed))


@dataclass(frozen=True, eq=False)
class Design:
    """A proposed experiment.

    Apply `samples()`; the record is what comes after `settle` seconds, `record` seconds long: `repeats` periods of the
    `multisine`, each of `cycles` periods of the system. `sd` (n_lines,) is the predicted standard deviation of every
    harmonic transfer function at `omega` (n_lines,), estimated line by line, `sd**2 = E |estimate - truth|**2`; `band`
    (n_lines,) the radius of the disc that holds it with probability 0.95. Both are for output noise of `noise_sd`, or
    per unit of it where that is None. `gain` (n_lines,) is the system's, where known. `advice` says it in sentences.
    """

    multisine: Multisine
    period: float
    cycles: int
    repeats: int
    settle: float
    record: float
    dt: float
    gain: Array | None
    noise_sd: float | None
    sd: Array
    band: Array
    advice: list[str]

    @property
    def omega(self) -> Array:
        """Angular frequencies of the lines (n_lines,), rad/s."""
        return self.multisine.omega

    @property
    def t_end(self) -> float:
        """End of the experiment, s."""
        return self.settle + self.record

    def samples(self) -> Array:
        """The input every `dt` seconds from 0 to `t_end`, both included; settling comes first."""
        return self.multisine.samples(t_end=self.t_end, dt=self.dt)

    def __str__(self) -> str:
        return "\n".join(self.advice)


def design(
    system: Any,
    band: Band,
    duration: float,
    *,
    dt: float = 1e-3,
    rms: float = 1.0,
    noise_sd: float | None = None,
    snr: float | None = None,
    gain: AtLines | None = None,
    shape: float = 0.5,
    harmonics: int = 10,
    input: str | int | None = None,
    output: str | int | None = None,
    repeats: int = 1,
    settle: int | None = None,
    lines: str = "distinct",
    half_pumping: str = "avoid",
    count: int | None = None,
    spread: str = "uniform",
    seed: int = 0,
) -> Design:
    """Propose a multisine for identifying `system` and predict the confidence bands that it will give.

    system: a model (its cycle and linearization give the gain, and the time to settle), a linearization, the harmonic
        transfer functions that a pilot gave, or only the pumping frequency in rad/s.
    band: input frequencies wanted, rad/s; the lines go 5 % further. duration: time there is, s, settling included.
    noise_sd, snr: noise on the output, as the standard deviation of a sample or as (rms output / rms noise)**2; a ratio
        wants a gain.
    gain: instead of the system's: output rms over input rms at the lines, or a function of their frequencies. shape:
        amplitudes go as `gain**-shape`: 0 is flat, 1 makes all relative errors equal.
    harmonics: how many of the system's harmonics the gain counts. input, output: which, where there are several: a name
        of the model, or a number from 0.
    repeats: periods of the multisine in the record; settle: periods of the system before it.
    lines, half_pumping, count, spread, seed: as in `multisine`.

    Raises `InputError` when the duration is too short, the band has no line or passes half the sampling frequency.
    """
    if noise_sd is not None and snr is not None:
        raise InputError("design: found noise_sd and snr, which say the same thing; give one of them")
    known = None if isinstance(system, (int, float, np.number)) else _linear(system)
    period = 2 * np.pi / float(system) if known is None else float(known.period)
    if settle is None and known is not None and hasattr(known, "multipliers"):
        settle = _ltp.settling_periods(float(np.max(np.abs(known.multipliers), initial=0.0)))
    plan = _ltp.ExperimentPlan(period, _band(band), duration, dt, repeats, settle, lines, half_pumping, count, spread)
    if gain is None and known is not None:
        gain = _gain(known, harmonics, input, output)
    gains = None if gain is None else _at_lines("gain", gain, plan.omega)
    found = plan.design(gains, rms, shape, noise_sd, snr, _CREST_TURNS, seed)
    settling, record = plan.times
    return Design(
        multisine=Multisine.wrap(found["multisine"]),
        period=period,
        cycles=plan.cycles,
        repeats=max(repeats, 1),
        settle=settling,
        record=record,
        dt=dt,
        gain=gains,
        noise_sd=found["noise_sd"],
        sd=found["sd"],
        band=found["band"],
        advice=found["advice"],
    )


def _linear(system: Any) -> Any:
    """The linear periodic system: of a model around its cycle, or as given."""
    if isinstance(system, Model):
        return linearize(system, cycle(system))
    if isinstance(system, Htf) or all(hasattr(system, name) for name in ("period", "multipliers", "htf")):
        return system
    found = type(system).__name__
    raise InputError(
        f"design: found a {found}, expected a model, a linearization, harmonic transfer functions or a pumping "
        "frequency in rad/s"
    )


def _gain(linear: Any, harmonics: int, input: str | int | None, output: str | int | None) -> Callable[[Array], Array]:
    """The output's rms over that of a sine at the input, all harmonics together."""

    def gain(omega: Array) -> Array:
        if isinstance(linear, Htf):
            # A pilot says nothing beyond its own band: there the gain at the end of the band has to do.
            known = np.clip(omega, linear.omega[0], linear.omega[-1])
            y, u = _place(linear, "output", output, linear.values), _place(linear, "input", input, linear.values)
            chosen = linear.harmonics[np.abs(linear.harmonics) <= harmonics]
            values = np.array([linear.at(k, known, y, u) for k in chosen.tolist()])
        else:
            every = np.asarray(linear.htf(omega, harmonics).values)
            values = every[:, :, _place(linear, "output", output, every), _place(linear, "input", input, every)]
        return np.asarray(np.sqrt((np.abs(values) ** 2).sum(axis=0)), dtype=np.float64)

    return gain


def _place(linear: Any, kind: str, wanted: str | int | None, values: npt.NDArray[np.complex128]) -> int:
    """The number of an input or output, which need not be named where there is one."""
    there = values.shape[2 if kind == "output" else 3]
    names = list(getattr(linear, f"{kind}_names", []))
    if isinstance(wanted, str):
        if wanted not in names:
            known = f"they are {', '.join(names)}" if names else "they have numbers, from 0"
            raise InputError(f"design: there is no {wanted!r} among the {kind}s; {known}")
        return names.index(wanted)
    if (wanted is None and there != 1) or not 0 <= (wanted or 0) < there:
        found = "none was chosen" if wanted is None else f"number {wanted} was"
        raise InputError(f"design: the system has {there} {kind}s and {found}; choose by `{kind}`")
    return wanted or 0


def _band(band: Band) -> tuple[float, float]:
    ends = _array("band", band)
    if ends.shape not in ((), (2,)):
        raise InputError(f"band: found {ends.size} numbers, expected its upper end or both ends, in rad/s")
    low, high = ends if ends.shape else (0.0, ends)
    return float(low), float(high)


def _at_lines(name: str, values: AtLines, omega: Array) -> Array:
    return _array(name, values(omega) if callable(values) else values)


def _array(name: str, values: npt.ArrayLike) -> Array:
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name}: not an array of real numbers ({error}); convert it") from None
