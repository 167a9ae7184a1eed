"""Owns the tests of `isolability` from Python and the command line: known pairs, wrong input, text and picture."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ltp
from ltp.cli import main


def volts(t: float) -> float:
    return 3.0 * (math.sin(3.1 * t) + 0.8 * math.sin(5.3 * t + 1) + 0.5 * math.sin(1.3 * t + 2))


@pytest.fixture(scope="module")
def found() -> ltp.Isolability:
    effects = ["viscous_friction", "coulomb_friction", "stribeck_friction", "constant_force", "output_bias"]
    return ltp.isolability(ltp.zoo.load("cart_pendulum"), {"V": volts}, t_end=10.0, dt=0.01, effects=effects)


class TestCartPendulum:
    def test_what_parameters_and_states_hide(self, found: ltp.Isolability) -> None:
        seen = {effect.label: effect.detectable for effect in found.effects}
        # Damping is a parameter at both ports, and where x begins is free.
        assert not any(seen[name] for name in ("viscous_friction@cart", "viscous_friction@pendulum", "output_bias@x"))
        assert seen["coulomb_friction@cart"]
        assert seen["coulomb_friction@pendulum"]
        (hidden,) = (e for e in found.effects if e.label == "viscous_friction@pendulum")
        assert hidden.alike == "B_p"

    def test_torque_and_biased_angle_ask_for_another_amplitude(self, found: ltp.Isolability) -> None:
        pair = {"constant_force@pendulum", "output_bias@theta"}
        (open_question,) = (a for a in found.advice if set(a.of) == pair)
        assert open_question.now < 10
        assert open_question.by[0].kind == "amplitude"
        assert "twice the input amplitude" in open_question.by[0].sentence
        assert open_question.by[0].deviance > 50

    def test_dry_frictions_ask_for_slow_reversals(self, found: ltp.Isolability) -> None:
        pair = {"coulomb_friction@pendulum", "stribeck_friction@pendulum"}
        (open_question,) = (a for a in found.advice if set(a.of) == pair)
        assert [help.kind for help in open_question.by] == ["slow"]

    def test_the_advice_holds(self, found: ltp.Isolability) -> None:
        """Plan the record that was advised: the pair is then told apart as predicted."""
        names = ["constant_force", "output_bias"]
        records = [{"V": volts}, {"V": lambda t: 2 * volts(t)}]
        model = ltp.zoo.load("cart_pendulum")
        sensors = {name: noise.value for name, noise in found.sensors.items()}
        planned = ltp.isolability(model, records, sensors, t_end=10.0, dt=0.01, effects=names)
        labels = [effect.label for effect in planned.effects]
        i, j = labels.index("constant_force@pendulum"), labels.index("output_bias@theta")
        assert planned.words[i][j] == "separable"

    def test_noise_scales_the_matrix(self) -> None:
        model = ltp.zoo.load("cart_pendulum")
        names = ["coulomb_friction", "cubic_stiffness"]
        one, ten = (
            ltp.isolability(
                model,
                {"V": volts},
                {"x": scale * 1e-4, "theta": scale * 1e-3},
                t_end=4.0,
                dt=0.01,
                effects=names,
            )
            for scale in (1.0, 10.0)
        )
        # Not by 100: the stated uncertainty of the parameters does not widen with the noise.
        assert np.all(one.separation >= ten.separation - 1e-9)
        assert one.separation[0, 1] > 20 * ten.separation[0, 1]

    def test_matrix_words_and_text(self, found: ltp.Isolability) -> None:
        m = len(found.effects)
        assert found.matrix.shape == found.separation.shape == (m, m)
        assert np.allclose(found.separation, found.separation.T)
        assert np.all(np.diag(found.matrix) == 0)
        # A rival cannot leave more than there is.
        own = np.array([effect.visible**2 for effect in found.effects])
        assert np.all(found.matrix <= own[:, None] * (1 + 1e-9) + 1e-9)
        text = str(found)
        assert found.sentence in text
        assert "what would help" in text
        assert json.loads(found.to_json())["sentence"] == found.sentence
        assert found.plot().axes


def test_hopper_with_height_alone() -> None:
    """A bias of `h`, a constant leg force and an error of the leg's length are one thing; the length is uncertain."""
    found = ltp.isolability(
        ltp.zoo.load("hopper"),
        {"u_c": "0.5*sin(7*t)"},
        {"h": 1e-5},
        t_end=2.64,
        dt=0.0025,
        effects=["constant_force", "output_bias", "viscous_friction"],
    )
    labels = [effect.label for effect in found.effects]
    force, bias = labels.index("constant_force@leg"), labels.index("output_bias@h")
    for effect in (found.effects[force], found.effects[bias]):
        assert effect.raw > 50
        assert not effect.detectable
    assert found.separation[force, bias] < 0.1
    # Leg damping is a parameter: of a change of a thousand noises rms, next to nothing is its own.
    (damping,) = (effect for effect in found.effects if effect.label == "viscous_friction@leg")
    assert damping.raw > 500
    assert damping.visible < 1e-3 * damping.raw * len(np.arange(0, 2.64, 0.0025)) ** 0.5
    # Friction of the body against the world is no parameter.
    (body,) = (effect for effect in found.effects if effect.label == "viscous_friction@body")
    assert body.visible > 1000


class TestWrongInput:
    def test_names_and_numbers(self) -> None:
        model = ltp.zoo.load("drive")
        good: dict[str, Any] = {"t_end": 2.0, "dt": 0.01}
        bad: list[tuple[Any, dict[str, Any], str]] = [
            ({"tow": "1"}, {}, "there is no input `tow`"),
            ({"tau": "sin(t)"}, {"sensors": ["w"]}, "there is no output or state `w`"),
            ({"tau": "sin(t)"}, {"effects": ["columb_friction"]}, "coulomb_friction"),
            ({"tau": np.zeros(7)}, {}, "expected 201"),
            ({"tau": "sin(t)"}, {"dt": -1.0}, "dt = -1"),
            ({"tau": "sin(t)"}, {"sensors": {"q": 0.0}}, "positive noise"),
            ({"tau": "1 +"}, {}, "column"),
        ]
        for inputs, change, message in bad:
            with pytest.raises(ltp.InputError) as refusal:
                ltp.isolability(model, inputs, **(good | change))
            assert message in str(refusal.value)


def test_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plot = tmp_path / "matrix.svg"
    words = [
        "isolability",
        "zoo:drive",
        "--t-end",
        "4",
        "--input",
        "tau=multisine(30, 0.3:3)",
        "--input",
        "tau=20*sin(t)",
    ]
    assert main([*words, "--sensor", "q=1e-5", "--sensor", "v", "--plot", str(plot)]) == 0
    text = capsys.readouterr().out
    assert "sensors and their noise: q (1e-05 m), v (" in text
    assert plot.read_text(encoding="utf-8").startswith("<?xml")
    assert main([*words, "--json"]) == 0
    tree = json.loads(capsys.readouterr().out)
    assert {"model_name", "sensors", "size", "effects", "matrix", "separation", "words", "advice"} <= set(tree)
    assert main(["isolability", "zoo:drive", "--t-end", "4", "--input", "tau=multisine(30)"]) == 2
    assert "LOW:HIGH" in capsys.readouterr().err
