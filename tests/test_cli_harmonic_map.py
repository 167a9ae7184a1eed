"""Owns the tests of the command `ltp harmonic-map`: text, picture, JSON, and what it says of wrong input."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from ltp.cli import main


@pytest.fixture(autouse=True)
def in_own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


class TestHarmonicMap:
    WORDS = ("harmonic-map", "zoo:hopper", "probed.csv@13.2:29.035")

    @pytest.fixture
    def probed(self) -> None:
        """A hopper with less leg damping than the model's, on its orbit, under three sines that share 12 periods."""
        sines = " + ".join(f"sin(2*pi*t*{line}/3.96 + {line})" for line in (1, 2, 4))
        words = ("--set", "d=11", "--t-end", "29.04", "--dt", "0.005", "--input", f"u_c=0.3*({sines})")
        assert main(["simulate", "zoo:hopper", *words, "--out", "probed.csv"]) == 0

    @pytest.mark.usefixtures("probed")
    def test_text_and_picture(self, capsys: pytest.CaptureFixture[str]) -> None:
        capsys.readouterr()
        assert main([*self.WORDS, "--harmonics", "2", "--plot", "map.svg"]) == 0
        out = capsys.readouterr().out
        for word in ("u_c to h", "+2", "touchdown comes 2 ms late", "map.svg"):
            assert word in out
        assert Path("map.svg").read_text(encoding="utf-8").startswith("<?xml")

    @pytest.mark.usefixtures("probed")
    def test_json(self, capsys: pytest.CaptureFixture[str]) -> None:
        capsys.readouterr()
        assert main([*self.WORDS, "--harmonics", "1", "--band", "0.6", "--set", "d=11", "--json"]) == 0
        tree = json.loads(capsys.readouterr().out)
        assert tree["differs"] is False
        assert tree["harmonics"] == [-1, 0, 1]
        assert tree["omega"] == pytest.approx([math.tau / 3.96, math.tau / 1.98])

    @pytest.mark.usefixtures("probed")
    @pytest.mark.parametrize(
        ("old", "new", "message"),
        [
            ("zoo:hopper", "zoo:drive", "'tau'"),
            ("probed.csv@13.2:29.035", "nowhere.csv", "no such file"),
            ("probed.csv@13.2:29.035", "probed.csv@13.2:15", "fewer than 8"),
            ("1", "1000", "Nyquist"),
            ("map.svg", "nowhere/map.svg", "'nowhere' does not exist"),
        ],
    )
    def test_wrong_input(self, old: str, new: str, message: str, capsys: pytest.CaptureFixture[str]) -> None:
        capsys.readouterr()
        words = [*self.WORDS, "--harmonics", "1", "--plot", "map.svg"]
        assert main([new if word == old else word for word in words]) == 2
        captured = capsys.readouterr()
        assert captured.out == ""
        assert message in captured.err

    def test_a_model_without_a_clock(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert main(["simulate", "zoo:drive", "--t-end", "1", "--input", "tau=sin(9*t)", "--out", "run.csv"]) == 0
        assert main(["harmonic-map", "zoo:drive", "run.csv"]) == 2
        assert "no [clock]" in capsys.readouterr().err
