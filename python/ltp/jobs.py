"""Owns `Job`, one diagnosis to be made, and how the words that name models and recordings are read."""

from __future__ import annotations

import hashlib
import json
import math
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from ltp import zoo
from ltp._ltp import InputError
from ltp.files import read_bytes
from ltp.model import Model
from ltp.readers import stem
from ltp.recording import Recording

#: A recording, or where it is: a path, or `FILE@START:END` for a part of a file (s).
Source: TypeAlias = "Recording | str | os.PathLike[str]"

_ZOO = "zoo:"
_WINDOW = re.compile(r"^(?P<file>.+)@(?P<start>[^@:/\\]*):(?P<end>[^@:/\\]*)$")
#: Options that say how recordings are read, and those of the diagnosis. Threads change no bit of the answer.
_READING = ("columns", "dt")
_DIAGNOSIS = ("candidates", "hold", "seed", "threads")


@dataclass(frozen=True)
class Job:
    """One diagnosis to be made by `ltp.diagnose_many`.

    name: what the result is called; any text, each job another.
    model: a model, the path of its document, or "zoo:NAME".
    train, test: recordings or paths, one or several, as in `ltp.diagnose`; `FILE@START:END` takes a part (s). What is
        given as a path is read where the job runs, so a cluster has to see the same files; what is given as an object
        travels with the job.
    options: `candidates`, `hold`, `seed`, `threads` of `ltp.diagnose`; `columns` and `dt` of `Recording.read`.

    Raises `InputError` for an empty name, no training recording, or an unknown option.
    """

    name: str
    model: Model | str | os.PathLike[str]
    train: Source | Sequence[Source]
    test: Source | Sequence[Source] = ()
    options: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.name:
            raise InputError("a job has no name; results are found by it, so give each job one of its own")
        known = [*_DIAGNOSIS, *_READING]
        for option in self.options:
            if option not in known:
                raise InputError(f"job {self.name!r}: unknown option {option!r}; it may have {', '.join(known)}")
        if not _listed(self.train):
            raise InputError(f"job {self.name!r}: no training recording; give at least one in `train`")

    def read(self) -> tuple[Model, list[Recording], list[Recording]]:
        """The model, the training and the held-out recordings. Raises `InputError` for files that cannot be read."""
        model = self.model if isinstance(self.model, Model) else read_model(os.fspath(self.model))
        columns, dt = self.options.get("columns") or {}, self.options.get("dt")

        def opened(source: Source) -> Recording:
            if isinstance(source, Recording):
                return source
            return read_recording(os.fspath(source), model, columns, dt)

        return model, [opened(one) for one in _listed(self.train)], [opened(one) for one in _listed(self.test)]

    def diagnosis_options(self) -> dict[str, Any]:
        """The options that `ltp.diagnose` takes."""
        return {name: value for name, value in self.options.items() if name in _DIAGNOSIS}

    def fingerprint(self) -> str:
        """A hash of everything the answer depends on: documents, samples, options and the version of ltp.

        Files count by their bytes, not by their dates. Raises `InputError` for a file that cannot be read.
        """
        from ltp import __version__

        digest = hashlib.sha256()

        def add(kind: str, *parts: bytes) -> None:
            for part in (kind.encode(), *parts):
                digest.update(len(part).to_bytes(8, "little"))
                digest.update(part)

        add("ltp", __version__.encode())
        options = {name: value for name, value in self.options.items() if name != "threads"}
        add("options", json.dumps(options, sort_keys=True, default=str).encode())
        if isinstance(self.model, Model):
            add("model", self.model.to_toml().encode(), json.dumps(self.model._own).encode())
        else:
            word = os.fspath(self.model)
            add("model", word.encode() if word.startswith(_ZOO) else read_bytes(word))
        for role, sources in (("train", self.train), ("test", self.test)):
            for source in _listed(sources):
                if isinstance(source, Recording):
                    names = json.dumps([source.name, source.input_names, source.output_names])
                    arrays = (source.t, source.inputs, source.outputs)
                    add(role, names.encode(), *(np.ascontiguousarray(array).tobytes() for array in arrays))
                else:
                    file, window = split_window(os.fspath(source))
                    add(role, Path(file).name.encode(), repr(window).encode(), read_bytes(file))
        return digest.hexdigest()


def read_model(word: str, effects: Sequence[str] = ()) -> Model:
    """The model of a document's path or of `zoo:NAME`, with effects of one's own from files."""
    return zoo.load(word[len(_ZOO) :]).with_effects(effects) if word.startswith(_ZOO) else Model.load(word, effects)


def read_recording(word: str, model: Model, columns: Mapping[str, str | None], dt: float | None) -> Recording:
    """A recording from `FILE` or `FILE@START:END`, the window in seconds; either end may be left out."""
    file, window = split_window(word)
    # Parts of one file are told apart by their name.
    name = None if window is None else stem(file) + word[len(file) :]
    recording = Recording.read(file, model, columns, name, dt=dt)
    return recording if window is None else recording.slice(*window)


def split_window(word: str) -> tuple[str, tuple[float, float] | None]:
    """`FILE@START:END` as the file and the window (s); no window for a plain name, or one that is a file."""
    match = None if Path(word).exists() else _WINDOW.match(word)
    if match is None:
        return word, None
    return match["file"], (_seconds(word, match["start"], -math.inf), _seconds(word, match["end"], math.inf))


def _seconds(word: str, text: str, otherwise: float) -> float:
    try:
        value = float(text) if text.strip() else otherwise
    except ValueError:
        value = math.nan
    if math.isnan(value) or (text.strip() and math.isinf(value)):
        raise InputError(
            f"{word}: {text!r} in the window is not a number of seconds; write FILE@START:END, as run.csv@10:35.5"
        )
    return value


def _listed(sources: Source | Sequence[Source]) -> list[Source]:
    single = isinstance(sources, (Recording, str, os.PathLike))
    return [sources] if single else list(sources)  # type: ignore[arg-type, list-item]
