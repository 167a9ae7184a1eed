"""Fewer points with the same picture: what a line or a cloud of a long record looks like at the width of a page."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


def envelope(t: Array, y: Array, limit: int = 2000) -> tuple[Array, Array]:
    """A line of at most ``limit`` points with the same minima, maxima and gaps as ``y`` (n,) over ``t`` (n,).

    The record is cut into equal blocks; each keeps its smallest and its largest sample, in their order, and one NaN
    where it has a gap, so that neither a spike nor an interruption is lost.
    """
    n = len(y)
    if n <= limit:
        return t, y
    gaps = ~np.isfinite(y)
    blocks = max(1, (limit - 2) // (3 if gaps.any() else 2))
    edges = np.linspace(0, n, blocks + 1).astype(np.intp)
    keep = [0, n - 1]
    for start, end in pairwise(edges):
        block, missing = y[start:end], gaps[start:end]
        if not missing.any():
            keep += [start + int(block.argmin()), start + int(block.argmax())]
            continue
        keep.append(start + int(missing.argmax()))
        if not missing.all():
            keep.append(start + int(np.where(missing, np.inf, block).argmin()))
            keep.append(start + int(np.where(missing, -np.inf, block).argmax()))
    index = np.unique(np.asarray(keep, dtype=np.intp))
    return t[index], y[index]


def thin(count: int, limit: int) -> npt.NDArray[np.intp]:
    """Indices of at most ``limit`` samples spread evenly over ``count``."""
    if count <= limit:
        return np.arange(count)
    return np.linspace(0, count - 1, max(1, limit)).astype(np.intp)


def binned_mean(x: Array, y: Array, bins: int = 24) -> tuple[Array, Array]:
    """Mean of ``y`` in equally wide bins of ``x``; zero is always an edge, since friction changes its sign there.

    Bins that hold fewer than five samples are left out. Returns the mean ``x`` and ``y`` of every bin that is kept.
    """
    good = np.isfinite(x) & np.isfinite(y)
    x, y = x[good], y[good]
    if len(x) < 5 or float(np.ptp(x)) == 0:
        return np.empty(0), np.empty(0)
    edges = np.linspace(float(x.min()), float(x.max()), bins + 1)
    if edges[0] < 0 < edges[-1]:
        edges = np.sort(np.append(np.delete(edges, int(np.abs(edges[1:-1]).argmin()) + 1), 0.0))
    which = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, len(edges) - 2)
    count = np.bincount(which, minlength=bins)
    full = count >= 5
    return (
        np.bincount(which, weights=x, minlength=bins)[full] / count[full],
        np.bincount(which, weights=y, minlength=bins)[full] / count[full],
    )


def finite_range(*series: Array) -> tuple[float, float]:
    """Smallest and largest finite value of all ``series``; (0, 0) when there is none."""
    lows = [float(s[np.isfinite(s)].min()) for s in series if np.isfinite(s).any()]
    highs = [float(s[np.isfinite(s)].max()) for s in series if np.isfinite(s).any()]
    return (min(lows), max(highs)) if lows else (0.0, 0.0)
