"""Owns `ltp.harmonic_map` and the nouns `HarmonicMap` and `EventTime` in Python."""

from __future__ import annotations

import json
import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ltp import _ltp
from ltp._ltp import InputError
from ltp.model import Model
from ltp.recording import Recording

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class EventTime:
    """When the events `name` of one record happened: measured minus predicted time `residual_s` (negative is early), s.

    `sd_s` is one standard deviation, `phase` that of the predicted event in the cycle, in [0, 1), `count` the number of
    events that it was measured from.
    """

    record: str
    name: str
    mode_from: str
    mode_to: str
    residual_s: float
    sd_s: float
    phase: float | None
    count: int


@dataclass(frozen=True)
class HarmonicMap:
    """Where in harmonics and frequency recordings differ from a model with a clock.

    `z` (ny, nu, 2K+1, n) is the magnitude of identified minus exact harmonic transfer functions in units of the
    standard deviation of the difference, at input frequencies `omega` (n,), rad/s, for `harmonics` (2K+1,). Its
    `mean_square` is 1 where there is noise alone; `differs` says whether it stands above. `blur` is the
    standard deviation over the size of the model's functions, both rms: smaller differences are lost in noise. `events`
    are event times.
    """

    model_name: str
    period: float
    harmonics: npt.NDArray[np.int64]
    omega: Array
    outputs: list[str]
    inputs: list[str]
    z: Array
    mean_square: float
    blur: float
    differs: bool
    events: list[EventTime]
    method: str
    sentence: str
    warnings: list[str]
    _json: str = field(repr=False, compare=False)

    def to_json(self) -> str:
        """The whole as one JSON object."""
        return self._json

    def plot(self) -> Figure:
        """The map as a picture: bright cells are where the machine is not the model."""
        from ltp.plots.harmonic_map import harmonic_map_figure  # drawing is slow to import

        return harmonic_map_figure(self)


def harmonic_map(
    model: Model,
    recordings: Recording | Sequence[Recording],
    *,
    harmonics: int = 3,
    band: float | None = None,
    hold: str = "first-order",
    progress: Callable[[str, float], None] | None = None,
) -> HarmonicMap:
    """Compare a clock-driven machine with its model harmonic by frequency, and measure when its events happen.

    recordings: of the machine on its orbit, probed by a small input; an input that repeats (`ltp.signals.multisine`)
        gives the sharpest map, since noise is then what does not repeat.
    harmonics: the largest, K; band: the largest input frequency, rad/s (default: as far as the input has power).
    hold: what inputs do between samples: "first-order", "zero-order" or "cubic".

    The model is taken at its own parameters: refit them first, or what they are off by is seen as well. Raises
    `InputError` for a model without a clock and recordings that cannot be used, `ConvergenceError` when the model has
    no periodic orbit near its start.
    """
    listed: list[Any] = [recordings] if isinstance(recordings, Recording) else list(recordings)
    for record in listed:
        if not isinstance(record, Recording):
            raise InputError(f"harmonic_map: found a {type(record).__name__}, expected recordings; use ltp.Recording")
    text = _ltp.harmonic_map(
        model._core,
        [record._core for record in listed],
        harmonics=harmonics,
        band=band,
        hold=hold,
        progress=progress,
    )
    found = from_tree(json.loads(text), text)
    known = {text for record in listed for text in record.warnings}
    for warning in found.warnings:
        if warning not in known:
            warnings.warn(f"{found.model_name}: {warning}", stacklevel=2)
    return found


def from_tree(tree: Mapping[str, Any], text: str | None = None) -> HarmonicMap:
    """A map again from its JSON, parsed; `text` is what `to_json` gives back.

    Raises `KeyError`, `TypeError` or `ValueError` for what is not the JSON of a map.
    """
    values = [
        [[[math.nan if v is None else v for v in row] for row in rows] for rows in by_input] for by_input in tree["z"]
    ]
    return HarmonicMap(
        model_name=tree["model_name"],
        period=tree["period"],
        harmonics=np.array(tree["harmonics"], dtype=np.int64),
        omega=np.array(tree["omega"], dtype=np.float64),
        outputs=tree["outputs"],
        inputs=tree["inputs"],
        z=np.array(values, dtype=np.float64),
        mean_square=math.nan if tree["mean_square"] is None else tree["mean_square"],
        blur=math.nan if tree["blur"] is None else tree["blur"],
        differs=tree["differs"],
        events=[EventTime(**event) for event in tree["events"]],
        method=tree["method"],
        sentence=tree["sentence"],
        warnings=tree["warnings"],
        _json=json.dumps(tree) if text is None else text,
    )
