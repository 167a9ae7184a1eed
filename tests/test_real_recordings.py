"""Owns the tests on recordings of real machines, through the door that a user takes: `ltp diagnose MODEL RUN --json`.

The recordings are public but not ours to commit. They are looked for in the folder that LTP_DATA names, or else in
`shared/data` beside the checkout; docs/recordings says where they come from.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest

from ltp.cli import main

ROOT = Path(__file__).parents[1]
DATA = Path(os.environ.get("LTP_DATA") or ROOT.parent / "shared" / "data")
MODELS = ROOT / "docs" / "recordings"

SYDNEY = "realVSmodel_fwAnd5vstepsx3AndChirp_innerSW.mat"


def diagnose(capsys: pytest.CaptureFixture[str], model: str, folder: str, train: str, *words: str) -> dict[str, Any]:
    """The JSON that the command prints; words that end in `.mat` are files of the folder."""
    place = DATA / folder
    if not place.is_dir():
        pytest.skip(f"no recordings in {place}; docs/recordings says where they come from, LTP_DATA where they are")
    rest = [str(place / word) if ".mat" in word else word for word in words]
    assert main(["diagnose", str(MODELS / model), str(place / train), *rest, "--json"]) == 0
    tree: dict[str, Any] = json.loads(capsys.readouterr().out)
    return tree


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_emps(capsys: pytest.CaptureFixture[str]) -> None:
    """A carriage on a ball screw: dry friction of 20.39 N, which the viscous friction had absorbed."""
    found = diagnose(capsys, "emps.toml", "emps", "DATA_EMPS.mat", "--test", "DATA_EMPS_PULSES.mat")
    assert found["verdict"] == "effect"
    assert found["ambiguous_with"] == []
    first, *others = found["candidates"]
    assert (first["name"], first["at"], first["score"]) == ("coulomb_friction", "drive", 0)
    assert all(entry["score"] is None or entry["score"] > 10 for entry in others)
    (effect,) = found["effects"]
    assert (effect["name"], effect["at"]) == ("coulomb_friction", "drive")
    assert effect["parameters"]["force"]["value"] == pytest.approx(20.39, rel=0.05)
    assert found["parameters"]["M"]["after"] == pytest.approx(95.11, rel=0.01)
    (row,) = found["fit"]["test"]
    assert row["rms_after"] <= 3.9e-6
    assert row["rms_before"] > 6.0e-6
    assert found["parameters"]["Fv"]["before"] > 1.9 * found["parameters"]["Fv"]["after"]
    assert "velocity" in found["location"]["variable"]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_sydney_inner_leg(capsys: pytest.CaptureFixture[str]) -> None:
    """A swinging leg: dry friction of 5.45e-3 N m; the chirp was held out."""
    words = ("--test", f"{SYDNEY}@37.9:", "--columns", "t=datatimeall")
    found = diagnose(capsys, "sydney_inner_leg.toml", "sydney_compass_gait", f"{SYDNEY}@0:37.9", *words)
    assert found["verdict"] == "effect"
    (effect,) = found["effects"]
    assert (effect["name"], effect["at"]) == ("coulomb_friction", "hip")
    assert effect["parameters"]["force"]["value"] == pytest.approx(5.45e-3, rel=0.1)
    (row,) = found["fit"]["test"]
    degree = 0.017453292519943295
    assert row["rms_after"] <= 1.7 * degree
    assert row["rms_before"] > 3.5 * degree


@pytest.mark.parametrize("axis", ["axial", "radial"])
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_bicycle_wheel(axis: str, capsys: pytest.CaptureFixture[str]) -> None:
    """A negative control: two to five swings of a wheel, explained by viscous damping; nothing may be claimed."""
    found = diagnose(capsys, f"bicycle_wheel_{axis}.toml", "bicycle_wheel_pendulum", f"{axis}.csv")
    assert found["verdict"] in ("consistent", "parameter"), found["sentence"]
    assert found["effects"] == []
    assert found["law"] is None
