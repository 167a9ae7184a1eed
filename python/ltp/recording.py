"""Owns `ltp.Recording` in Python: measured inputs and outputs over time, read from files or given as arrays.

This file finds columns, converts units and reports what is wrong with its place; what a recording *is* (sampling,
jitter, gaps) is decided by the core when it is constructed.
"""

from __future__ import annotations

import difflib
import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from ltp import _ltp
from ltp._ltp import InputError
from ltp.model import Model
from ltp.readers import Column, Frame, Table, read_table, stem

Array = npt.NDArray[np.float64]


class Recording:
    """Samples of one experiment: time, inputs and outputs in the units of the model.

    `t` (n,) in seconds, strictly increasing; `inputs` and `outputs` map names to (n,) samples. A NaN in an output is a
    gap: it is kept and left out of every residual, never filled. Jittered sampling is resampled to an even step with a
    warning that gives the jitter. Raises `InputError` when lengths differ, time does not increase, or an input is not
    known at every instant.
    """

    def __init__(
        self,
        t: npt.ArrayLike,
        inputs: Mapping[str, npt.ArrayLike] | None = None,
        outputs: Mapping[str, npt.ArrayLike] | None = None,
        name: str = "recording",
    ) -> None:
        time = _vector(name, "t", t)
        u = {key: _vector(name, key, values) for key, values in (inputs or {}).items()}
        y = {key: _vector(name, key, values) for key, values in (outputs or {}).items()}
        _check_lengths(name, {"t": time, **u, **y})
        self._core: _ltp.Recording = _construct(name, name, time, u, y)

    @classmethod
    def wrap(cls, core: _ltp.Recording) -> Recording:
        """The Python face of a recording of the extension."""
        recording = cls.__new__(cls)
        recording._core = core
        return recording

    @classmethod
    def read(
        cls,
        source: str | os.PathLike[str] | Frame | Mapping[str, Any],
        model: Model,
        columns: Mapping[str, str | None] | None = None,
        name: str | None = None,
        *,
        dt: float | None = None,
    ) -> Recording:
        """Read the inputs and outputs of `model` from a file, a data frame or a dict of arrays.

        source: `.csv`, `.tsv`, `.txt` (each also `.gz`), `.npz`, `.mat`, `.json`, a pandas or polars frame, or a dict.
        columns: where a name of the model differs from the file, such as `{"q": "qm", "theta": "angle [deg]"}`; by
            default `model.column(name)`. None for an output says that it was not recorded.
        name: what reports call the recording; by default the file's name without suffix.
        dt: sampling period in s, for a file without a time column (`t` or `time`).

        A unit in a header or in `columns`, `[deg]` or `(deg)`, is converted to the model's unit; without one the
        model's unit is taken (time: seconds). An input that the file lacks takes the default of the document, if it has
        one. Raises `InputError` with file, row and column for each way a file can be wrong.
        """
        mapping = dict(columns or {})
        _check_names(mapping, model)
        table = read_table(source)
        title = name or (stem(source) if isinstance(source, (str, os.PathLike)) else table.source)

        chosen: dict[str, tuple[Column, str | None]] = {}
        for key in [*model.inputs, *model.outputs]:
            found = _find(table, mapping.get(key, model.column(key)), key, model)
            if found is not None:
                chosen[key] = found
        time = _find_time(table, mapping, dt)
        if time is not None:
            chosen = {"t": time, **chosen}
        measured = [key for key in model.outputs if key in chosen]
        if not measured:
            raise InputError(f"{table.source}: no output of the model is recorded here; map at least one in `columns`")

        values = {key: _values(table, column, unit, key, model) for key, (column, unit) in chosen.items()}
        _check_lengths(table.source, {chosen[key][0].header: samples for key, samples in values.items()})
        n = len(values[measured[0]])
        _check_count(table, n)
        if time is None:
            values["t"] = np.arange(n, dtype=np.float64) * float(dt or 0.0)
        else:
            _check_time(table, time[0], values["t"])
        u: dict[str, Array] = {}
        for key in model.inputs:
            if key in values:  # one that is missing has a default, which whoever uses the recording knows
                _check_known(table, chosen[key][0], values[key])
                u[key] = values[key]
        y = {key: values[key] for key in measured}
        return cls.wrap(_construct(title, table.source, values["t"], u, y))

    @classmethod
    def read_columns(
        cls,
        source: str | os.PathLike[str] | Frame | Mapping[str, Any],
        inputs: Sequence[str],
        outputs: Sequence[str],
        name: str | None = None,
        *,
        dt: float | None = None,
    ) -> Recording:
        """Read named columns as they are, without a model: no units are converted, no defaults filled in.

        source, name, dt: as in `read`. Raises `InputError` with file, row and column for each way a file can be wrong.
        """
        table = read_table(source)
        title = name or (stem(source) if isinstance(source, (str, os.PathLike)) else table.source)
        chosen: dict[str, Column] = {}
        for header in [*inputs, *outputs]:
            found = table.find(header)
            if found is None:
                raise table.missing(header, f"{header!r}", "name one of the columns of the file")
            chosen[header] = found[0]
        values = {header: table.numbers(column) for header, column in chosen.items()}
        time = _find_time(table, {}, dt)
        counted = np.arange(len(values[outputs[0]]), dtype=np.float64) * float(dt or 0.0)
        t: Array = counted if time is None else table.numbers(time[0])
        _check_lengths(table.source, {"time": t, **values})
        _check_count(table, len(t))
        if time is not None:
            _check_time(table, time[0], t)
        for header in inputs:
            _check_known(table, chosen[header], values[header])
        columns = ({header: values[header] for header in names} for names in (inputs, outputs))
        return cls.wrap(_construct(title, table.source, t, *columns))

    def slice(self, start: float, end: float) -> Recording:
        """The samples with `start <= t <= end` (s), times kept. Raises `InputError` for an empty window."""
        return Recording.wrap(self._core.slice(start, end))

    @property
    def name(self) -> str:
        """What reports call the recording."""
        return self._core.name

    @property
    def t(self) -> Array:
        """Time of the samples, (n,), s."""
        return self._core.t

    @property
    def inputs(self) -> Array:
        """Inputs, (n, nu), in the model's units, columns as in `input_names`."""
        return self._core.inputs

    @property
    def outputs(self) -> Array:
        """Outputs, (n, ny), in the model's units, columns as in `output_names`; NaN where nothing was measured."""
        return self._core.outputs

    @property
    def dt(self) -> float:
        """Sampling period, s."""
        return self._core.dt

    @property
    def warnings(self) -> list[str]:
        """What is doubtful about the recording, with numbers and advice."""
        return self._core.warnings

    @property
    def input_names(self) -> list[str]:
        """Names of the columns of `inputs`."""
        return self._core.input_names

    @property
    def output_names(self) -> list[str]:
        """Names of the columns of `outputs`."""
        return self._core.output_names

    def __reduce__(self) -> tuple[Callable[..., Recording], tuple[Any, ...]]:
        """A recording travels to another process, and is copied, as its samples, equal to the bit."""
        arrays = (self.t, self.inputs, self.outputs)
        return _restored, (self.name, *arrays, self.input_names, self.output_names, self.dt, self.warnings)

    def __len__(self) -> int:
        return len(self.t)

    def __repr__(self) -> str:
        t = self.t
        return (
            f"<ltp.Recording {self.name!r}; {len(t)} samples, {t[0]:g} to {t[-1]:g} s, dt {self.dt:g} s; "
            f"inputs: {', '.join(self.input_names) or 'none'}; outputs: {', '.join(self.output_names)}>"
        )


def _restored(name: str, t: Array, u: Array, y: Array, inputs: list[str], outputs: list[str], *rest: Any) -> Recording:
    return Recording.wrap(_ltp.Recording(name, t, u, y, inputs, outputs).restored(*rest))


def _construct(name: str, source: str, t: Array, inputs: dict[str, Array], outputs: dict[str, Array]) -> _ltp.Recording:
    try:
        core = _ltp.Recording(name, t, _stack(inputs, len(t)), _stack(outputs, len(t)), list(inputs), list(outputs))
    except InputError as error:
        raise InputError(f"{source}: {error}") from None
    for text in core.warnings:
        warnings.warn(f"{source}: {text}", stacklevel=3)
    return core


def _stack(columns: dict[str, Array], n: int) -> Array:
    return np.column_stack(list(columns.values())) if columns else np.empty((n, 0))


def _vector(name: str, key: str, values: npt.ArrayLike) -> Array:
    try:
        vector = np.ascontiguousarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"{name}: {key!r} is not an array of real numbers ({error}); give one number per sample"
        ) from None
    if vector.ndim != 1:
        raise InputError(f"{name}: {key!r} has shape {vector.shape}, expected (n,); give one array per signal")
    return vector


def _check_names(mapping: Mapping[str, str | None], model: Model) -> None:
    known = ["t", *model.inputs, *model.outputs]
    for key, header in mapping.items():
        if key not in known:
            near = difflib.get_close_matches(key, known, n=3, cutoff=0.5)
            hint = f"did you mean {' or '.join(near)}? " if near else ""
            raise InputError(
                f"columns: {model.name!r} has no input or output {key!r}; {hint}it has {', '.join(known[1:])} (and t); "
                "the left side is the model's name, the right side the file's"
            )
        if header is None and key in model.inputs and model.input_default(key) is None:
            raise InputError(
                f"columns: the input {key!r} has no default in the model, so it cannot be left out; "
                "name its column, or give it a `value` in the model's document"
            )


def _find(table: Table, wanted: str | None, key: str, model: Model) -> tuple[Column, str | None] | None:
    """The column of an input or output and its unit; None for one that the recording goes without."""
    if wanted is None:
        return None
    found = table.find(wanted)
    if found is not None:
        return found
    kind = "input" if key in model.inputs else "output"
    if kind == "input" and model.input_default(key) is not None:
        return None
    advice = f"say which one it is with columns={{{key!r}: 'name in the file'}} (command line: --columns {key}=NAME)"
    if kind == "output":
        advice += f", or that it was not recorded with columns={{{key!r}: None}} (--columns {key}=)"
    raise table.missing(wanted, f"the {kind} {key!r}", advice)


def _find_time(table: Table, mapping: Mapping[str, str | None], dt: float | None) -> tuple[Column, str | None] | None:
    """The time column and its unit; None when the samples are counted in steps of `dt`."""
    if dt is not None and not (np.isfinite(dt) and dt > 0):
        raise InputError(f"dt is {dt!r}, expected the sampling period as a positive number of seconds; correct it")
    if "t" in mapping:
        wanted = mapping["t"]
        found = None if wanted is None else table.find(wanted)
    else:
        wanted = "t"
        capital = next((c.header for c in table.columns if c.name.lower() == "time"), "time")
        found = table.find("t") or table.find("time") or table.find(capital)
    if found is None and dt is None:
        raise table.missing(
            wanted or "t",
            "the time",
            "name it with columns={'t': ...} (--columns t=NAME), or give the period with dt (--dt)",
        )
    if found is not None and dt is not None:
        raise InputError(
            f"{table.source}: dt = {dt:g} s is given, but the file has the time column {found[0].header!r}; "
            "leave dt out, or ignore the column with columns={'t': None} (--columns t=)"
        )
    return found


def _values(table: Table, column: Column, unit: str | None, key: str, model: Model) -> Array:
    """One column in the model's unit."""
    values = table.numbers(column)
    wanted = "s" if key == "t" else model.unit(key)
    if unit is None or unit == wanted:
        return values
    try:
        return values * _ltp.unit_factor(unit, wanted)
    except InputError as error:
        raise InputError(
            f"{table.source}: column {column.header!r}, wanted for {key!r} in {wanted!r}: {error}"
        ) from None


def _check_lengths(source: str, columns: Mapping[str, Array]) -> None:
    if len({len(values) for values in columns.values()}) > 1:
        found = ", ".join(f"{name!r} has {len(values)}" for name, values in columns.items())
        raise InputError(f"{source}: columns of unequal length ({found} samples); all must have one sample per instant")


def _check_count(table: Table, n: int) -> None:
    if n == 0:
        raise InputError(f"{table.source}: a header but no rows below it; one row per sample is expected")
    if n == 1:
        raise InputError(f"{table.source}: only one row (row {table.row(0)}); a recording has many, one per sample")


def _check_time(table: Table, column: Column, t: Array) -> None:
    where = f"column {column.header!r}"
    missing = np.flatnonzero(np.isnan(t))
    if missing.size:
        raise InputError(
            f"{table.source}: row {table.row(int(missing[0]))}, {where}: no time ({missing.size} such rows); "
            "remove these rows, a gap in the outputs may stay"
        )
    back = np.flatnonzero(np.diff(t) <= 0)
    if back.size:
        first = int(back[0])
        what = "stands still" if t[first + 1] == t[first] else "runs back"
        raise InputError(
            f"{table.source}: row {table.row(first + 1)}, {where}: time {what}: {float(t[first + 1])!r} s after "
            f"{float(t[first])!r} s in row {table.row(first)}; "
            "sort the rows, remove doubles, or split the file where a new run begins"
        )


def _check_known(table: Table, column: Column, values: Array) -> None:
    missing = np.flatnonzero(np.isnan(values))
    if missing.size:
        raise InputError(
            f"{table.source}: row {table.row(int(missing[0]))}, column {column.header!r}: no value of an input "
            f"({missing.size} such rows); an input must be known at every instant: fill it in, or use a part without "
            "the gap (Recording.slice, FILE@START:END)"
        )
