"""A figure as inline SVG for an HTML page: small, text as text, colours as CSS variables, identifiers unique."""

from __future__ import annotations

import html
import io
import re
import warnings

from matplotlib.figure import Figure

from .style import COLORS, styled

_NUMBER = re.compile(r"-?\d+\.\d{3,}")
_IDENTIFIER = re.compile(r'(\bid="|href="#|url\(#)')


@styled
def to_svg(figure: Figure, name: str, description: str) -> str:
    """``figure`` as an ``<svg>`` element that scales with the page.

    ``name`` makes the identifiers inside unique within the page; ``description`` is read aloud by screen readers.
    Coordinates are rounded to a hundredth of a point. Each colour of :data:`ltp.plots.style.COLORS` becomes
    ``var(--role, #rrggbb)``, so that a page can give it another value in the dark.
    """
    buffer = io.StringIO()
    with warnings.catch_warnings():
        # The page draws the text in the reader's fonts, so a glyph that matplotlib's font lacks is no loss.
        warnings.filterwarnings("ignore", message=".*[Gg]lyph.*")
        figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None})
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>\s*", "", text, flags=re.DOTALL)
    # matplotlib's style sheet says `*`, which inside a page would mean the whole page; page.css holds these two rules.
    text = re.sub(r"<defs>\s*<style.*?</style>\s*</defs>\s*", "", text, count=1, flags=re.DOTALL)
    text = re.sub(r"<!--.*?-->\s*", "", text, flags=re.DOTALL)
    text = re.sub(r"\sd=\"[^\"]*\"", lambda m: _compact(m.group(0)), text)
    text = _IDENTIFIER.sub(lambda m: f"{m.group(1)}{name}-", text)
    for role, color in COLORS.items():
        text = text.replace(f": {color}", f": var(--{role}, {color})")
    head, body = text.split(">", 1)
    box = re.search(r'viewBox="[^"]*"', head)
    assert box is not None
    return (
        f'<svg {box.group(0)} role="img" aria-label="{html.escape(description, quote=True)}" '
        f'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink">{body.strip()}'
    )


def _compact(path: str) -> str:
    """Path data with two decimals and single spaces."""
    rounded = _NUMBER.sub(lambda m: f"{float(m.group(0)):.2f}".rstrip("0").rstrip("."), path)
    return " d=" + re.sub(r"\s+", " ", rounded.split("=", 1)[1]).replace(' "', '"')
