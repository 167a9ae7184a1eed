"""Owns the choice of a reader: by suffix for files, by shape for data frames. One format is one file of this folder."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from ltp._ltp import InputError
from ltp.readers import delimited, frame, mat, npz, records
from ltp.readers.frame import Frame
from ltp.readers.table import Column, Table, split_unit

__all__ = ["Column", "Frame", "Table", "read_table", "split_unit", "stem"]

_READERS: dict[str, Callable[[Path], Table]] = {
    suffix: module.read for module in (delimited, npz, mat, records) for suffix in module.SUFFIXES
}


def read_table(source: str | os.PathLike[str] | Frame | Mapping[str, Any]) -> Table:
    """The table in a file, a data frame or a dict of arrays. Raises `InputError` when there is none."""
    if isinstance(source, (str, os.PathLike)):
        path = Path(source)
        suffix = _suffix(path)
        if suffix not in _READERS:
            raise InputError(
                f"{path}: no reader for {suffix or 'a name without suffix'!r}; "
                f"recordings end in {', '.join(_READERS)}: convert the file, or rename it to what it is"
            )
        return _READERS[suffix](path)
    if isinstance(source, (Mapping, Frame)):
        return frame.read(source, "dict of arrays" if isinstance(source, Mapping) else "data frame")
    raise InputError(
        f"a recording is read from a path, a data frame or a dict of arrays, found {type(source).__name__}; "
        "give one of these, or call ltp.Recording(...) with the arrays"
    )


def stem(source: str | os.PathLike[str]) -> str:
    """The file's name without folder and suffixes: `run1` for `logs/run1.csv.gz`."""
    path = Path(source)
    return path.name[: len(path.name) - len(_suffix(path))] or path.name


def _suffix(path: Path) -> str:
    suffixes = path.suffixes
    double = "".join(suffixes[-2:]).lower()
    return double if double.endswith(".gz") and len(suffixes) > 1 else path.suffix.lower()
