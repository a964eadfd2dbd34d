"""Numbers as engineers write them: as many digits as are known, prefixes in steps of a thousand, units with them."""

from __future__ import annotations

import math
from typing import Final

PREFIXES: Final = {0: "", -3: "m", -6: "µ", -9: "n", -12: "p", 3: "k", 6: "M"}
PREFIXED: Final = ("N m", "A", "V")  # a prefix before these, at the beginning of a unit, is read at once
PREFIXED_ALONE: Final = ("s", "Hz")
PLAIN_FROM, PLAIN_TO = 1e-3, 1e4  # without prefix: sizes written out
SUPERSCRIPTS: Final = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
DIGITS: Final = 4  # of a value whose error is not known
NO_CHANCE: Final = 1e-16  # smaller probabilities are rounding


def measure(value: float | None, std: float | None, unit: str) -> str:
    """Write a value with its standard deviation and unit, such as "500.30 ± 0.79 µN m"; a dash where there is none."""
    if value is None or not math.isfinite(value):
        return "–"
    known = std is not None and math.isfinite(std) and std > 0
    largest = max(abs(value), std) if known and std is not None else abs(value)
    power = thousands(largest) if _takes_prefix(unit) else _plain_power(largest)
    value = value / 10.0**power
    if known and std is not None:
        std = std / 10.0**power
        decimals = min(max(1 - math.floor(math.log10(std)), 0), 12)
        number = f"{value:.{decimals}f} ± {std:.{decimals}f}"
    else:
        number = f"{value:.{DIGITS}g}"
    if _takes_prefix(unit):
        return f"{number} {PREFIXES[power]}{unit}"
    if power:
        number = (f"({number})" if known else number) + f"·10{str(power).translate(SUPERSCRIPTS)}"
    return number if unit == "-" else f"{number} {unit}"


def thousands(size: float) -> int:
    """Return the power of ten, a multiple of three that has a prefix, with which a size has one to three digits."""
    if size <= 0 or not math.isfinite(size):
        return 0
    return min(max(3 * math.floor(math.log10(size) / 3), min(PREFIXES)), max(PREFIXES))


def probability(p: float) -> str:
    """Write a probability."""
    if p < NO_CHANCE:
        return f"< 10{str(math.floor(math.log10(NO_CHANCE))).translate(SUPERSCRIPTS)}"
    if p >= PLAIN_FROM:
        return f"{p:.2g}"
    power = math.floor(math.log10(p))
    return f"{p / 10.0**power:.1f}·10{str(power).translate(SUPERSCRIPTS)}"


def in_words(parameter: str, unit: str) -> str:
    """Return a parameter's name in words: "stribeck_speed_rad_s" in rad/s is its Stribeck speed."""
    ending = "_" + unit.replace("N m", "Nm").replace("²", "2").replace("/", "_").replace(" ", "_")
    return parameter.removesuffix(ending).replace("_", " ").replace("stribeck", "Stribeck").replace("ar c", "AR c")


def _takes_prefix(unit: str) -> bool:
    return unit in PREFIXED_ALONE or any(
        unit == first or unit.startswith((f"{first} ", f"{first}/")) for first in PREFIXED
    )


def _plain_power(size: float) -> int:
    return 0 if size <= 0 or PLAIN_FROM <= size < PLAIN_TO else math.floor(math.log10(size))
