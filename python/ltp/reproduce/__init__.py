"""Owns `ltp.reproduce`: published work, computed anew by the public verbs of ltp and set beside what was printed."""

from __future__ import annotations

from ltp.reproduce.hopper import hopper
from ltp.reproduce.result import Chapter, Picture, Reproduction, Row

__all__ = ["Chapter", "Picture", "Reproduction", "Row", "hopper"]
