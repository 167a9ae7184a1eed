"""Owns the tests of `ltp.reproduce`: the quick reproduction keeps its bounds, its page is whole, rows are honest."""

from __future__ import annotations

import html
import math
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

import ltp
from ltp.reproduce import Chapter, Reproduction, Row, Table, cart_pendulum, hopper
from ltp.reproduce.duyul.ode45 import ode45


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("reproduce") / "hopper"


@pytest.fixture(scope="module")
def done(folder: Path) -> Reproduction:
    return hopper(folder, quick=True)


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("reproduce") / "cart"


@pytest.fixture(scope="module")
def cart(place: Path) -> Reproduction:
    return cart_pendulum(place, quick=True)


class TestQuick:
    def test_every_bound_is_kept(self, done: Reproduction) -> None:
        assert [f"{row.what}: {row.ours} not in {row.bar}" for row in done.missed] == []
        assert done.passed
        assert sum(row.passed is not None for row in done.rows) > 45

    def test_what_the_paper_prints_comes_out(self, done: Reproduction) -> None:
        published = {row.what.strip(): row.ours for row in done.rows if row.paper.endswith("%")}
        assert published["n_h 21, smoothness to 0: 1 Hz"] == pytest.approx(3.3, abs=0.1)
        assert published["limit cycle off by 0.33 um: settled step"] == pytest.approx(68.0, abs=2.0)

    def test_no_estimate_beats_its_floor(self, done: Reproduction) -> None:
        """Beyond what chance allows: errors of estimates and of truncation may cancel by a little."""
        for row in done.rows:
            if row.unit == "%" and not math.isnan(row.floor):
                assert row.ours > 0.95 * row.floor, row.what

    def test_page_and_figures(self, done: Reproduction, folder: Path) -> None:
        page = (folder / "hopper.html").read_text(encoding="utf-8")
        for chapter in done.chapters:
            assert html.escape(chapter.title, quote=True) in page
        assert "://" not in page.replace("http://www.w3.org/", "")  # it opens offline
        svgs = [
            part[: part.index("</svg>") + 6]
            for part in page.split("<figure>")[1:]
            for part in [part[part.index("<svg") :]]
        ]
        pictures = [picture for chapter in done.chapters for picture in chapter.pictures]
        assert len(svgs) == len(pictures) >= 9
        for svg in svgs:
            ElementTree.fromstring(svg)
        for picture in pictures:
            assert (folder / f"{picture.name}.png").read_bytes().startswith(b"\x89PNG")
        assert not list(folder.glob(".*"))  # nothing is left half written

    def test_chapters_were_told_one_by_one(self) -> None:
        told: list[str] = []

        def stop(chapter: Chapter) -> None:
            told.append(chapter.title)
            raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            hopper(quick=True, say=stop)
        assert told == ["Limit cycle (figure 5)"]

    def test_a_place_that_cannot_be(self, tmp_path: Path) -> None:
        (tmp_path / "file").write_text("", encoding="utf-8")
        with pytest.raises(ltp.InputError, match="cannot make this folder"):
            hopper(tmp_path / "file" / "out")


class TestCartPendulum:
    def test_every_bound_is_kept(self, cart: Reproduction) -> None:
        assert [f"{row.what}: {row.ours} not in {row.bar}" for row in cart.missed] == []
        assert sum(row.passed is not None for row in cart.rows) > 130

    def test_all_hundred_eigenvalues_are_shown(self, cart: Reproduction) -> None:
        tables = [table for chapter in cart.chapters for table in chapter.tables if table.title.startswith("Table 4.")]
        assert [table.title for table in tables] == [f"Table 4.{k}" for k in range(1, 6)]
        assert sum(len(table.cells) for table in tables) == 100

    def test_failing_gains_are_stable_and_say_why(self, cart: Reproduction) -> None:
        chapter = next(chapter for chapter in cart.chapters if "Inverted" in chapter.title)
        assert len(chapter.notes) == 2
        for note in chapter.notes:
            assert "the reference is not an orbit" in note
            assert "transient growth" in note

    def test_page_and_figures(self, cart: Reproduction, place: Path) -> None:
        page = (place / "cart_pendulum.html").read_text(encoding="utf-8")
        assert "://" not in page.replace("http://www.w3.org/", "")  # it opens offline
        pictures = [picture for chapter in cart.chapters for picture in chapter.pictures]
        assert page.count("<figure>") == len(pictures) >= 12
        for picture in pictures:
            assert (place / f"{picture.name}.png").read_bytes().startswith(b"\x89PNG")
        assert page.count("<details>") == 5  # the long tables are folded away

    def test_tables_are_in_the_tree(self) -> None:
        chapter = Chapter("A", "B.", [], tables=[Table("T", ["a"], [["1"]])])
        tree = Reproduction([chapter], 1.0).tree()
        assert tree["chapters"][0]["tables"] == [{"title": "T", "head": ["a"], "cells": [["1"]]}]


class TestOde45:
    """The emulation of ode45: its order, and what loose tolerances do."""

    def test_the_error_is_that_of_its_tolerance(self) -> None:
        t, y = ode45(lambda t, y: np.array([y[1], -y[0]]), np.array([1.0, 0.0]), 20.0)
        error = np.abs(y[:, 0] - np.cos(t)).max()
        assert 1e-4 < error < 3e-2  # loose on purpose
        assert t[-1] == 20.0
        assert np.all(np.diff(t) > 0)
        assert (len(t) - 1) % 4 == 0  # each step in four

    def test_a_line_is_followed_exactly(self) -> None:
        t, y = ode45(lambda t, y: np.array([2.0]), np.array([1.0]), 3.0)
        assert np.abs(y[:, 0] - (1.0 + 2.0 * t)).max() < 1e-14


class TestRow:
    @pytest.mark.parametrize(
        ("low", "high", "passed", "bar"),
        [
            (math.nan, math.nan, None, "-"),
            (2.0, math.nan, True, "at least 2.00"),
            (math.nan, 2.0, False, "at most 2.00"),
            (2.0, 4.0, True, "2.00 to 4.00"),
            (3.4, 4.0, False, "3.40 to 4.00"),
        ],
    )
    def test_bounds(self, low: float, high: float, passed: bool | None, bar: str) -> None:
        row = Row("1 Hz", 3.3, "%", low=low, high=high)
        assert (row.passed, row.bar) == (passed, bar)

    def test_what_is_not_a_number_keeps_no_bound(self) -> None:
        assert Row("1 Hz", math.nan, "%", high=4.0).passed is False

    def test_cells(self) -> None:
        assert Row("step", 67.44, "%", "68 %", floor=3e-6, low=60.0).cells() == [
            "step", "68 %", "67.4 %", "3.00e-6", "at least 60.0", "yes",
        ]  # fmt: skip
