"""Owns the tests of linear periodic systems from Python: made, closed, lifted, decomposed, seen across an orbit."""

from __future__ import annotations

import math

import numpy as np
import pytest

import ltp

OMEGA_0 = 5.0  # rad/s, pumping frequency of the example (2.19)
PERIOD = math.tau / OMEGA_0


def dynamics(t: float) -> np.ndarray:
    """A(t) of equation (2.19) of Duyul (2018)."""
    return np.array([[0.0, 1.0], [-1.0 + math.cos(2 * OMEGA_0 * t), -1.0 + 3.0 * math.cos(OMEGA_0 * t)]])


@pytest.fixture(scope="module")
def example() -> ltp.LtpSystem:
    return ltp.LtpSystem.from_functions(PERIOD, dynamics, [[0.0], [1.0]], [[1.0, 0.0]], [[0.0]])


def lines_of_a_sine(system: ltp.LtpSystem, omega: float, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Angular frequencies and complex amplitudes of the settled output to `sin(omega t)`, over a beat of 2 pi s."""
    per_beat = round(math.tau / step)
    settle = 20 * per_beat
    t = np.arange(settle + per_beat) * (math.tau / per_beat)
    y = system.simulate(np.sin(omega * t), math.tau / per_beat)[settle:, 0]
    return np.arange(per_beat // 2 + 1, dtype=float), np.fft.rfft(y)[: per_beat // 2 + 1] / per_beat * 2.0


class TestFigure2_1:
    """Equations (2.18), (2.19): a sine through a constant system stays a sine, through a periodic one it does not."""

    OMEGA = 2.0  # rad/s: lines of the periodic system stand at |2 + 5 k|

    def test_the_constant_system_answers_at_the_frequency_of_its_input(self) -> None:
        constant = ltp.LtpSystem.from_functions(PERIOD, [[0.0, 1.0], [-1.0, -1.0]], [[0.0], [1.0]], [[1.0, 0.0]])
        omega, amplitude = lines_of_a_sine(constant, self.OMEGA, 1e-3)
        response = 1.0 / (1.0 - self.OMEGA**2 + 1j * self.OMEGA)
        np.testing.assert_allclose(amplitude[omega == self.OMEGA], -1j * response, rtol=1e-5)
        assert np.abs(amplitude[omega != self.OMEGA]).max() < 1e-6

    def test_the_periodic_system_answers_at_its_modulations_only(self, example: ltp.LtpSystem) -> None:
        omega, amplitude = lines_of_a_sine(example, self.OMEGA, 1e-3)
        htf = example.htf([self.OMEGA], 12)
        expected = np.zeros(len(omega), dtype=complex)
        for k in range(-12, 13):
            line = self.OMEGA + k * OMEGA_0
            value = -1j * htf.values[k + 12, 0, 0, 0]
            expected[round(abs(line))] += value if line > 0 else np.conj(value)
        # Straight lines between samples of the input leave (omega step)^2 / 12.
        assert np.abs(amplitude - expected).max() < 1e-6 * np.abs(expected).max()
        modulated = {abs(2 + 5 * k) for k in range(-12, 13)}
        others = [i for i in range(60) if i not in modulated]
        assert np.abs(amplitude[others]).max() < 1e-9
        # The lines of the figure: 2, and 3 and 7 beside it, then 8 and 12.
        assert all(abs(amplitude[line]) > 1e-4 for line in (2, 3, 7, 8, 12))

    def test_the_harmonic_state_space_agrees(self, example: ltp.LtpSystem) -> None:
        exact = example.htf([0.3, 2.0, 6.1], 3).values
        lifted = example.lifted_htf([0.3, 2.0, 6.1], 3, 20).values
        np.testing.assert_allclose(lifted, exact, atol=1e-12)


class TestMaking:
    def test_samples_and_functions_are_one_system(self, example: ltp.LtpSystem) -> None:
        times = np.arange(16) * PERIOD / 16
        sampled = ltp.LtpSystem.from_samples(PERIOD, [dynamics(t) for t in times], [[0.0], [1.0]], [[1.0, 0.0]])
        np.testing.assert_allclose(sampled.monodromy, example.monodromy, atol=1e-11)
        assert (sampled.state_names, sampled.input_names, sampled.output_names) == (["x1", "x2"], ["u1"], ["y1"])
        np.testing.assert_allclose(sampled.A(0.3), dynamics(0.3), atol=1e-10)

    def test_too_few_samples_are_warned_of(self) -> None:
        times = np.arange(12) * PERIOD / 12
        with pytest.warns(UserWarning, match="take more samples"):
            ltp.LtpSystem.from_samples(PERIOD, [[[math.exp(3 * math.sin(OMEGA_0 * t))]] for t in times])

    @pytest.mark.parametrize(
        ("spoiled", "message"),
        [
            ({"A": lambda t: [[math.cos(t)]]}, "not periodic"),
            ({"A": lambda t: [[abs(math.sin(OMEGA_0 * t + 0.3))]]}, "not smooth"),
            ({"A": lambda t: [[math.nan]]}, "nan|NaN"),
            ({"A": [[0.0, 1.0]]}, r"A: found shape \(1, 2\), expected \(1, 1\)"),
            ({"B": [[1.0], [2.0]]}, r"B: found shape \(2, 1\), expected \(1, 1\)"),
            ({"A": lambda t: [[0.0]] if t == 0.0 else [[0.0, 1.0]]}, "A at t"),
            ({"A": "nonsense"}, "not an array"),
            ({"period": -1.0}, "period"),
        ],
    )
    def test_what_cannot_be_is_refused(self, spoiled: dict[str, object], message: str) -> None:
        good: dict[str, object] = {"period": PERIOD, "A": lambda t: [[-1.0 + math.cos(OMEGA_0 * t)]], "B": [[1.0]]}
        ltp.LtpSystem.from_functions(**good)  # type: ignore[arg-type]
        with pytest.raises(ltp.InputError, match=message):
            ltp.LtpSystem.from_functions(**{**good, **spoiled})  # type: ignore[arg-type]

    def test_an_error_of_the_function_comes_through(self) -> None:
        def broken(t: float) -> list[list[float]]:
            if t > 0.5:
                raise KeyError("my own")
            return [[0.0]]

        with pytest.raises(KeyError, match="my own"):
            ltp.LtpSystem.from_functions(1.0, broken)


class TestFloquet:
    def test_the_decomposition_obeys_its_equations(self, example: ltp.LtpSystem) -> None:
        floquet = example.floquet()
        assert floquet.residual < 1e-11
        np.testing.assert_allclose(floquet.P(0.0), np.eye(2), atol=1e-12)
        np.testing.assert_allclose(floquet.P(0.4 + PERIOD), floquet.P(0.4), atol=1e-11)
        h = 1e-4
        for t in (0.2, 0.71, 1.1):
            slope = (floquet.P(t - 2 * h) - 8 * floquet.P(t - h) + 8 * floquet.P(t + h) - floquet.P(t + 2 * h)) / (
                12 * h
            )
            np.testing.assert_allclose(slope, dynamics(t) @ floquet.P(t) - floquet.P(t) @ floquet.A_bar, atol=1e-8)
        np.testing.assert_allclose(
            np.sort_complex(np.exp(example.exponents * PERIOD)), np.sort_complex(example.multipliers), atol=1e-12
        )

    def test_lifted_modes_tell_copies_from_artefacts(self, example: ltp.LtpSystem) -> None:
        artefacts = []
        for truncation in (6, 12, 20):
            modes = example.lifted_modes(truncation)
            assert len(modes) == (2 * truncation + 1) * 2
            assert max(m.value.real for m in modes if m.converged) == pytest.approx(-0.5, abs=1e-5)
            assert max(m.value.real for m in modes) == pytest.approx(-0.380549, abs=1e-6)
            artefacts.append(sorted(m.distance for m in modes if not m.converged))
            # Eigenvectors: what lives at the edge is an artefact, and a converged mode does not reach it.
            assert all(not m.converged for m in modes if m.edge > 1e-2)
            assert all(m.edge < 1e-4 for m in modes if m.converged)
        # The error of an artefact does not shrink with the truncation, and there are no more of them.
        assert len(artefacts[0]) == 12
        np.testing.assert_allclose(artefacts[1:], artefacts[:-1], rtol=1e-6, atol=1e-9)
        with pytest.raises(ltp.InputError, match="at least 1"):
            example.lifted_modes(0)

    def test_the_true_pumping_frequency(self, example: ltp.LtpSystem) -> None:
        double = ltp.LtpSystem.from_functions(3 * PERIOD, dynamics, [[0.0], [1.0]], [[1.0, 0.0]])
        assert (example.pumping_divisor(), double.pumping_divisor()) == (1, 3)
        assert double.shortened().period == pytest.approx(PERIOD)
        np.testing.assert_allclose(double.shortened().multipliers, example.multipliers, atol=1e-12)
        assert (example.bandwidth(), double.bandwidth()) == (2, 6)


class TestClosed:
    def test_gains_of_every_form(self, example: ltp.LtpSystem) -> None:
        constant = example.closed([[2.0, 1.0]])
        np.testing.assert_allclose(constant.A(0.1), dynamics(0.1) - [[0.0, 0.0], [2.0, 1.0]], atol=1e-10)
        gain = ltp.Feedback.from_harmonics({0: np.array([[2.0, 1.0]]), 2: np.array([[0.5 - 0.25j, 1j]])}, PERIOD)
        closed = example.closed(gain)
        for t in (0.1, 0.9):
            np.testing.assert_allclose(closed.A(t), dynamics(t) - [[0.0], [1.0]] @ gain.at(t), atol=1e-9)
        assert closed.exponents[0].real < 0.0

    def test_a_gain_of_the_wrong_shape_or_period_is_refused(self, example: ltp.LtpSystem) -> None:
        with pytest.raises(ltp.InputError, match=r"shape \(1, 3\), expected \(1, 2\)"):
            example.closed([[1.0, 2.0, 3.0]])
        with pytest.raises(ltp.InputError, match="period of the gain"):
            example.closed(ltp.Feedback.from_harmonics({0: np.ones((1, 2)), 1: np.ones((1, 2))}, 0.77 * PERIOD))


class TestTransverse:
    @pytest.mark.parametrize("mu", [0.01, 0.1, 1.0])
    def test_van_der_pol_has_one_exponent_across(self, mu: float) -> None:
        model = ltp.zoo.van_der_pol().with_parameters(mu=mu)
        cycle = ltp.cycle(model)
        system = ltp.linearize(model, cycle)
        across = system.transverse()
        assert across.system.state_names == ["xi1"]
        exponent = across.system.exponents[0]
        assert exponent.real == pytest.approx(system.exponents[1].real, abs=1e-9)
        # Andersen and Geer: the multiplier at mu = 1; to first order in mu the exponent is -mu.
        expected = math.log(8.5969506e-4) / 6.6632868593 if mu == 1.0 else -mu
        assert exponent.real == pytest.approx(expected, rel=1e-6 if mu == 1.0 else mu**2)
        assert abs(exponent.imag) < 1e-9
        for t in (0.0, 1.7, 4.4):
            np.testing.assert_allclose(across.Z(t).T @ across.Z(t), [[1.0]], atol=1e-10)
            np.testing.assert_allclose(across.Z(t).T @ across.tangent(t), [0.0], atol=1e-9)

    def test_a_gain_across_leaves_the_phase(self) -> None:
        model = ltp.zoo.van_der_pol()
        system = ltp.linearize(model, ltp.cycle(model))
        across = system.transverse()
        # Frame and input face each other and turn their backs, once a turn: only an odd harmonic acts.
        gain = ltp.Feedback.from_harmonics({0: np.array([[0.1]]), 1: np.array([[0.2 - 0.4j]])}, across.period)
        narrow = across.system.closed(gain).exponents[0].real
        assert abs(narrow - across.system.exponents[0].real) > 0.05
        whole = system.closed(across.gain(gain)).exponents.real
        np.testing.assert_allclose(np.sort(whole), np.sort([0.0, narrow]), atol=1e-7)
        constant = across.system.closed([[0.3]]).exponents[0].real
        assert constant == pytest.approx(across.system.exponents[0].real, abs=1e-7)

    def test_an_orbit_with_a_clock_has_no_phase(self, example: ltp.LtpSystem) -> None:
        with pytest.raises(ltp.InputError, match="no Floquet multiplier is one"):
            example.transverse()
        with pytest.raises(ltp.InputError, match=r"tangent: found shape \(4, 3\)"):
            example.transverse(np.ones((4, 3)))
        with pytest.warns(UserWarning, match="no motion of the system"):
            example.transverse(np.ones((8, 2)))
