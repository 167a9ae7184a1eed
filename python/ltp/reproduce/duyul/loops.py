"""Owns the panels that show a tracked motion, and the quiet in which designs are made whose doubts the page prints."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

import ltp
from ltp.plots.tracking import Curve, Run

SHOWN = ("x", "theta")
UNITS = {"x": "m", "theta": "rad", "V": "V"}


@contextmanager
def quiet() -> Iterator[None]:
    """Without the warnings of designs that are made to be looked at."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        yield


def coordinates(
    tracked: ltp.Tracked, words: str, window: tuple[float, float], marks: Mapping[str, float] | None = None
) -> list[Run]:
    """Cart to the left and pendulum to the right, each with its reference."""
    shown = (tracked.t >= window[0]) & (tracked.t <= window[1])
    panels = []
    for name in SHOWN:
        column = tracked.state_names.index(name)
        curves = [
            Curve("motion", tracked.states[shown, column], "after"),
            Curve("reference", tracked.references[shown, column], "ink", dashed=True),
        ]
        panels.append(Run(words, tracked.t[shown], curves, name, UNITS[name], dict(marks or {})))
    return panels


def errors(
    tracked: ltp.Tracked, words: str, window: tuple[float, float], marks: Mapping[str, float] | None = None
) -> list[Run]:
    """What cart and pendulum are off their references."""
    shown = (tracked.t >= window[0]) & (tracked.t <= window[1])
    panels = []
    for name in SHOWN:
        column = tracked.state_names.index(name)
        error = tracked.states[shown, column] - tracked.references[shown, column]
        curves = [Curve("error", error, "before")]
        panels.append(Run(words, tracked.t[shown], curves, f"error of {name}", UNITS[name], dict(marks or {})))
    return panels


def voltage(tracked: ltp.Tracked, words: str, window: tuple[float, float], marks: Mapping[str, float]) -> Run:
    """The input."""
    shown = (tracked.t >= window[0]) & (tracked.t <= window[1])
    curves = [Curve("motion", tracked.inputs[shown, 0], "after")]
    return Run(words, tracked.t[shown], curves, "V", UNITS["V"], dict(marks))
