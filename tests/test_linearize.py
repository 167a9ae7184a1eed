"""Owns the tests of `ltp.linearize` from Python: jumps, exact transfer functions, two routes, selections."""

from __future__ import annotations

import math

import numpy as np
import pytest

import ltp

DT = 1e-3
K_LEG = 6500.0  # N/m


@pytest.fixture(scope="module")
def hopper() -> ltp.LtpSystem:
    model = ltp.zoo.hopper()
    return ltp.linearize(model, ltp.cycle(model))


class TestHopper:
    def test_two_routes_to_the_multipliers(self, hopper: ltp.LtpSystem) -> None:
        cycle = ltp.cycle(ltp.zoo.hopper())
        np.testing.assert_allclose(np.sort(np.abs(hopper.multipliers)), np.sort(np.abs(cycle.multipliers)), atol=1e-9)

    def test_jumps_in_closed_form(self, hopper: ltp.LtpSystem) -> None:
        liftoff, touchdown = hopper.jumps
        assert (liftoff.name, touchdown.name) == ("liftoff", "touchdown")
        # Touchdown loses the toe: its speed is reset, and the body gains -(d/M) dh_t. States are h, ht, hd, htd.
        expected = np.diag([1.0, 0.0, 1.0, 0.0])
        expected[2, 1] = -12.0 / 2.7
        np.testing.assert_allclose(touchdown.state, expected, atol=1e-9)
        np.testing.assert_array_equal(touchdown.input, np.zeros((4, 1)))
        # Liftoff happens when the force crosses zero, and the input is part of that force: b = g / 8579.1 N/s.
        assert liftoff.input[3, 0] == pytest.approx(9.81 / 8579.1, rel=1e-5)

    def test_matrices_of_the_two_modes(self, hopper: ltp.LtpSystem) -> None:
        stance, flight = hopper.A(0.0), hopper.A(0.15)
        np.testing.assert_allclose(stance[2], [-K_LEG / 2.7, K_LEG / 2.7, -12 / 2.7, 12 / 2.7], rtol=1e-9)
        np.testing.assert_allclose(flight[3], [K_LEG / 0.05, -K_LEG / 0.05, 12 / 0.05, -12 / 0.05], rtol=1e-9)
        np.testing.assert_allclose(hopper.B(0.15), [[0.0], [0.0], [1 / 2.7], [-1 / 0.05]], rtol=1e-9)
        np.testing.assert_allclose(hopper.C(0.15), [[1.0, 0.0, 0.0, 0.0]], atol=1e-12)
        np.testing.assert_array_equal(hopper.D(0.15), [[0.0]])
        np.testing.assert_allclose(hopper.A(0.15), hopper.A(0.15 + 3 * hopper.period), atol=1e-9)

    def test_a_constant_shifts_by_u_over_k_and_does_nothing_else(self, hopper: ltp.LtpSystem) -> None:
        values = hopper.htf([0.0], 10).values[:, 0, 0, 0] * K_LEG
        assert abs(values[10] - 1.0) < 1e-10
        assert np.abs(np.delete(values, 10)).max() < 1e-10

    def test_a_sine_in_the_nonlinear_simulation(self, hopper: ltp.LtpSystem) -> None:
        omega, amplitude, periods, per_period = math.tau, 1e-4, 120, 330
        htf = hopper.htf([omega], 160)
        n = periods * per_period
        run = {
            a: ltp.simulate(
                ltp.zoo.hopper(), {"u_c": f"{a}*sin({omega!r}*t)"}, t_end=n * DT, dt=DT, step=DT / 4
            ).outputs
            for a in (0.0, amplitude)
        }
        late = slice(100 * per_period, n, 5)
        measured = (run[amplitude] - run[0.0])[late, 0]
        predicted = htf.steady_state(omega, amplitude, np.arange(n)[late] * DT, phase=-math.pi / 2)[:, 0]
        assert ltp.metrics.e_rms(measured, predicted) < 5e-3  # percent

    def test_simulation_agrees_with_the_transfer_functions(self, hopper: ltp.LtpSystem) -> None:
        # A smooth pulse: both routes see the same input between its samples.
        t = np.arange(20 * 330) * DT
        u = np.exp(-(((t - 1.0) / 0.1) ** 2))
        htf = hopper.htf(math.tau * np.arange(0.0, 12.0, 0.02), 60)
        simulated, predicted = hopper.simulate(u, DT), htf.predict(u, DT)
        assert simulated.shape == predicted.shape == (len(t), 1)
        assert ltp.metrics.e_rms(simulated[:, 0], predicted[:, 0]) < 0.05  # percent; harmonics beyond 60 are the rest

    def test_prediction_depends_on_the_phase_of_the_clock(self, hopper: ltp.LtpSystem) -> None:
        u = np.exp(-(((np.arange(2000) * DT - 0.5) / 0.1) ** 2))
        first, later = hopper.simulate(u, DT), hopper.simulate(u, DT, t0=0.1)
        np.testing.assert_allclose(first, hopper.simulate(u, DT, t0=hopper.period), atol=1e-12)
        assert np.abs(first - later).max() > 0.1 * np.abs(first).max()


@pytest.fixture(scope="module")
def mathieu() -> ltp.LtpSystem:
    model = ltp.zoo.mathieu()
    return ltp.linearize(model, ltp.cycle(model))


class TestSmooth:
    def test_the_harmonic_state_space_is_a_second_route(self, mathieu: ltp.LtpSystem) -> None:
        omega = [0.3, 1.7]
        exact, lifted = mathieu.htf(omega, 3), mathieu.lifted_htf(omega, 3, 20)
        np.testing.assert_allclose(lifted.values, exact.values, rtol=1e-9, atol=1e-15)

    def test_the_lift_has_the_multipliers(self, mathieu: ltp.LtpSystem) -> None:
        values = np.linalg.eigvals(mathieu.lift(12))
        # The eigenvalues that belong to no cut-off block: those nearest to the real axis.
        middle = values[np.argsort(np.abs(values.imag))[:2]]
        found = np.exp(middle * mathieu.period)
        np.testing.assert_allclose(np.sort(np.abs(found)), np.sort(np.abs(mathieu.multipliers)), rtol=1e-6)

    def test_a_system_with_jumps_is_not_lifted(self, hopper: ltp.LtpSystem) -> None:
        with pytest.raises(ltp.InputError, match="jump"):
            hopper.lift(5)


class TestSelection:
    def test_inputs_and_outputs_by_name(self, hopper: ltp.LtpSystem) -> None:
        text = ltp.zoo.text("hopper").replace("[outputs]", '[outputs]\nspeed = { value = "hd", unit = "m/s" }')
        model = ltp.Model.from_toml(text)
        cycle = ltp.cycle(model)
        both = ltp.linearize(model, cycle)
        assert both.output_names == ["speed", "h"]
        only = ltp.linearize(model, cycle, outputs=["h"], inputs=["u_c"])
        assert (only.output_names, only.C(0.1).shape) == (["h"], (1, 4))
        omega = [0.0, 4.0]
        np.testing.assert_allclose(only.htf(omega, 2).values, both.htf(omega, 2).values[:, :, 1:, :], rtol=1e-12)
        np.testing.assert_allclose(only.htf(omega, 2).values, hopper.htf(omega, 2).values, rtol=1e-6, atol=1e-12)

    def test_unknown_names(self, hopper: ltp.LtpSystem) -> None:
        model = ltp.zoo.hopper()
        cycle = ltp.cycle(model)
        with pytest.raises(ltp.InputError, match="no output 'y'; it has h"):
            ltp.linearize(model, cycle, outputs=["y"])
        with pytest.raises(ltp.InputError, match="no input 'u'; it has u_c"):
            ltp.linearize(model, cycle, inputs=["u"])


class TestRefuses:
    def test_what_cannot_be(self, hopper: ltp.LtpSystem) -> None:
        for call, message in (
            (lambda: hopper.htf([1.0], -1), "harmonics is -1"),
            (lambda: hopper.htf([2.0, 1.0], 1), "sort the frequencies"),
            (lambda: hopper.htf("high", 1), "not an array"),
            (lambda: hopper.simulate(np.zeros((5, 2)), DT), "columns"),
            (lambda: hopper.simulate([math.nan], DT), "input"),
            (lambda: hopper.simulate([1.0], 0.0), "dt"),
        ):
            with pytest.raises(ltp.InputError, match=message):
                call()

    def test_an_orbit_of_another_model(self) -> None:
        other = ltp.zoo.van_der_pol()
        with pytest.raises(ltp.InputError, match="states of the orbit"):
            ltp.linearize(ltp.zoo.hopper(), ltp.cycle(other))

    def test_no_response_where_the_orbit_itself_resonates(self) -> None:
        model = ltp.zoo.van_der_pol()
        system = ltp.linearize(model, ltp.cycle(model))
        with pytest.raises(ltp.InputError, match="multiplier"):
            system.htf([0.0], 1)
