"""Owns `Table`, the noun every file reader produces: named columns with optional units, and where each cell stands.

A table is not yet a recording: cells of a text file stay text until a column is asked for, so that a column of remarks
does no harm, and so that a wrong cell can be reported with its row.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ltp._ltp import InputError

# What people and programs write into a cell that has no value; all of them mean a gap.
_MISSING = frozenset({"", "nan", "na", "n/a", "<na>", "nat", "null", "none"})
# "theta [deg]" or "theta (deg)": the name, then the unit in brackets at the end.
_WITH_UNIT = re.compile(r"^(?P<name>.*\S)\s*(?:\[(?P<square>[^\[\]]*)\]|\((?P<round>.*)\))$")
_SHOWN = 12  # names listed in a message before "and N more"


@dataclass(frozen=True)
class Column:
    """One column: its header as written, the name and unit read from it, and its cells (text or numbers)."""

    header: str
    name: str
    unit: str | None
    cells: Sequence[str] | npt.NDArray[Any]

    @classmethod
    def named(cls, header: str, cells: Sequence[str] | npt.NDArray[Any]) -> Column:
        """A column whose header may carry a unit, as `theta [deg]`."""
        name, unit = split_unit(header)
        return cls(header, name, unit, cells)


@dataclass(frozen=True)
class Table:
    """Columns of one file or data frame.

    `rows` holds the row number of each sample as the user counts it (in a text file the line, the header being a line
    too); without it samples are counted from 1. Columns may differ in length: a MAT file also holds what is no signal.
    """

    source: str
    columns: tuple[Column, ...]
    rows: Sequence[int] | None = None

    def row(self, sample: int) -> int:
        """The row number, as the user counts it, of sample `sample` (counted from 0)."""
        return sample + 1 if self.rows is None else self.rows[sample]

    def find(self, wanted: str) -> tuple[Column, str | None] | None:
        """The column that `wanted` names, with its unit (None when nobody states one); None when there is none.

        A header that reads exactly `wanted` comes first; otherwise units in brackets are set aside on both sides and
        the names compared. Raises `InputError` when two columns fit, or when header and `wanted` state different units.
        """
        exact = [column for column in self.columns if column.header == wanted]
        if exact:
            return self._only(exact, wanted), exact[0].unit
        name, unit = split_unit(wanted)
        alike = [column for column in self.columns if name in (column.header, column.name)]
        if not alike:
            return None
        column = self._only(alike, wanted)
        if unit is not None and column.unit is not None and unit != column.unit:
            raise InputError(
                f"{self.source}: column {column.header!r} says its unit is {column.unit!r}, "
                f"the mapping {wanted!r} says {unit!r}; correct one of the two"
            )
        return column, unit if unit is not None else column.unit

    def missing(self, wanted: str, purpose: str, advice: str) -> InputError:
        """The error for a column that is not there: what it was wanted for, the nearest names, what to do."""
        names = list(dict.fromkeys(column.header for column in self.columns if column.header))
        by_lower = {name.lower(): name for header in names for name in (header, split_unit(header)[0])}
        near = difflib.get_close_matches(split_unit(wanted)[0].lower(), by_lower, n=3, cutoff=0.5)
        hint = f"; nearest: {', '.join(repr(by_lower[name]) for name in near)}" if near else ""
        more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
        found = ", ".join(repr(name) for name in names[:_SHOWN]) + more
        return InputError(f"{self.source}: no column {wanted!r} for {purpose}{hint}; the columns are {found}; {advice}")

    def numbers(self, column: Column) -> npt.NDArray[np.float64]:
        """The cells of one column as numbers, (n,); a cell without a value is NaN.

        Raises `InputError` with row and column for text, a complex or an infinite value.
        """
        cells = column.cells
        if isinstance(cells, np.ndarray) and cells.dtype.kind in "fiub":
            values = np.ascontiguousarray(cells, dtype=np.float64)
        elif isinstance(cells, np.ndarray) and cells.dtype.kind not in "OUS":
            kind = "complex numbers" if cells.dtype.kind == "c" else f"values of type {cells.dtype}"
            raise InputError(
                f"{self.source}: column {column.header!r} holds {kind}, real numbers are expected; "
                "convert it first (times: to seconds)"
            )
        else:
            values = self._parse(column, cells if not isinstance(cells, np.ndarray) else [str(c) for c in cells])
        infinite = np.flatnonzero(np.isinf(values))
        if infinite.size:
            raise InputError(
                f"{self.source}: row {self.row(int(infinite[0]))}, column {column.header!r}: infinite value "
                f"({infinite.size} in this column); every value must be finite: "
                "leave the cell empty if it was not measured"
            )
        return values

    def _parse(self, column: Column, cells: Sequence[str]) -> npt.NDArray[np.float64]:
        values = np.empty(len(cells))
        for sample, cell in enumerate(cells):
            value = as_number(cell)
            if value is None:
                if has_decimal_comma(cell):
                    advice = "write a decimal point, not a comma"
                else:
                    advice = "correct the cell, or leave it empty if it was not measured"
                raise InputError(
                    f"{self.source}: row {self.row(sample)}, column {column.header!r}: "
                    f"found the text {_short(cell)!r} where a number belongs; {advice}"
                )
            values[sample] = value
        return values

    def _only(self, columns: list[Column], wanted: str) -> Column:
        if len(columns) > 1:
            headers = ", ".join(repr(column.header) for column in columns)
            raise InputError(
                f"{self.source}: {len(columns)} columns fit {wanted!r} ({headers}); "
                "give each its own name, or name one exactly in `columns`"
            )
        return columns[0]


def split_unit(header: str) -> tuple[str, str | None]:
    """Name and unit of a header: `theta [deg]` or `theta (deg)` is ("theta", "deg"), `theta` alone ("theta", None)."""
    header = header.strip()
    match = _WITH_UNIT.match(header)
    if match is None:
        return header, None
    unit = match["square"] if match["square"] is not None else match["round"]
    return match["name"], unit.strip().replace("°", "deg") or None


def as_number(cell: str) -> float | None:
    """The number in a cell, NaN for a cell without a value, None for text."""
    try:
        # Python reads 1_000 as a thousand; in a measurement file it is a typing error.
        return float(cell) if "_" not in cell else None
    except ValueError:
        return float("nan") if cell.strip().lower() in _MISSING else None


def has_decimal_comma(cell: str) -> bool:
    """Whether the cell would be a number if its comma were a point."""
    return as_number(cell) is None and as_number(cell.replace(",", ".", 1)) is not None


def _short(text: str, limit: int = 40) -> str:
    return text if len(text) <= limit else text[: limit - 3] + "..."
