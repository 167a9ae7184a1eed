"""Owns what the Python tests share: a small rig as a model document, and one good recording of it that tests spoil."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

import ltp

RIG = """
name = "rig"
description = "A carriage under a measured force"
[states]
q = { value = 0.0, unit = "m" }
v = { value = 0.0, unit = "m/s" }
[inputs]
tau = { unit = "N" }
load = { unit = "N", value = 0.5 }
[parameters]
M = { value = 10.0, sd = 1.0, unit = "kg", min = 0.1 }
b = { value = 4.0, sd = 1.0, unit = "N s/m", min = 0.0 }
[flow]
q = "v"
v = "(tau - load - b*v)/M"
[outputs]
q = { value = "q", unit = "m", column = "qm" }
v = { value = "v", unit = "m/s" }
[ports.drive]
position = "q"
velocity = "v"
acts = { v = "1/M" }
unit = "N"
"""

HEADER = ["t", "tau", "load", "qm", "v"]
SAMPLES = 20
DT = 0.1


@pytest.fixture
def rig() -> ltp.Model:
    return ltp.Model.from_toml(RIG, "rig.toml")


@pytest.fixture
def rig_file(tmp_path: Path) -> Path:
    path = tmp_path / "rig.toml"
    path.write_text(RIG, encoding="utf-8")
    return path


@pytest.fixture
def good() -> dict[str, npt.NDArray[np.float64]]:
    """Columns of a recording with nothing wrong in it: 20 samples, 0.1 s apart."""
    t = np.round(np.arange(SAMPLES) * DT, 10)
    return {"t": t, "tau": np.sin(3 * t), "load": 0.2 * np.cos(t), "qm": 0.1 * t**2, "v": 0.2 * t}


def rows_of(columns: dict[str, npt.NDArray[np.float64]]) -> list[list[str]]:
    """The columns as rows of text, header first, so that a test can spoil one cell."""
    samples = zip(*(values.tolist() for values in columns.values()), strict=True)
    return [list(columns), *([repr(value) for value in row] for row in samples)]


def write_rows(path: Path, rows: Iterable[Sequence[str]], delimiter: str = ",") -> Path:
    path.write_text("".join(delimiter.join(row) + "\n" for row in rows), encoding="utf-8")
    return path
