"""Owns the classes of effects that no data of a set-up can tell apart: each counts as one answer, with the reason.

The table is part of the score, so it is short, and every row can be derived on paper. Effects that the nominal
parameters imitate are not in it: they are not drawn.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Class:
    """Answers that count as one: labels `effect@place` of a system, and why."""

    system: str
    answers: frozenset[str]
    reason: str
    difficulties: frozenset[str] = frozenset()  # empty: all


def _class(system: str, answers: str, reason: str, *difficulties: str) -> Class:
    return Class(system, frozenset(answers.split()), reason, frozenset(difficulties))


_OFFSET = "an offset of the input is a constant force at the port that the input drives"
_LATE = "one time-invariant channel: what comes in late comes out late"
_SHORT = "to first order in frequency times time a lag is a delay; the difference is below the noise, sample by sample"

#: Input, port that it drives, outputs.
DRIVEN = {
    "cart_pendulum": ("V", "cart", ("x", "theta")),
    "pendulum": ("tau", "pivot", ("theta",)),
    "duffing": ("F", "mass", ("x",)),
    "two_mass": ("tau", "motor", ("theta_m", "theta_l")),
    "drive": ("tau", "drive", ("q",)),
    "hopper": ("u_c", "leg", ("h",)),
}

CLASSES: tuple[Class, ...] = (
    *(
        _class(system, f"input_bias@{u} constant_force@{port}", _OFFSET)
        for system, (u, port, _) in DRIVEN.items()
        if system not in ("hopper", "two_mass")
    ),
    _class(
        "hopper",
        "input_bias@u_c input_bias@u constant_force@leg output_bias@h ground_height@toe",
        "with the height alone, a constant leg force, the height of the ground, the sensor's zero and the rest length "
        "of the leg shift the same number and nothing else",
    ),
    _class(
        "two_mass",
        "constant_force@motor constant_force@load input_bias@tau",
        "a constant torque turns both masses alike; the twist that tells where it acts is a ten-thousandth of that",
    ),
    _class(
        "hopper",
        "added_mass@body added_mass@toe constant_force@body constant_force@toe parameter_error@g output_gain@h",
        "with the height alone, and masses, stiffness, drive and rest length free, only g ties lengths and forces to a "
        "scale: a wrong scale of h, a wrong g, mass without weight and weight without mass are one; at the toe a "
        "constant force lifts the whole in flight, as less g does",
    ),
    _class(
        "hopper", "input_delay@u output_delay@h", "clock and probe enter by the actuator: if it is late, all is late"
    ),
    _class(
        "two_mass",
        "output_bias@theta_m output_bias@theta_l constant_force@shaft",
        "starting angles are free, so that only the twist is off: by a constant, whatever the reason",
    ),
    _class(
        "two_mass",
        "output_gain@theta_m output_gain@theta_l",
        "a common scale of both angles is one of the inertias and dampings, which are free: only the ratio shows",
    ),
    _class(
        "cart_pendulum",
        "output_gain@x parameter_error@g",
        "with length and masses free, a common scale of x, length and g does not show in theta",
    ),
    _class("pendulum", "input_delay@tau output_delay@theta", _LATE),
    _class("drive", "input_delay@tau output_delay@q", _LATE),
    _class("pendulum", "input_lag@tau output_lag@theta", "to the size of the nonlinearity, one channel: see the delay"),
    _class("drive", "input_lag@tau output_lag@q", "a linear channel: the order of its parts does not show"),
    *(_class(system, f"input_delay@{u} input_lag@{u}", _SHORT, "buried") for system, (u, _, _) in DRIVEN.items()),
    *(
        _class(system, f"output_delay@{y} output_lag@{y}", _SHORT, "buried")
        for system, (_, _, outputs) in DRIVEN.items()
        for y in outputs
    ),
)


def alike(system: str, difficulty: str, answer: str) -> frozenset[str]:
    """All answers that count as this one, itself included."""
    found = {answer}
    for c in CLASSES:
        if c.system == system and answer in c.answers and (not c.difficulties or difficulty in c.difficulties):
            found |= c.answers
    return frozenset(found)


def same_port(system: str, kind: str, at: str, found: str) -> bool:
    """Whether a located place is that of an effect: an input and the port that it drives are one place.

    kind: what the effect acts on, by the first word of its name; sensors and parameters have no port.
    """
    u, port, _ = DRIVEN[system]
    if kind == "input":
        return found in (at, u, port)
    if at == port:
        return found in (at, u, "u")
    return found == at
