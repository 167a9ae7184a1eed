"""Owns reading of NumPy archives (`.npz`).

Each one-dimensional array is a column; a matrix gives `name[0]`, `name[1]`, ... counted as NumPy counts.
"""

from __future__ import annotations

import io
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ltp._ltp import InputError
from ltp.files import read_bytes
from ltp.readers.matrix import columns_of, table_of
from ltp.readers.table import Table

SUFFIXES = (".npz",)


def read(path: Path) -> Table:
    """The numeric arrays of an archive; everything else in it is ignored.

    Pickled objects are never loaded. Raises `InputError` when the file is no archive or holds no numeric array.
    """
    data = read_bytes(path)
    if not data:
        raise InputError(f"{path}: the file is empty; an archive of numpy.savez with one array per signal is expected")
    columns = []
    try:
        archive = np.load(io.BytesIO(data), allow_pickle=False)
        if not isinstance(archive, np.lib.npyio.NpzFile):
            raise ValueError("it holds a single array without a name")
        with archive:
            for name in archive.files:
                values = _array(archive, name)
                if values is not None:
                    columns += columns_of(name, values, first=0)
    except (zipfile.BadZipFile, zlib.error, EOFError, OSError, ValueError) as error:
        raise InputError(
            f"{path}: not a readable .npz archive ({error}); write it with numpy.savez, or copy the file again"
        ) from None
    return table_of(path, columns)


def _array(archive: np.lib.npyio.NpzFile, name: str) -> npt.NDArray[Any] | None:
    """One array, or None for an array of Python objects, which only pickle could read."""
    try:
        values: npt.NDArray[Any] = archive[name]
    except ValueError as error:
        if "allow_pickle" in str(error):
            return None
        raise
    return values
