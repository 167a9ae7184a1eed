"""Owns the tests of what a diagnosis may call by a name: what recordings show of it, and what stands beside what."""

from __future__ import annotations

import numpy as np
import pytest

import ltp
from ltp.conceal import draw
from test_diagnose import record, slider

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")


def note(found: ltp.Diagnosis, name: str) -> str:
    """What is noted beside a candidate of the first round."""
    return next(c.note or "" for c in found.candidates if c.name == name and not c.beside)


def named(found: ltp.Diagnosis) -> list[str]:
    return [e.name for e in found.effects]


def stiff() -> ltp.Model:
    """The slider with a spring that is known ten times better."""
    return ltp.Model.from_toml(slider().to_toml().replace("sd = 2.0", "sd = 0.2"))


def bent(truth: ltp.Model, seed: int, q: float) -> ltp.Recording:
    """A run from `q` under a heavy load, so that the spring stays bent to one side."""
    force = f"60 + 6*sin({3.1 + 0.2 * seed}*t) + 4*sin(5.3*t + {seed})"
    run = ltp.simulate(truth, {"tau": force}, t_end=8.0, dt=0.01, initial_state={"q": q})
    noise = np.random.default_rng(seed).normal(scale=1e-4, size=len(run.t))
    return ltp.Recording(run.t, {"tau": run.inputs[:, 0]}, {"q": run.outputs[:, 0] + noise}, name=f"run {seed}")


class TestShown:
    @pytest.mark.parametrize("waves", [0.4, 3.0])
    def test_what_repeats_has_been_seen_to(self, waves: float) -> None:
        """The same cogging, of which the bed shows less than one tooth, and three."""
        runs = [record(slider(), amplitude, seed) for seed, amplitude in enumerate((30.0, 14.0, 22.0), 1)]
        wavelength = float(np.ptp(runs[0].outputs)) / waves
        cogs = {"amplitude": 4.0, "wavelength": wavelength, "phase": 1.2}
        truth = slider().attach("position_periodic_force", "bed", cogs)
        runs = [record(truth, amplitude, seed) for seed, amplitude in enumerate((30.0, 14.0, 22.0), 1)]
        found = ltp.diagnose(slider(), runs[:2], runs[2], candidates=["position_periodic_force"])
        if waves < 1:
            assert named(found) == [] and found.verdict != "effect", found.sentence
            assert "nobody has seen it repeat" in note(found, "position_periodic_force")
            assert any("repeat" in text for text in found.warnings)
        else:
            assert named(found) == ["position_periodic_force"]
            assert found.effects[0].parameters["wavelength"].value == pytest.approx(wavelength, rel=0.01)

    def test_a_gap_that_nothing_enters_is_a_constant_force(self) -> None:
        """Under a heavy load the spring stays on one side: its gap cannot be told from a force, and is not."""
        truth = slider().attach("constant_force", "bed", {"force": 0.4})

        runs = [bent(truth, seed, 0.75) for seed in (1, 2, 3)]
        found = ltp.diagnose(stiff(), runs[:2], runs[2], candidates=["backlash", "constant_force"])
        assert named(found) == ["constant_force"], found.sentence
        assert found.ambiguous_with == []
        assert "no recording passes a corner" in note(found, "backlash")

    def test_a_spring_that_never_yields_is_a_spring(self) -> None:
        exact = ltp.Model.from_toml(slider().to_toml().replace(", sd = 2.0", "").replace("sd = 2.0\n", ""))
        stiff = exact.attach("linear_stiffness", "bed", {"stiffness": 6.0})
        runs = [record(stiff, amplitude, seed) for seed, amplitude in enumerate((30.0, 14.0, 22.0), 1)]
        both = ltp.diagnose(exact, runs[:2], runs[2], candidates=["hysteresis", "linear_stiffness"])
        assert named(both) == ["linear_stiffness"]
        assert both.ambiguous_with == []
        alone = ltp.diagnose(exact, runs[:2], runs[2], candidates=["hysteresis"])
        assert named(alone) == [], alone.sentence
        assert "yield_displacement" in note(alone, "hysteresis")

    def test_of_answers_that_fit_alike_the_simplest_comes_first(self) -> None:
        """The same load, but the slider passes the gap in the first instant: a gap is possible now, and more to say."""
        truth = slider().attach("constant_force", "bed", {"force": 0.4})
        runs = [bent(truth, seed, -0.02) for seed in (13, 14, 15)]  # by half a unit, chance speaks for the gap
        found = ltp.diagnose(stiff(), runs[:2], runs[2], candidates=["backlash", "constant_force"])
        assert named(found) == ["constant_force"], found.sentence
        assert found.ambiguous_with == ["backlash@bed"]
        scores = {c.name: c.score for c in found.candidates}
        assert scores["backlash"] is not None and -2 < scores["backlash"] < 0


class TestSeveral:
    def test_a_delay_behind_a_lag_is_ruled_out_and_said_to_be(self) -> None:
        """What a lag leaves depends on the motion and cannot be delayed: no reason to end a diagnosis."""
        truth = slider().attach("input_lag", "tau", {"time_constant": 0.1})
        truth = truth.attach("coulomb_friction", "bed", {"force": 0.3})
        runs = [record(truth, amplitude, seed) for seed, amplitude in enumerate((30.0, 14.0, 22.0), 1)]
        words = ["input_lag", "input_delay", "coulomb_friction"]
        found = ltp.diagnose(slider(), runs[:2], runs[2], candidates=words)
        assert named(found) == ["input_lag", "coulomb_friction"], found.sentence
        (delay,) = (c for c in found.candidates if c.name == "input_delay" and c.beside == ["input_lag@tau"])
        assert "nothing to act on" in (delay.note or "")

    def test_a_small_second_effect_that_completes_the_explanation(self) -> None:
        """Less than a hundredth of the error is left by the first, and all of it is the second."""
        truth = slider().attach("cubic_stiffness", "bed", {"cubic_stiffness": 60.0})
        truth = truth.attach("time_periodic_force", "bed", {"amplitude": 0.05, "omega": 9.7, "phase": 0.4})
        runs = [record(truth, a, seed, noise=2e-5) for seed, a in enumerate((30.0, 14.0, 22.0), 1)]
        found = ltp.diagnose(slider(), runs[:2], runs[2])
        assert sorted(named(found)) == ["cubic_stiffness", "time_periodic_force"], found.sentence
        wave = next(e for e in found.effects if e.name == "time_periodic_force")
        assert wave.parameters["omega"].value == pytest.approx(9.7, abs=0.02)
        assert abs(wave.share) < 0.02

    def test_the_wrong_half_gives_way(self) -> None:
        """With a cubic spring beside it, an offset of the sensor explains more at first than the bias that is there."""
        case = draw("pendulum", "pair", 1000000114000009)
        assert {e.name for e in case.label.effects} == {"input_bias", "cubic_stiffness"}
        words = ["output_bias", "input_bias", "cubic_stiffness"]
        found = ltp.diagnose(case.model, case.train, case.test, candidates=words)
        assert found.candidates[0].name == "output_bias", "it does not mislead any more: find another case"
        assert sorted(named(found)) == ["cubic_stiffness", "input_bias"], found.sentence

    @pytest.mark.parametrize(
        ("effect", "at", "parameters"),
        [
            ("input_delay", "tau", {"delay": 0.02}),
            ("input_lag", "tau", {"time_constant": 0.05}),
            ("hysteresis", "bed", {"stiffness": 8.0, "yield_displacement": 0.1}),
            ("output_backlash", "q", {"gap": 0.01}),
        ],
    )
    def test_a_model_that_holds_an_effect_is_diagnosed_again(
        self, effect: str, at: str, parameters: dict[str, float]
    ) -> None:
        """What was found goes on in the model, with states and delays of its own, and friction is found beside it."""
        model = slider().attach(effect, at, parameters)
        truth = model.attach("coulomb_friction", "bed", {"force": 0.8})
        runs = [record(truth, amplitude, seed) for seed, amplitude in enumerate((30.0, 14.0, 22.0), 1)]
        found = ltp.diagnose(model, runs[:2], runs[2], candidates=["coulomb_friction", "quadratic_drag"])
        assert named(found) == ["coulomb_friction"], found.sentence
        assert isinstance(found.location, ltp.Location)
        assert found.location.at == "bed"
        assert found.effects[0].parameters["force"].value == pytest.approx(0.8, rel=0.01)


class TestHonest:
    """A spring that hardens, known to an engineer as a straight one, with nothing in reach that could say so."""

    DOCUMENT = """
        name = "spring"
        states = { q = { value = 0.0, unit = "m" }, v = { value = 0.0, unit = "m/s" } }
        inputs = { tau = { unit = "N" } }
        flow = { q = "v", v = "(tau - k*q - c*v - hardening*q^3)/m" }
        outputs = { q = { value = "q", unit = "m" } }
        [parameters]
        m = { value = 1.0, unit = "kg" }
        c = { value = 1.0, sd = 0.02, unit = "N s/m" }
        k = { value = 30.0, sd = 0.5, unit = "N/m" }
        hardening = { value = HARDENING, unit = "N/m^3" }
    """

    def spring(self, hardening: float) -> ltp.Model:
        return ltp.Model.from_toml(self.DOCUMENT.replace("HARDENING", str(hardening)))

    @pytest.mark.parametrize(("hardening", "verdict"), [(2.0, "unknown"), (0.0, "consistent")])
    def test_a_parameter_that_leaves_much_is_not_the_answer(self, hardening: float, verdict: str) -> None:
        """The stiffness moves by 13 of its uncertainties and leaves five times the noise: that is not right."""
        runs = []
        for seed, amplitude in enumerate((30.0, 14.0, 22.0), 1):
            force = f"{amplitude}*sin({3.1 + 0.2 * seed}*t) + {amplitude / 2}*sin(5.3*t + {seed})"
            run = ltp.simulate(self.spring(hardening), {"tau": force}, t_end=8.0, dt=0.01)
            noise = np.random.default_rng(seed).normal(scale=0.03, size=len(run.t))
            inputs, outputs = {"tau": run.inputs[:, 0]}, {"q": run.outputs[:, 0] + noise}
            runs.append(ltp.Recording(run.t, inputs, outputs, name=f"run {seed}"))
        found = ltp.diagnose(self.spring(0.0), runs[:2], runs[2], candidates=["output_delay", "input_bias"])
        assert found.verdict == verdict, found.sentence
        assert ("structure is right" in found.sentence) is False


class TestWaves:
    def test_a_weak_tone_beyond_a_spring_is_heard_in_the_residuals(self) -> None:
        """A force of 4 mN m at 34.8 rad/s behind a shaft, of which the nominal parameters leave a fifth of the noise.
        It does not show in the smoothed missing force, and does in the residuals.
        """
        case = draw("two_mass", "noisy", 1_000_000_191_000_002)
        (planted,) = case.label.effects
        assert planted.name == "time_periodic_force"
        found = ltp.diagnose(case.model, case.train, case.test, candidates=[planted.name])
        assert named(found) == [planted.name], found.sentence
        assert found.effects[0].parameters["omega"].value == pytest.approx(planted.parameters["omega"], rel=1e-3)
