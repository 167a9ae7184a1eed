"""Owns the tests of `ltp.feedforward` and `ltp.Reference` from Python: figures of the thesis, names, bad input."""

from __future__ import annotations

import math

import numpy as np
import pytest

import ltp

OMEGA = 10 * math.pi


@pytest.fixture(scope="module")
def inverted() -> ltp.Model:
    return ltp.zoo.cart_pendulum().with_parameters(K_s=0.74)


def test_hanging_reference() -> None:
    found = ltp.feedforward(ltp.zoo.cart_pendulum(), "x", amplitude=0.05, omega=2 * math.pi)
    amplitude, phase = found.sinusoid("theta")
    assert amplitude == pytest.approx(0.24716, abs=6e-6)
    assert (phase + math.pi) % math.tau == pytest.approx(0.68050, abs=6e-6)
    assert max(found.defect.values()) < 1e-10
    assert found.period == pytest.approx(1.0)
    t = np.linspace(0, 1, 7)
    assert found.states(t)[:, 0] == pytest.approx(0.05 * np.sin(2 * math.pi * t), abs=1e-15)
    assert found.inputs(t).shape == (7, 1)


def test_inverted_reference_and_its_linearization(inverted: ltp.Model) -> None:
    true = ltp.feedforward(inverted, "theta", amplitude=0.1, offset=math.pi, omega=OMEGA)
    assert true.sinusoid("x") == pytest.approx((0.04003, -0.06323), abs=6e-6)
    assert true.sinusoid("V") == pytest.approx((16.8837, 2.5161), abs=5e-4)
    printed = ltp.Reference.sinusoids(inverted, OMEGA, {"x": (0.0375, -0.0769), "theta": (0.1, 0, math.pi)})
    assert printed.sinusoid("V") == pytest.approx((15.6614, 2.4914), abs=6e-4)
    assert printed.defect["omega"] > 0.05 and printed.defect["x"] < 1e-14
    # The tables of the thesis were made with 0.03752, which prints as 0.0375.
    tables = ltp.Reference.sinusoids(inverted, OMEGA, {"x": (0.03752, -0.0769), "theta": (0.1, 0, math.pi)})
    for reference, slow in ((tables, -0.2295), (true, -0.0065)):
        exponents = np.log(ltp.linearize(inverted, reference).multipliers.astype(complex)) / reference.period
        assert np.sort(exponents.real)[-2] == pytest.approx(slow, abs=6e-5)


def test_printed_input_is_taken_as_it_is(inverted: ltp.Model) -> None:
    states = {"x": (0.0375, -0.0769), "theta": (0.1, 0, math.pi)}
    found = ltp.Reference.sinusoids(inverted, OMEGA, states, inputs={"V": (14.0857, 2.6703)})
    assert found.sinusoid("V") == pytest.approx((14.0857, 2.6703))
    assert found.sinusoid("V", 3) == (0.0, 0.0)
    assert found.defect["v"] > 0.05


def test_moved_references(inverted: ltp.Model) -> None:
    true = ltp.feedforward(inverted, "theta", amplitude=0.1, offset=math.pi, omega=OMEGA)
    t = np.linspace(0, true.period, 9)
    ahead = true.ahead(phase=math.pi / 4)
    assert ahead.states(t) == pytest.approx(true.states(t + true.period / 8))
    assert ahead.inputs(t) == pytest.approx(true.inputs(t + true.period / 8))
    moved = true.shifted(x=-0.1)
    assert moved.states(t)[:, 0] == pytest.approx(true.states(t)[:, 0] - 0.1)
    assert true.with_inputs_of(ahead).inputs(t) == pytest.approx(ahead.inputs(t))
    again = ltp.Reference.series(inverted, true.period, true.state_coefficients, true.input_coefficients)
    assert again.states(t) == pytest.approx(true.states(t))


def test_bad_input(inverted: ltp.Model) -> None:
    with pytest.raises(ltp.InputError, match="theta"):
        ltp.feedforward(inverted, "tetha", amplitude=0.1, omega=OMEGA)
    with pytest.raises(ltp.InputError, match="`W`"):
        ltp.feedforward(inverted, "theta", amplitude=0.1, omega=OMEGA, input="W")
    with pytest.raises(ltp.InputError, match="harmonics"):
        ltp.feedforward(inverted, "theta", amplitude=0.1, omega=OMEGA, harmonics=0)
    with pytest.raises(ltp.InputError, match="positive"):
        ltp.feedforward(inverted, "theta", amplitude=0.1, omega=-OMEGA)
    with pytest.raises(ltp.ConvergenceError, match="no periodic motion"):
        ltp.feedforward(inverted, "theta", amplitude=0.1, offset=1.0, omega=OMEGA)
    with pytest.raises(ltp.InputError, match="theta"):
        ltp.Reference.sinusoids(inverted, OMEGA, {"x": 0.1})
    true = ltp.feedforward(inverted, "theta", amplitude=0.1, offset=math.pi, omega=OMEGA)
    with pytest.raises(ltp.InputError, match="either"):
        true.ahead()
    with pytest.raises(ltp.InputError, match="state"):
        true.shifted(y=1.0)
    with pytest.raises(ltp.InputError, match="states"):
        ltp.Reference.series(inverted, 0.2, np.zeros((2, 3)))
