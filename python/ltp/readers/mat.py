"""Owns reading of MATLAB files (`.mat`): versions 4 to 7 through scipy, version 7.3 (HDF5) through h5py.

Both are optional: scipy comes with the extra `mat`. Vectors are columns, a matrix gives `name[1]`, `name[2]`, ...
counted as MATLAB counts; structures, cells, text and scalars are ignored.
"""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np

from ltp._ltp import InputError
from ltp.files import read_bytes
from ltp.readers.matrix import columns_of, table_of
from ltp.readers.table import Column, Table

SUFFIXES = (".mat",)

_HDF5 = b"\x89HDF\r\n\x1a\n"
_NOT_SIGNALS = frozenset({b"char", b"cell", b"struct", b"function_handle", b"string", b"table"})


def read(path: Path) -> Table:
    """The numeric variables of a MAT file.

    Raises `InputError` when the file is no MAT file, holds no numeric vector, or needs a package that is not installed.
    """
    data = read_bytes(path)
    if not data:
        raise InputError(f"{path}: the file is empty; a MAT file with one variable per signal is expected")
    # A 7.3 file is HDF5 behind a user block of 512 bytes that begins with MATLAB's own words.
    if data.startswith((b"MATLAB 7.3", _HDF5)):
        return table_of(path, _read_hdf5(path))
    return table_of(path, _read_classic(path))


def _read_classic(path: Path) -> list[Column]:
    try:
        from scipy.io import loadmat
    except ImportError:
        raise InputError(
            f"{path}: reading MAT files needs scipy, which is not installed; "
            'install it with: pip install "ltp-dynamics[mat]", or save the signals as CSV'
        ) from None
    try:
        with warnings.catch_warnings():
            # About variables that share a name, such as MATLAB's own "None" objects: none of them is a signal.
            warnings.simplefilter("ignore")
            variables: dict[str, Any] = loadmat(path)
    except Exception as error:  # scipy answers damaged files with whatever its parser stumbled over
        raise InputError(
            f"{path}: not a readable MAT file ({type(error).__name__}: {error}); save it again from MATLAB, or as CSV"
        ) from None
    columns = []
    for name, values in variables.items():
        if not name.startswith("__") and isinstance(values, np.ndarray):
            columns += columns_of(name, values, first=1)
    return columns


def _read_hdf5(path: Path) -> list[Column]:
    try:
        import h5py  # type: ignore[import-not-found,import-untyped,unused-ignore]
    except ImportError:
        raise InputError(
            f"{path}: a MAT file of version 7.3 (HDF5), which needs h5py, which is not installed; "
            "install it with: pip install h5py, or save again in MATLAB with: save(..., '-v7')"
        ) from None
    columns = []
    try:
        with h5py.File(path, "r") as file:
            for name, item in file.items():
                kind = item.attrs.get("MATLAB_class")
                if isinstance(item, h5py.Dataset) and item.dtype.kind in "fiub" and kind not in _NOT_SIGNALS:
                    # MATLAB stores columns first, HDF5 rows first: a matrix arrives transposed.
                    columns += columns_of(name, np.asarray(item[()]).T, first=1)
    except OSError as error:
        raise InputError(f"{path}: not a readable HDF5 file ({error}); save it again from MATLAB, or as CSV") from None
    return columns
