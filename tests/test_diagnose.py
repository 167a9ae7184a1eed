"""Owns the tests of `diagnose` from Python: truth is recovered, doubt is admitted, and wrong input has its message."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest

import ltp
from ltp.conceal import conceal, draw
from ltp.demo import near

SEED = 3
PORTS = ("cart", "pendulum")
# Viscous friction stands in the nominal model, at both ports: more of it is a parameter, never an effect.
FORCES = [
    "coulomb_friction",
    "stribeck_friction",
    "quadratic_drag",
    "linear_stiffness",
    "cubic_stiffness",
    "constant_force",
]
# The rest of the vocabulary, each at one place where the nominal parameters cannot do the same.
OTHERS = {
    "backlash": "pendulum",
    "hysteresis": "cart",
    "position_periodic_force": "cart",
    "time_periodic_force": "pendulum",
    "flexible_mode": "cart",
    "input_delay": "V",
    "input_saturation": "V",
    "input_dead_zone": "V",
    "output_gain": "x",
    "output_bias": "theta",
    "output_delay": "theta",
    "output_lag": "x",
    "output_backlash": "theta",
    "parameter_drift": "B_p",
}
# What no recording of this machine can tell apart: a force at the driven port and an offset of its voltage.
TWINS = {("constant_force", "cart"): {("constant_force", "cart"), ("input_bias", "V")}}

# A sliding mass on a spring, and what its bed may do to it. `more` is what the truth has and the nominal model lacks.
SLIDER = """
name = "slider"
[states]
q = {{ value = 0.0, unit = "m" }}
v = {{ value = 0.0, unit = "m/s" }}
[inputs]
tau = {{ unit = "N" }}
[parameters]
M = {{ value = 2.0, sd = 0.04, unit = "kg", min = 0.1 }}
b = {{ value = 6.0, sd = 1.0, unit = "N s/m", min = 0.0 }}
k = {{ value = 80.0, sd = 2.0, unit = "N/m", min = 0.0 }}
bend = {{ value = 18.0, unit = "N/m^2" }}
[flow]
q = "v"
v = "(tau - k*q - b*v{more})/M"
[outputs]
q = {{ value = "q", unit = "m" }}
[ports.bed]
position = "q"
velocity = "v"
acts = {{ v = "1/M" }}
unit = "N"
"""


def slider(more: str = "") -> ltp.Model:
    return ltp.Model.from_toml(SLIDER.format(more=more), "slider.toml")


def record(truth: ltp.Model, amplitude: float, seed: int, noise: float = 3e-4, t_end: float = 10.0) -> ltp.Recording:
    """The slider under a multisine, with white noise of `noise` metres on its position."""

    def tau(t: float) -> float:
        return amplitude * (math.sin(3.1 * t + seed) + 0.8 * math.sin(5.3 * t + 2 * seed) + 0.5 * math.sin(1.3 * t))

    run = ltp.simulate(truth, {"tau": tau}, t_end=t_end, dt=0.01)
    measured = run.outputs[:, 0] + np.random.default_rng(seed).normal(scale=noise, size=len(run.t))
    return ltp.Recording(run.t, {"tau": run.inputs[:, 0]}, {"q": measured}, name=f"run {seed}")


@pytest.mark.filterwarnings("ignore::UserWarning")
class TestTruth:
    """What an independent integrator concealed is found: its name, its place, its size."""

    @pytest.mark.parametrize("port", PORTS)
    @pytest.mark.parametrize("effect", FORCES)
    def test_every_force_at_every_port(self, effect: str, port: str) -> None:
        case = conceal(effect=effect, port=port, duration=6.0, seed=SEED)
        found = ltp.diagnose(case.model, case.train, case.test)
        if twins := TWINS.get((effect, port)):
            said = {(e.name, e.at) for e in found.effects} | {tuple(a.split("@")) for a in found.ambiguous_with}
            assert (found.verdict, said) == ("ambiguous", twins)
            assert found.separate == [], "nothing would tell them apart"
            return
        assert (found.verdict, [(e.name, e.at) for e in found.effects]) == ("effect", [(effect, port)]), found.sentence
        assert found.ambiguous_with == []
        assert isinstance(found.location, ltp.Location)
        assert found.location.at == port
        (named,) = found.effects
        assert named.share is not None
        assert named.share > 0.9
        for name, true in case.label.parameters.items():
            assert near(named.parameters[name], true), name
        for row in found.fit.test:
            assert row.after < 1.3 * row.floor
        assert any(row.after < 0.2 * row.before for row in found.fit.test)

    @pytest.mark.parametrize(("effect", "at"), OTHERS.items())
    def test_the_rest_of_the_vocabulary(self, effect: str, at: str) -> None:
        case = draw("cart_pendulum", "noisy", SEED, effect=effect, at=at)
        found = ltp.diagnose(case.model, case.train, case.test)
        (named,) = found.effects
        assert (named.name, named.at) == (effect, at), found.sentence
        (planted,) = case.label.effects
        for name, true in planted.parameters.items():
            if name not in ("phase", "sharpness"):
                assert near(named.parameters[name], true), name
        for row in found.fit.test:
            assert row.after < 1.3 * row.floor

    @pytest.mark.parametrize("port", PORTS)
    def test_more_of_what_the_model_has_is_no_effect(self, port: str) -> None:
        case = conceal(effect="viscous_friction", port=port, duration=6.0, seed=SEED)
        found = ltp.diagnose(case.model, case.train, case.test)
        assert found.verdict in ("consistent", "parameter")
        assert found.effects == []
        (entry,) = (c for c in found.candidates if (c.name, c.at) == ("viscous_friction", port))
        assert math.isnan(entry.score)
        assert entry.note is not None
        assert "cannot be told" in entry.note
        name = {"cart": "B_eq", "pendulum": "B_p"}[port]
        change = found.parameters[name]
        true = {p["name"]: p["value"] for p in ltp.zoo.load("cart_pendulum").parameters}[name]
        # Motor and masses may share what the cart's damping lacks; a pivot shares with nothing.
        if port == "pendulum":
            assert change.after == pytest.approx(true + case.label.parameters["damping"], rel=0.05)

    @pytest.mark.parametrize("seed", [3, 4])
    def test_nothing_concealed(self, seed: int) -> None:
        case = conceal(effect="nothing", seed=seed)
        found = ltp.diagnose(case.model, case.train, case.test)
        assert found.verdict == "consistent"
        assert (found.effects, found.ambiguous_with, found.law) == ([], [], None)
        for row in found.fit.train + found.fit.test:
            assert row.after == row.before < 1.15 * row.floor

    def test_a_parameter_that_is_off(self) -> None:
        case = conceal(effect="nothing", seed=SEED)
        wrong = case.model.with_parameters({"B_p": 0.05 + 6 * 0.01})
        found = ltp.diagnose(wrong, case.train, case.test)
        assert found.verdict == "parameter"
        assert found.effects == []
        assert "B_p" in found.sentence
        change = found.parameters["B_p"]
        assert change.nominal == pytest.approx(0.11)
        assert change.after == pytest.approx(0.05, rel=0.03)


@pytest.mark.filterwarnings("ignore::UserWarning")
class TestDoubt:
    """What cannot be known is said."""

    def test_physics_outside_the_library(self) -> None:
        """A spring that pulls to the same side whichever way it is bent: no effect of the library has an even law."""
        truth = slider(" - bend*q^2")
        found = ltp.diagnose(slider(), [record(truth, 30.0, 1), record(truth, 14.0, 2)], record(truth, 22.0, 3))
        assert found.verdict == "unknown", found.sentence
        assert found.effects == []
        assert isinstance(found.location, ltp.Location)
        assert (found.location.at, found.location.variable) == ("bed", "position")
        assert found.law is not None
        assert (found.law.variable, found.law.unit, found.law.variable_unit) == ("position", "N", "m")
        true = -18.0 * found.law.grid**2
        assert np.corrcoef(found.law.force, true)[0, 1] > 0.9

    def test_weak_evidence_names_nothing_wrong(self) -> None:
        """With noise as large as what an effect changes, the truth is named, or in the set, or nothing is claimed."""
        for effect in ("coulomb_friction", "quadratic_drag"):
            case = conceal(effect=effect, port="cart", snr=0.5, duration=2.0, seed=SEED)
            found = ltp.diagnose(case.model, case.train, case.test)
            named = {f"{e.name}@{e.at}" for e in found.effects} | set(found.ambiguous_with)
            assert not named or f"{effect}@cart" in named, found.sentence
            assert (found.verdict == "ambiguous") == bool(found.ambiguous_with)

    def test_two_laws_that_act_alike_here(self) -> None:
        """A slider that only ever moves in one direction: dry friction and a constant force are the same."""
        truth = slider().attach("coulomb_friction", "bed", {"force": 4.0})

        def record_one_way(seed: int) -> ltp.Recording:
            run = ltp.simulate(truth, {"tau": f"{20 + 10 * seed}*t"}, t_end=3.0, dt=0.01)
            noise = np.random.default_rng(seed).normal(scale=1e-4, size=len(run.t))
            return ltp.Recording(
                run.t, {"tau": run.inputs[:, 0]}, {"q": run.outputs[:, 0] + noise}, name=f"ramp {seed}"
            )

        found = ltp.diagnose(slider(), [record_one_way(1), record_one_way(2)], record_one_way(3))
        alike = {"coulomb_friction@bed", "constant_force@bed", "stribeck_friction@bed"}
        named = {f"{e.name}@{e.at}" for e in found.effects} | set(found.ambiguous_with)
        assert named & alike, found.sentence


@pytest.fixture(scope="module")
def case() -> Any:
    return conceal(effect="coulomb_friction", port="cart", duration=4.0, seed=SEED)


@pytest.mark.filterwarnings("ignore::UserWarning")
class TestResult:
    def test_same_bits_with_any_number_of_threads(self, case: Any) -> None:
        texts = []
        for threads in (1, 2):
            tree = json.loads(ltp.diagnose(case.model, case.train, case.test, threads=threads, seed=7).to_json())
            del tree["seconds"]
            texts.append(json.dumps(tree))
        assert texts[0] == texts[1]

    def test_public_json(self, case: Any) -> None:
        tree = json.loads(ltp.diagnose(case.model, case.train, case.test).to_json())
        number, maybe = (int, float), (int, float, type(None))
        kinds = {
            "model_name": str, "verdict": str, "sentence": str, "location": dict, "effects": list,
            "ambiguous_with": list, "candidates": list, "parameters": dict, "fit": dict, "model": str,
            "law": (dict, type(None)), "warnings": list, "seconds": number,
        }  # fmt: skip
        check(tree, kinds)
        place = {"kind": str, "at": str, "mode": (str, type(None)), "variable": str, "phases": list, "p_value": number}
        check(tree["location"], place)
        assert tree["location"]["repeats"] is None, "dry friction repeats nothing"
        for effect in tree["effects"]:
            check(effect, {"name": str, "at": str, "parameters": dict, "share": number})
            for estimate in effect["parameters"].values():
                check(estimate, {"value": number, "sd": maybe, "unit": str})
        for entry in tree["candidates"]:
            check(entry, {"name": str, "at": str, "score": maybe, "held_out": maybe, "converged": bool})
        assert {"nothing"} < {entry["name"] for entry in tree["candidates"]}
        for change in tree["parameters"].values():
            check(change, {"nominal": number, "before": number, "after": number, "sd": number})
        for role in ("train", "test"):
            assert tree["fit"][role]
            for row in tree["fit"][role]:
                words = {"record": str, "output": str}
                check(row, words | {"nominal": maybe, "before": maybe, "after": maybe, "floor": number})
        assert ltp.Model.from_toml(tree["model"]).effects[0]["name"] == "coulomb_friction"

    def test_augmented_model_runs_and_is_right(self, case: Any) -> None:
        found = ltp.diagnose(case.model, case.train, case.test)
        record = case.test[0]
        run = ltp.simulate(found.model, {"V": record.inputs[:, 0]}, t_end=float(record.t[-1]), dt=record.dt)
        for column, row in enumerate(found.fit.test):
            error = run.outputs[:, column] - record.outputs[:, column]
            assert np.sqrt(np.mean(error**2)) < 2 * row.rms_after

    def test_traces_have_units(self, case: Any) -> None:
        traces = ltp.diagnose(case.model, case.train, case.test).traces
        assert [(r["name"], r["role"]) for r in traces["records"]] == [
            ("train A", "train"), ("train B", "train"), ("held out", "test"),
        ]  # fmt: skip
        for force in traces["force"]:
            assert (force["unit"], force["position_unit"], force["velocity_unit"]) == ("N", "m", "m/s")
            assert force["force"].shape == force["sd"].shape == force["t"].shape
        assert (traces["law"]["unit"], traces["law"]["variable_unit"]) == ("N", "m/s")

    def test_without_test_records_a_part_is_held_out(self, case: Any) -> None:
        found = ltp.diagnose(case.model, case.train, candidates=["coulomb_friction"])
        assert any("last third" in text for text in found.warnings)
        assert [row.record for row in found.fit.test if row.output == "x"] == [
            "train A (held out)", "train B (held out)",
        ]  # fmt: skip

    def test_gaps_count_nowhere(self, case: Any) -> None:
        def with_gaps(record: ltp.Recording) -> ltp.Recording:
            y = record.outputs.copy()
            y[100:150] = np.nan
            y[::7, 0] = np.nan
            outputs = {name: y[:, k] for k, name in enumerate(record.output_names)}
            return ltp.Recording(record.t, {"V": record.inputs[:, 0]}, outputs, name=record.name)

        train = [with_gaps(record) for record in case.train]
        found = ltp.diagnose(case.model, train, case.test)
        assert [(e.name, e.at) for e in found.effects] == [("coulomb_friction", "cart")]
        assert near(found.effects[0].parameters["force"], case.label.parameters["force"])


def check(tree: dict[str, Any], kinds: dict[str, Any]) -> None:
    for key, kind in kinds.items():
        assert key in tree
        assert isinstance(tree[key], kind), (key, tree[key])


@pytest.mark.filterwarnings("ignore::UserWarning")
class TestWrongInput:
    """One good call, and one thing wrong in each."""

    @pytest.fixture
    def good(self) -> dict[str, Any]:
        model = slider()
        return {"model": model, "train": [record(model, 20.0, 1, t_end=2.0)]}

    def spoiled(self, good: dict[str, Any], **outputs: Any) -> ltp.Recording:
        t = good["train"][0].t
        return ltp.Recording(t, outputs.pop("inputs", {"tau": np.sin(t)}), outputs or {"q": np.sin(t)}, name="odd")

    def test_an_input_that_was_not_recorded(self, good: dict[str, Any]) -> None:
        good["train"] = [self.spoiled(good, inputs={"taw": np.ones(len(good["train"][0].t))})]
        with pytest.raises(ltp.InputError, match="tau"):
            ltp.diagnose(**good)

    def test_no_output_of_the_model(self, good: dict[str, Any]) -> None:
        good["train"] = [self.spoiled(good, x=np.ones(len(good["train"][0].t)))]
        with pytest.raises(ltp.InputError, match="q"):
            ltp.diagnose(**good)

    def test_unknown_candidate(self, good: dict[str, Any]) -> None:
        with pytest.raises(ltp.InputError, match=r"no effect `coulom_friction`.*coulomb_friction"):
            ltp.diagnose(**good, candidates=["coulom_friction"])

    def test_no_recording(self, good: dict[str, Any]) -> None:
        with pytest.raises(ltp.InputError, match="train recordings: found 0"):
            ltp.diagnose(good["model"], [])

    def test_what_is_no_recording(self, good: dict[str, Any]) -> None:
        with pytest.raises(ltp.InputError, match="train holds a str, expected recordings"):
            ltp.diagnose(good["model"], ["run.csv"])  # type: ignore[list-item]

    def test_half_a_concealed_effect(self) -> None:
        with pytest.raises(ltp.InputError, match="an effect alone, expected an effect with its port"):
            conceal(effect="coulomb_friction")
        with pytest.raises(ltp.InputError, match="a port alone"):
            conceal(port="cart")

    @pytest.mark.parametrize(
        ("words", "message"),
        [
            ({"effect": "coulom_friction", "port": "cart"}, "did you mean `coulomb_friction`"),
            ({"effect": "coulomb_friction", "port": "cat"}, "did you mean `cart`"),
            ({"model": "cart_pendulm"}, "did you mean `cart_pendulum`"),
        ],
    )
    def test_unknown_names_of_concealment(self, words: dict[str, Any], message: str) -> None:
        with pytest.raises(ltp.InputError, match=message):
            conceal(**words)
