"""Owns reading of data frames and mappings: anything with `.columns` and column access (pandas, polars), or a dict."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Protocol, runtime_checkable

import numpy as np

from ltp._ltp import InputError
from ltp.readers.table import Column, Table


@runtime_checkable
class Frame(Protocol):
    """What is asked of a data frame: its column names, and a column by its name."""

    @property
    def columns(self) -> Iterable[Any]:
        """The column names."""

    def __getitem__(self, name: Any) -> Any: ...


def read(frame: Frame | Mapping[str, Any], source: str) -> Table:
    """The columns of a data frame, or of a dict of arrays; `source` is what errors call it.

    Raises `InputError` for a column that is not one-dimensional, or when there is none.
    """
    names = list(frame) if isinstance(frame, Mapping) else list(frame.columns)
    if not names:
        raise InputError(f"{source}: no columns; one per signal, and one for t, are expected")
    columns = []
    for name in names:
        values = np.asarray(frame[name])
        if values.ndim != 1:
            raise InputError(
                f"{source}: column {str(name)!r} has shape {values.shape}, one dimension is expected; "
                "give each column its own name"
            )
        columns.append(Column.named(str(name), values))
    return Table(source=source, columns=tuple(columns))
