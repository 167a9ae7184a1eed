"""Owns the tests on recordings of real machines, through the door that a user takes: `ltp diagnose MODEL RUN --json`.

The recordings are public but not ours to commit. They are looked for in the folder that LTP_DATA names, or else in
`shared/data` beside the checkout; docs/recordings says where they come from.
"""

from __future__ import annotations

import json
import math
import os
from pathlib import Path
from typing import Any

import pytest

from ltp.cli import main

ROOT = Path(__file__).parents[1]
DATA = Path(os.environ.get("LTP_DATA") or ROOT.parent / "shared" / "data")
MODELS = ROOT / "docs" / "recordings"

#: Recordings that take minutes: `make proofs` runs them.
long = pytest.mark.skipif(not os.environ.get("LTP_LONG"), reason="takes minutes; make proofs runs it")

SYDNEY = "realVSmodel_fwAnd5vstepsx3AndChirp_innerSW.mat"
WALK = "SysID_data_12exp_120steps.mat"
#: One run of ten steps each, from 30 ms after the join to the one before the next.
WALKS = (
    "0.03:6.95", "6.99:14.11", "14.15:19.41", "19.45:25.1", "25.14:30.91", "30.95:36.705",
    "36.745:42.38", "42.42:48.12", "48.16:53.17", "53.21:58.83", "58.87:63.845", "63.885:68.935",
)  # fmt: skip
#: Laws that hold at rest.
DRY = ("coulomb_friction", "stribeck_friction", "hysteresis")


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
    assert row["rms_after"] <= 3.6e-6
    assert row["rms_before"] > 6.0e-6
    assert found["parameters"]["Fv"]["before"] > 1.9 * found["parameters"]["Fv"]["after"]
    assert "velocity" in found["location"]["variable"]
    # What dry friction leaves has no name; a law over velocity shows it: viscous friction, unlike in two directions.
    assert (found["law"]["at"], found["law"]["variable"]) == ("drive", "velocity")
    assert "unknown to the library" in found["sentence"]


def pooled(found: dict[str, Any], role: str, key: str) -> float:
    """Root mean square over the records of a role, each record counted alike."""
    rows = found["fit"][role]
    return math.sqrt(sum(row[key] ** 2 for row in rows) / len(rows))


def leg(capsys: pytest.CaptureFixture[str], which: str, end: float, start: float) -> dict[str, Any]:
    """The leg fitted on decay and steps, up to `end`; the chirp, from `start`, is held out."""
    file = SYDNEY.replace("inner", which)
    words = ("--test", f"{file}@{start}:", "--columns", "t=datatimeall")
    return diagnose(capsys, f"sydney_{which}_leg.toml", "sydney_compass_gait", f"{file}@0:{end}", *words)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_sydney_inner_leg(capsys: pytest.CaptureFixture[str]) -> None:
    """A swinging leg: dry friction of 5.45e-3 N m; the chirp was held out."""
    found = leg(capsys, "inner", 37.9, 37.9)
    assert found["verdict"] in ("effect", "ambiguous")
    friction = next(effect for effect in found["effects"] if effect["name"] in DRY)
    assert friction["at"] == "hip"
    if friction["name"] == "coulomb_friction":
        assert friction["parameters"]["force"]["value"] == pytest.approx(5.45e-3, rel=0.1)
    (row,) = found["fit"]["test"]
    assert row["rms_after"] <= math.radians(1.6)
    assert row["rms_before"] > math.radians(3.5)


@long
@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_sydney_outer_leg(capsys: pytest.CaptureFixture[str]) -> None:
    """The other leg: held out, dry friction helps far less than for the inner leg, and the verdict may not boast."""
    found = leg(capsys, "outer", 37.75, 37.755)
    (row,) = found["fit"]["test"]
    assert row["rms_before"] < math.radians(1.9)
    assert all(effect["at"] in ("hip", "theta", "u") for effect in found["effects"])
    if found["effects"]:
        assert any(effect["name"] in DRY for effect in found["effects"])
        assert row["rms_after"] < 0.8 * row["rms_before"]


@long
@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_dynamixel(capsys: pytest.CaptureFixture[str]) -> None:
    """A servo with its gears: friction is named, and most of all that which grows with the load on the teeth."""
    folder = DATA / "bam_xl330"
    files = sorted(folder.glob("*.json"))
    if not files:
        pytest.skip(f"no recordings in {folder}; docs/recordings says where they come from, LTP_DATA where they are")
    gain = {path: json.loads(path.read_text())["kp"] for path in files}
    train = [str(path) for path in files if gain[path] in (100, 400)]
    test = [word for path in files if gain[path] in (200, 800) for word in ("--test", str(path))]
    words = ["diagnose", str(MODELS / "dynamixel.toml"), *train, *test, "--columns", "t=timestamp", "--json"]
    assert main(words) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["verdict"] in ("effect", "ambiguous")
    friction = [effect for effect in found["effects"] if effect["name"] in DRY]
    assert [effect["at"] for effect in friction] == ["gearbox"]
    assert pooled(found, "test", "rms_before") > 0.22
    assert pooled(found, "test", "rms_after") <= 0.10


@long
@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_sydney_walking(capsys: pytest.CaptureFixture[str]) -> None:
    """The hip of the walking robot, run freely through nine landings: what is left has no law, and none is claimed."""
    runs = [f"{WALK}@{window}" for window in WALKS]
    words = [*runs[1:8], *(word for run in runs[8:] for word in ("--test", run)), "--columns", "t=datatime"]
    found = diagnose(capsys, "sydney_walking.toml", "sydney_compass_gait", runs[0], *words)
    # Fitted to experiment 1, not to the walk, the model is right to a tenth of the motion already.
    assert pooled(found, "test", "nominal") < 0.15
    assert pooled(found, "test", "rms_before") < math.radians(1.5)
    if found["effects"]:
        assert pooled(found, "test", "rms_after") < 0.85 * pooled(found, "test", "rms_before")
    else:
        assert found["verdict"] in ("unknown", "consistent", "parameter")


@pytest.mark.parametrize("axis", ["axial", "radial"])
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_bicycle_wheel(axis: str, capsys: pytest.CaptureFixture[str]) -> None:
    """A negative control: two to five swings of a wheel, explained by viscous damping; nothing may be claimed."""
    found = diagnose(capsys, f"bicycle_wheel_{axis}.toml", "bicycle_wheel_pendulum", f"{axis}.csv")
    assert found["verdict"] in ("consistent", "parameter"), found["sentence"]
    assert found["effects"] == []
    assert found["law"] is None
