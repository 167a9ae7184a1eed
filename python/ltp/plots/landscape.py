"""An objective along straight lines through the space of gains, with the designs that stand on them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from matplotlib.figure import Figure

from .decimate import Array
from .style import COLORS, hide_spines, new_figure, plain_ticks, shared_legend, styled


@dataclass(frozen=True)
class Profile:
    """Values (n,) of objectives by name over `share` (n,), the place on the line; `marks` are places with a name."""

    title: str
    share: Array
    values: Mapping[str, Array]
    marks: dict[str, float] = field(default_factory=dict)


@styled
def landscape(profiles: Sequence[Profile], *, name: str, unit: str = "1/s", height: float = 3.2) -> Figure:
    """Panels side by side, one line through the gains each."""
    figure = new_figure(height)
    grid = figure.subplots(1, len(profiles), squeeze=False)[0]
    roles = ("after", "before", "rival", "floor")
    for axes, profile in zip(grid, profiles, strict=True):
        for role, (label, values) in zip(roles, profile.values.items(), strict=False):
            axes.plot(profile.share, values, color=COLORS[role], lw=1.3, label=label)
        axes.axhline(0.0, color=COLORS["muted"], lw=0.8, zorder=1)
        for text, at in profile.marks.items():
            axes.axvline(at, color=COLORS["muted"], lw=0.8, ls=(0, (2, 2)), zorder=0)
            axes.annotate(
                text, (at, 1.0), xycoords=axes.get_xaxis_transform(), xytext=(3, -2), textcoords="offset points",
                fontsize=8, color=COLORS["muted"], va="top",
            )  # fmt: skip
        axes.set_title(profile.title, fontsize=9.0, loc="left", color=COLORS["muted"])
        axes.set_xlabel("place on the line between two gains")
        plain_ticks(axes, x=6, y=6)
        hide_spines(axes, "left", "bottom")
        axes.tick_params(axis="x", length=0)
    grid[0].set_ylabel(f"{name} ({unit})")
    shared_legend(figure, grid)
    return figure
