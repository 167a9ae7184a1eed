"""Owns the chapter on the hanging pendulum (figures 4.2 to 4.24): loops closed, references changed."""

from __future__ import annotations

import math

from matplotlib.figure import Figure

import ltp
from ltp.plots.tracking import tracking
from ltp.reproduce.duyul.loops import coordinates, errors, voltage
from ltp.reproduce.duyul.rig import Rig, gain
from ltp.reproduce.duyul.thesis import PRESCRIBED, PRINTED_THETA, PRINTED_V
from ltp.reproduce.result import Chapter, Picture, Row

SECONDS = 15.0  # of a run: whole periods, and the slowest loop has come to rest
CHANGE = 10.0  # s, when references change, as in the thesis
STEP = -0.1  # m, of the cart's position
TIMES = 0.02  # s, within which settling times of two programs agree: samples lie 0.01 s apart
#: Times (s) after which x and theta stay within 2 % of their amplitudes, from a separate prototype.
SETTLING = {"fig 4.3": (1.19, 1.08), "fig 4.7": (1.15, 0.98), "fig 4.10": (1.33, 1.19), "fig 4.23": (0.97, 3.55)}
#: Phase (rad) by the figure that shows it, and the time after which x has settled.
PHASES = {"fig 4.17": (math.pi / 4, 1.21), "fig 4.19": (math.pi / 2, 1.32), "fig 4.21": (math.pi, 1.29)}
#: Largest error (percent) of x and theta that stays with reference (4.1) or (4.2), from a separate prototype.
STEADY = {"fig 4.3": (0.22, 0.19), "fig 4.7": (0.60, 0.39), "fig 4.23": (0.01, 0.08)}


def chapter(rig: Rig) -> Chapter:
    """Everything section 4.1 shows of loops in time."""
    rows = _open(rig)
    for words, equation in (("fig 4.3", "4.1"), ("fig 4.7", "4.2"), ("fig 4.23", "4.1")):
        end = _loop(rig, equation, words).stages[-1]
        paper = "about 1.2 s" if words == "fig 4.3" else ""
        for name, expected, left in zip(("x", "theta"), SETTLING[words], STEADY[words], strict=True):
            rows.append(_settles(f"{words}: {name} settles after", end, name, paper, expected))
            steady = 100 * end.steady[name]
            rows.append(Row(f"  error of {name} that stays", steady, "%", low=left - 0.01, high=left + 0.01))
    end = _stepped(rig).stages[-1]
    for name, expected in zip(("x", "theta"), SETTLING["fig 4.10"], strict=True):
        words = f"cart asked to go {-STEP:g} m aside (fig 4.10): {name} settles after"
        rows.append(_settles(words, end, name, "tracks", expected))
    wider = _wider(rig).stages[-1]
    for name, paper, expected in (("x", "about 8 %", 8.09), ("theta", "about 8.5 %", 8.59)):
        words = f"amplitude from 5 to 7 cm under the old input (fig 4.13): error of {name}"
        rows.append(Row(words, 100 * wider.steady[name], "%", paper, low=expected - 0.05, high=expected + 0.05))
    spoiled = _wider(rig, printed_input=True).stages[-1]
    for name, expected in (("x", 12.5), ("theta", 12.6)):
        words = f"  of {name} if the input were the printed (3.9)"
        rows.append(Row(words, 100 * spoiled.steady[name], "%", low=expected - 0.1, high=expected + 0.1))
    for words, (phase, expected) in PHASES.items():
        what = f"phase ahead by {phase / math.pi:g} pi ({words}): x settles after"
        rows.append(_settles(what, _ahead(rig, phase).stages[-1], "x", "tracks", expected))
    sentence = (
        "Hanging, everything the thesis says holds: the printed gain settles in 1.2 s, follows steps of position and "
        "phase, and keeps 8 % of error when the amplitude changes and the input does not. With the printed voltage "
        "that error would be half as large again, so the thesis did not use it."
    )
    return Chapter("Hanging pendulum (section 4.1)", sentence, rows, _pictures(rig))


def _settles(what: str, end: ltp.StageOutcome, name: str, paper: str, expected: float) -> Row:
    found = end.settled[name]
    seconds = math.nan if found is None else found
    return Row(what, seconds, "s", paper, low=expected - TIMES, high=expected + TIMES)


def _loop(rig: Rig, equation: str, words: str) -> ltp.Tracked:
    return ltp.track(rig.hanging, [(rig.reference(equation), gain(words), SECONDS)], deviation=rig.starts["down"])


def _open(rig: Rig) -> list[Row]:
    """How long the pendulum takes to find its orbit under the input alone."""
    reference, found = rig.reference("4.1"), _from_rest(rig)
    column = found.state_names.index("theta")
    error = abs(found.states[:, column] - found.references[:, column])
    rows = []
    for share, expected in ((0.05, 2.28), (0.02, 3.40)):
        last = float(found.t[error > share * reference.amplitudes["theta"]][-1])
        words = f"open loop from rest (fig 4.2): theta within {100 * share:.0f} % after"
        rows.append(Row(words, last, "s", "about 3 s", low=expected - TIMES, high=expected + TIMES))
    return rows


def _from_rest(rig: Rig) -> ltp.Tracked:
    """The input alone, from rest."""
    reference = rig.reference("4.1")
    rest = {name: -value for name, value in zip(rig.hanging.states, reference.states(0.0)[0], strict=True)}
    return ltp.track(rig.hanging, [(reference, [[0.0, 0.0, 0.0, 0.0]], 8.0)], deviation=rest)


def _stepped(rig: Rig) -> ltp.Tracked:
    """Off the old place of the cart by the usual deviation when the new one is asked for."""
    deviation = {**rig.starts["down"], "x": rig.starts["down"]["x"] - STEP}
    stages = [(rig.reference("4.1").shifted(x=STEP), gain("fig 4.10"), SECONDS)]
    return ltp.track(rig.hanging, stages, deviation=deviation)


def _wider(rig: Rig, printed_input: bool = False) -> ltp.Tracked:
    """From (4.1) to (4.3) while the input of (4.1), or the printed one, goes on."""
    first, law = rig.reference("4.1"), gain("fig 4.13")
    if printed_input:
        first = rig.along("4.1", {"x": PRESCRIBED["4.1"], "theta": PRINTED_THETA["4.1"], "V": PRINTED_V})
    second = rig.reference("4.3").with_inputs_of(first)
    return ltp.track(rig.hanging, [(first, law, CHANGE), (second, law, 2 * CHANGE)])


def _ahead(rig: Rig, phase: float) -> ltp.Tracked:
    first, law = rig.reference("4.1"), gain("fig 4.17")
    return ltp.track(rig.hanging, [(first, law, CHANGE), (first.ahead(phase=phase), law, CHANGE + SECONDS)])


def _pictures(rig: Rig) -> list[Picture]:
    marks, around = {"change": CHANGE}, (CHANGE - 1.0, CHANGE + 3.0)

    def closed() -> Figure:
        found, shown = _loop(rig, "4.1", "fig 4.3"), (0.0, 3.0)
        return tracking([coordinates(found, "figure 4.3", shown), errors(found, "figure 4.4", shown)])

    def open_loop() -> Figure:
        return tracking([coordinates(_from_rest(rig), "figures 3.3 and 4.2: the input alone, from rest", (0.0, 5.0))])

    def others() -> Figure:
        rows = [
            errors(_loop(rig, equation, words), words, (0.0, 4.0))
            for words, equation in (("fig 4.7", "4.2"), ("fig 4.23", "4.1"))
        ]
        return tracking(rows)

    def step() -> Figure:
        found, shown = _stepped(rig), (0.0, 3.0)
        return tracking([coordinates(found, "figure 4.10", shown), errors(found, "figure 4.11", shown)])

    def amplitude() -> Figure:
        found = _wider(rig)
        volts = voltage(found, "input, figure 4.16", around, marks)
        rows = [coordinates(found, "figure 4.13", around, marks), errors(found, "figure 4.14", around, marks)]
        return tracking([*rows, [volts]])

    def phases() -> Figure:
        rows = []
        for words, (phase, _) in PHASES.items():
            rows.append(coordinates(_ahead(rig, phase), f"{words}: ahead by {phase / math.pi:g} pi", around, marks))
        return tracking(rows)

    return [
        Picture(
            "fig4_2_open_loop",
            "Figures 3.3 and 4.2: the pendulum finds its orbit, the cart stays off its own.",
            open_loop,
        ),
        Picture("fig4_3_closed_loop", "Figures 4.3 and 4.4: from 2 cm and 0.2 rad off the reference.", closed),
        Picture(
            "fig4_8_errors", "Figures 4.8 and 4.24: errors at 0.8 Hz, and under the gain that simulation found.", others
        ),
        Picture("fig4_10_position", "Figures 4.10 and 4.11: the cart is asked to go 10 cm aside.", step),
        Picture(
            "fig4_13_amplitude", "Figures 4.13, 4.14 and 4.16: a wider orbit under the input of the old one.", amplitude
        ),
        Picture("fig4_17_phases", "Figures 4.17 to 4.22: the reference jumps ahead.", phases),
    ]
