"""Figures of a diagnosis and of rhythmic recordings, as matplotlib ``Figure`` objects.

The report embeds them, and users may save them.

>>> from ltp import plots
>>> figure = plots.ranking([plots.Candidate("coulomb_friction at drive", 0.0, -5210.0, True, "named")])
>>> figure.savefig("ranking.pdf")                                                   # doctest: +SKIP
"""

from __future__ import annotations

from .curves import Curves, comparison, leaves_frame
from .errors import ErrorRow, errors
from .force import Force, Law, Units, axis_of, missing_force
from .parameters import Shift, absorbed
from .phase import force_over_phase
from .ranking import Candidate, ranking
from .style import COLORS
from .svg import to_svg
from .unclocked import Action, MeanCycle, Trial, held_out_runs, mean_cycle

__all__ = [
    "COLORS",
    "Action",
    "Candidate",
    "Curves",
    "ErrorRow",
    "Force",
    "Law",
    "MeanCycle",
    "Shift",
    "Trial",
    "Units",
    "absorbed",
    "axis_of",
    "comparison",
    "errors",
    "force_over_phase",
    "held_out_runs",
    "leaves_frame",
    "mean_cycle",
    "missing_force",
    "ranking",
    "to_svg",
]
