"""Owns the progress bar: one line on a terminal's standard error, nothing at all in a pipe."""

from __future__ import annotations

import shutil
import sys
import time
from types import TracebackType
from typing import TextIO

_WIDTH = 24  # characters of the bar itself
_PERIOD = 0.1  # s between redraws: fast enough to live, slow enough to cost nothing


class Progress:
    """A bar that is called with a message and the finished fraction in [0, 1].

    Use it in a `with` block, which clears the line at the end, whatever happened::

        with Progress() as progress:
            ltp.diagnose(model, train, progress=progress)
    """

    def __init__(self, stream: TextIO | None = None) -> None:
        self._stream = sys.stderr if stream is None else stream
        self._live = self._stream.isatty()
        self._last = float("-inf")
        self._drawn = False

    def __call__(self, message: str, fraction: float) -> None:
        """Show how far things are; most calls return at once, so that the caller may call often."""
        now = time.monotonic()
        if not self._live or (now - self._last < _PERIOD and fraction < 1.0):
            return
        self._last = now
        share = min(max(fraction, 0.0), 1.0)
        full = round(share * _WIDTH)
        line = f"[{'#' * full}{'.' * (_WIDTH - full)}] {share:4.0%} {message}"
        room = shutil.get_terminal_size().columns - 1
        self._stream.write("\r\x1b[K" + line[:room])
        self._stream.flush()
        self._drawn = True

    def clear(self) -> None:
        """Take the bar away until it is called again, so that something else can be printed."""
        if self._drawn:
            self._stream.write("\r\x1b[K")
            self._stream.flush()
            self._drawn = False

    def __enter__(self) -> Progress:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.clear()
