"""Owns how arrays of a binary file become columns: vectors as they are, matrices column by column."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy.typing as npt

from ltp._ltp import InputError
from ltp.readers.table import Column, Table


def columns_of(name: str, values: npt.NDArray[Any], first: int) -> list[Column]:
    """The columns of one array: none for a scalar or for what is not numeric, one for a vector, k for a matrix.

    The longer side of a matrix is taken for time. Its columns are called `name[first]`, `name[first + 1]`, ...: `first`
    is the format's own custom, 0 in NumPy and 1 in MATLAB.
    """
    if values.dtype.kind not in "fiubc" or values.ndim not in (1, 2) or values.size == 1:
        return []
    if values.ndim == 1:
        return [Column.named(name, values)]
    if 1 in values.shape:
        return [Column.named(name, values.reshape(-1))]
    tall = values if values.shape[0] >= values.shape[1] else values.T
    return [Column(f"{name}[{first + k}]", f"{name}[{first + k}]", None, tall[:, k]) for k in range(tall.shape[1])]


def table_of(path: Path, columns: list[Column]) -> Table:
    """The table of a binary file; columns may differ in length until some of them are chosen.

    Raises `InputError` when there is no column at all.
    """
    if not columns:
        raise InputError(
            f"{path}: holds no numeric array with more than one sample; "
            "one array per signal, and one for t, are expected"
        )
    # Vectors first: when a name is not found, they are what the message should show.
    return Table(source=str(path), columns=tuple(sorted(columns, key=lambda column: column.header.endswith("]"))))
