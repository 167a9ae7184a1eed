"""Owns `ltp.reproduce`: published work, computed anew by the public verbs of ltp and set beside what was printed."""

from __future__ import annotations

from ltp.reproduce.cart_pendulum import cart_pendulum
from ltp.reproduce.hopper import hopper
from ltp.reproduce.result import Chapter, Picture, Reproduction, Row, Table

__all__ = ["Chapter", "Picture", "Reproduction", "Row", "Table", "cart_pendulum", "hopper"]
