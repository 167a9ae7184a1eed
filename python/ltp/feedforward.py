"""Owns `ltp.feedforward` and the noun `Reference` in Python: a motion to be followed and its input."""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from ltp import _ltp
from ltp._ltp import InputError
from ltp.model import Model

Array = npt.NDArray[np.float64]
# Amplitude, then phase (rad) and offset where they are not zero: offset + amplitude sin(omega t + phase).
Sinusoid = float | tuple[float] | tuple[float, float] | tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Reference:
    """A periodic motion to be followed, with the inputs that go with it; it need not be an orbit.

    `period` in s; `defect` is, per state, the rms over one period of `z' - f(z, u)` relative to that of `z'` (absolute
    where the state rests): zero for an orbit. Names are those of the model, and so are the units.
    """

    period: float
    defect: dict[str, float]
    amplitudes: dict[str, float]
    state_names: list[str]
    input_names: list[str]
    model: Model = field(repr=False)
    _core: _ltp.Reference = field(repr=False)

    @classmethod
    def wrap(cls, model: Model, core: _ltp.Reference) -> Reference:
        """The Python face of a reference of the extension."""
        states = model.states
        return cls(
            period=core.period,
            defect=dict(zip(states, core.defect, strict=True)),
            amplitudes={name: float(a) for name, a in zip(states, core.amplitudes, strict=True)},
            state_names=states,
            input_names=model.inputs,
            model=model,
            _core=core,
        )

    @classmethod
    def sinusoids(
        cls,
        model: Model,
        omega: float,
        states: Mapping[str, Sinusoid],
        *,
        inputs: Mapping[str, Sinusoid] | None = None,
        input: str | None = None,
    ) -> Reference:
        """The motion in which each given state is a sinusoid of `omega`, rad/s: (amplitude, phase in rad, offset).

        A state that is the rate of a given one (a velocity) need not be given. Without `inputs` the input named `input`
        (by default the first) is the one that leaves the smallest force unbalanced in the model's equations, the others
        are zero; with `inputs`, all are the sinusoids given there, and zero where not.

        Raises `InputError` for a name that is not there, or a state that is neither given nor a rate of one.
        """
        given = [(name, *_sinusoid(name, value)) for name, value in states.items()]
        core = _ltp.Reference.of_sinusoids(model._core, float(omega), given, _input(model, input), {})
        found = cls.wrap(model, core)
        if inputs is None:
            return found
        lines = np.zeros((2, max(len(model.inputs), 1)), dtype=np.complex128)
        for name, value in inputs.items():
            if name not in model.inputs:
                raise _unknown("Reference.sinusoids", model, "input", name, model.inputs)
            amplitude, phase, offset = _sinusoid(name, value)
            lines[:, model.inputs.index(name)] = offset, -0.5j * amplitude * np.exp(1j * phase)
        return found._with(inputs=lines)

    @classmethod
    def series(
        cls, model: Model, period: float, states: npt.ArrayLike, inputs: npt.ArrayLike | None = None
    ) -> Reference:
        """States (K + 1, nx) and inputs (K + 1, nu) by their Fourier coefficients `c_0..c_K`, as they are.

        `z(t) = c_0 + 2 Re sum_{k>0} c_k e^{j k w t}`. Raises `InputError` for shapes that do not fit the model.
        """
        if inputs is None:
            inputs = np.zeros((1, max(len(model.inputs), 1)))
        core = _ltp.Reference.of_coefficients(
            model._core, float(period), _block("states", states), _block("inputs", inputs)
        )
        return cls.wrap(model, core)

    @property
    def omega(self) -> float:
        """Fundamental frequency, rad/s."""
        return math.tau / self.period

    @property
    def state_coefficients(self) -> npt.NDArray[np.complex128]:
        """Fourier coefficients `c_0..c_K` of the states (K + 1, nx)."""
        return self._core.state_coefficients

    @property
    def input_coefficients(self) -> npt.NDArray[np.complex128]:
        """Fourier coefficients `c_0..c_K` of the inputs (K + 1, nu)."""
        return self._core.input_coefficients

    def states(self, t: npt.ArrayLike) -> Array:
        """States (n, nx) at the times `t` (n,), s."""
        return self._core.states(np.atleast_1d(np.asarray(t, dtype=np.float64)))

    def inputs(self, t: npt.ArrayLike) -> Array:
        """Inputs (n, nu) at the times `t` (n,), s."""
        return self._core.inputs(np.atleast_1d(np.asarray(t, dtype=np.float64)))

    def sinusoid(self, name: str, harmonic: int = 1) -> tuple[float, float]:
        """Amplitude and phase (rad, in (-pi, pi]) of one harmonic of a state or input, as a sine.

        Raises `InputError` for a name that is not there.
        """
        if name in self.state_names:
            lines, column = self.state_coefficients, self.state_names.index(name)
        elif name in self.input_names:
            lines, column = self.input_coefficients, self.input_names.index(name)
        else:
            known = [*self.state_names, *self.input_names]
            raise _unknown("Reference.sinusoid", self.model, "state or input", name, known)
        if not 0 < harmonic < len(lines):
            return 0.0, 0.0
        line = complex(2j * lines[harmonic, column])
        return abs(line), math.atan2(line.imag, line.real)

    def ahead(self, *, time: float | None = None, phase: float | None = None) -> Reference:
        """The reference ahead by `time` (s) or by `phase` (rad) of its fundamental, input and all."""
        if (time is None) == (phase is None):
            raise InputError("Reference.ahead: give either time (s) or phase (rad)")
        ahead = time if time is not None else (phase or 0.0) / self.omega
        return Reference.wrap(self.model, self._core.ahead(float(ahead)))

    def shifted(self, **amounts: float) -> Reference:
        """The reference with amounts added to states, such as `shifted(x=-0.1)`; defects are kept as they are.

        Raises `InputError` for a state that is not there.
        """
        core = self._core
        for name, amount in amounts.items():
            if name not in self.state_names:
                raise _unknown("Reference.shifted", self.model, "state", name, self.state_names)
            core = core.shifted(self.state_names.index(name), float(amount))
        return Reference.wrap(self.model, core)

    def with_inputs_of(self, other: Reference) -> Reference:
        """These states under the inputs of another reference of the same period."""
        return self._with(inputs=other.input_coefficients)

    def _with(self, inputs: npt.ArrayLike) -> Reference:
        return Reference.series(self.model, self.period, self.state_coefficients, inputs)


def feedforward(
    model: Model,
    state: str,
    *,
    amplitude: float,
    omega: float,
    phase: float = 0.0,
    offset: float = 0.0,
    harmonics: int = 12,
    input: str | None = None,
    inputs: Mapping[str, float] | None = None,
    start: Mapping[str, float] | Reference | None = None,
) -> Reference:
    """The periodic motion whose `state` is `offset + amplitude sin(omega t + phase)`, and the input that makes it.

    By harmonic balance: all other states and the input named `input` (by default the first) are solved with `harmonics`
    harmonics, so that nothing is left over; see `Reference.defect`. Where the equations leave a direction open, as the
    place of a cart, it stays where `start` has it.

    inputs: constant values of the other inputs, zero by default.
    start: values that replace those of the document in the state to start from, or a reference to start from.

    Raises `InputError` for a name or value that cannot be, `ConvergenceError` when no such motion is found, naming the
    equation that cannot be balanced.
    """
    if harmonics < 1:
        raise InputError(f"feedforward: harmonics is {harmonics}, expected at least 1; correct it")
    core = _ltp.feedforward(
        model._core,
        state,
        (float(amplitude), float(phase), float(offset)),
        float(omega),
        harmonics=harmonics,
        input=_input(model, input),
        inputs=dict(inputs or {}),
        start=None if start is None or isinstance(start, Reference) else dict(start),
        start_from=start._core if isinstance(start, Reference) else None,
    )
    return Reference.wrap(model, core)


def _input(model: Model, name: str | None) -> str:
    if name is None:
        if not model.inputs:
            raise InputError(f"feedforward: {model.name!r} has no input that could be solved for")
        return model.inputs[0]
    return name


def _sinusoid(name: str, value: Sinusoid) -> tuple[float, float, float]:
    try:
        numbers = [float(v) for v in np.atleast_1d(np.asarray(value, dtype=np.float64))]
    except (TypeError, ValueError):
        numbers = []
    if not 1 <= len(numbers) <= 3:
        raise InputError(f"Reference.sinusoids: {name!r} is {value!r}, expected (amplitude, phase, offset)")
    amplitude, phase, offset = (*numbers, 0.0, 0.0)[:3]
    return amplitude, phase, offset


def _block(name: str, values: npt.ArrayLike) -> npt.NDArray[np.complex128]:
    array = np.asarray(values, dtype=np.complex128)
    if array.ndim != 2:
        raise InputError(f"Reference.series: {name} has shape {array.shape}, expected (K + 1, rows)")
    return np.ascontiguousarray(array[:, :, np.newaxis, np.newaxis])


def _unknown(verb: str, model: Model, kind: str, name: str, known: list[str]) -> InputError:
    near = difflib.get_close_matches(name, known, n=3, cutoff=0.4)
    hint = f"did you mean {' or '.join(near)}? " if near else ""
    return InputError(f"{verb}: {model.name!r} has no {kind} {name!r}; {hint}it has {', '.join(known) or 'none'}")
