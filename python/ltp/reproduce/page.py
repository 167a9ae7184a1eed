"""Owns the page of a reproduction: one HTML file that opens offline, and its figures as PNG beside it."""

from __future__ import annotations

import io
import os
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from string import Template

from matplotlib.figure import Figure

from ltp._ltp import InputError
from ltp.files import check_writable, write_bytes, write_text
from ltp.plots.numbers import MISSING
from ltp.plots.style import styled
from ltp.report.markup import details, escape, figure, paragraph, table
from ltp.reproduce.result import HEAD, NONE, Chapter, Reproduction, Table

_DPI = 130
LONG = 12  # rows of a table that is folded away


@dataclass(frozen=True)
class Front:
    """What stands before the chapters: file name and title of the page, and two paragraphs."""

    page: str
    title: str
    lead: str
    facts: str


def prepare(out: str | os.PathLike[str], front: Front) -> Path:
    """The folder, made if it is not there, so that a long computation does not end without a place for its page.

    Raises `InputError` when it cannot be made or written to.
    """
    folder = Path(out)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(f"{folder}: cannot make this folder, {reason}; choose another one") from error
    check_writable(folder / front.page)
    return folder


def write(folder: Path, front: Front, done: Reproduction) -> Path:
    """Write the page and its figures into the folder, each whole or not at all; returns the path of the page."""
    sections: list[str] = []
    for index, chapter in enumerate(done.chapters):
        drawn = []
        for picture in chapter.pictures:
            drawing = picture.draw()
            write_bytes(folder / f"{picture.name}.png", png(drawing))
            drawn.append(figure(drawing, f"f{len(sections)}-{picture.name}", picture.caption, picture.caption))
        sections.append(_section(index, chapter, drawn))
    resources = files("ltp.report")
    text = Template(resources.joinpath("page.html").read_text(encoding="utf-8")).substitute(
        title=front.title,
        css=resources.joinpath("page.css").read_text(encoding="utf-8"),
        headline=_headline(front, done),
        sections="\n".join(sections),
    )
    return write_text(folder / front.page, text)


@styled
def png(drawing: Figure) -> bytes:
    """A figure as PNG on white."""
    stream = io.BytesIO()
    drawing.savefig(stream, format="png", dpi=_DPI, facecolor="white")
    return stream.getvalue()


def _headline(front: Front, done: Reproduction) -> str:
    barred = [row for row in done.rows if row.passed is not None]
    missed = len(done.missed)
    state = "consistent" if done.passed else "unknown"
    verdict = f"{len(barred) - missed} of {len(barred)} figures lie within their bounds"
    return (
        f'<header class="verdict-{state}">\n<p class="verdict">{escape(verdict)}</p>\n<h1>{escape(front.title)}</h1>\n'
        + paragraph(front.lead)
        + f'<p class="facts">{done.seconds:.0f} s in all, drawing aside. {escape(front.facts)}</p>\n</header>'
    )


def _cell(text: str) -> str:
    # An en dash leads what belongs to the row above: HTML swallows spaces at the beginning of a cell.
    led = f"\N{EN DASH} {text.strip()}" if text.startswith("  ") else text
    return MISSING if led == NONE else led


def _table(each: Table) -> str:
    """A short table stands open under its title, a long one opens when it is asked for."""
    body = table(each.head, each.cells)
    return details(each.title, body) if len(each.cells) > LONG else f"<h3>{escape(each.title)}</h3>\n{body}"


def _section(index: int, chapter: Chapter, drawn: list[str]) -> str:
    # A missing figure is a dash of the width of a digit.
    rows = [[_cell(cell) for cell in row.cells()] for row in chapter.rows]
    parts = [
        f'<section aria-labelledby="c{index}">\n<h2 id="c{index}">{escape(chapter.title)}</h2>',
        paragraph(chapter.sentence),
        table([cell or "figure" for cell in HEAD], rows),
        *(_table(each) for each in chapter.tables),
        *drawn,
        *(paragraph(note) for note in chapter.notes),
        f'<p class="facts">{chapter.seconds:.1f} s</p>\n</section>',
    ]
    return "\n".join(parts)
