"""Owns the tests of `ltp.signals` and `ltp.metrics`: the signals of the paper, laws of multisines, predicted bands.

What the formulas give is tested in the core; here stands what a user of Python relies on.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import ltp
from ltp import metrics, signals

Array = npt.NDArray[np.float64]
TAU = 2 * np.pi
T = 0.33
PAPER: dict[str, Any] = {"amplitude": 0.1, "t_end": 462.0}


class TestPaper:
    @pytest.mark.parametrize("hertz", [5.0, 10.0])
    def test_chirps_of_equations_18_and_19(self, hertz: float) -> None:
        u = signals.phase_shifted_chirps(T, TAU * hertz, 20.0, **PAPER)
        t = np.arange(462_001) * 1e-3
        slot = np.arange(462_001) // 20_000
        ti = t - slot * 20.0 + slot * T / 21
        expected = np.where(slot < 21, 0.1 * np.sin(np.pi * hertz / 20.0 * ti**2), 0.0)
        np.testing.assert_allclose(u, expected, atol=1e-11)

    def test_even_timing_cuts_no_chirp(self) -> None:
        single = signals.chirp(TAU * 5, 20.0)
        u = signals.phase_shifted_chirps(0.32, TAU * 5, 20.0, repetitions=4, timing="even")
        # Slots of 64 periods, 20.48 s, hold the 20 s and a shift of up to 0.24 s.
        assert u.shape == (4 * 20_480 + 1,)
        for i in range(4):
            start = i * (20_480 + 80)
            np.testing.assert_allclose(u[start : start + 20_000], single[:20_000], atol=1e-11)

    def test_noise_of_equations_21_and_22(self) -> None:
        x = signals.sine(TAU, t_end=20.0)
        noisy, sd = signals.add_noise(x, 12.5, seed=1)
        assert sd == pytest.approx(np.sqrt(np.mean(x**2) / 12.5), rel=1e-12)
        assert np.std(noisy - x) == pytest.approx(sd, rel=4 / np.sqrt(2 * x.size))
        np.testing.assert_array_equal(noisy, signals.add_noise(x, 12.5, seed=1)[0])

    def test_e_rms_of_equation_20(self) -> None:
        y = np.array([3.0, -4.0, np.nan, 0.0])
        assert metrics.e_rms(y, [0.0, 0.0, 1.0, 0.0]) == 100.0
        assert metrics.e_rms(y, [3.0, 0.0, 1.0, 3.0]) == pytest.approx(100.0)
        assert metrics.e_rms(2 * y, y) == pytest.approx(50.0)
        assert metrics.rms_error([1.0, 2.0], [1.0, 0.0]) == pytest.approx(np.sqrt(2.0))
        assert metrics.relative_rms([1.0, -1.0], [0.0, 0.0]) == 1.0


class TestGrid:
    def test_samples_are_those_that_simulate_takes(self, rig: ltp.Model) -> None:
        u = signals.step(amplitude=2.0, start=0.3, end=0.6, t_end=0.9, dt=0.1)
        run = ltp.simulate(rig, {"tau": u}, t_end=0.9, dt=0.1)
        np.testing.assert_array_equal(run.inputs[:, 0], [0, 0, 0, 2, 2, 2, 0, 0, 0, 0])

    def test_a_sine(self) -> None:
        t = np.arange(31) * 0.1
        np.testing.assert_allclose(
            signals.sine(2.0, amplitude=3.0, phase=0.5, t_end=3.0, dt=0.1), 3 * np.sin(2 * t + 0.5), atol=1e-14
        )

    def test_a_chirp_is_followed_by_silence(self) -> None:
        u = signals.chirp((1.0, 9.0), 2.0, t_end=3.0, dt=0.01)
        t = np.arange(200) * 0.01
        np.testing.assert_allclose(u[:200], np.sin(t + 2 * t**2), atol=1e-13)
        assert not u[200:].any()


class TestMultisine:
    @settings(deadline=None, max_examples=40)
    @given(st.integers(2, 80), st.integers(1, 60), st.integers(4, 300), st.integers(0, 2**32))
    def test_every_output_line_has_one_source(self, half: int, low: int, width: int, seed: int) -> None:
        n = 2 * half
        band = (TAU * low / (n * T), TAU * (low + width) / (n * T))
        signal = signals.multisine(T, band, n, rms=0.2, low_crest=False, seed=seed)
        residues = [min(b % n, n - b % n) for b in signal.lines.tolist()]
        assert len(set(residues)) == len(residues)
        assert (signal.lines % 2 == 1).all() and not {0, half} & set(residues)
        assert signal.rms == pytest.approx(0.2, rel=1e-12)

    @settings(deadline=None, max_examples=20)
    @given(st.integers(0, 2**32), st.integers(3, 60))
    def test_the_crest_is_never_worse_than_random(self, seed: int, count: int) -> None:
        crests = [
            signals.multisine(
                1.0, TAU, 400, lines="full", half_pumping="any", count=count, low_crest=low, seed=seed
            ).crest
            for low in (True, False)
        ]
        assert crests[0] <= crests[1]

    def test_samples_show_lines_amplitudes_and_phases(self) -> None:
        signal = signals.multisine(0.5, TAU * 3, 40, weights=lambda omega: 1 / (1 + omega), rms=0.3)
        x = signal.samples(t_end=20.0, dt=0.01)
        assert x[0] == pytest.approx(x[-1], abs=1e-12)
        spectrum = np.fft.rfft(x[:-1]) * 2 / 2000
        expected = np.zeros(1001, dtype=complex)
        expected[signal.lines] = signal.amplitudes * np.exp(1j * signal.phases)
        np.testing.assert_allclose(spectrum, expected, atol=1e-13)
        np.testing.assert_allclose(signal.amplitudes[0] / signal.amplitudes, (1 + signal.omega) / (1 + signal.omega[0]))

    def test_half_the_pumping_frequency(self) -> None:
        on = signals.multisine(T, TAU * 5, 40, lines="full", half_pumping="on")
        np.testing.assert_allclose(on.omega, np.arange(1, 4) * np.pi / T)
        off = signals.multisine(T, TAU * 5, 40, lines="full")
        assert not set(on.lines.tolist()) & set(off.lines.tolist())

    def test_one_can_be_built_from_its_lines(self) -> None:
        signal = signals.multisine(T, TAU * 5, 40)
        again = signals.Multisine(signal.period, signal.lines, signal.amplitudes, signal.phases)
        np.testing.assert_array_equal(again.samples(t_end=1.0), signal.samples(t_end=1.0))
        assert again.lines.dtype == np.int64 and again.omega.shape == again.amplitudes.shape


class Filter:
    """`y = (1 + 0.8 cos(w_p t)) x`, `x' = -3 x + u`, with the face of a linearization."""

    period = 0.5
    multipliers = np.array([np.exp(-1.5)])

    def htf(self, omega: Array, harmonics: int) -> SimpleNamespace:
        values = np.zeros((2 * harmonics + 1, omega.size, 1, 1), dtype=complex)
        values[harmonics, :, 0, 0] = 1 / (1j * omega + 3)
        for k in (-1, 1):
            values[harmonics + k] = 0.4 * values[harmonics]
        return SimpleNamespace(values=values)

    def simulate(self, u: Array, dt: float, substeps: int = 4) -> Array:
        """The filter on straight lines through the samples, exactly; from rest."""
        decay = np.exp(-3 * dt)
        first = (1 - decay) / 3
        slope = (dt - first) / 3
        x = np.zeros(u.size)
        for i in range(1, u.size):
            x[i] = decay * x[i - 1] + first * u[i - 1] + slope * (u[i] - u[i - 1]) / dt
        return (1 + 0.8 * np.cos(TAU / self.period * np.arange(u.size) * dt)) * x


class TestDesign:
    def test_the_hopper_s_experiment_from_its_pumping_frequency(self) -> None:
        design = signals.design(TAU / T, TAU * 5, 462.0, noise_sd=1e-5)
        assert (design.cycles, design.repeats) == (1300, 1)
        assert (design.settle, design.record) == (pytest.approx(33.0), pytest.approx(429.0))
        assert design.samples().shape == (462_001,)
        assert design.omega[-1] == pytest.approx(TAU * 5.25, rel=2e-3)
        # sd = 2 s / (a sqrt(N)), and the disc of 95 %.
        np.testing.assert_allclose(design.sd, 2e-5 / design.multisine.amplitudes / np.sqrt(429_000), rtol=1e-12)
        np.testing.assert_allclose(design.band, np.sqrt(np.log(20)) * design.sd, rtol=1e-12)
        assert "95 % disc" in str(design)

    def test_a_linearization_gives_gain_settling_and_noise(self) -> None:
        design = signals.design(Filter(), TAU * 3, 45.0, dt=0.01, snr=5.0, shape=1.0)
        # exp(-1.5)^n is below 1e-7 first for n = 11.
        assert design.settle == pytest.approx(11 * 0.5)
        np.testing.assert_allclose(design.gain, np.sqrt(1.32) / np.abs(1j * design.omega + 3), rtol=1e-12)
        assert design.gain is not None
        relative = design.sd / design.gain
        np.testing.assert_allclose(relative, relative[0], rtol=1e-12)

    def test_predicted_bands_hold_in_experiments(self) -> None:
        system = Filter()
        design = signals.design(system, TAU * 2, 50.0, dt=0.005, snr=10.0)
        clean = system.simulate(design.samples(), design.dt)
        start, n = round(design.settle / design.dt), round(design.record / design.dt)
        u = np.fft.rfft(design.samples()[start : start + n])[design.multisine.lines]
        omega, ratios = design.omega, []
        # Straight lines between samples are the sum of cosines times sinc^2: the gain of the hold, not of the filter.
        hold = np.sinc(omega * design.dt / TAU) ** 2
        for seed in range(25):
            y = clean + signals.noise(clean.size, float(design.noise_sd or 0.0), seed=seed)
            spectrum = np.fft.rfft(y[start : start + n])
            for k, weight in ((0, 1.0), (1, 0.4), (3, 0.0)):
                found = spectrum[design.multisine.lines + k * design.cycles] / u
                ratios.append(np.abs(found - weight * hold / (1j * omega + 3)) ** 2 / design.sd**2)
        # Exponential with mean one; what aliases through the hold is 2e-6 of the deviation.
        mean, inside = np.mean(ratios), np.mean(np.array(ratios) <= np.log(20))
        count = np.size(ratios)
        assert mean == pytest.approx(1.0, abs=4 / np.sqrt(count))
        assert inside == pytest.approx(0.95, abs=4 * np.sqrt(0.05 * 0.95 / count))

    def test_one_of_several_inputs_and_outputs_is_chosen(self) -> None:
        class Two(Filter):
            def htf(self, omega: Array, harmonics: int) -> SimpleNamespace:
                values = super().htf(omega, harmonics).values
                rows = np.concatenate([values, 2 * values], axis=2)
                return SimpleNamespace(values=np.concatenate([rows, 3 * rows], axis=3))

        def gain(system: Any, **chosen: Any) -> Array:
            found = signals.design(system, TAU * 3, 45.0, dt=0.01, **chosen).gain
            assert found is not None
            return found

        np.testing.assert_allclose(gain(Two(), input=1, output=1), 6 * gain(Filter()))
        with pytest.raises(ltp.InputError, match="2 outputs and none was chosen"):
            gain(Two(), input=0)
        with pytest.raises(ltp.InputError, match="1 inputs and number 1 was"):
            gain(Filter(), input=1)
        with pytest.raises(ltp.InputError, match="no 'h' among the outputs; they have numbers"):
            gain(Filter(), output="h")

    def test_a_pilot_s_transfer_functions_are_enough(self) -> None:
        omega = np.linspace(0.0, TAU * 2, 400)
        pilot = ltp.Htf(Filter().htf(omega, 2).values, omega, Filter.period)
        design = signals.design(pilot, TAU * 2, 100.0, dt=0.01, snr=5.0)
        exact = signals.design(Filter(), TAU * 2, 100.0, dt=0.01, snr=5.0, settle=20)
        np.testing.assert_array_equal(design.omega, exact.omega)
        assert design.gain is not None and exact.gain is not None
        inside = design.omega <= omega[-1]
        np.testing.assert_allclose(design.gain[inside], exact.gain[inside], rtol=1e-6)
        # The lines go 5 % past the pilot's band: there the gain at its end is taken.
        assert not inside[-1]
        assert design.gain[-1] == pytest.approx(np.sqrt(1.32) / abs(2j * TAU + 3), rel=1e-9)

    def test_a_pilot_s_gain_shapes_it(self) -> None:
        flat = signals.design(TAU, TAU * 2, 100.0, dt=0.01)
        shaped = signals.design(TAU, TAU * 2, 100.0, dt=0.01, gain=lambda omega: 1 / omega)
        np.testing.assert_allclose(flat.multisine.amplitudes, flat.multisine.amplitudes[0])
        ratio = shaped.multisine.amplitudes / np.sqrt(shaped.omega)
        np.testing.assert_allclose(ratio, ratio[0])
        assert flat.noise_sd is None and flat.gain is None

    def test_a_model_is_enough(self) -> None:
        design = signals.design(ltp.zoo.hopper(), TAU * 5, 462.0, input="u_c", output="h", rms=0.0707, snr=12.5)
        with pytest.raises(ltp.InputError, match="no 'q' among the outputs; they are h"):
            signals.design(ltp.zoo.hopper(), TAU * 5, 462.0, output="q")
        # 0.8479^n is below 1e-7 first for n = 98; a constant force shifts h by 1/k.
        assert design.settle == pytest.approx(98 * T)
        assert design.gain is not None
        assert design.gain[0] == pytest.approx(1 / 6500, rel=0.02)
        # The gain peaks at the resonances of the hopping motion, 0.666 and 3.030 -+ 0.666 Hz.
        peak = design.omega[np.argmax(design.gain)] / TAU
        assert min(abs(peak - f) for f in (0.666, 2.364, 3.696)) < 0.05


class TestErrors:
    @pytest.mark.parametrize(
        ("call", "message"),
        [
            (lambda: signals.chirp((2.0, 1.0), 1.0), "lower end of the band = 2"),
            (lambda: signals.chirp((1.0, 2.0, 3.0), 1.0), "found 3 numbers"),  # type: ignore[arg-type]
            (lambda: signals.chirp("fast", 1.0), "band: not an array"),  # type: ignore[arg-type]
            (lambda: signals.chirp(1.0, 1.0, dt=2.0), "at least one step, dt = 2 s"),
            (lambda: signals.phase_shifted_chirps(T, 9.0, 20.0, timing="evn"), "timing: there is no choice `evn`"),
            (lambda: signals.phase_shifted_chirps(T, 9.0, 0.2), "period = 0.33"),
            (lambda: signals.sine(-1.0, t_end=1.0), "omega = -1"),
            (lambda: signals.step(start=1.0, end=0.5, t_end=2.0), "end of the step = 0.5"),
            (lambda: signals.noise(5, -1.0), "sd = -1"),
            (lambda: signals.add_noise([0.0, 0.0], 12.5), "rms of the signal = 0"),
            (lambda: signals.add_noise([[1.0]], 12.5), "expected a 1-D array"),
            (lambda: signals.multisine(T, 9.0, 7), "cycles = 7: expected an even number"),
            (lambda: signals.multisine(T, 9.0, 40, lines="even"), "lines: there is no choice `even`"),
            (lambda: signals.multisine(T, 9.0, 40, weights=[1.0]), "amplitudes of the multisine"),
            (lambda: signals.Multisine(1.0, np.array([2, 1]), np.ones(2), np.ones(2)), r"lines\[1\] = 1"),
            (lambda: signals.design(TAU, TAU * 2, 100.0, snr=5.0), "without the system's gain"),
            (lambda: signals.design(TAU, TAU * 2, 100.0, snr=5.0, noise_sd=1.0), "give one of them"),
            (lambda: signals.design(TAU, TAU * 2, 3.0), "duration = 3: expected at least 4 s"),
            (lambda: signals.design("hopper", TAU * 2, 3.0), "found a str, expected a model"),
            (lambda: metrics.e_rms([1.0, 2.0], [1.0]), "found 1 values, expected 2"),
            (lambda: metrics.e_rms(["a"], [1.0]), "measured is not an array"),
        ],
    )
    def test_what_cannot_be_is_said(self, call: Any, message: str) -> None:
        with pytest.raises(ltp.InputError, match=message):
            call()
