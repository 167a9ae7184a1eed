"""Owns the tests of `ltp.Model`, `ltp.zoo`, `ltp.simulate` and `ltp.diagnose` as Python sees them.

What the numbers are is tested with the core; here: documents in every form, names, files, arguments and their errors.
"""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ltp
from conftest import RIG

DOCUMENT: dict[str, Any] = {
    "name": "rig",
    "states": {"q": {"value": 0.0, "unit": "m"}, "v": {"value": 0.0, "unit": "m/s"}},
    "inputs": {"tau": {"unit": "N"}},
    "parameters": {"M": {"value": 10.0, "sd": 1.0, "unit": "kg"}},
    "flow": {"q": "v", "v": "tau/M"},
    "outputs": {"q": {"value": "q", "unit": "m", "column": "qm"}},
    "ports": {"drive": {"position": "q", "velocity": "v", "acts": {"v": "1/M"}, "unit": "N"}},
}


class TestModel:
    def test_keyword_arguments(self) -> None:
        model = ltp.Model(**DOCUMENT)
        assert (model.name, model.states, model.inputs, model.outputs) == ("rig", ["q", "v"], ["tau"], ["q"])
        assert model.ports == ["drive"]
        assert len(model.modes) == 1
        assert model.effects == []
        assert (model.unit("M"), model.unit("q"), model.column("q"), model.column("tau")) == ("kg", "m", "qm", "tau")

    def test_numpy_values(self) -> None:
        parameters = {"M": {"value": np.float64(10.0), "sd": np.float32(1.0), "unit": "kg"}}
        (mass,) = ltp.Model(**{**DOCUMENT, "parameters": parameters}).parameters
        assert (mass["name"], mass["value"], mass["sd"], mass["unit"]) == ("M", 10.0, 1.0, "kg")

    def test_value_that_is_not_finite(self) -> None:
        parameters = {"M": {"value": 10.0, "max": float("inf"), "unit": "kg"}}
        with pytest.raises(ltp.InputError, match="leave a bound out"):
            ltp.Model(**{**DOCUMENT, "parameters": parameters})

    def test_value_that_no_document_knows(self) -> None:
        with pytest.raises(ltp.InputError, match="set"):
            ltp.Model(**{**DOCUMENT, "flow": {"q": {"v"}}})

    def test_unknown_name_in_an_expression(self) -> None:
        with pytest.raises(ltp.InputError, match="taw"):
            ltp.Model(**{**DOCUMENT, "flow": {"q": "v", "v": "taw/M"}})

    def test_save_and_load(self, tmp_path: Path) -> None:
        model = ltp.Model(**DOCUMENT)
        path = model.save(tmp_path / "rig.toml")
        again = ltp.Model.load(path)
        assert again.to_toml() == model.to_toml()
        assert again.parameters == model.parameters
        assert [file.name for file in tmp_path.iterdir()] == ["rig.toml"]

    def test_load_json(self, tmp_path: Path) -> None:
        path = tmp_path / "rig.json"
        path.write_text(json.dumps(DOCUMENT), encoding="utf-8")
        assert ltp.Model.load(path).states == ["q", "v"]

    def test_load_missing_file(self, tmp_path: Path) -> None:
        with pytest.raises(ltp.InputError, match=r"rig\.toml: no such file"):
            ltp.Model.load(tmp_path / "rig.toml")

    def test_load_another_format(self, tmp_path: Path) -> None:
        with pytest.raises(ltp.InputError, match=r"ends in \.toml.*found '\.csv'"):
            ltp.Model.load(tmp_path / "run.csv")

    def test_load_names_the_file(self, tmp_path: Path) -> None:
        path = tmp_path / "rig.toml"
        path.write_text(RIG.replace("value = 10.0", "value = "), encoding="utf-8")
        with pytest.raises(ltp.InputError, match=r"rig\.toml"):
            ltp.Model.load(path)

    def test_load_binary(self, tmp_path: Path) -> None:
        path = tmp_path / "rig.toml"
        path.write_bytes(b"name = \xff\xfe")
        with pytest.raises(ltp.InputError, match="not a text file"):
            ltp.Model.load(path)

    def test_save_into_a_missing_folder(self, rig: ltp.Model, tmp_path: Path) -> None:
        with pytest.raises(ltp.InputError, match="does not exist"):
            rig.save(tmp_path / "nowhere" / "rig.toml")

    def test_failed_save_keeps_the_old_file(
        self, rig: ltp.Model, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        path = tmp_path / "rig.toml"
        path.write_text("old", encoding="utf-8")

        def interrupt(*_: object) -> None:
            raise KeyboardInterrupt

        monkeypatch.setattr("ltp.files.os.replace", interrupt)
        with pytest.raises(KeyboardInterrupt):
            rig.save(path)
        assert path.read_text(encoding="utf-8") == "old"
        assert [file.name for file in tmp_path.iterdir()] == ["rig.toml"]

    def test_with_parameters(self, rig: ltp.Model) -> None:
        lighter = rig.with_parameters({"M": 8.0}, b=5.0)
        assert {p["name"]: p["value"] for p in lighter.parameters} == {"M": 8.0, "b": 5.0}
        assert {p["name"]: p["value"] for p in rig.parameters} == {"M": 10.0, "b": 4.0}

    def test_with_an_unknown_parameter(self, rig: ltp.Model) -> None:
        with pytest.raises(ltp.InputError, match="mass"):
            rig.with_parameters(mass=8.0)

    def test_attach(self, rig: ltp.Model) -> None:
        (effect,) = rig.attach("coulomb_friction", "drive", force=2.5).effects
        assert (effect["name"], effect["at"]) == ("coulomb_friction", "drive")
        assert effect["parameters"]["force"]["value"] == 2.5
        assert rig.effects == []

    def test_attach_an_unknown_effect(self, rig: ltp.Model) -> None:
        with pytest.raises(ltp.InputError, match="coulomb_frction"):
            rig.attach("coulomb_frction", "drive", force=2.5)

    def test_places(self, rig: ltp.Model) -> None:
        assert rig.places("input_delay") == ["tau", "load"]
        assert rig.places("backlash") == []
        with pytest.raises(ltp.InputError, match="no stiffness along this port"):
            rig.attach("backlash", "drive", gap=0.1)

    def test_effects_of_ones_own(self, rig: ltp.Model, tmp_path: Path) -> None:
        wind = tmp_path / "wind.toml"
        wind.write_text(
            'sentence = "air that moves"\non = "port"\nlaw = "-drag*(velocity - 1)"\nreference = "the weather"\n'
            '[parameters]\ndrag = { unit = "force/velocity", min = 0.0, scale = "force/velocity" }\n'
        )
        windy = rig.with_effects([wind])
        assert windy.library[-1] == "wind" and "wind" not in rig.library
        saved = windy.attach("wind", "drive", drag=2.0).save(tmp_path / "windy.toml")
        (effect,) = ltp.Model.load(saved, effects=[wind]).effects
        assert effect["parameters"]["drag"] == {"value": 2.0, "sd": None, "unit": "N s/m"}
        with pytest.raises(ltp.InputError, match="wind"):
            ltp.Model.load(saved)
        with pytest.raises(ltp.InputError, match="of this name already"):
            windy.with_effects([wind])

    def test_repr(self, rig: ltp.Model) -> None:
        assert repr(rig) == "<ltp.Model 'rig'; states: q, v; inputs: tau, load; outputs: q, v; ports: drive>"


class TestZoo:
    def test_every_model_loads(self) -> None:
        assert "drive" in ltp.zoo.names()
        for name in ltp.zoo.names():
            model = getattr(ltp.zoo, name)()
            assert model.name == name
            assert model.description
            assert name in dir(ltp.zoo)

    def test_unknown_model(self) -> None:
        with pytest.raises(AttributeError, match="hoper"):
            _ = ltp.zoo.hoper
        with pytest.raises(ltp.InputError, match="did you mean hopper"):
            ltp.zoo.text("hoper")


class TestSimulate:
    def test_shapes_and_names(self, rig: ltp.Model) -> None:
        run = ltp.simulate(rig, {"tau": "2*sin(3*t)"}, t_end=1.0, dt=0.1)
        assert run.t[-1] == pytest.approx(1.0)
        assert run.states.shape == run.inputs.shape == run.outputs.shape == (11, 2)
        assert run.mode.shape == (11,)
        assert (run.state_names, run.input_names, run.output_names) == (["q", "v"], ["tau", "load"], ["q", "v"])
        assert not run.stop.early

    def test_forms_of_an_input_agree(self, rig: ltp.Model) -> None:
        t = np.arange(101) * 0.01
        forms: list[Any] = [2.0, "2", np.full(101, 2.0), [2] * 101, lambda time: 2.0 if time >= 0 else 0.0]
        runs = [ltp.simulate(rig, {"tau": form}, t_end=1.0, dt=0.01) for form in forms]
        for run in runs:
            np.testing.assert_allclose(run.t, t)
            np.testing.assert_allclose(run.states, runs[0].states, rtol=1e-9, atol=1e-12)

    def test_default_of_an_input(self, rig: ltp.Model) -> None:
        run = ltp.simulate(rig, {"tau": 0.0}, t_end=1.0, dt=0.1)
        np.testing.assert_array_equal(run.inputs[:, 1], 0.5)

    def test_initial_state(self, rig: ltp.Model) -> None:
        run = ltp.simulate(rig, {"tau": 0.0}, t_end=1.0, dt=0.1, initial_state={"q": 3.0})
        assert run.states[0, 0] == 3.0

    def test_run_is_read_back(self, rig: ltp.Model, tmp_path: Path) -> None:
        run = ltp.simulate(rig, {"tau": "sin(t)", "load": "cos(t)"}, t_end=2.0, dt=0.1)
        recording = ltp.Recording.read(run.save(tmp_path / "run.csv"), rig)
        np.testing.assert_array_equal(recording.outputs, run.outputs)
        np.testing.assert_array_equal(recording.inputs, run.inputs)

    def test_early_end(self) -> None:
        ball = ltp.zoo.bouncing_ball()
        run = ltp.simulate(ball, t_end=6.0, dt=0.01)
        assert run.stop.early
        assert run.stop.message
        assert run.t[-1] < 6.0
        assert [event.name for event in run.events[:2]] == ["impact", "impact"]
        assert run.events[0].time == pytest.approx(0.451523641, abs=1e-8)
        with pytest.raises(ltp.ConvergenceError):
            ltp.simulate(ball, t_end=6.0, dt=0.01, strict=True)

    @pytest.mark.parametrize(
        ("arguments", "message"),
        [
            ({"inputs": {"taw": 1.0}}, "no input 'taw'; did you mean tau"),
            ({"inputs": {"tau": np.zeros(10)}}, r"shape \(10,\), expected \(11,\)"),
            ({"inputs": {"tau": np.full(11, np.nan)}}, "is nan at t = 0 s"),
            ({"inputs": {"tau": ["a"] * 11}}, "not an array of real numbers"),
            ({"inputs": {"tau": "sin(", "load": "0"}}, "tau"),
            ({"inputs": {"tau": "sin(t)", "load": np.zeros(11)}}, "all as expressions, or all as samples"),
            ({"t_end": -1.0}, "t_end is -1.0"),
            ({"t_end": float("nan")}, "t_end is nan"),
            ({"dt": 0.0}, "dt is 0.0"),
            ({"dt": 2.0}, "longer than t_end"),
            ({"hold": "third-order"}, "third-order"),
            ({"initial_state": {"x": 1.0}}, "x"),
            ({"initial_mode": "flight"}, "flight"),
        ],
    )
    def test_wrong_arguments(self, rig: ltp.Model, arguments: dict[str, Any], message: str) -> None:
        good: dict[str, Any] = {"inputs": {"tau": 1.0}, "t_end": 1.0, "dt": 0.1}
        with pytest.raises(ltp.InputError, match=message):
            ltp.simulate(rig, **{**good, **arguments})


class TestEffectsWithAPast:
    """Simulated from Python as the engine does: an input that comes late, a sensor that is late, a sensor with play."""

    def runs(self, effect: str, at: str, **parameters: float) -> tuple[ltp.Trajectory, ltp.Trajectory]:
        model = ltp.zoo.drive()
        late = model.attach(effect, at, parameters)
        t = np.arange(401) * 0.005
        drive = {"tau": np.where(t > 0.1, 300 * np.sin(5 * t), 0.0)}
        return tuple(ltp.simulate(m, drive, t_end=2.0, dt=0.005) for m in (model, late))  # type: ignore[return-value]

    @pytest.mark.parametrize(("effect", "at"), [("input_delay", "tau"), ("output_delay", "q")])
    def test_a_delay_delays(self, effect: str, at: str) -> None:
        model, late = self.runs(effect, at, delay=0.05)
        assert np.ptp(model.outputs) > 0.01
        np.testing.assert_allclose(late.outputs[10:], model.outputs[:-10], atol=2e-4 * np.ptp(model.outputs))

    def test_a_lag_much_shorter_than_a_sample(self) -> None:
        model, slow = self.runs("input_lag", "tau", time_constant=2e-4)
        assert slow.stop.reason == "finished"
        np.testing.assert_allclose(slow.outputs, model.outputs, atol=2e-3 * np.ptp(model.outputs))

    def test_play_stands_still_after_a_reversal(self) -> None:
        model, loose = self.runs("output_backlash", "q", gap=0.004)
        away = loose.outputs - model.outputs
        assert np.max(np.abs(away)) == pytest.approx(0.002, rel=1e-3)
        assert np.sum(np.diff(loose.outputs[:, 0]) == 0) > 10


class TestDiagnose:
    @pytest.fixture(scope="class")
    def found(self) -> ltp.Diagnosis:
        """A rig with dry friction, seen through a model without it; noise of 10 um and 0.1 mm/s."""
        rig = ltp.Model.from_toml(RIG, "rig.toml")
        truth = rig.attach("coulomb_friction", "drive", force=2.0)
        rng = np.random.default_rng(1)
        records = []
        for name, tau in (("train", "8*sin(2*t) + 5*sin(5.3*t)"), ("test", "6*sin(3*t) + 6*sin(4.1*t)")):
            run = ltp.simulate(truth, {"tau": tau}, t_end=8.0, dt=0.02)
            q, v = (run.outputs + rng.normal(size=run.outputs.shape) * [1e-5, 1e-4]).T
            inputs = {"tau": run.inputs[:, 0], "load": run.inputs[:, 1]}
            records.append(ltp.Recording(run.t, inputs, {"q": q, "v": v}, name=name))
        return ltp.diagnose(rig, records[0], [records[1]], candidates=["coulomb_friction", "viscous_friction"])

    def test_names_the_physics(self, found: ltp.Diagnosis) -> None:
        assert found.verdict == "effect"
        (effect,) = found.effects
        assert (effect.name, effect.at) == ("coulomb_friction", "drive")
        assert effect.parameters["force"].value == pytest.approx(2.0, rel=0.05)
        assert effect.parameters["force"].unit == "N"

    def test_fields(self, found: ltp.Diagnosis) -> None:
        assert isinstance(found.location, ltp.Location)
        assert (found.location.kind, found.location.at) == ("port", "drive")
        assert found.candidates[0].name == "coulomb_friction"
        assert found.candidates[0].score == 0.0
        assert any(candidate.name == "nothing" for candidate in found.candidates)
        assert found.parameters["M"].nominal == 10.0
        assert [row.record for row in found.fit.test] == ["test", "test"]
        for row in [*found.fit.train, *found.fit.test]:
            assert row.after < row.before
        with pytest.raises(dataclasses.FrozenInstanceError):
            found.verdict = "unknown"  # type: ignore[misc]

    def test_model_is_augmented(self, found: ltp.Diagnosis, tmp_path: Path) -> None:
        assert [effect["name"] for effect in ltp.Model.load(found.model.save(tmp_path / "m.toml")).effects] == [
            "coulomb_friction"
        ]

    def test_json_and_traces(self, found: ltp.Diagnosis) -> None:
        tree = json.loads(found.to_json())
        assert tree["verdict"] == found.verdict
        assert tree["sentence"] == found.sentence
        assert {record["role"] for record in found.traces["records"]} == {"train", "test"}

    def test_report(self, found: ltp.Diagnosis, tmp_path: Path) -> None:
        page = found.report(tmp_path / "report.html").read_text(encoding="utf-8")
        assert "<html" in page
        assert found.model_name in page

    def test_report_into_a_missing_folder(self, found: ltp.Diagnosis, tmp_path: Path) -> None:
        with pytest.raises(ltp.InputError, match="does not exist"):
            found.report(tmp_path / "nowhere" / "report.html")

    def test_what_is_no_recording(self, rig: ltp.Model) -> None:
        with pytest.raises(ltp.InputError, match="train holds a str, expected recordings"):
            ltp.diagnose(rig, ["run.csv"])  # type: ignore[list-item]

    def test_unknown_candidate(self, rig: ltp.Model, good: dict[str, Any]) -> None:
        with pytest.raises(ltp.InputError, match="colomb"):
            ltp.diagnose(rig, ltp.Recording.read(good, rig, name="run"), candidates=["colomb"])
