"""The report of a diagnosis: one HTML file that opens offline, holds its own figures and needs no script."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ltp.files import write_text

from .builder import build
from .view import View

__all__ = ["render", "write_report"]


def render(diagnosis: Mapping[str, Any], traces: Mapping[str, Any] | None = None) -> str:
    """The page for the public JSON of a diagnosis (parsed) and its traces; without traces it has no curves.

    ``diagnosis`` is what ``ltp diagnose --json`` prints; ``traces`` is a dict with ``records``, ``force`` and ``law``.
    """
    return build(View(diagnosis, traces))


def write_report(diagnosis: Any, path: str | os.PathLike[str]) -> Path:
    """Write the report of a ``Diagnosis`` to ``path`` in one step and return the path.

    An existing file is replaced only when the new one is complete. Raises ``ltp.InputError`` when the place cannot be
    written to. ``diagnosis`` needs ``to_json()`` (text or dict) and ``traces`` (a dict, or a method that gives one).
    """
    found = diagnosis.to_json()
    data = json.loads(found) if isinstance(found, str) else found
    traces = getattr(diagnosis, "traces", None)
    return write_text(path, render(data, traces() if callable(traces) else traces))
