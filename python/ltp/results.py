"""Owns the results folder of `ltp.diagnose_many`: one diagnosis per JSON file, with its curves in a file beside it.

A file is written under a temporary name and then renamed, the curves before the JSON that makes them count: a folder
that a kill left behind holds whole results only.
"""

from __future__ import annotations

import hashlib
import io
import json
import math
import re
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from ltp._ltp import InputError
from ltp.diagnose import Diagnosis
from ltp.files import sweep, write_bytes, write_text

_FORMAT = 1
_ARRAY = "array:"  # stands, with its number, where an array was


class Store:
    """A folder of results. Raises `InputError` when it cannot be made."""

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            reason = error.strerror or str(error)
            raise InputError(f"results folder {self.folder}: {reason}; choose another place") from error

    def path(self, name: str) -> Path:
        """The JSON file of the job `name`; other signs than a-z, 0-9, . _ - are replaced, with a hash."""
        plain = re.sub(r"[^A-Za-z0-9._-]", "_", name)
        safe = plain == name and not name.startswith(".") and len(name) <= 100 and name == name.lower()
        suffix = "" if safe else "-" + hashlib.sha256(name.encode()).hexdigest()[:8]
        return self.folder / f"{plain.lstrip('.')[:100]}{suffix}.json"

    def save(self, name: str, fingerprint: str, diagnosis: Diagnosis, seconds: float) -> None:
        """Write a diagnosis, whole or not at all."""
        arrays: list[Any] = []
        curves = _without_arrays(diagnosis.traces, arrays)
        buffer = io.BytesIO()
        np.savez_compressed(buffer, **{str(i): array for i, array in enumerate(arrays)})
        path = self.path(name)
        write_bytes(path.with_suffix(".npz"), buffer.getvalue())
        tree = {
            "format": _FORMAT,
            "job": name,
            "fingerprint": fingerprint,
            "curves_sha256": hashlib.sha256(buffer.getvalue()).hexdigest(),
            "seconds": seconds,
            "error": None,
            "diagnosis": json.loads(diagnosis.to_json()),
            "curves": curves,
        }
        write_text(path, json.dumps(tree, allow_nan=False) + "\n")

    def save_error(self, name: str, kind: str, message: str) -> None:
        """Write why there is no diagnosis; it replaces an older result, whose inputs are no longer the job's."""
        tree = {"format": _FORMAT, "job": name, "fingerprint": None, "error": {"kind": kind, "message": message}}
        write_text(self.path(name), json.dumps(tree) + "\n")

    def load(self, name: str, fingerprint: str) -> tuple[Diagnosis, float] | None:
        """The diagnosis made from the same inputs and its seconds; None when there is none that can be read.

        What a kill left half written for this job is removed.
        """
        path = self.path(name)
        sweep(path)
        sweep(path.with_suffix(".npz"))
        try:
            tree = json.loads(path.read_text(encoding="utf-8"))
            if tree["format"] != _FORMAT or tree["job"] != name or tree["fingerprint"] != fingerprint:
                return None
            packed = path.with_suffix(".npz").read_bytes()
            if hashlib.sha256(packed).hexdigest() != tree["curves_sha256"]:
                return None
            with np.load(io.BytesIO(packed), allow_pickle=False) as arrays:
                curves = _with_arrays(tree["curves"], arrays)
            return Diagnosis.from_json(json.dumps(tree["diagnosis"]), curves), float(tree["seconds"])
        except (OSError, ValueError, KeyError, TypeError, zipfile.BadZipFile):
            return None  # a half-deleted folder, or a file of something else: the job is done again


def _without_arrays(tree: Any, arrays: list[Any]) -> Any:
    if isinstance(tree, np.ndarray) or (isinstance(tree, float) and not math.isfinite(tree)):  # JSON has no NaN
        arrays.append(tree)
        return f"{_ARRAY}{len(arrays) - 1}"
    if isinstance(tree, dict):
        return {key: _without_arrays(value, arrays) for key, value in tree.items()}
    if isinstance(tree, (list, tuple)):
        return [_without_arrays(value, arrays) for value in tree]
    return tree


def _with_arrays(tree: Any, arrays: Any) -> Any:
    if isinstance(tree, str) and tree.startswith(_ARRAY):
        array = arrays[tree[len(_ARRAY) :]]
        return array if array.ndim else array.item()
    if isinstance(tree, dict):
        return {key: _with_arrays(value, arrays) for key, value in tree.items()}
    if isinstance(tree, list):
        return [_with_arrays(value, arrays) for value in tree]
    return tree
