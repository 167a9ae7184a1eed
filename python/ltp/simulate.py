"""Owns `ltp.simulate` and the noun `Trajectory` in Python: inputs in every form people have them, numpy fields out."""

from __future__ import annotations

import csv
import difflib
import io
import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ltp import _ltp
from ltp._ltp import ConvergenceError, InputError
from ltp.files import write_text
from ltp.model import Model

Array = npt.NDArray[np.float64]
# An input: samples (n,), a function of time in seconds, an expression of `t` such as "2*sin(3*t)", or a constant.
InputLike = npt.ArrayLike | Callable[[float], float] | str

# The stop reason of a simulation that reached `t_end`.
FINISHED = "finished"
_SLACK = 1e-9  # of a sample: t_end = 0.3 with dt = 0.1 has three steps, although 0.3 / 0.1 is not 3 in binary


@dataclass(frozen=True)
class Event:
    """One event: a transition of the model, its time (s), and the modes on both sides."""

    name: str
    time: float
    mode_before: str
    mode_after: str


@dataclass(frozen=True)
class Stop:
    """How the simulation ended: the time (s) and mode it reached, and a sentence.

    `reason` is "finished", or what cut it short: "zeno", "chattering", "grazing", "escape", "step_limit".
    """

    reason: str
    time: float
    mode: str
    message: str

    @property
    def early(self) -> bool:
        """Whether the simulation ended before `t_end`."""
        return self.reason != FINISHED


@dataclass(frozen=True)
class Trajectory:
    """A simulated run.

    `t` (n,) in s; `states` (n, nx), `inputs` (n, nu), `outputs` (n, ny) in the model's units, columns as in
    `state_names`, `input_names`, `output_names`; `mode` (n,) names; `events` in order of time; `stop` how it ended;
    `stats` the work done (steps, bisections, evaluations). A run that ended early is shorter than asked for, and what
    is there is valid.
    """

    t: Array
    states: Array
    inputs: Array
    outputs: Array
    mode: npt.NDArray[np.str_]
    events: list[Event]
    stop: Stop
    stats: dict[str, Any]
    state_names: list[str]
    input_names: list[str]
    output_names: list[str]
    # How inputs and outputs are called in files, so that a written run is read back without a mapping.
    _columns: dict[str, str] = field(default_factory=dict, repr=False)

    def signals(self) -> dict[str, Array]:
        """Every sampled signal (n,) by its column name: `t`, inputs, outputs, then states not already among them."""
        columns = {"t": self.t}
        groups = (
            (self.input_names, self.inputs),
            (self.output_names, self.outputs),
            (self.state_names, self.states),
        )
        for names, values in groups:
            for k, name in enumerate(names):
                columns.setdefault(self._columns.get(name, name), values[:, k])
        return columns

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write all signals and the mode as CSV that `Recording.read` understands; returns the path.

        Values have all their digits, in the model's units. Raises `InputError` when the file cannot be written.
        """
        columns = self.signals()
        stream = io.StringIO(newline="")
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow([*columns, "mode"])
        cells = [[repr(value) for value in column.tolist()] for column in columns.values()]
        writer.writerows(zip(*cells, self.mode.tolist(), strict=True))
        return write_text(path, stream.getvalue())


def simulate(
    model: Model,
    inputs: Mapping[str, InputLike] | None = None,
    *,
    t_end: float,
    dt: float = 1e-3,
    hold: str = "first-order",
    step: float | None = None,
    initial_state: Mapping[str, float] | None = None,
    initial_mode: str | None = None,
    strict: bool = False,
) -> Trajectory:
    """Simulate `model` from t = 0 and sample it every `dt` seconds up to `t_end`.

    inputs: name to samples (n,) at the times of the result, a function of time (s), an expression of `t`, or a
    constant, in
        the input's unit. An input that is left out takes the default of the document.
    hold: what samples do in between: "first-order" (straight lines), "zero-order" (steps) or "cubic".
    step: longest integration step, s; by default one step leads from sample to sample, more where an effect brought a
        shorter time constant along.
    initial_state: values that replace those of the document, in the states' units; initial_mode likewise.
    strict: raise `ConvergenceError` when the run ends before `t_end` (Zeno, grazing, escape, step limit) instead of
        returning the valid part with its `stop`.

    Raises `InputError` for an unknown name, a wrong length, or a value that is not finite.
    """
    t = _grid(t_end, dt)
    core = _ltp.simulate(
        model._core,
        _inputs(model, inputs or {}, t),
        t,
        hold=hold,
        step=step,
        initial_state=None if initial_state is None else dict(initial_state),
        initial_mode=initial_mode,
    )
    run = wrap_trajectory(model, core)
    if strict and run.stop.early:
        raise ConvergenceError(f"{model.name}: {run.stop.message}")
    return run


def wrap_trajectory(model: Model, core: _ltp.Trajectory) -> Trajectory:
    """The Python face of a trajectory of the extension."""
    return Trajectory(
        t=core.t,
        states=core.states,
        inputs=core.inputs,
        outputs=core.outputs,
        mode=np.array(core.mode, dtype=np.str_),
        events=[Event(*event) for event in core.events],
        stop=Stop(**core.stop),
        stats=core.stats,
        state_names=model.states,
        input_names=model.inputs,
        output_names=model.outputs,
        _columns={name: model.column(name) for name in [*model.inputs, *model.outputs]},
    )


def _grid(t_end: float, dt: float) -> Array:
    for name, value in (("t_end", t_end), ("dt", dt)):
        if not (math.isfinite(value) and value > 0):
            raise InputError(f"simulate: {name} is {value!r}, expected a positive number of seconds; correct it")
    steps = math.floor(t_end / dt + _SLACK)
    if steps < 1:
        raise InputError(f"simulate: dt = {dt:g} s is longer than t_end = {t_end:g} s; make dt smaller or t_end larger")
    return np.arange(steps + 1, dtype=np.float64) * dt


def _inputs(model: Model, given: Mapping[str, InputLike], t: Array) -> Mapping[str, Array] | Mapping[str, str]:
    for name in given:
        if name not in model.inputs:
            near = difflib.get_close_matches(name, model.inputs, n=3, cutoff=0.4)
            hint = f"did you mean {' or '.join(near)}? " if near else ""
            known = f"its inputs are {', '.join(model.inputs)}" if model.inputs else "it has no inputs"
            raise InputError(f"simulate: {model.name!r} has no input {name!r}; {hint}{known}")
    expressions = {name: _expression(value) for name, value in given.items()}
    texts = {name: text for name, text in expressions.items() if text is not None}
    if len(texts) == len(given):
        return texts
    mixed = [name for name, value in given.items() if isinstance(value, str)]
    if mixed:
        raise InputError(
            f"simulate: the input {mixed[0]!r} is an expression while another one is sampled; "
            "give all as expressions, or all as samples or functions (lambda t: ...)"
        )
    return {name: _samples(name, value, t) for name, value in given.items()}


def _expression(value: InputLike) -> str | None:
    """The input as an expression of `t`, where it is one or a constant."""
    if isinstance(value, str):
        return value
    if isinstance(value, (bool, int, float, np.number)):
        return repr(float(value))
    return None


def _samples(name: str, value: InputLike, t: Array) -> Array:
    if callable(value):
        # One call per sample: a function with an `if` in it cannot take the whole array.
        samples = np.array([float(value(time)) for time in t.tolist()])
    else:
        try:
            samples = np.ascontiguousarray(value, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise InputError(f"simulate: the input {name!r} is not an array of real numbers ({error})") from None
        if samples.ndim == 0:
            samples = np.full(t.shape, samples)
    if samples.shape != t.shape:
        raise InputError(
            f"simulate: the input {name!r} has shape {samples.shape}, expected {t.shape} for 0 to {t[-1]:g} s; "
            "give one sample per dt with both ends, or a function of time"
        )
    bad = np.flatnonzero(~np.isfinite(samples))
    if bad.size:
        raise InputError(
            f"simulate: the input {name!r} is {samples[bad[0]]} at t = {t[bad[0]]:g} s (sample {bad[0]}); "
            "every sample must be a finite number"
        )
    return samples
