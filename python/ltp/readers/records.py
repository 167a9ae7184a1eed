"""Owns reading of JSON logs (`.json`).

A log is a list of objects, one per sample, or an object that holds one such list, or one list per signal. A key of the
samples is a column; a number that stands beside the list, such as a gain of the run, is a column with that value in
every row. Text, and whatever else is no number, is ignored.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from ltp._ltp import InputError
from ltp.files import read_bytes
from ltp.readers.table import Column, Table

SUFFIXES = (".json",)

_EXPECTED = "a log is a list of objects, one per sample, with or without numbers beside it, or one list per signal"


def read(path: Path) -> Table:
    """The numeric columns of a log; a sample without a key, or with null there, has a gap.

    Raises `InputError` when the file is not JSON, or holds no samples, or two lists of them.
    """
    try:
        tree = json.loads(read_bytes(path).decode("utf-8-sig"))
    except ValueError as error:
        raise InputError(f"{path}: not readable as JSON ({error}); {_EXPECTED}") from None
    beside: dict[str, Any] = {}
    if isinstance(tree, dict):
        beside = tree
        logs = [name for name, value in tree.items() if _is_log(value)]
        if len(logs) > 1:
            raise InputError(f"{path}: the lists {', '.join(map(repr, logs))} hold samples; keep one of them in a file")
        tree = tree[logs[0]] if logs else None
    signals: dict[str, Any] = {}
    if _is_log(tree):
        for key in dict.fromkeys(key for sample in tree for key in sample):
            signals[key] = [sample.get(key) for sample in tree]
    elif tree is None:
        signals = {name: value for name, value in beside.items() if isinstance(value, list)}
    columns = [Column.named(name, values) for name, cells in signals.items() if (values := _numbers(cells)) is not None]
    if not columns:
        raise InputError(f"{path}: no samples in it; {_EXPECTED}")
    rows = len(columns[0].cells)
    constants = {name: value for name, value in beside.items() if name not in signals and _is_number(value)}
    columns += [Column.named(name, np.full(rows, float(value))) for name, value in constants.items()]
    return Table(str(path), tuple(columns))


def _is_log(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(sample, dict) for sample in value)


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _numbers(cells: list[Any]) -> np.ndarray[Any, np.dtype[np.float64]] | None:
    """Numbers, truth values as 0 and 1, null as NaN; None for a column with anything else, or with nothing."""
    if not all(cell is None or isinstance(cell, (int, float)) for cell in cells) or all(c is None for c in cells):
        return None
    return np.array([np.nan if cell is None else float(cell) for cell in cells])
