"""Puts the page together: the sections in their order, the style sheet, the template.

A new section is a new file in ``sections`` and one more name in ``SECTIONS``.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib.resources import files
from string import Template

from ltp.plots.numbers import parse_sentence

from .markup import Section, escape
from .sections import absorbed, curves, fit, force, guide, harmonic, headline, model, notes, ranking, separate
from .view import View

#: In the order of the page. Each takes the view and gives a section, or ``None`` when there is nothing to say.
SECTIONS: tuple[Callable[[View], Section | None], ...] = (
    fit.section,
    curves.section,
    force.section,
    harmonic.section,
    ranking.section,
    separate.section,
    absorbed.section,
    notes.section,
    model.section,
    guide.section,
)


def build(view: View) -> str:
    """The whole page as one string of HTML that needs no other file."""
    made = [section for section in (make(view) for make in SECTIONS) if section is not None]
    resources = files(__package__)
    return Template(resources.joinpath("page.html").read_text(encoding="utf-8")).substitute(
        title=escape(f"{view.model_name}: {view.title}"),
        css=resources.joinpath("page.css").read_text(encoding="utf-8"),
        headline=headline.html(view),
        sections="\n".join(_section(section) for section in made),
    )


def _section(section: Section) -> str:
    return (
        f'<section aria-labelledby="{section.anchor}">\n<h2 id="{section.anchor}">{escape(section.title)}</h2>\n'
        f"<p>{escape(parse_sentence(section.sentence))}</p>\n{section.body}\n</section>"
    )
