"""Owns the figure of docs/recordings/sydney_walking.md: it runs its blocks and draws what they leave behind."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ltp import plots

PAGE = Path(__file__).parents[1] / "docs" / "recordings" / "sydney_walking.md"
RECORD = "SysID_data_12exp_120steps.mat"
#: Time after a step of the motor voltage at which the hip is read, s.
AFTER = 0.12


def walking(recording: Path) -> list[Figure]:
    """The page's two figures, from the recording of that name."""
    names: dict[str, Any] = {}
    for block in re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL):
        exec(block.replace(RECORD, recording.as_posix()), names)
    return [_orbit_and_action(names), _trial(names)]


def _orbit_and_action(names: dict[str, Any]) -> Figure:
    phase, orbit, model = names["phase"], names["orbit"], names["model"]
    columns = (np.rad2deg(values[:, 0]) for values in (orbit.mean, orbit.spread, orbit.standard_error))
    cycle = plots.MeanCycle("hip angle", "deg", orbit.phase, *columns)
    # Later than this before a switch, the switch would come first.
    reach = 1.1 * AFTER / phase.period
    places = np.array([p for p in np.arange(0.005, 1, 0.01) if all(p < m - reach or p > m for m in phase.marks[1:])])
    steps = [model.step_response("motor", phase=p, duration=AFTER) for p in places]
    value, sd = np.rad2deg([(step.values[-1, 0], step.sd[-1, 0]) for step in steps]).T
    name = f"hip moved {AFTER:g} s after 1 V"
    action = plots.Action(name, "deg", places, value, sd, {"the leg hanging free, experiment 1": names["free"]})
    return plots.mean_cycle(cycle, action, phase.marks)


def _trial(names: dict[str, Any]) -> Figure:
    walk, phase = names["walk"], names["phase"]
    scores = {"periodic": names["periodic"], "time-invariant": names["constant"]}
    run = int(np.argsort(names["periodic"].by_group[:, 0])[6])  # neither the best nor the worst of twelve
    times = [t for cycle in phase.cycles if cycle.run == run for t in cycle.times]
    rows = (walk.t > times[0]) & (walk.t < times[-1])
    curves = {text: np.rad2deg(score.prediction[rows, 0]) for text, score in scores.items()}
    errors = {text: np.rad2deg(score.by_group[:, 0]) for text, score in scores.items()}
    errors["stride before"] = np.rad2deg(names["periodic"].previous_by_group[:, 0])
    measured = np.rad2deg(walk.outputs[rows, 0])
    trial = plots.Trial(f"measured - predicted, run {run + 1}", "deg", walk.t[rows], measured, curves, errors)
    return plots.held_out_runs(trial)
