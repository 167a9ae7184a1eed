"""Owns `ltp.isolability` and the noun `Isolability` in Python: what a planned experiment could tell apart."""

from __future__ import annotations

import json
import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ltp import _ltp
from ltp._ltp import InputError
from ltp.diagnose import Estimate
from ltp.model import Model
from ltp.simulate import InputLike

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = npt.NDArray[np.float64]
_SLACK = 1e-9  # of a sample


@dataclass(frozen=True)
class TriedEffect:
    """One effect at one place, at the size it was tried with.

    `raw` is the rms change of the measured outputs in units of their noise before anything is refitted; `visible` the
    length of what nominal parameters and initial states cannot imitate, in units of noise. It is `detectable` when the
    square of that exceeds 10. `alike` names the nominal parameter that does much the same, where one does.
    """

    name: str
    at: str
    parameters: dict[str, Estimate]
    raw: float
    visible: float
    detectable: bool
    alike: str | None

    @property
    def label(self) -> str:
        """`name@at`."""
        return f"{self.name}@{self.at}"


@dataclass(frozen=True)
class Help:
    """What to do: a sentence, its kind (amplitude, sensor, slow, bandwidth, longer), and the deviance it leads to."""

    sentence: str
    kind: str
    deviance: float


@dataclass(frozen=True)
class Advice:
    """An open question, an effect not seen or a pair not told apart, and what settles it, best first."""

    of: list[str]
    now: float
    by: list[Help]


@dataclass(frozen=True)
class Isolability:
    """The answer of `ltp.isolability`; `print` shows it as text.

    `effects` (m) are the candidates at their reference size, `size` times what is natural at their place. `matrix`
    (m, m) is the gain in deviance expected when the effect of the row is true and that of the column is fitted instead,
    at any size, beside nominal parameters and initial states. `separation` (m, m) is the smaller of both directions
    (the larger where one law contains the other); `words` (m, m) says it: "separable" above 10, "doubtful" above 2,
    else "never". `advice` says what would help, computed for each variation of the set-up. `sensors` are the noise
    levels.
    """

    model_name: str
    size: float
    sensors: dict[str, Estimate]
    effects: list[TriedEffect]
    matrix: Array
    separation: Array
    words: list[list[str]]
    advice: list[Advice]
    sentence: str
    warnings: list[str]
    _json: str = field(repr=False, compare=False)

    def to_json(self) -> str:
        """The whole as one JSON object, as `ltp isolability --json` prints it."""
        return self._json

    def plot(self) -> Figure:
        """The matrix as a picture: which pairs are told apart, and which effects are seen at all."""
        from ltp.plots.isolability import isolability_figure  # drawing is slow to import

        return isolability_figure(self)

    def __str__(self) -> str:
        from ltp.cli.text import isolability_text

        return isolability_text(self)


def isolability(
    model: Model,
    inputs: Mapping[str, InputLike] | Sequence[Mapping[str, InputLike]],
    sensors: Mapping[str, float | None] | Sequence[str] | None = None,
    *,
    t_end: float,
    dt: float,
    noise: float = 0.01,
    size: float = 0.05,
    effects: Sequence[str] | None = None,
    initial_state: Mapping[str, float] | None = None,
    hold: str = "first-order",
    threads: int = 0,
    progress: Callable[[str, float], None] | None = None,
) -> Isolability:
    """Say which effects a planned experiment could tell apart, and what would help, before it is made.

    inputs: name to samples (n,), an expression of `t` (s), a function of time or a constant; a list of such dicts plans
        several records, each of `t_end` seconds sampled every `dt`.
    sensors: what is measured, outputs or states, with the noise of each (one standard deviation, in its unit; None for
        `noise` times the motion it sees); all outputs by default.
    noise: noise of sensors without a figure, as a share of the motion they see.
    size: size at which effects are tried, as a share of what is natural at their place: of the force that moves the
        port, of its position, velocity and time; of an input, output or parameter.
    effects: names of effects to ask about, all of the library by default.
    initial_state: values that replace those of the document; `hold` as in `ltp.simulate`.
    threads: 0 for one per core; the result has the same bits with any number.

    Raises `InputError` for names and numbers that cannot be right, `ConvergenceError` when the model cannot be
    simulated along the plan.
    """
    records = [inputs] if isinstance(inputs, Mapping) else list(inputs)
    core = _ltp.isolability(
        model._core,
        [{name: _signal(name, value, t_end, dt) for name, value in record.items()} for record in records],
        t_end=t_end,
        dt=dt,
        sensors=_sensors(sensors),
        noise=noise,
        size=size,
        effects=None if effects is None else list(effects),
        initial_state=None if initial_state is None else dict(initial_state),
        hold=hold,
        threads=threads,
        progress=progress,
    )
    found = _parse(core)
    for text in found.warnings:
        warnings.warn(f"{found.model_name}: {text}", stacklevel=2)
    return found


def _sensors(given: Mapping[str, float | None] | Sequence[str] | None) -> list[tuple[str, float]] | None:
    if given is None:
        return None
    if isinstance(given, str):
        raise InputError(f"isolability: sensors is the text {given!r}; give a list of names, or a dict to noise")
    pairs = given.items() if isinstance(given, Mapping) else ((name, None) for name in given)
    return [(name, math.nan if noise is None else float(noise)) for name, noise in pairs]


def _signal(name: str, value: InputLike, t_end: float, dt: float) -> str | Array:
    if isinstance(value, str):
        return value
    if isinstance(value, (bool, int, float, np.number)):
        return repr(float(value))
    if callable(value):
        steps = math.floor(t_end / dt + _SLACK)
        return np.array([float(value(k * dt)) for k in range(steps + 1)])
    try:
        return np.ascontiguousarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"isolability: the input {name!r} is not an array of real numbers ({error})") from None


def _parse(text: str) -> Isolability:
    tree: dict[str, Any] = json.loads(text)

    def sizes(entries: Mapping[str, Any]) -> dict[str, Estimate]:
        return {name: Estimate(entry["value"], None, entry["unit"]) for name, entry in entries.items()}

    return Isolability(
        model_name=tree["model_name"],
        size=tree["size"],
        sensors=sizes(tree["sensors"]),
        effects=[TriedEffect(**(e | {"parameters": sizes(e["parameters"])})) for e in tree["effects"]],
        matrix=np.array(tree["matrix"], dtype=np.float64),
        separation=np.array(tree["separation"], dtype=np.float64),
        words=tree["words"],
        advice=[Advice(a["of"], a["now"], [Help(**help) for help in a["by"]]) for a in tree["advice"]],
        sentence=tree["sentence"],
        warnings=tree["warnings"],
        _json=text,
    )
