"""Owns the tests of the pages: every block of Python and every `ltp` command in README.md and docs runs as printed."""

from __future__ import annotations

import os
import re
import shlex
from pathlib import Path

import pytest

from ltp.cli import main

ROOT = Path(__file__).parents[1]
DATA = Path(os.environ.get("LTP_DATA") or ROOT.parent / "shared" / "data")
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
#: Recordings that the pages name, by their folder in the data.
FOLDERS = {"DATA_EMPS": "emps", "realVSmodel": "sydney_compass_gait", "radial": "bicycle_wheel_pendulum"}
FOLDERS["axial"] = FOLDERS["radial"]
FOLDERS["SysID"] = FOLDERS["realVSmodel"]
FOLDERS["2026-01-15_"] = "bam_xl330"


def blocks(page: Path, language: str) -> list[str]:
    return [body for kind, body in BLOCK.findall(page.read_text(encoding="utf-8")) if kind == language]


def commands(page: Path) -> list[str]:
    return [line for body in blocks(page, "sh") for line in body.splitlines() if line.strip()]


def place(word: str) -> str:
    """The word with a recording or a document of the project where it really is."""
    folder = next((folder for start, folder in FOLDERS.items() if word.startswith(start)), None)
    if folder is not None and Path(word.partition("@")[0]).suffix in (".mat", ".csv", ".json"):
        path = DATA / folder / word
        if not (DATA / folder).is_dir():
            pytest.skip(
                f"no recordings in {DATA / folder}; the page says where they come from, LTP_DATA where they are"
            )
        return str(path)
    return str(ROOT / word) if word.startswith("docs/") else word


def ids(pages: list[Path]) -> list[str]:
    return [page.relative_to(ROOT).as_posix() for page in pages]


WITH_PYTHON = [page for page in PAGES if blocks(page, "python")]
#: Pages whose commands take minutes and are the very ones of tests/test_real_recordings.py.
ELSEWHERE = {"emps.md", "dynamixel.md", "sydney.md"}
WITH_COMMANDS = [page for page in PAGES if commands(page) and page.name not in ELSEWHERE]


@pytest.fixture(autouse=True)
def in_own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def shape(text: str) -> str:
    """A text without its line breaks and with every number as `#`."""
    return re.sub(r"\d[\d.]*(e[-+]?\d+)?", "#", " ".join(text.split()))


@pytest.mark.parametrize("page", WITH_PYTHON, ids=ids(WITH_PYTHON))
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_python_blocks_run_in_order(page: Path) -> None:
    names: dict[str, object] = {}
    for body in blocks(page, "python"):
        for name in re.findall(r'"(\w+\.(?:mat|csv))"', body):
            if place(name) != name:
                Path(name).symlink_to(place(name))
        exec(compile(body, str(page), "exec"), names)


@pytest.mark.parametrize("page", WITH_COMMANDS, ids=ids(WITH_COMMANDS))
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_commands_run_in_order(page: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for line in commands(page):
        program, *words = shlex.split(line)
        assert program == "ltp", line
        assert main([place(word) for word in words]) == 0, capsys.readouterr().err


@pytest.mark.parametrize("example", [0, 1])
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_readme_prints_what_it_says(example: int, capsys: pytest.CaptureFixture[str]) -> None:
    page = ROOT / "README.md"
    exec(compile(blocks(page, "python")[example], str(page), "exec"), {})
    assert shape(capsys.readouterr().out) == shape(blocks(page, "text")[example])


def test_signals_page_prints_what_it_says(capsys: pytest.CaptureFixture[str]) -> None:
    page = ROOT / "docs" / "signals.md"
    exec(compile(blocks(page, "python")[0], str(page), "exec"), {})
    assert capsys.readouterr().out == blocks(page, "text")[0]


def test_links_lead_somewhere() -> None:
    for page in PAGES:
        for target in re.findall(r"\]\((?!https?:|#)([^)#]+)", page.read_text(encoding="utf-8")):
            assert (page.parent / target).exists(), f"{page.name}: {target}"


def test_readme_is_short() -> None:
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 125
