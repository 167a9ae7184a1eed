"""Small pieces of HTML. Every text that comes from a model, a recording or a user passes through :func:`escape`."""

from __future__ import annotations

import html
import re
from collections.abc import Sequence
from dataclasses import dataclass

from matplotlib.figure import Figure

from ltp.plots import to_svg


@dataclass(frozen=True)
class Section:
    """A section of the page: a title, a sentence and a figure. ``sentence`` is plain text, ``body`` is HTML."""

    anchor: str
    title: str
    sentence: str
    body: str = ""


def escape(text: object) -> str:
    """Text for HTML content and attributes; control characters, which HTML forbids, become a replacement mark."""
    clean = "".join(ch if ch.isprintable() or ch in "\n\t\u00a0\u202f" else "\ufffd" for ch in str(text))
    return html.escape(clean, quote=True)


def prose(text: object) -> str:
    """As :func:`escape`, with names in backticks set as code."""
    return re.sub(r"`([^`\n]+)`", r"<code>\1</code>", escape(text))


def table(head: Sequence[str], rows: Sequence[Sequence[str]], *, text_columns: int = 1) -> str:
    """A table of plain texts; columns after the first ``text_columns`` hold numbers and are set to the right."""

    def row(cells: Sequence[str], tag: str) -> str:
        parts = []
        for index, cell in enumerate(cells):
            kind = ' class="number"' if index >= text_columns else ""
            scope = ' scope="col"' if tag == "th" else ""
            parts.append(f"<{tag}{kind}{scope}>{escape(cell)}</{tag}>")
        return f"<tr>{''.join(parts)}</tr>"

    body = "\n".join(row(cells, "td") for cells in rows)
    return (
        f'<div class="scroll" tabindex="0" role="region" aria-label="table"><table>\n<thead>{row(head, "th")}</thead>\n'
        f"<tbody>\n{body}\n</tbody></table></div>"
    )


def figure(drawing: Figure, name: str, description: str, caption: str = "") -> str:
    """A figure with an optional caption; ``name`` is unique on the page, ``description`` is read aloud."""
    below = f"<figcaption>{escape(caption)}</figcaption>" if caption else ""
    spoken = escape(description).replace("\ufffd", " ")
    svg = to_svg(drawing, name, html.unescape(spoken))
    return f'<figure><div class="scroll" tabindex="0" role="region" aria-label="figure">{svg}</div>{below}</figure>'


def details(summary: str, body: str, *, opened: bool = False) -> str:
    """A part that unfolds on request; ``body`` is HTML."""
    return f"<details{' open' if opened else ''}><summary>{escape(summary)}</summary>\n{body}\n</details>"


def paragraph(text: str) -> str:
    """A paragraph of plain text."""
    return f"<p>{escape(text)}</p>"
