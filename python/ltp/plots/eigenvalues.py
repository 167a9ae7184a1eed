"""Eigenvalues in the complex plane: those of a truncated lift, the exact exponents, and what they are compared with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

from .style import COLORS, hide_spines, new_figure, plain_ticks, shared_legend, styled

Complex = npt.NDArray[np.complex128]


@dataclass(frozen=True)
class Cloud:
    """Eigenvalues (n,) with a name; `role` names a colour of `COLORS`, `marker` is one of matplotlib's."""

    name: str
    values: Complex
    role: str
    marker: str = "o"


@dataclass(frozen=True)
class Plane:
    """One panel; `strip` is the half height of the primary strip, rad/s, shaded where it is given."""

    title: str
    clouds: Sequence[Cloud]
    strip: float | None = None


@styled
def eigenvalues(planes: Sequence[Plane], *, height: float = 3.8) -> Figure:
    """Panels side by side: real part to the right, imaginary part upwards, the stability border at zero."""
    figure = new_figure(height)
    grid = figure.subplots(1, len(planes), squeeze=False)[0]
    for axes, plane in zip(grid, planes, strict=True):
        if plane.strip is not None:
            axes.axhspan(-plane.strip, plane.strip, color=COLORS["rule"], alpha=0.45, lw=0, zorder=0)
        axes.axvline(0.0, color=COLORS["muted"], lw=0.8, zorder=1)
        for z, cloud in enumerate(plane.clouds):
            open_marker = cloud.marker in "os"
            axes.plot(
                cloud.values.real, cloud.values.imag, cloud.marker, color=COLORS[cloud.role], label=cloud.name,
                ms=6.0 if open_marker else 5.0, mfc="none", mew=1.2, ls="none", zorder=3 + z,
            )  # fmt: skip
        axes.set_title(plane.title, fontsize=9.0, loc="left", color=COLORS["muted"])
        axes.set_xlabel("real part (1/s)")
        plain_ticks(axes, x=5, y=6)
        hide_spines(axes, "left", "bottom")
        axes.tick_params(axis="x", length=0)
    grid[0].set_ylabel("imaginary part (rad/s)")
    shared_legend(figure, grid)
    return figure
