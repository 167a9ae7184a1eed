"""Owns how results are set as plain text: aligned tables, numbers with as many digits as they deserve."""

from __future__ import annotations

import math
from collections.abc import Sequence

NONE = "-"


def table(header: Sequence[str], rows: Sequence[Sequence[str]], left: int = 1) -> str:
    """Rows under a header, indented by two; the first `left` columns are flush left, the others flush right."""
    lines = [header, *rows]
    widths = [max(len(line[k]) for line in lines) for k in range(len(header))]
    return "\n".join(
        "  "
        + "   ".join(
            cell.ljust(width) if k < left else cell.rjust(width)
            for k, (cell, width) in enumerate(zip(line, widths, strict=True))
        ).rstrip()
        for line in lines
    )


def number(value: float | None, digits: int = 4) -> str:
    """A number with `digits` significant digits, a dash for none."""
    return NONE if value is None or math.isnan(value) else f"{value:.{digits}g}"


def percent(value: float | None) -> str:
    """A ratio in percent with three significant digits, a dash for none."""
    return NONE if value is None or math.isnan(value) else f"{100 * value:.3g} %"


def estimate(value: float | None, sd: float | None) -> str:
    """`20.44 +/- 0.31`: the uncertainty with two significant digits, the value to the same decimal place."""
    if value is None or sd is None or not (math.isfinite(sd) and sd > 0 and math.isfinite(value)):
        return number(value, 5)
    place = 1 - math.floor(math.log10(sd))  # decimals that show two digits of sd
    largest = max(abs(value), sd)
    if not 1e-4 <= largest < 1e6 or place > 9:
        exponent = math.floor(math.log10(largest))
        scale = 10.0**exponent
        return f"({estimate(value / scale, sd / scale)})e{exponent:+03d}" if exponent else f"{value:.9g} +/- {sd:.2g}"
    decimals = max(place, 0)
    return f"{value:.{decimals}f} +/- {sd:.{decimals}f}"


def with_unit(text: str, unit: str) -> str:
    """The text followed by its unit, except for what is dimensionless."""
    return text if unit in ("", "1") else f"{text} {unit}"
