"""Owns the nouns of a reproduction: a row (published beside ours), a chapter of rows and pictures, and the whole."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: A dash for what is not there.
NONE = "-"


@dataclass(frozen=True)
class Row:
    """One figure: what it is, what the paper prints, what ltp finds, and between which bounds that is right.

    `floor` is what the exact harmonic transfer functions reach with as many harmonics: no estimate can be better.
    `low` and `high` are the bounds, NaN where there is none; `unit` is "%" or an SI unit, empty for pure numbers.
    """

    what: str
    ours: float
    unit: str = ""
    paper: str = ""
    floor: float = math.nan
    low: float = math.nan
    high: float = math.nan
    digits: int = 3

    @property
    def passed(self) -> bool | None:
        """Whether the figure lies within its bounds; None where it has none."""
        if math.isnan(self.low) and math.isnan(self.high):
            return None
        return bool(
            (math.isnan(self.low) or self.ours >= self.low) and (math.isnan(self.high) or self.ours <= self.high)
        )

    @property
    def bar(self) -> str:
        """The bounds in words."""
        low, high = number(self.low, self.digits), number(self.high, self.digits)
        if math.isnan(self.low):
            return NONE if math.isnan(self.high) else f"at most {high}"
        return f"at least {low}" if math.isnan(self.high) else f"{low} to {high}"

    def cells(self) -> list[str]:
        """The row as texts: what, paper, ours, floor, bar, standing."""
        ours = f"{number(self.ours, self.digits)} {self.unit}".rstrip()
        standing = {True: "yes", False: "NO", None: NONE}[self.passed]
        return [self.what, self.paper or NONE, ours, number(self.floor), self.bar, standing]

    def tree(self) -> dict[str, Any]:
        """The row for JSON."""
        return {
            "what": self.what,
            "paper": self.paper or None,
            "ours": self.ours,
            "unit": self.unit,
            "floor": self.floor,
            "bar": [self.low, self.high],
            "passed": self.passed,
        }


#: What stands above the cells of rows.
HEAD = ["", "paper", "ours", "exact", "bar", "kept"]


@dataclass(frozen=True)
class Table:
    """Printed numbers beside ours, cell by cell, where rows with a bar each would hide the pattern.

    head: what stands above the columns; cells: (rows, columns) of texts.
    """

    title: str
    head: Sequence[str]
    cells: Sequence[Sequence[str]]


@dataclass(frozen=True)
class Picture:
    """A figure that is drawn when it is wanted: a file name without suffix, a caption, and how it is drawn."""

    name: str
    caption: str
    draw: Callable[[], Figure] = field(compare=False)


@dataclass(frozen=True)
class Chapter:
    """Rows, tables and pictures that belong together; `sentence` says what is seen, `notes` what to keep in mind."""

    title: str
    sentence: str
    rows: Sequence[Row]
    pictures: Sequence[Picture] = ()
    notes: Sequence[str] = ()
    tables: Sequence[Table] = ()
    seconds: float = math.nan


@dataclass(frozen=True)
class Reproduction:
    """Everything that was reproduced: `chapters`, and the `seconds` it took."""

    chapters: Sequence[Chapter]
    seconds: float

    @property
    def rows(self) -> list[Row]:
        """All rows in order."""
        return [row for chapter in self.chapters for row in chapter.rows]

    @property
    def missed(self) -> list[Row]:
        """The rows that do not lie within their bounds."""
        return [row for row in self.rows if row.passed is False]

    @property
    def passed(self) -> bool:
        """Whether every row that has bounds lies within them."""
        return not self.missed

    def tree(self) -> dict[str, Any]:
        """Everything but the pictures, for JSON."""
        return {
            "passed": self.passed,
            "seconds": self.seconds,
            "chapters": [
                {
                    "title": chapter.title,
                    "sentence": chapter.sentence,
                    "seconds": chapter.seconds,
                    "notes": list(chapter.notes),
                    "rows": [row.tree() for row in chapter.rows],
                    "tables": [vars(table) for table in chapter.tables],
                }
                for chapter in self.chapters
            ],
        }


def number(value: float, digits: int = 3) -> str:
    """A number with `digits` significant digits, a dash for none."""
    if math.isnan(value):
        return NONE
    if value == 0:
        return "0"
    if 1e-3 <= abs(value) < 1e5:
        return f"{value:#.{digits}g}".rstrip(".")
    return f"{value:.{digits - 1}e}".replace("e-0", "e-").replace("e+0", "e+")
