"""Owns `ltp.linearize` and the noun `LtpSystem` in Python: a model around its orbit, linear, periodic, with jumps."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from ltp import _ltp
from ltp._ltp import InputError
from ltp.cycle import LimitCycle
from ltp.feedback import Gain, gain_coefficients
from ltp.feedforward import Reference
from ltp.htf import Htf
from ltp.model import Model
from ltp.periodic import (
    Floquet,
    LiftedMode,
    Matrix,
    Transverse,
    core_from_functions,
    core_from_samples,
    tangent_coefficients,
)

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Jump:
    """What an event does to a deviation: `x+ = state x- + input u`, at `time` (s) in the period.

    `state` (nx, nx) is the saltation matrix, `input` (nx, nu) what the input does by moving the event.
    """

    name: str
    time: float
    state: Array
    input: Array


@dataclass(frozen=True, eq=False)
class LtpSystem:
    """A linear time-periodic system with jumps: `x' = A(t) x + B(t) u`, `y = C(t) x + D(t) u`, jumps at events.

    Deviations from the orbit; `period` in s, time zero is that of the clock; `multipliers` (nx,) and `monodromy`
    (nx, nx) are those of one period from time zero, jumps included. Names are those of the model.
    """

    period: float
    jumps: list[Jump]
    multipliers: npt.NDArray[np.complex128]
    monodromy: Array
    state_names: list[str]
    input_names: list[str]
    output_names: list[str]
    _core: _ltp.LtpSystem = field(repr=False)

    def A(self, t: float) -> Array:
        """Dynamics (nx, nx) at time `t`, s; at a jump, those just after."""
        return self._core.matrix("A", float(t))

    def B(self, t: float) -> Array:
        """Input matrix (nx, nu) at time `t`, s."""
        return self._core.matrix("B", float(t))

    def C(self, t: float) -> Array:
        """Output matrix (ny, nx) at time `t`, s."""
        return self._core.matrix("C", float(t))

    def D(self, t: float) -> Array:
        """Feedthrough (ny, nu) at time `t`, s."""
        return self._core.matrix("D", float(t))

    def htf(self, omega: npt.ArrayLike, harmonics: int) -> Htf:
        """Exact harmonic transfer functions at input frequencies `omega` (rad/s, from zero up), harmonics -K to K.

        From the periodic steady state: nothing of the state is truncated, however many harmonics are asked for. Raises
        `InputError` at a frequency where a multiplier of modulus one resonates, since no response exists there.
        """
        _check_harmonics("htf", harmonics)
        return Htf.wrap(self._core.htf(_vector("omega", omega), harmonics))

    def simulate(self, u: npt.ArrayLike, dt: float, *, t0: float = 0.0) -> Array:
        """Outputs (n, ny) under inputs `u`, (n,) or (n, nu), every `dt` seconds from the clock's time `t0`, from rest.

        Inputs run straight between samples; a sample at the instant of a jump sees the state after it. Raises
        `InputError` for inputs that are not finite or have another number of columns.
        """
        samples = _vector("u", u)
        columns = samples[:, np.newaxis] if samples.ndim == 1 else samples
        return self._core.simulate(columns, float(t0), float(dt))

    def lift(self, truncation: int) -> npt.NDArray[np.complex128]:
        """The matrix `A - N` of the harmonic state space, blocks -truncation to truncation, of order (2N+1) nx.

        Warns when it is too small for the harmonics of the matrices, saying which suffices. Raises `InputError` for a
        system with jumps, which has no Fourier series that converges.
        """
        _check_harmonics("lift", truncation)
        matrix = self._core.lift(truncation)
        try:
            self._core.check_truncation(truncation)
        except InputError as doubt:
            warnings.warn(f"lift: {doubt}", stacklevel=2)
        return matrix

    def lifted_htf(self, omega: npt.ArrayLike, harmonics: int, truncation: int) -> Htf:
        """As `htf`, by the harmonic state space truncated at `truncation`: a second route, for smooth systems."""
        _check_harmonics("lifted_htf", harmonics)
        return Htf.wrap(self._core.lifted_htf(_vector("omega", omega), harmonics, truncation))

    @classmethod
    def from_functions(
        cls, period: float, A: Matrix, B: Matrix | None = None, C: Matrix | None = None, D: Matrix | None = None
    ) -> LtpSystem:
        """A smooth system of `period` (s) from functions of time that give its matrices, or constants.

        `A(t)` (nx, nx), `B(t)` (nx, nu), `C(t)` (ny, nx), `D(t)` (ny, nu); what is left out is zero, without inputs or
        outputs. Raises `InputError` for functions that are not periodic, not smooth or not finite, and for shapes that
        do not fit each other.
        """
        core, size = core_from_functions(period, {"A": A, "B": B, "C": C, "D": D})
        return cls._named(core, *_numbered(size))

    @classmethod
    def from_samples(
        cls,
        period: float,
        A: npt.ArrayLike,
        B: npt.ArrayLike | None = None,
        C: npt.ArrayLike | None = None,
        D: npt.ArrayLike | None = None,
    ) -> LtpSystem:
        """A smooth system from even samples of its matrices over one `period` (s), (n, rows, columns), or constants.

        The first sample stands at time zero. Warns when the samples are too few for what they show; raises `InputError`
        as `from_functions` does.
        """
        core, size = core_from_samples(period, {"A": A, "B": B, "C": C, "D": D})
        return cls._named(core, *_numbered(size))

    @classmethod
    def _named(
        cls, core: _ltp.LtpSystem, states: Sequence[str], inputs: Sequence[str], outputs: Sequence[str]
    ) -> LtpSystem:
        return cls(
            period=core.period,
            jumps=[Jump(*jump) for jump in core.jumps],
            multipliers=core.multipliers,
            monodromy=core.monodromy,
            state_names=list(states),
            input_names=list(inputs),
            output_names=list(outputs),
            _core=core,
        )

    @property
    def exponents(self) -> npt.NDArray[np.complex128]:
        """Floquet exponents (nx,), 1/s, largest real part first; accurate also for modes that a period extinguishes."""
        return self._core.exponents()

    def floquet(self) -> Floquet:
        """The Floquet decomposition `x = P(t) z`, `z' = A_bar z`, of a smooth system."""
        return Floquet.wrap(self._core.floquet())

    def lifted_modes(self, truncation: int) -> list[LiftedMode]:
        """Every eigenvalue of the truncated lift, largest real part first: copy of an exponent or artefact of the edge.

        Raises `InputError` for a truncation that leaves out harmonics of the matrices, saying which suffices.
        """
        _check_harmonics("lifted_modes", truncation)
        found = self._core.lifted_modes(truncation)
        return [LiftedMode(complex(re, im), i, n, far, edge, yes) for re, im, i, n, far, edge, yes in found]

    def pumping_divisor(self) -> int:
        """How many times the matrices repeat within the period, to 1e-10: the true period is T divided by it."""
        return self._core.pumping_divisor()

    def shortened(self) -> LtpSystem:
        """The same system over its true period."""
        return self._named(self._core.shortened(), self.state_names, self.input_names, self.output_names)

    def bandwidth(self, share: float = 1e-3) -> int:
        """The highest harmonic of A and B above `share` of the largest of its entry; a lift of N holds up to 2N."""
        return self._core.bandwidth(float(share))

    def closed(self, gain: Gain) -> LtpSystem:
        """The system under `u = -K(t) x + v`: an array (nu, nx), or a gain with `period` and `harmonics`."""
        period, lines = gain_coefficients("LtpSystem.closed", gain, self.input_names, self.state_names)
        core = self._core.closed(period or self.period, lines[:, np.newaxis])
        return self._named(core, self.state_names, self.input_names, self.output_names)

    def transverse(self, tangent: npt.ArrayLike | None = None) -> Transverse:
        """The system across its orbit, without the phase: nx - 1 states in a periodic orthonormal frame.

        tangent: the derivative of the orbit, (n, nx) even samples over one period from time zero. Without one, it is
        the mode of the multiplier one, which an orbit without a clock has; `InputError` when there is none.
        """
        nx = len(self.state_names)
        core = self._core.transverse(None if tangent is None else tangent_coefficients(tangent, nx))
        states = [f"xi{i + 1}" for i in range(nx - 1)]
        for message in core.warnings:
            warnings.warn(message, stacklevel=2)
        system = self._named(core.system, states, self.input_names, self.output_names)
        return Transverse(system, self.period, core.defect, core.warnings, core)

    def __repr__(self) -> str:
        return (
            f"<ltp.LtpSystem period {self.period:g} s, {len(self.jumps)} jumps; states: {', '.join(self.state_names)}; "
            f"inputs: {', '.join(self.input_names)}; outputs: {', '.join(self.output_names)}>"
        )


def linearize(
    model: Model,
    cycle: LimitCycle | Reference,
    *,
    inputs: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
) -> LtpSystem:
    """The linear time-periodic system of `model` around `cycle`, through its events; or along a `Reference`.

    A reference need not be an orbit: what it lacks is a forcing, which the matrices do not see.

    inputs, outputs: names of those to keep, in this order; all by default.

    Raises `InputError` for a name that is not there or an orbit of another model, `ConvergenceError` where the orbit is
    not resolved.
    """
    if isinstance(cycle, Reference):
        core = _ltp.linearize_along(model._core, cycle._core)
    else:
        core = _ltp.linearize(model._core, cycle._core)
    chosen_inputs = _chosen("input", inputs, model.inputs, model)
    chosen_outputs = _chosen("output", outputs, model.outputs, model)
    if inputs is not None or outputs is not None:
        core = core.select(
            [model.inputs.index(name) for name in chosen_inputs],
            [model.outputs.index(name) for name in chosen_outputs],
        )
    return LtpSystem._named(core, model.states, chosen_inputs, chosen_outputs)


def _chosen(kind: str, wanted: Sequence[str] | None, known: Sequence[str], model: Model) -> list[str]:
    if wanted is None:
        return list(known)
    for name in wanted:
        if name not in known:
            raise InputError(f"linearize: {model.name!r} has no {kind} {name!r}; it has {', '.join(known) or 'none'}")
    return list(wanted)


def _numbered(size: tuple[int, int, int]) -> list[list[str]]:
    return [[f"{letter}{i + 1}" for i in range(count)] for letter, count in zip("xuy", size, strict=True)]


def _check_harmonics(verb: str, harmonics: int) -> None:
    if harmonics < 0:
        raise InputError(f"{verb}: harmonics is {harmonics}, expected the largest harmonic, from 0 on; correct it")


def _vector(name: str, values: npt.ArrayLike) -> Array:
    try:
        return np.atleast_1d(np.asarray(values, dtype=np.float64))
    except (TypeError, ValueError) as error:
        raise InputError(f"{name}: not an array of real numbers ({error}); convert it") from None
