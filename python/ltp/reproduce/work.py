"""Owns the noun `Work`: what is reproduced, chapter by chapter, and how that is performed and written down."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

from ltp.reproduce.page import Front, prepare, write
from ltp.reproduce.result import Chapter, Reproduction

Progress = Callable[[str, float], None]
Rig = TypeVar("Rig")


@dataclass(frozen=True)
class Work(Generic[Rig]):
    """A published work: the front of its page, and its chapters in order, each made on a rig that they share."""

    front: Front
    chapters: Sequence[tuple[str, Callable[[Rig], Chapter]]]

    def perform(
        self,
        rig: Rig,
        out: str | os.PathLike[str] | None,
        progress: Progress | None,
        say: Callable[[Chapter], None] | None,
    ) -> Reproduction:
        """All chapters, one after the other; the page and its figures go to the folder `out` where one is given.

        progress: called with a message and the finished fraction; say: called with each chapter when it is done.
        Raises `InputError` when `out` cannot be written to, before anything is computed.
        """
        folder = None if out is None else prepare(out, self.front)
        tell = progress or (lambda message, share: None)
        began = time.perf_counter()
        done: list[Chapter] = []
        for number, (words, make) in enumerate(self.chapters):
            tell(words, number / len(self.chapters))
            start = time.perf_counter()
            made = make(rig)
            done.append(replace(made, seconds=time.perf_counter() - start))
            if say is not None:
                say(done[-1])
        if folder is not None:
            tell("figures", 1.0)
            write(folder, self.front, Reproduction(done, time.perf_counter() - began))
        return Reproduction(done, time.perf_counter() - began)
