"""Owns the chapter on the limit cycle (figure 5): events, multipliers, the other attractor."""

from __future__ import annotations

import numpy as np

import ltp
from ltp.reproduce.result import Chapter, Picture, Row
from ltp.reproduce.uyanik.rig import DT, Rig

#: Phases of liftoff and touchdown, real and imaginary part of the leading multiplier: Newton on closed-form flows.
PRINTED = (0.024890445, 0.825119006, 0.160353154, 0.832614057)
WITH_TOE = (0.025065644, 0.825120932, 0.160349014, 0.832614856)
EXACT = 1e-8  # how near to these ltp has to come

LOW_DROP = 0.25  # m: let go from rest at this height, the hopper does not begin to hop


def chapter(rig: Rig) -> Chapter:
    """The cycle as printed, with the weight of the toe in the guard, and the motion that never leaves the ground."""
    toe = ltp.Model.from_toml(ltp.zoo.text("hopper").replace('guard = "f"', 'guard = "f + m*g"'), "hopper, f + m*g")
    rows = [*_rows(rig.cycle, PRINTED, "guard as printed"), *_rows(ltp.cycle(toe), WITH_TOE, "guard f + m g")]
    low, high, hops = _grounded(rig)
    rows += [
        Row("liftoffs in the last 100 periods after a drop from 0.25 m", float(hops), low=0.0, high=0.0),
        Row("  lowest height of that motion", low, "m", low=0.1823, high=0.1825, digits=4),
        Row("  greatest height of that motion", high, "m", low=0.2094, high=0.2096, digits=4),
    ]
    sentence = (
        "One stance and one flight in every period, as in figure 5; the multipliers say that a disturbance falls to "
        "85 % in each period. A second attractor never leaves the ground: it is reported, and not fallen into."
    )
    picture = Picture(
        "fig5_limit_cycle",
        "Figure 5: the limit cycle. Left its cross-section, right one period.",
        lambda: rig.cycle.plot("h", "hd", others=["ht"]),
    )
    return Chapter("Limit cycle (figure 5)", sentence, rows, [picture], list(rig.cycle.warnings))


def _rows(cycle: ltp.LimitCycle, expected: tuple[float, ...], words: str) -> list[Row]:
    phases = {event.name: event.phase for event in cycle.events}
    leading = max(cycle.multipliers, key=lambda z: (abs(z), z.imag))
    rest = np.sort(np.abs(cycle.multipliers))[:-2]
    found = {
        "phase of liftoff": phases["liftoff"],
        "phase of touchdown": phases["touchdown"],
        "leading multiplier, real part": leading.real,
        "leading multiplier, imaginary part": abs(leading.imag),
    }
    rows = [
        Row(f"{what}, {words}", found, low=value - EXACT, high=value + EXACT, digits=9)
        for (what, found), value in zip(found.items(), expected, strict=True)
    ]
    return [*rows, Row(f"the other two multipliers, {words}", float(rest.max()), high=EXACT)]


def _grounded(rig: Rig) -> tuple[float, float, int]:
    """Lowest and greatest height, m, and the number of liftoffs, in the last 100 of 300 periods after a low drop."""
    start = {"h": LOW_DROP, "ht": LOW_DROP - rig.parameter("l0"), "hd": 0.0, "htd": 0.0}
    run = ltp.simulate(rig.model, t_end=300 * rig.period, dt=DT, initial_state=start, initial_mode="flight")
    late = run.t >= 200 * rig.period
    hops = sum(event.name == "liftoff" and event.time >= 200 * rig.period for event in run.events)
    return float(run.outputs[late, 0].min()), float(run.outputs[late, 0].max()), hops
