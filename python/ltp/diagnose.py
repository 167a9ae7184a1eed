"""Owns `ltp.diagnose` and the noun `Diagnosis` in Python: the core's answer as typed, frozen records."""

from __future__ import annotations

import json
import math
import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from ltp import _ltp
from ltp._ltp import InputError
from ltp.harmonic import EventTime, HarmonicMap
from ltp.harmonic import from_tree as _harmonic_map
from ltp.model import Model
from ltp.recording import Recording

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Estimate:
    """A value with its one-sigma uncertainty (None where it has none) and unit."""

    value: float
    sd: float | None
    unit: str


@dataclass(frozen=True)
class Location:
    """Where model and data part, and what the missing part depends on.

    `kind` and `at` say which port, input, output, contact or parameter; `variable` what it depends on there: "sign of
    velocity", "velocity", "position", "mode", "phase of the cycle", "time since the last event", "input `u`", "rate of
    input `u`", "time" (a drift), at a sensor "the measured value" or its rate. `phases` are the parts of the cycle, in
    [0, 1), when it is confined to some; `p_value` is that of the dependence, however many variables were tried;
    `repeats` says how far on it repeats, over position or over time (by its unit), where it does; `margin` is the gain
    in log-likelihood that a free force (or bias of a sensor or an input) at this place brings.
    """

    kind: str
    at: str
    mode: str | None
    variable: str | None
    phases: list[Any]
    p_value: float | None
    margin: float | None
    sentence: str = ""
    repeats: Estimate | None = None


@dataclass(frozen=True)
class Absorbed:
    """A nominal parameter that had soaked up missing physics before it was named, by how many standard deviations.

    `forbidden` says why its absorbed value cannot be physics, where it cannot (a damping that turned negative).
    """

    parameter: str
    before: float
    after: float
    sigmas: float
    unit: str
    forbidden: str | None


@dataclass(frozen=True)
class Separating:
    """A change of the experiment that would tell the rivals `separates` apart, with the deviance `gain` it promises.

    `kind` is "amplitude", "sensor", "slow", "bandwidth" or "longer"; a gain of 10 is decisive.
    """

    sentence: str
    kind: str
    separates: list[str]
    gain: float


@dataclass(frozen=True)
class Effect:
    """A piece of physics that was left out: its name, where it acts, and the share of the mismatch that it explains."""

    name: str
    at: str
    parameters: dict[str, Estimate]
    share: float | None


@dataclass(frozen=True)
class Candidate:
    """One explanation that was tried: `score` is 0 for the best, larger is worse, NaN for one out of the race.

    `held_out` is its deviance on the held-out records less that of the nominal model, negative when it predicts better.
    The entry named "nothing" is the nominal model with refitted parameters. `note` says why one is out of the race;
    `beside` names what was accepted before and stands beside it.
    """

    name: str
    at: str
    score: float
    held_out: float | None
    converged: bool
    parameters: dict[str, float]
    note: str | None
    beside: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class ParameterChange:
    """A nominal parameter as stated, refitted without the effect (`before`), and with it (`after`, with its `sd`).

    Where `before` strays from `after`, the parameter had absorbed what the model left out. `away` is how far `after` is
    from what was stated, in standard deviations of what the recordings can add to a true statement: above three the
    statement is wrong.
    """

    nominal: float
    nominal_sd: float | None
    before: float
    after: float
    sd: float | None
    unit: str
    away: float | None = None


@dataclass(frozen=True)
class FitRow:
    """Errors of one output of one record: rms(y - y_hat) / std(y), and in the output's unit where named `rms_`.

    NaN where there is none, such as `after` when no effect was added.
    """

    record: str
    output: str
    unit: str
    nominal: float
    before: float
    after: float
    floor: float
    rms_before: float
    rms_after: float


@dataclass(frozen=True)
class Fit:
    """Errors on the records that were fitted, and on those held out."""

    train: list[FitRow]
    test: list[FitRow]


@dataclass(frozen=True)
class Law:
    """The missing force over what it depends on: `grid` (m,) in `variable_unit`, `force` (m,) and its `sd` (m,)."""

    at: str
    variable: str
    unit: str
    variable_unit: str
    grid: Array
    force: Array
    sd: Array


class _Core(Protocol):
    """What a diagnosis rests on: that of the extension, or one that was told again."""

    def json(self) -> str: ...
    def traces(self) -> dict[str, Any]: ...


@dataclass(frozen=True)
class _Told:
    """A diagnosis from another process or from a file."""

    text: str
    curves: dict[str, Any]

    def json(self) -> str:
        return self.text

    def traces(self) -> dict[str, Any]:
        return self.curves


@dataclass(frozen=True)
class Diagnosis:
    """The answer of `ltp.diagnose`.

    `verdict` is one of "consistent", "parameter", "effect", "ambiguous", "unknown"; `sentence` says it with numbers and
    units. `location` is a list when two effects are named, None when there is nothing to locate. `ambiguous_with` names
    what the data cannot tell from the winner. `absorbed` lists the
    nominal parameters that had soaked up what was missing, `separate` the experiments that would tell rivals apart.
    `harmonic` is the harmonic map of the refitted nominal model, `harmonic_after` its mean square with what was named
    attached (1: noise alone); both None without a clock, and where the inputs do not tell harmonics apart.
    `model` is the augmented model, `model_name` the nominal one's name.
    """

    verdict: str
    sentence: str
    location: Location | list[Location] | None
    effects: list[Effect]
    candidates: list[Candidate]
    ambiguous_with: list[str]
    parameters: dict[str, ParameterChange]
    absorbed: list[Absorbed]
    separate: list[Separating]
    events: list[EventTime]
    harmonic: HarmonicMap | None
    harmonic_after: float | None
    fit: Fit
    law: Law | None
    warnings: list[str]
    seconds: float
    model_name: str
    _core: _Core = field(repr=False, compare=False)
    _document: str = field(repr=False)
    _own: tuple[tuple[str, str], ...] = field(default=(), repr=False)  # effects that the library does not ship

    @cached_property
    def model(self) -> Model:
        """The augmented model: simulate it, save it, diagnose with it again."""
        source = f"diagnosis of {self.model_name}"
        return Model.wrap(_ltp.Model.from_toml(self._document, source, list(self._own)), self._own)

    @cached_property
    def traces(self) -> dict[str, Any]:
        """The curves behind the figures: `records` (measured, nominal, before, after), `force` and `law`, as arrays."""
        return self._core.traces()

    def to_json(self) -> str:
        """The whole diagnosis as one JSON object, as `ltp diagnose --json` prints it."""
        return self._core.json()

    @staticmethod
    def from_json(text: str, traces: Mapping[str, Any] | None = None) -> Diagnosis:
        """A diagnosis again, from `to_json` and, for the figures of its report, from its `traces`.

        Raises `InputError` when the text is not what `to_json` or `ltp diagnose --json` wrote.
        """
        curves = dict(traces) if traces is not None else {"records": [], "force": [], "law": None}
        return _parse(_Told(text, curves))

    def __reduce__(self) -> tuple[Callable[..., Diagnosis], tuple[Any, ...]]:
        """A diagnosis travels to another process, and is copied, as its JSON and its curves."""
        return _told, (self.to_json(), self.traces, self._own)

    def report(self, path: str | os.PathLike[str]) -> Path:
        """Write a self-contained HTML page that opens offline; returns the path.

        Raises `InputError` when it cannot be written there.
        """
        from ltp.report import write_report  # drawing is slow to import, and only reports draw

        return write_report(self, path)


def diagnose(
    model: Model,
    train: Recording | Sequence[Recording],
    test: Recording | Sequence[Recording] = (),
    *,
    candidates: Sequence[str] | None = None,
    hold: str = "first-order",
    seed: int = 0,
    threads: int = 0,
    progress: Callable[[str, float], None] | None = None,
) -> Diagnosis:
    """Compare `model` with recordings, locate the mismatch, and name and fit the physics that was left out.

    train: recordings to fit; test: recordings held out, to judge by.
    candidates: names of effects to try, all of the library by default.
    hold: what inputs do between samples: "first-order", "zero-order" or "cubic".
    seed: of everything random; the same seed gives the same bits with any number of `threads` (0: one per core).
    progress: called with a message and the finished fraction in [0, 1].

    Doubts (few samples, a parameter on its bound) are warned of and kept in `warnings`. Raises `InputError` when the
    recordings do not fit the model, `ConvergenceError` when nothing meaningful could be fitted.
    """
    train, test = _listed("train", train), _listed("test", test)
    core = _ltp.diagnose(
        model._core,
        [recording._core for recording in train],
        [recording._core for recording in test],
        candidates=None if candidates is None else list(candidates),
        hold=hold,
        seed=seed,
        threads=threads,
        progress=progress,
    )
    diagnosis = replace(_parse(core), _own=model._own)
    known = {text for recording in [*train, *test] for text in recording.warnings}  # said when they were read
    for text in diagnosis.warnings:
        if text in known:
            continue
        warnings.warn(f"{diagnosis.model_name}: {text}", stacklevel=2)
    return diagnosis


def _listed(role: str, records: Recording | Sequence[Recording]) -> list[Recording]:
    listed = [records] if isinstance(records, Recording) else list(records)
    for record in listed:
        if not isinstance(record, Recording):
            raise InputError(
                f"diagnose: {role} holds a {type(record).__name__}, expected recordings; "
                "read them with ltp.Recording.read"
            )
    return listed


def _told(text: str, traces: dict[str, Any], own: tuple[tuple[str, str], ...]) -> Diagnosis:
    return replace(Diagnosis.from_json(text, traces), _own=own)


def _parse(core: _Core) -> Diagnosis:
    try:
        return _from_tree(core, json.loads(core.json()))
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(
            f"not the JSON of a diagnosis ({type(error).__name__}: {error}); expected what to_json() "
            "or `ltp diagnose --json` wrote, by this version"
        ) from None


def _from_tree(core: _Core, tree: dict[str, Any]) -> Diagnosis:
    where = tree["location"]
    law = tree["law"]
    return Diagnosis(
        verdict=tree["verdict"],
        sentence=tree["sentence"],
        location=[_location(one) for one in where] if isinstance(where, list) else _location(where) if where else None,
        effects=[
            Effect(effect["name"], effect["at"], _estimates(effect["parameters"]), effect.get("share"))
            for effect in tree["effects"]
        ],
        candidates=[
            Candidate(
                name=entry["name"],
                at=entry["at"],
                score=_number(entry["score"]),
                held_out=entry["held_out"],
                converged=entry["converged"],
                parameters=entry["parameters"],
                note=entry["note"],
                beside=entry.get("with", []),
            )
            for entry in tree["candidates"]
        ],
        ambiguous_with=tree["ambiguous_with"],
        parameters={name: _change(entry) for name, entry in tree["parameters"].items()},
        absorbed=[Absorbed(**entry) for entry in tree["absorbed"]],
        separate=[Separating(**entry) for entry in tree["separate"]],
        events=[EventTime(**entry) for entry in tree["events"]],
        harmonic=None if tree["harmonic"] is None else _harmonic_map(tree["harmonic"]),
        harmonic_after=tree["harmonic_after"],
        fit=Fit([_row(row) for row in tree["fit"]["train"]], [_row(row) for row in tree["fit"]["test"]]),
        law=None
        if law is None
        else Law(
            at=law["at"],
            variable=law["variable"],
            unit=law["unit"],
            variable_unit=law["variable_unit"],
            grid=_array(law["grid"]),
            force=_array(law["force"]),
            sd=_array(law["sd"]),
        ),
        warnings=tree["warnings"],
        seconds=tree["seconds"],
        model_name=tree["model_name"],
        _core=core,
        _document=tree["model"],
    )


def _location(tree: Mapping[str, Any]) -> Location:
    return Location(
        kind=tree["kind"],
        at=tree["at"],
        mode=tree.get("mode"),
        variable=tree.get("variable"),
        phases=tree.get("phases", []),
        p_value=tree.get("p_value"),
        margin=tree.get("margin"),
        sentence=tree.get("sentence") or "",
        repeats=_estimates({"": tree["repeats"]})[""] if tree.get("repeats") else None,
    )


def _estimates(tree: Mapping[str, Any]) -> dict[str, Estimate]:
    return {name: Estimate(entry["value"], entry.get("sd"), entry["unit"]) for name, entry in tree.items()}


def _change(tree: Mapping[str, Any]) -> ParameterChange:
    return ParameterChange(
        nominal=_number(tree["nominal"]),
        nominal_sd=tree.get("nominal_sd"),
        before=_number(tree["before"]),
        after=_number(tree["after"]),
        sd=tree.get("sd"),
        unit=tree["unit"],
        away=tree.get("away"),
    )


def _row(tree: Mapping[str, Any]) -> FitRow:
    errors = ("nominal", "before", "after", "floor", "rms_before", "rms_after")
    return FitRow(
        record=tree["record"], output=tree["output"], unit=tree["unit"], **{key: _number(tree[key]) for key in errors}
    )


def _number(value: float | None) -> float:
    """JSON has no NaN: what could not be computed arrives as null."""
    return math.nan if value is None else float(value)


def _array(values: Sequence[float | None]) -> Array:
    return np.array([_number(value) for value in values])
