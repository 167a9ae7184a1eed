"""`ltp.files`: whole or not at all, and nothing left beside it."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from ltp import files


def interrupted(*_: object, **__: object) -> None:
    raise KeyboardInterrupt


def interrupted_after(does: Callable[..., object]) -> Callable[..., object]:
    def call(*args: object, **options: object) -> object:
        does(*args, **options)
        raise KeyboardInterrupt

    return call


def test_replaces_in_one_step(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    files.write_text(path, "old")
    assert files.write_text(path, "new") == path
    assert path.read_text(encoding="utf-8") == "new"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.skipif(os.name != "posix", reason="permissions as POSIX has them")
def test_permissions_are_those_the_user_asks_for(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        files.write_text(tmp_path / "a.txt", "a")
    finally:
        os.umask(before)
    assert (tmp_path / "a.txt").stat().st_mode & 0o777 == 0o640


@pytest.mark.parametrize("when", ["renaming", "opening"])
def test_ctrl_c_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, when: str) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old", encoding="utf-8")
    if when == "renaming":  # the file is written and not yet renamed
        monkeypatch.setattr(os, "replace", interrupted)
    else:  # it was opened, and the signal comes before a byte is in it
        monkeypatch.setattr("builtins.open", interrupted_after(open))
    with pytest.raises(KeyboardInterrupt):
        files.write_text(path, "new")
    monkeypatch.undo()
    assert path.read_text(encoding="utf-8") == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_what_a_kill_left_is_swept_and_nothing_else(tmp_path: Path) -> None:
    for name in (".a[1].json.0123abcd.part", ".a1.json.0123abcd.part", ".b.json.0123abcd.part", "a[1].json"):
        (tmp_path / name).write_text("half", encoding="utf-8")
    files.sweep(tmp_path / "a[1].json")
    left = [".a1.json.0123abcd.part", ".b.json.0123abcd.part", "a[1].json"]
    assert sorted(path.name for path in tmp_path.iterdir()) == left
