"""How numbers and units are written for people: significant digits, uncertainties, SI prefixes, typographic units.

Figures and the report share these, so that a force reads the same on an axis, in a table and in a sentence.
"""

from __future__ import annotations

import math
import re

MISSING = "–"
NBSP = "\u00a0"

# Units that people read with prefixes, and the largest useful prefix exponent ("k" for newtons, none for seconds).
_PREFIXABLE = {"m": 3, "s": 0, "N": 6, "N m": 6, "V": 3, "A": 3, "rad": 0, "Hz": 9, "W": 9, "J": 9, "Pa": 9}
_PREFIX = {-12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}
#: Digits and signs as they stand in exponents.
SUPERSCRIPT = str.maketrans("0123456789-−+.", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻⁻⁺·")
_SPELLING = {"deg": "°", "um": "µm", "us": "µs", "ohm": "Ω", "Ohm": "Ω"}


def as_number(value: object) -> float:
    """The value as a float; NaN for anything absent or not a number (JSON null, text)."""
    if isinstance(value, bool) or value is None:
        return math.nan
    try:
        return float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        return math.nan


def pretty_unit(unit: str | None) -> str:
    """A unit as it is printed: ``"kg m^2"`` becomes ``kg·m²``, ``"deg/s"`` becomes ``°/s``, ``"1"`` becomes nothing."""
    if unit is None or unit.strip() in ("", "1"):
        return ""
    bare = re.sub(r"\^\(([-−+]?[0-9.]+)\)", r"^\1", unit.strip())
    raised = re.sub(r"\^([-−+]?[0-9.]+)", lambda m: m.group(1).translate(SUPERSCRIPT), bare)
    spelled = re.sub(r"[^\W\d_]+", lambda m: _SPELLING.get(m.group(0), m.group(0)), raised)
    return re.sub(r"[ *]+", "·", re.sub(r" */ *", "/", spelled))


def prefixed(unit: str | None, magnitude: float) -> tuple[float, str]:
    """The factor and the printed unit that bring ``magnitude`` (in ``unit``) between 1 and 1000.

    Values from 0.1 to 1000 stay as they are; units that take no prefix (``kg``, ``deg``, ``N s/m``) are never scaled.
    """
    name = (unit or "").strip()
    largest = _PREFIXABLE.get(name)
    if largest is None or not math.isfinite(magnitude) or magnitude == 0 or 0.1 <= abs(magnitude) < 1000:
        return 1.0, pretty_unit(unit)
    # The tiny addition keeps 1e-3, whose logarithm may come out a hair below -3, in milli.
    exponent = 3 * math.floor(math.log10(abs(magnitude)) / 3 + 1e-12)
    exponent = max(-12, min(largest, exponent))
    return 10.0**-exponent, _PREFIX[exponent] + pretty_unit(name)


def significant(value: object, digits: int = 3) -> str:
    """``digits`` significant digits with a real minus sign; powers of ten outside 0.001 to 100 000."""
    number = as_number(value)
    if math.isnan(number):
        return MISSING
    if math.isinf(number):
        return "∞" if number > 0 else "−∞"
    if number == 0:
        return "0"
    mantissa, power = f"{number:.{digits - 1}e}".split("e")
    exponent = int(power)
    if -3 <= exponent < 5:
        return minus(f"{float(f'{number:.{digits - 1}e}'):.{max(0, digits - 1 - exponent)}f}")
    return f"{minus(mantissa)}{NBSP}×{NBSP}10{str(exponent).translate(SUPERSCRIPT)}"


def minus(text: str) -> str:
    """Hyphens turned into minus signs."""
    return text.replace("-", "−")


def percent(value: object) -> str:
    """A fraction as a percentage with three significant digits, e.g. ``0.236`` as ``23.6 %``."""
    number = as_number(value)
    if math.isnan(number):
        return MISSING
    return f"{significant(100 * number)}{NBSP}%"


def with_unit(text: str, unit: str) -> str:
    """Number and printed unit, joined so that no line break can part them; degrees stand close to the number."""
    if not unit or text == MISSING:
        return text
    return text + unit if unit == "°" else text + NBSP + unit


def quantity(value: object, unit: str | None = None, sd: object = None, digits: int = 3) -> str:
    """A value with its unit and, where known, its one-sigma uncertainty: ``20.4 ± 0.3 N``.

    The uncertainty gets one significant digit, two when it begins with 1; the value stops at the same decimal.
    """
    number, spread = as_number(value), as_number(sd)
    if not math.isfinite(number):
        return with_unit(significant(number), pretty_unit(unit))
    has_spread = math.isfinite(spread) and spread > 0
    factor, printed = prefixed(unit, number if abs(number) >= spread or not has_spread else spread)
    number *= factor
    if not has_spread:
        return with_unit(significant(number, digits), printed)
    spread *= factor
    largest = math.floor(math.log10(max(abs(number), spread)))
    power = largest if not -3 <= largest < 5 else 0
    body = _plus_minus(number / 10.0**power, spread / 10.0**power)
    if power:
        return with_unit(f"({body}){NBSP}×{NBSP}10{str(power).translate(SUPERSCRIPT)}", printed)
    return with_unit(f"({body})" if printed == "°" else body, printed)


def _plus_minus(number: float, spread: float) -> str:
    leading = math.floor(math.log10(spread))
    digits = 2 if spread / 10.0**leading < 1.95 else 1
    decimals = digits - 1 - leading
    shown = max(0, decimals)
    return f"{minus(f'{round(number, decimals):.{shown}f}')}{NBSP}±{NBSP}{round(spread, decimals):.{shown}f}"


def parse_sentence(text: str) -> str:
    """The diagnosis' own sentence with ``+-`` (or ``+/-``) set as ``±`` and no break around it."""
    signed = re.sub(r"(?<=\s)\+/?-(?=\s)", "±", text)
    # Neither an uncertainty, nor its unit, nor a percent sign may begin a line.
    joined = re.sub(r"(?<=\d) (?=[%±°])|(?<=±) (?=\d)", NBSP, signed)
    return re.sub(rf"(±{NBSP}[\d.]+) (?=\S)", rf"\1{NBSP}", joined)


def shorten(text: str, limit: int = 34) -> str:
    """A name for a figure: control characters removed, and the middle cut out when it is longer than ``limit``."""
    clean = "".join(ch if ch.isprintable() else " " for ch in str(text))
    if len(clean) <= limit:
        return clean
    head = (limit - 1) * 2 // 3
    return clean[:head] + "…" + clean[-(limit - 1 - head) :]
