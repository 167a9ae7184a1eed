"""Owns the chapter beyond the thesis: feedback that is robust on the true orbits, and orbits that have no clock."""

from __future__ import annotations

import itertools
import math

import numpy as np
from matplotlib.figure import Figure

import ltp
from ltp.plots.tracking import Curve, Run, tracking
from ltp.reproduce.duyul.loops import coordinates, quiet, voltage
from ltp.reproduce.duyul.rig import SPREAD, WIDE, Rig, gain
from ltp.reproduce.duyul.thesis import PRESCRIBED, UP
from ltp.reproduce.result import Chapter, Picture, Row, Table

PERIODIC = (0, 2)  # harmonics of K0 + Re(K2 e^{2 j w t}): 12 numbers
NARROW = PRESCRIBED["4.5"].amplitude
WEIGHTS = (1.0, 1.0, 0.0, 0.0)
#: Periodic regulators: amplitude (rad), weight of the input, shift (1/s); exponent of the whole gain and of its
#: harmonics 0 and 2, worst with one parameter changed at a time, 1/s, peak feedback, V; from a separate prototype.
REGULATORS = (
    (NARROW, 1e-4, 0.0, -0.673, -0.675, -0.625, 7.4),
    (NARROW, 1e-5, 0.0, -1.01, -1.023, -0.886, 16.7),
    (NARROW, 1e-2, 1.0, -2.00, -2.015, -0.936, 15.4),
    (WIDE, 1e-4, 0.0, -0.729, -0.732, -0.645, 9.2),
    (WIDE, 1e-2, 1.0, -2.04, -2.055, -0.283, 20.0),
)
#: Robust designs: amplitude, bound on the norm of the gain; bars on the exponent, nominal and worst, and on volts.
ROBUST = (
    (NARROW, 188.0, -2.0, -0.93, 15.0),
    (WIDE, 140.0, -0.65, -0.65, 9.0),
    (WIDE, 205.0, -2.06, -0.65, 20.0),
)
MOST = 1000.0  # norm of constant gains
SAMPLES = 64  # of the orbit's rates over one period
TRANSVERSE = 1e-3  # mu of van der Pol's oscillator, whose transversal exponent is -mu


def chapter(rig: Rig) -> Chapter:
    """Periodic gains: a regulator as the baseline, and a robust design in the same Toeplitz form."""
    rows, cells = [], []
    for words, expected in (("fig 4.27", 0.110), ("table 4.3", 0.096)):
        longer = ltp.certify(
            rig.inverted, rig.orbit("4.5"), gain(words), spread={"l_p": SPREAD["l_p"]}, tolerated=False
        )
        found = next(case.slowest for case in longer.cases if case.changes["l_p"] > 0)
        rows.append(
            Row(
                f"{words} on the true orbit, pendulum 1 % longer: largest exponent",
                math.nan if found is None else found,
                "1/s",
                "not asked",
                low=expected - 0.001,
                high=expected + 0.001,
            )
        )
    for amplitude in (NARROW, WIDE):
        constant = robust(rig, amplitude, MOST, (0,))
        case = _certificate(rig, amplitude, constant).worst
        slowest = math.inf if case is None or case.slowest is None else case.slowest
        words = f"constant gain for all corners, {amplitude:g} rad, norm up to {MOST:g}: worst of its own orbits"
        rows.append(Row(words, slowest, "1/s", low=0.0))
    for amplitude, rho, shift, whole, cut, worst, volts in REGULATORS:
        full, short = (_regulator(rig, amplitude, rho, shift, harmonics) for harmonics in (None, PERIODIC))
        certificate = _certificate(rig, amplitude, full)
        single = max(
            math.inf if case.slowest is None else case.slowest
            for case in certificate.cases
            if sum(change != 0 for change in case.changes.values()) <= 1
        )
        name = f"regulator, {amplitude:g} rad, weight {rho:g}, shift {shift:g}"
        rows += [
            _near(f"{name}: exponent", certificate.slowest, whole, 0.006),
            _near("  harmonics 0 and 2 of its gain", _exact(rig, amplitude, short), cut, 0.0008),
            _near("  worst, one parameter off at a time", single, worst, 0.0008),
            Row("  peak of the feedback", certificate.runs[0].feedback["V"], "V", low=volts - 0.2, high=volts + 0.2),
        ]
        cells.append(_cells(f"{name}, whole", certificate))
    for amplitude, limit, nominal, worst, volts in ROBUST:
        feedback = robust(rig, amplitude, limit)
        certificate = _certificate(rig, amplitude, feedback)
        case = certificate.worst
        slowest = math.inf if case is None or case.slowest is None else case.slowest
        name = f"robust K0 + K2, {amplitude:g} rad, norm {limit:g}"
        steady = math.inf if certificate.orbit is None else max(certificate.orbit.error.values())
        rows += [
            Row(f"{name}: exponent of the loop's own orbit", certificate.slowest, "1/s", high=nominal),
            Row("  worst, both parameters off together", slowest, "1/s", high=worst),
            Row("  peak of the feedback", certificate.runs[0].feedback["V"], "V", high=volts),
            Row("  error that stays, nominally", 100 * steady, "%", high=1e-6),
        ]
        cells.append(_cells(name, certificate))
    rows += _transverse(rig)
    sentence = (
        "On the true orbits no constant gain was found that survives all corners of the parameters' ranges: the best "
        "for them along the nominal orbit loses the orbits its loops then have. A gain with one more harmonic does: "
        "twelve numbers, designed for the worst of all corners, beat the periodic regulator in speed and in robustness "
        "at the same voltage, and leave no error."
    )
    head = ["gain", "exponent", "worst corner", "feedback", "x settles", "error at the worst"]
    return Chapter("Beyond the thesis", sentence, rows, _pictures(rig), [], [Table("Periodic gains", head, cells)])


def robust(rig: Rig, amplitude: float, limit: float, harmonics: tuple[int, ...] = PERIODIC) -> ltp.Feedback:
    """A gain whose worst exponent over the corners of the parameters' ranges, along the nominal orbit, is least.

    A periodic one is descended to from a regulator's; a constant one, which has no such start, is searched for.
    """
    system = rig.system("4.5", True, amplitude)
    corners = itertools.product(*((-share, share) for share in SPREAD.values()))
    values = {each["name"]: float(each["value"]) for each in rig.inverted.parameters}
    variants = [
        ltp.linearize(
            rig.inverted.with_parameters(
                {name: values[name] * (1 + change) for name, change in zip(SPREAD, changes, strict=True)}
            ),
            rig.orbit("4.5", amplitude),
        )
        for changes in corners
    ]
    with quiet():
        return ltp.control(
            system,
            objective="floquet",
            harmonics=harmonics,
            variants=variants,
            start=_regulator(rig, amplitude, 1e-4, 0.0, PERIODIC) if harmonics == PERIODIC else None,
            search="local" if harmonics == PERIODIC else "global",
            limit=limit,
        )


def _regulator(rig: Rig, amplitude: float, rho: float, shift: float, harmonics: tuple[int, ...] | None) -> ltp.Feedback:
    system = rig.system("4.5", True, amplitude)
    with quiet():
        return ltp.control(
            system, "periodic-lqr", state_weights=WEIGHTS, input_weights=rho, shift=shift, harmonics=harmonics
        )


def _certificate(rig: Rig, amplitude: float, feedback: ltp.Feedback) -> ltp.Certificate:
    return ltp.certify(
        rig.inverted,
        rig.orbit("4.5", amplitude),
        feedback,
        deviations=rig.starts["up"],
        spread=SPREAD,
        tolerated=False,
    )


def _exact(rig: Rig, amplitude: float, feedback: ltp.Feedback) -> float:
    return float(rig.system("4.5", True, amplitude).closed(feedback).exponents.real.max())


def _near(what: str, ours: float, right: float, bound: float) -> Row:
    return Row(what, ours, "1/s", low=right - bound, high=right + bound, digits=4)


def _cells(name: str, certificate: ltp.Certificate) -> list[str]:
    run, case, error = certificate.runs[0], certificate.worst, certificate.worst_error
    settled = run.settled["x"]
    worst = "-" if case is None or case.slowest is None else f"{case.slowest:.3f}"
    return [
        name,
        f"{certificate.slowest:.3f}",
        worst,
        f"{run.feedback['V']:.1f} V",
        "-" if settled is None else f"{settled:.2f} s",
        f"{100 * max(error['x'], error['theta']):.0f} %",
    ]


def _transverse(rig: Rig) -> list[Row]:
    """Orbits without a clock: the phase mode is taken out, and what is left can be designed for."""
    oscillator = ltp.zoo.van_der_pol().with_parameters(mu=TRANSVERSE)
    cycle = ltp.cycle(oscillator)
    left = ltp.linearize(oscillator, cycle).transverse().system.exponents
    rows = [
        Row(
            "van der Pol, mu 0.001: transversal exponent over -mu",
            float(left.real[0]) / -TRANSVERSE,
            "",
            low=0.999,
            high=1.001,
            digits=5,
        )
    ]
    orbit = rig.orbit("4.5", WIDE)
    t = np.arange(SAMPLES) / SAMPLES * orbit.period
    k = np.arange(len(orbit.state_coefficients))[:, np.newaxis]
    lines = 2.0 * (1j * k * UP * orbit.state_coefficients)
    rates = np.real(np.exp(1j * UP * t[:, np.newaxis] * k.T) @ lines)
    with quiet():
        around = rig.system("4.5", True, WIDE).transverse(rates)
        feedback = ltp.control(
            around.system, "periodic-lqr", state_weights=(1.0, 1.0, 1.0), input_weights=1e-2, shift=0.5
        )
    closed = around.system.closed(feedback).exponents
    rows += [
        Row(
            "cart-pendulum at 0.105 rad, phase left free: transversal exponent",
            float(around.system.exponents.real.max()),
            "1/s",
            low=0.0,
        ),
        Row("  with a regulator of the three transversal states", float(closed.real.max()), "1/s", high=-0.5),
    ]
    return rows


def _pictures(rig: Rig) -> list[Picture]:
    def draw() -> Figure:
        amplitude, limit = ROBUST[1][:2]
        reference, seconds = rig.orbit("4.5", amplitude), 6.0
        stages = [(reference, robust(rig, amplitude, limit), seconds)]
        found = ltp.track(rig.inverted, stages, deviation=rig.starts["up"])
        rows = coordinates(found, f"robust gain, orbit of {amplitude:g} rad", (0.0, seconds))
        return tracking([rows, [voltage(found, "input", (0.0, seconds), {})]])

    def gains() -> Figure:
        rows = []
        for amplitude, limit, *_ in ROBUST[:2]:
            feedback = robust(rig, amplitude, limit)
            t = np.linspace(0.0, feedback.period, 201)
            values = feedback.at(t)[:, 0, :]
            rows.append(
                [
                    Run(
                        f"orbit of {amplitude:g} rad, {words}",
                        t,
                        [Curve(n, values[:, rig.inverted.states.index(n)], role) for n, role in pair.items()],
                        "gain",
                        unit,
                    )
                    for words, pair, unit in (
                        ("positions", {"x": "after", "theta": "before"}, ""),
                        ("velocities", {"v": "rival", "omega": "floor"}, ""),
                    )
                ]
            )
        return tracking(rows)

    return [
        Picture("beyond_robust", "The truly unstable orbit under the robust gain, from 1 cm and 0.05 rad off.", draw),
        Picture(
            "beyond_gains", "The robust gains over one period of the orbit: the second harmonic does the work.", gains
        ),
    ]
