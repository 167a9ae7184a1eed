"""Owns what the subcommands on harmonic transfer functions share: recordings by column, and how they are printed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ltp._ltp import InputError
from ltp.cli import text
from ltp.htf import Htf
from ltp.recording import Recording

METHODS = ("floquet", "curvature", "lines")
_SHOWN_HZ = 8  # frequencies in the table
_SHOWN_K = (0, 1, 2, -1, -2)


def recordings(
    files: Sequence[str], inputs: Sequence[str], outputs: Sequence[str], dt: float | None, minus: str | None
) -> list[Recording]:
    """Recordings with these columns, less the outputs of the one of the orbit where there is one."""
    read = [Recording.read_columns(file, inputs, outputs, dt=dt) for file in files]
    if minus is None:
        return read
    orbit = Recording.read_columns(minus, [], outputs, dt=dt)
    return [_minus(record, orbit) for record in read]


def _minus(record: Recording, orbit: Recording) -> Recording:
    n = len(record)
    if (
        len(orbit) < n
        or abs(orbit.dt - record.dt) > 1e-9 * record.dt
        or abs(orbit.t[0] - record.t[0]) > 1e-6 * record.dt
    ):
        raise InputError(
            f"--minus {orbit.name}: {len(orbit)} samples every {orbit.dt:g} s from {orbit.t[0]:g} s, expected at least "
            f"{n} every {record.dt:g} s from {record.t[0]:g} s as in {record.name}; record the orbit at the same times"
        )
    deviations = record.outputs - orbit.outputs[:n]
    columns = {name: deviations[:, i] for i, name in enumerate(record.output_names)}
    inputs = {name: record.inputs[:, i] for i, name in enumerate(record.input_names)}
    return Recording(record.t, inputs, columns, record.name)


def tree(htf: Htf) -> dict[str, Any]:
    """The JSON object: the fields of `Htf`, complex numbers as pairs."""
    values = htf.values
    return {
        "period": htf.period,
        "harmonics": htf.harmonics.tolist(),
        "omega": htf.omega.tolist(),
        "values": np.stack([values.real, values.imag], axis=-1).tolist(),
        "sd": None if htf.sd is None else htf.sd.tolist(),
        "coherence": None if htf.coherence is None else htf.coherence.tolist(),
        "method": htf.method,
        "figures": htf.figures,
        "warnings": htf.warnings,
    }


def summary(htf: Htf, inputs: Sequence[str], outputs: Sequence[str]) -> str:
    """A few frequencies of the first harmonics, magnitude and where known its sd, for each input and output."""
    rows_, width, ny, nu = htf.values.shape
    most = rows_ // 2
    chosen = np.unique(np.linspace(0, width - 1, min(width, _SHOWN_HZ)).round().astype(int))
    shown = [k for k in _SHOWN_K if abs(k) <= most]
    parts = [f"{htf.method}: harmonics -{most} to {most}, {width} frequencies up to {htf.omega[-1] / math.tau:.4g} Hz"]
    for y in range(ny):
        for u in range(nu):
            rows = [
                [f"{htf.omega[i] / math.tau:.4g}", *(_size(htf, k, int(i), y, u) for k in shown)]
                for i in chosen.tolist()
            ]
            head = ["input, Hz", *(f"|H_{k}|" for k in shown)]
            parts += ["", f"from {inputs[u]} to {outputs[y]}", text.table(head, rows, left=0)]
    return "\n".join(parts)


def _size(htf: Htf, k: int, i: int, y: int, u: int) -> str:
    row = k + len(htf.values) // 2
    value = float(abs(htf.values[row, i, y, u]))
    return f"{value:.3e}" if htf.sd is None else f"{value:.3e} +/- {htf.sd[row, i, y, u]:.0e}"
