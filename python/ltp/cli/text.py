"""Owns how results are set as plain text: aligned tables, numbers with as many digits as they deserve."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ltp.isolability import Isolability

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


def isolability_text(found: Isolability) -> str:
    """What a set-up tells apart: a table of effects, the matrix of pairs, and what would help."""
    sensors = ", ".join(f"{name} ({with_unit(number(e.value, 3), e.unit)})" for name, e in found.sensors.items())
    rows = [
        [
            str(k + 1),
            effect.label,
            ", ".join(f"{name} = {with_unit(number(e.value, 3), e.unit)}" for name, e in effect.parameters.items()),
            number(effect.raw, 3),
            number(effect.visible, 3),
            "yes" if effect.detectable else f"no: like {effect.alike}" if effect.alike else "no",
        ]
        for k, effect in enumerate(found.effects)
    ]
    marks = {"separable": "+", "doubtful": "?", "never": "="}
    seen = [effect.detectable for effect in found.effects]
    grid = [
        [str(i + 1)] + ["" if i == j else marks[word] if seen[i] and seen[j] else "." for j, word in enumerate(words)]
        for i, words in enumerate(found.words)
    ]
    parts = [
        found.sentence,
        "",
        f"sensors and their noise: {sensors}",
        "",
        table(["", "effect", "at this size", "raw change", "visible", "seen"], rows, left=3),
        "",
        "raw change: rms over noise; visible: what parameters and initial states cannot imitate, in units of noise",
        "",
        table(["", *(str(k + 1) for k in range(len(rows)))], grid),
        "",
        "+ told apart   ? doubtful   = not told apart   . one of the two is not seen",
    ]
    if found.advice:
        parts += ["", "what would help (deviance now -> then, 10 is decisive):"]
    for advice in found.advice:
        helps = "; ".join(f"{help.sentence} (-> {number(help.deviance, 3)})" for help in advice.by[:3])
        parts.append(f"  {' and '.join(advice.of)} ({number(advice.now, 2)}): {helps or 'nothing that was tried'}")
    return "\n".join(parts)
