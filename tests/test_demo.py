"""Owns the tests of `ltp demo` and of `conceal`: what is sealed stays sealed, and the opening is true."""

from __future__ import annotations

import hashlib
import json
import re
from pathlib import Path

import numpy as np
import pytest

import ltp
from ltp import demo
from ltp.cli import main
from ltp.conceal import Label, Seal, conceal


@pytest.fixture(autouse=True)
def in_own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


class TestConceal:
    def test_same_seed_same_bits(self) -> None:
        first, again, other = (
            conceal(seed=5, duration=1.0),
            conceal(seed=5, duration=1.0),
            conceal(seed=6, duration=1.0),
        )
        assert first.label == again.label != other.label
        assert first.model.to_toml() == again.model.to_toml()
        for a, b in zip(first.train + first.test, again.train + again.test, strict=True):
            np.testing.assert_array_equal(a.outputs, b.outputs)

    def test_what_is_seen_does_not_tell(self) -> None:
        case = conceal(effect="coulomb_friction", port="cart", seed=2, duration=1.0)
        assert case.model.effects == []
        assert "coulomb" not in case.model.to_toml()
        assert [record.name for record in case.train + case.test] == ["train A", "train B", "held out"]

    def test_model_is_off_by_less_than_it_says(self) -> None:
        stated = {p["name"]: p for p in conceal(seed=2, duration=1.0).model.parameters}
        for true in ltp.zoo.load("cart_pendulum").parameters:
            if true["sd"] is None:
                assert stated[true["name"]]["value"] == true["value"]
            else:
                assert 0 < abs(stated[true["name"]]["value"] - true["value"]) <= true["sd"]

    def test_label_text_is_sorted(self) -> None:
        case = conceal(effect="stribeck_friction", port="cart", seed=2, duration=1.0)
        tree = json.loads(case.label.text)
        assert json.dumps(tree, sort_keys=True, separators=(",", ":")) == case.label.text
        assert tree["parameters"].keys() == {"force", "static_force", "stribeck_velocity"}


class TestSeal:
    LABEL = Label.read('{"at":"cart","effect":"coulomb_friction","parameters":{"force":0.3},"seed":1}')

    def test_holds_for_this_label_only(self) -> None:
        seal = Seal.of(self.LABEL)
        assert seal.holds(self.LABEL)
        assert not seal.holds(Label.read(self.LABEL.text.replace("0.3", "0.31")))
        assert seal.sha256 == hashlib.sha256((self.LABEL.text + seal.salt).encode()).hexdigest()

    def test_salt_cannot_be_guessed(self) -> None:
        assert Seal.of(self.LABEL).salt != Seal.of(self.LABEL).salt


@pytest.mark.filterwarnings("ignore:cart_pendulum:UserWarning")
class TestDemo:
    def test_walk(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert main(["demo"]) == 0
        out = capsys.readouterr().out
        assert Path("ltp-demo.html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
        sealed = re.search(r"sealed +SHA-256 of label and salt: ([0-9a-f]{64})", out)
        label, salt = re.search(r"label +(\{.*\})", out), re.search(r"salt +([0-9a-f]{32})", out)
        assert sealed is not None
        assert label is not None
        assert salt is not None
        assert sealed.start() < out.index("noise floor") < label.start()
        assert hashlib.sha256((label[1] + salt[1]).encode()).hexdigest() == sealed[1]
        tree = json.loads(label[1])
        before = out[: out.index("noise floor")]
        assert f"`{tree['effect']}` at `{tree['at']}` was left out" in before
        assert "explanations tried" in out
        assert out.count("right") == 2 + len(tree["parameters"])
        assert "wrong" not in out

    def test_json(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert main(["demo", "--seed", "5", "--json", "--report", "other.html"]) == 0
        captured = capsys.readouterr()
        tree = json.loads(captured.out)
        assert tree["sealed"]["sha256"] in captured.err
        assert tree["right"] == {"name": True, "place": True, "size": True}
        assert tree["diagnosis"]["verdict"] == "effect"
        assert Path("other.html").exists()
        assert not Path("ltp-demo.html").exists()

    def test_place_is_checked_before_the_work(self, monkeypatch: pytest.MonkeyPatch) -> None:
        def never(**_: object) -> None:
            raise AssertionError("the work had begun")

        monkeypatch.setattr("ltp.demo.run", never)
        assert main(["demo", "--report", "nowhere/demo.html"]) == 2

    def test_what_the_parameters_can_imitate(self, capsys: pytest.CaptureFixture[str]) -> None:
        """Seed 3 draws viscous friction, which the model has: right is to name nothing, and the demo says why."""
        found = demo.run(seed=3)
        assert found.effects == []
        out = capsys.readouterr().out
        assert '"effect":"viscous_friction"' in out
        assert "the nominal parameters can do the same" in out
        assert "right" not in out[out.index("The seal is opened") :]


@pytest.fixture(scope="module")
def found() -> ltp.Diagnosis:
    case = conceal(effect="linear_stiffness", port="cart", duration=4.0, seed=3)
    return ltp.diagnose(case.model, case.train, case.test, candidates=["linear_stiffness", "coulomb_friction"])


class TestMarks:
    @pytest.mark.parametrize(
        ("effect", "at", "factor", "marks"),
        [
            ("linear_stiffness", "cart", 1.0, (True, True, True)),
            ("linear_stiffness", "cart", 1.5, (True, True, False)),
            ("linear_stiffness", "pendulum", 1.0, (True, False, False)),
            ("cubic_stiffness", "cart", 1.0, (False, True, False)),
            ("nothing", "", 1.0, (False, False, False)),
        ],
    )
    def test_one_thing_wrong(
        self, found: ltp.Diagnosis, effect: str, at: str, factor: float, marks: tuple[bool, ...]
    ) -> None:
        size = found.effects[0].parameters["stiffness"].value * factor
        given = demo.mark(found, Label(effect, at, {"stiffness": size}, 3, ""))
        assert (given.name, given.place, given.size) == marks
        assert bool(given) == all(marks)
