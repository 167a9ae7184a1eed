"""Owns the tests of `ltp.control` from Python: designs, what judges them, gains from outside, what is refused."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import ltp


def mathieu(**parameters: float) -> ltp.LtpSystem:
    model = ltp.zoo.mathieu().with_parameters(parameters)
    return ltp.linearize(model, ltp.cycle(model))


@pytest.fixture(scope="module")
def lin() -> ltp.LtpSystem:
    """A Mathieu oscillator that is unstable by itself."""
    system = mathieu(c=0.2, k=12.0)
    assert np.abs(system.multipliers).max() > 1.2
    return system


def dense(lin: ltp.LtpSystem, gain: np.ndarray, n: int) -> np.ndarray:
    """A - N - B K, with the constant B of the oscillator."""
    return lin.lift(n) - np.kron(np.eye(2 * n + 1), lin.B(0.0) @ gain)


class TestClosedLoop:
    def test_lifted_eigenvalues_are_those_of_the_matrix(self, lin: ltp.LtpSystem) -> None:
        gain = np.array([[3.0, 1.5]])
        for n in (1, 2, 5):
            found = ltp.closed_loop_eigenvalues(lin, gain, n)
            expected = np.linalg.eigvals(dense(lin, gain, n))
            assert max(np.abs(expected - value).min() for value in found) < 1e-10
            assert np.all(np.diff(found.real) <= 0.0)

    def test_exponents_are_those_of_the_open_loop_without_gain(self, lin: ltp.LtpSystem) -> None:
        found = lin.closed(np.zeros((1, 2))).exponents
        expected = np.log(np.abs(lin.multipliers)) / lin.period
        np.testing.assert_allclose(found.real, np.sort(expected)[::-1], atol=1e-9)

    @pytest.mark.parametrize("objective", ["lifted", "floquet"])
    def test_gradients_are_differences(self, lin: ltp.LtpSystem, objective: str) -> None:
        closed = ltp.Objective(lin, objective=objective, truncation=5, modes="central", harmonics=(0, 1))
        assert closed.unknowns == 6
        x = np.array([6.0, 1.5, 0.4, -0.2, 0.3, 0.1])
        value, gradient = closed(x)
        for i in range(6):
            h = np.eye(6)[i] * 1e-5
            assert (closed(x + h)[0] - closed(x - h)[0]) / 2e-5 == pytest.approx(gradient[i], rel=1e-4, abs=1e-7)
        feedback = ltp.Feedback.from_harmonics({0: [x[:2]], 1: [x[2:4] + 1j * x[4:]]}, lin.period)
        assert lin.closed(feedback).exponents[0].real == pytest.approx(value, abs=2e-4)


class TestHarmonicBalance:
    def test_a_design_keeps_its_limit_and_its_word(self, lin: ltp.LtpSystem) -> None:
        feedback = ltp.control(lin, objective="floquet", limit=20.0, budget=5000)
        assert np.linalg.norm(feedback.gain) <= 20.0
        exact = lin.closed(feedback).exponents[0].real
        assert exact == pytest.approx(feedback.figures["exact, 1/s"], abs=1e-9)
        assert feedback.figures["objective, 1/s"] == pytest.approx(exact, rel=1e-3)
        assert exact < -2.0
        again = ltp.control(lin, objective="floquet", limit=20.0, budget=5000)
        np.testing.assert_array_equal(feedback.gain, again.gain)

    def test_more_harmonics_do_no_harm(self, lin: ltp.LtpSystem) -> None:
        one = ltp.control(lin, objective="floquet", limit=10.0, budget=5000)
        more = ltp.control(lin, objective="floquet", limit=10.0, budget=15000, harmonics=(0, 1), start=one)
        assert more.figures["exact, 1/s"] <= one.figures["exact, 1/s"]
        assert set(more.harmonics) <= {0, 1}
        t = np.array([0.0, 0.3])
        angle = np.exp(2j * np.pi * t / lin.period)
        expected = more.gain + (more.harmonics.get(1, np.zeros((1, 2))) * angle[:, None, None]).real
        np.testing.assert_allclose(more.at(t), expected, atol=1e-12)

    def test_the_worst_variant_counts(self, lin: ltp.LtpSystem) -> None:
        variants = [mathieu(c=0.2, k=11.0), mathieu(c=0.2, k=13.0)]
        feedback = ltp.control(lin, objective="floquet", limit=15.0, budget=4000, variants=variants)
        worst = max(v.closed(feedback).exponents[0].real for v in [lin, *variants])
        assert feedback.figures["exact, worst variant, 1/s"] == pytest.approx(worst, abs=1e-9)
        assert feedback.figures["objective, 1/s"] == pytest.approx(worst, rel=2e-3)

    def test_the_published_swarm(self, lin: ltp.LtpSystem) -> None:
        feedback = ltp.control(lin, limit=20.0, truncation=5, modes="central", search="swarm", budget=6000)
        assert feedback.figures["exact, 1/s"] < -1.5

    def test_without_a_limit_it_warns(self, lin: ltp.LtpSystem) -> None:
        with pytest.warns(UserWarning, match="no limit on the norm"):
            ltp.control(lin, objective="floquet", fastest=30.0, budget=2000)


class TestPeriodicRegulator:
    def test_exponents_are_below_the_shift(self, lin: ltp.LtpSystem) -> None:
        for shift in (0.0, 1.0, 3.0):
            feedback = ltp.control(lin, method="periodic-lqr", state_weights=[1.0, 0.0], input_weights=0.1, shift=shift)
            assert lin.closed(feedback).exponents[0].real < -shift
            assert feedback.figures["residual"] < 1e-8

    def test_harmonics_are_kept_or_cut(self, lin: ltp.LtpSystem) -> None:
        whole = ltp.control(lin, method="periodic-lqr", state_weights=np.eye(2), input_weights=[[0.1]])
        cut = ltp.control(lin, method="periodic-lqr", state_weights=np.eye(2), input_weights=[[0.1]], harmonics=(0, 1))
        assert set(cut.harmonics) == {0, 1}
        np.testing.assert_allclose(cut.harmonics[1], whole.harmonics[1], atol=1e-12)
        assert cut.figures["exact, whole gain, 1/s"] == whole.figures["exact, 1/s"]


class TestFeedback:
    def test_a_gain_from_outside(self) -> None:
        feedback = ltp.Feedback.constant([1.0, 2.0], period=0.5)
        np.testing.assert_array_equal(feedback.gain, [[1.0, 2.0]])
        np.testing.assert_array_equal(feedback.at(0.1), [[1.0, 2.0]])
        assert feedback.method == "given" and feedback.period == 0.5 and not feedback.warnings
        assert "harmonics [0]" in repr(feedback)

    def test_what_is_no_gain(self) -> None:
        with pytest.raises(ltp.InputError, match="period"):
            ltp.Feedback.constant([1.0], period=0.0)
        with pytest.raises(ltp.InputError, match="one shape"):
            ltp.Feedback.from_harmonics({0: [[1.0]], 1: [[1.0, 2.0]]}, 1.0)
        with pytest.raises(ltp.InputError, match="found NaN"):
            ltp.Feedback.constant([np.nan], period=1.0)


class TestBadInput:
    def test_gains_and_weights_that_do_not_fit(self, lin: ltp.LtpSystem) -> None:
        with pytest.raises(ltp.InputError, match=r"expected"):
            lin.closed([1.0, 2.0, 3.0])
        with pytest.raises(ltp.InputError, match="period of the gain"):
            lin.closed(ltp.Feedback.from_harmonics({0: [[1.0, 2.0]], 1: [[1.0, 0.0]]}, 0.7))
        with pytest.raises(ltp.InputError, match="symmetric"):
            ltp.control(lin, method="periodic-lqr", state_weights=[[1.0, 1.0], [0.0, 1.0]], input_weights=1.0)
        with pytest.raises(ltp.InputError, match="state_weights"):
            ltp.control(lin, method="periodic-lqr")

    def test_names_that_are_not_there(self, lin: ltp.LtpSystem) -> None:
        for arguments in ({"objective": "x"}, {"modes": "x"}, {"search": "x"}, {"method": "x"}):
            with pytest.raises(ltp.InputError, match="x"):
                ltp.control(lin, **arguments)

    def test_a_truncation_too_low(self, lin: ltp.LtpSystem) -> None:
        with pytest.raises(ltp.InputError, match="truncation = 0: expected at least 1"):
            ltp.control(lin, truncation=0, limit=10.0)

    def test_constraints_that_cannot_be_kept(self, lin: ltp.LtpSystem) -> None:
        with pytest.raises(ltp.InputError, match=r"constraints: .*relax"):
            ltp.control(lin, limit=1.0, slowest=500.0, budget=2000)

    def test_a_pair_that_cannot_be_stabilised(self) -> None:
        text = ltp.zoo.text("mathieu")
        # a second mass that no force reaches, and that runs away
        for old, new in (
            ("[inputs]", 'w = { value = 0.0, unit = "m" }\n\n[inputs]'),
            ("[parameters]", '[parameters]\na = { value = 0.3, unit = "1/s" }'),
            ("[flow]", '[flow]\nw = "a*w"'),
        ):
            assert old in text
            text = text.replace(old, new)
        model = ltp.Model.from_toml(text)
        lin = ltp.linearize(model, ltp.cycle(model))
        with pytest.raises(ltp.InputError, match=r"cannot be stabilised.*0\.3"):
            ltp.control(lin, limit=10.0)
        with pytest.raises(ltp.InputError, match="cannot be stabilised"):
            ltp.control(lin, method="periodic-lqr", state_weights=np.ones(3), input_weights=1.0)

    def test_jumps(self) -> None:
        model = ltp.zoo.hopper()
        lin = ltp.linearize(model, ltp.cycle(model))
        with pytest.raises(ltp.InputError, match="jumps"), warnings.catch_warnings():
            ltp.control(lin, limit=10.0)
