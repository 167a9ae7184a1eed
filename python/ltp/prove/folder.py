"""Owns what a proof leaves on disk: cases as files, the seal, labels, results; everything that a run needs to go on.

OUT/plan.json               which cases
OUT/cases/0007/             model.toml, train1.npz, train2.npz, test1.npz: all that a diagnosis sees
OUT/labels/0007.json        what was concealed; nobody reads it before the results stand
OUT/seal.json               SHA-256 of all labels and the salt
OUT/results/0007.json       the diagnosis
OUT/score.json, OUT/confusion.svg, OUT/confusion.png
"""

from __future__ import annotations

import hashlib
import io
import json
import secrets
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from ltp._ltp import InputError
from ltp.conceal import Concealed, Drawn
from ltp.files import write_bytes, write_text
from ltp.model import Model
from ltp.prove.plan import Task
from ltp.recording import Recording


class Folder:
    """A proof on disk. A folder that holds another plan is refused, one that holds this plan is continued."""

    def __init__(self, path: Path, tasks: Sequence[Task]) -> None:
        self.path = path
        self.tasks = list(tasks)
        text = json.dumps([asdict(task) for task in tasks], indent=0)
        plan = path / "plan.json"
        for folder in (path, path / "cases", path / "labels", path / "results"):
            folder.mkdir(parents=True, exist_ok=True)
        if plan.exists() and plan.read_text(encoding="utf-8") != text:
            raise InputError(f"{path} holds another proof (other cases or seeds); choose another --out or remove it")
        write_text(plan, text)

    def case(self, k: int) -> Path:
        """Folder of the files of a case."""
        return self.path / "cases" / f"{k:04d}"

    def label_file(self, k: int) -> Path:
        """File of the label of a case."""
        return self.path / "labels" / f"{k:04d}.json"

    def result_file(self, k: int) -> Path:
        """File of the diagnosis of a case."""
        return self.path / "results" / f"{k:04d}.json"

    def write_case(self, k: int, drawn: Drawn) -> None:
        """Write the files of a case, its label last: a case with a label is complete."""
        folder = self.case(k)
        folder.mkdir(exist_ok=True)
        write_text(folder / "model.toml", drawn.model.to_toml())
        for role, records in (("train", drawn.train), ("test", drawn.test)):
            for number, record in enumerate(records, 1):
                write_bytes(folder / f"{role}{number}.npz", _npz(record))
        write_text(self.label_file(k), drawn.label.text)

    def read_case(self, k: int) -> tuple[Model, list[Recording], list[Recording]]:
        """What a diagnosis sees: the model and recordings of a case, from its files alone."""
        return read_case(self.case(k))

    def label(self, k: int) -> Concealed:
        """Open the label of a case."""
        return Concealed.read(self.label_file(k).read_text(encoding="utf-8"))

    def seal(self) -> str:
        """The commitment to all labels: made once, checked ever after."""
        file = self.path / "seal.json"
        texts = [self.label_file(k).read_text(encoding="utf-8") for k in range(len(self.tasks))]
        if file.exists():
            tree = json.loads(file.read_text(encoding="utf-8"))
            if commitment(texts, tree["salt"]) != tree["sha256"]:
                raise InputError(f"{self.path}: the labels are not those that were sealed; remove the folder")
            return str(tree["sha256"])
        salt = secrets.token_hex(16)
        sha256 = commitment(texts, salt)
        write_text(file, json.dumps({"sha256": sha256, "salt": salt}))
        return sha256

    def result(self, k: int) -> dict[str, Any] | None:
        """The diagnosis of a case, None where there is none yet."""
        file = self.result_file(k)
        return json.loads(file.read_text(encoding="utf-8")) if file.exists() else None

    def write_result(self, k: int, text: str) -> None:
        """Keep the JSON of a diagnosis."""
        write_text(self.result_file(k), text)


def commitment(labels: Sequence[str], salt: str) -> str:
    """SHA-256 of all labels, one a line in the order of the cases, followed by the salt: 64 hexadecimal digits."""
    return hashlib.sha256(("\n".join(labels) + salt).encode()).hexdigest()


def read_case(folder: Path) -> tuple[Model, list[Recording], list[Recording]]:
    """Model and recordings from the files of a case."""
    model = Model.load(folder / "model.toml")

    def records(role: str) -> list[Recording]:
        return [Recording.read(file, model) for file in sorted(folder.glob(f"{role}*.npz"))]

    return model, records("train"), records("test")


def _npz(record: Recording) -> bytes:
    columns = dict(zip(record.input_names, record.inputs.T, strict=True))
    columns |= dict(zip(record.output_names, record.outputs.T, strict=True))
    arrays: dict[str, Any] = {"t": record.t}
    arrays |= {name: np.ascontiguousarray(values) for name, values in columns.items()}
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    return buffer.getvalue()
