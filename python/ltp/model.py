"""Owns `ltp.Model` in Python: a document of equations from a file, from text or from keyword arguments."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ltp import _ltp
from ltp.files import read_bytes, write_text

if TYPE_CHECKING:
    from ltp._ltp import _Effect, _Parameter

# A part of the document: names to plain values, expressions, or tables such as {"value": 1.0, "unit": "kg"}.
Section = Mapping[str, Any]


class Model:
    """Equations as data: states, inputs, parameters, flow per mode, transitions, outputs and ports.

    The keyword arguments are the sections of the document, spelled as in the TOML file::

        ltp.Model(
            name="drive",
            states={"q": {"value": 0.0, "unit": "m"}, "v": {"value": 0.0, "unit": "m/s"}},
            inputs={"tau": {"unit": "N"}},
            parameters={"M": {"value": 95.1, "sd": 2.0, "unit": "kg"}},
            flow={"q": "v", "v": "tau / M"},
            outputs={"q": "q"},
            ports={"drive": {"position": "q", "velocity": "v", "acts": {"v": "1/M"}, "unit": "N"}},
        )

    Expressions are parsed by a small grammar of our own and compiled; a model can never run code. A section that is
    left out is absent from the document. Raises `InputError`, naming the section and what was expected, when the
    document is not consistent.
    """

    def __init__(
        self,
        *,
        name: str,
        states: Section,
        description: str | None = None,
        inputs: Section | None = None,
        parameters: Section | None = None,
        signals: Section | None = None,
        flow: Section | None = None,
        modes: Section | None = None,
        initial_mode: str | None = None,
        mass_matrix: Section | None = None,
        transitions: Sequence[Section] | None = None,
        ticks: Sequence[Section] | None = None,
        clock: Section | None = None,
        outputs: Section | None = None,
        ports: Section | None = None,
        contacts: Section | None = None,
        effects: Sequence[Section] | None = None,
    ) -> None:
        sections = {
            "name": name,
            "description": description,
            "initial_mode": initial_mode,
            "states": states,
            "inputs": inputs,
            "parameters": parameters,
            "signals": signals,
            "flow": flow,
            "modes": modes,
            "mass_matrix": mass_matrix,
            "transitions": transitions,
            "ticks": ticks,
            "clock": clock,
            "outputs": outputs,
            "ports": ports,
            "contacts": contacts,
            "effects": effects,
        }
        document = {key: value for key, value in sections.items() if value is not None}
        source = f"ltp.Model(name={name!r})"
        self._core: _ltp.Model = _ltp.Model.from_json(_as_json(document, source), source)
        self._own: tuple[tuple[str, str], ...] = ()

    @classmethod
    def wrap(cls, core: _ltp.Model, own: Sequence[tuple[str, str]] = ()) -> Model:
        """The Python face of a model of the extension; `own` are names and texts of effects beyond the shipped ones."""
        model = cls.__new__(cls)
        model._core = core
        model._own = tuple(own)
        return model

    @classmethod
    def load(cls, path: str | os.PathLike[str], effects: Sequence[str | os.PathLike[str]] = ()) -> Model:
        """Read a model document from a `.toml` (or `.json`) file, UTF-8.

        `effects` are files of one's own pieces of physics (docs/model.md): they join the library under the names of the
        files, to be attached and to be tried by a diagnosis. A document that uses them needs them again.

        Raises `InputError` with file, line, column and the nearest known name when a document cannot be right.
        """
        source = Path(path)
        readers = {".toml": _ltp.Model.from_toml, ".json": _ltp.Model.from_json}
        reader = readers.get(source.suffix.lower())
        if reader is None:
            raise _ltp.InputError(
                f"{source}: a model document ends in .toml (or .json), found {source.suffix or 'no suffix'!r}; "
                "rename the file, or give the model first and the recordings after it"
            )
        own = _own_effects(effects)
        return cls.wrap(reader(_text(source), str(source), own), own)

    @classmethod
    def from_toml(cls, text: str, source: str = "TOML text", effects: Sequence[str | os.PathLike[str]] = ()) -> Model:
        """A model from the text of a document; `source` is what errors call it, `effects` as for :meth:`load`."""
        own = _own_effects(effects)
        return cls.wrap(_ltp.Model.from_toml(text, source, own), own)

    def with_effects(self, effects: Sequence[str | os.PathLike[str]]) -> Model:
        """The same model with more effects in its library, from files as for :meth:`load`.

        Raises `InputError` for a file that is no effect, or whose name is taken.
        """
        own = _own_effects(effects)
        return Model.wrap(self._core.with_effects(own), [*self._own, *own])

    def to_toml(self) -> str:
        """The document as TOML text; `Model.from_toml` reads it back."""
        return self._core.to_toml()

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the document as TOML, whole or not at all; returns the path. Raises `InputError` if it cannot."""
        return write_text(path, self.to_toml())

    def with_parameters(self, values: Mapping[str, float] | None = None, **named: float) -> Model:
        """The same model with other parameter values, in the parameters' own units (`unit(name)`).

        Raises `InputError` for an unknown name or a value outside its bounds.
        """
        return Model.wrap(self._core.with_parameters({**(values or {}), **named}), self._own)

    def attach(self, effect: str, at: str, parameters: Mapping[str, float] | None = None, **named: float) -> Model:
        """The model with one more piece of physics, such as `attach("coulomb_friction", "drive", force=20.4)`.

        `effect` is a name of the effects library, `at` the port, input (or signal that inputs enter), output, contact
        or parameter where it acts; parameters are in the units of the effect's document, and take its defaults where
        they are left out. Raises `InputError` for an unknown effect, place or parameter, and where there is nothing to
        act on.
        """
        return Model.wrap(self._core.attach(effect, at, {**(parameters or {}), **named}), self._own)

    def places(self, effect: str) -> list[str]:
        """Where an effect may act in this model, in document order. Raises `InputError` for an unknown effect."""
        return self._core.places(effect)

    @property
    def library(self) -> list[str]:
        """Names of the effects that may be attached: the shipped ones, then one's own."""
        return self._core.library

    @property
    def name(self) -> str:
        """The name the document gives itself."""
        return self._core.name

    @property
    def description(self) -> str:
        """One or two sentences of the document, or an empty string."""
        return self._core.description

    @property
    def states(self) -> list[str]:
        """Names of the states, in the order of the columns of `Trajectory.states`."""
        return self._core.states

    @property
    def inputs(self) -> list[str]:
        """Names of the inputs, in the order of the columns of `Trajectory.inputs`."""
        return self._core.inputs

    @property
    def outputs(self) -> list[str]:
        """Names of the outputs, in the order of the columns of `Trajectory.outputs`."""
        return self._core.outputs

    @property
    def ports(self) -> list[str]:
        """Names of the places where unmodelled physics may act."""
        return self._core.ports

    @property
    def modes(self) -> list[str]:
        """Names of the modes."""
        return self._core.modes

    @property
    def parameters(self) -> list[_Parameter]:
        """Each parameter as `{name, value, sd, unit, min, max}`; `sd`, `min` and `max` are None where not stated."""
        return self._core.parameters

    @property
    def effects(self) -> list[_Effect]:
        """Each attached effect as `{name, at, parameters: {NAME: {value, sd, unit}}}`."""
        return self._core.effects

    def unit(self, name: str) -> str:
        """Unit of a state, input, output, parameter or signal. Raises `InputError` for an unknown name."""
        return self._core.unit(name)

    def column(self, name: str) -> str:
        """The name an input or output has in files: its `column`, else its own name."""
        return self._core.column(name)

    def input_default(self, name: str) -> float | None:
        """The value an input has where a recording does not give it, in its unit; None when it must be given."""
        return self._core.input_default(name)

    def __reduce__(self) -> tuple[Callable[..., Model], tuple[str, str, tuple[tuple[str, str], ...]]]:
        """A model travels to another process, and is copied, as its document with those of its own effects."""
        return _told, (self.to_toml(), f"the copied model {self.name!r}", self._own)

    def __repr__(self) -> str:
        lists = {"states": self.states, "inputs": self.inputs, "outputs": self.outputs, "ports": self.ports}
        parts = [f"{word}: {', '.join(names)}" for word, names in lists.items() if names]
        parts += [f"with {effect['name']} at {effect['at']}" for effect in self.effects]
        return f"<ltp.Model {self.name!r}; {'; '.join(parts)}>"


def _text(path: Path) -> str:
    try:
        return read_bytes(path).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise _ltp.InputError(
            f"{path}: not a text file (byte {error.start} is not UTF-8); a document is UTF-8 text"
        ) from None


def _told(text: str, source: str, own: Sequence[tuple[str, str]]) -> Model:
    """A model from the text of its document and the texts of its own effects."""
    return Model.wrap(_ltp.Model.from_toml(text, source, list(own)), own)


def _own_effects(paths: Sequence[str | os.PathLike[str]]) -> list[tuple[str, str]]:
    """Names and texts of effects in files; the name is that of the file."""
    files = [paths] if isinstance(paths, (str, os.PathLike)) else paths
    return [(Path(file).stem, _text(Path(file))) for file in files]


def _as_json(document: Mapping[str, Any], source: str) -> str:
    def plain(value: object) -> object:
        """Numpy scalars and arrays, and mappings that are no dict, as the plain values that JSON knows."""
        if isinstance(value, Mapping):
            return dict(value)
        to_list = getattr(value, "tolist", None)
        if callable(to_list):
            listed: object = to_list()
            return listed
        raise TypeError(f"a {type(value).__name__} ({value!r})")

    try:
        return json.dumps(document, default=plain, allow_nan=False)
    except TypeError as error:
        raise _ltp.InputError(
            f"{source}: the document holds {error}; use numbers, strings, lists and dicts (expressions are strings)"
        ) from None
    except ValueError as error:
        raise _ltp.InputError(
            f"{source}: the document cannot be written as JSON ({error}); "
            "a value must be finite: leave a bound out instead of giving infinity"
        ) from None
