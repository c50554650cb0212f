"""How numbers and numbers of things are written: the one place that knows digits, signs, units and limits.

A minus sign is a hyphen here, which every terminal has; pages replace it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final, NamedTuple

DIGITS: Final = 3
"""Significant digits of the largest number of a column."""
MISSING: Final = "-"
"""What stands in place of a number that there is not."""


class Estimate(NamedTuple):
    """An estimate with its limits, nan where they are not known, as a row of a table has them."""

    estimate: float
    low: float
    high: float

    @classmethod
    def of(cls, row: Mapping[str, Any], name: str) -> Estimate:
        """Return a figure of a row: its columns ``name``, ``name_low`` and ``name_high``."""
        values = (row.get(f"{name}{end}") for end in ("", "_low", "_high"))
        return cls(*(math.nan if value is None else value for value in values))


def is_missing(value: object) -> bool:
    """Return whether a value is None or nan."""
    return value is None or (isinstance(value, float) and math.isnan(value))


def decimals_of(values: Iterable[float | None], digits: int = DIGITS) -> int | None:
    """Return with how many decimals numbers that stand together are written."""
    sizes = [abs(float(value)) for value in values if value is not None and math.isfinite(value)]
    if all(size.is_integer() for size in sizes):  # also if there are no sizes
        return 0
    largest = max(sizes)
    if not 1e-4 <= largest < 1e12:
        return None
    decimals = max(digits - 1 - math.floor(math.log10(largest)), 0)
    smallest = min(size for size in sizes if size > 0)
    if smallest < 0.5 * 10**-decimals:  # it would be written as 0
        return None
    while decimals and all(f"{size:.{decimals}f}".endswith("0") for size in sizes):
        decimals -= 1
    return decimals


def few_decimals_of(values: Iterable[float | None]) -> int:
    """Return as few decimals as leave the largest of several numbers two digits; whole numbers have none."""
    sizes = [abs(float(value)) for value in values if value is not None and math.isfinite(value)]
    if all(round(size, 9).is_integer() for size in sizes):  # also if there are no sizes
        return 0
    return max(1 - math.floor(math.log10(max(sizes))), 0)


def number(
    value: float | None, decimals: int | None = None, *, digits: int = DIGITS, sign: bool = False
) -> str:
    """Write a number; one that is missing becomes a hyphen."""
    if value is None or is_missing(value):
        return MISSING
    if math.isinf(value):
        text = "∞" if value > 0 else "-∞"
    elif decimals is not None and abs(value) < 1e12:
        text = f"{value:.{decimals}f}"
        text = text if float(text) else text.removeprefix("-")  # 0, not -0
    elif isinstance(value, int) or (float(value).is_integer() and abs(value) < 1e12):
        text = f"{int(value)}"
    else:
        text = f"{value:.{digits}g}"
        if "e+" in text and abs(value) < 1e12:
            text = f"{value:.0f}"
    return f"+{text}" if sign and value > 0 and text.strip("0.") else text


def stated(value: float | None) -> str:
    """Write a number as somebody stated it, such as a threshold: with up to six significant digits."""
    return number(value, digits=6)


def whole(n: float) -> str:
    """Write a number of things whose name follows later, as in ``1,000 of 2,000 runs``."""
    return f"{n:,.0f}"


def percent(
    share: float | None, decimals: int | None = 1, *, digits: int = DIGITS, sign: bool = False
) -> str:
    """Write a share from 0 to 1 in percent, with its sign for percent."""
    if share is None or is_missing(share):
        return MISSING
    return f"{number(100 * share, decimals, digits=digits, sign=sign)} %"


def stated_percent(share: float | None) -> str:
    """Write a share that somebody stated, such as a boundary, in percent: ``50 %``, ``2.5 %``."""
    return percent(share, None, digits=4)


def with_limits(interval: Any, unit: str = "", decimals: int | None = None, *, sign: bool = False) -> str:
    """Write an estimate, its unit and its limits: ``441 s [410, 472]``; limits that are unknown are left out."""
    values = [interval.estimate, interval.low, interval.high]
    if unit in ("%", "points"):
        values = [100 * value for value in values]
        decimals = 1 if decimals is None else decimals
    if not decimals:
        decimals = decimals_of(values) if decimals is None else few_decimals_of(values)
    estimate, low, high = (number(value, decimals, sign=sign) for value in values)
    text = estimate if estimate == MISSING or not unit else f"{estimate} {unit}"
    is_known = math.isfinite(values[0]) and (math.isfinite(values[1]) or math.isfinite(values[2]))
    return f"{text} [{low}, {high}]" if is_known and MISSING not in (low, high) else text


def p_value(p: float | None) -> str:
    """Write a p-value with three decimals; one below them as such."""
    if p is None or is_missing(p):
        return MISSING
    return "< 0.001" if p < 0.001 else f"{p:.3f}"


def span(values: Iterable[float | None], decimals: int | None = None) -> str:
    """Write the range from the smallest to the largest number; a hyphen if there is none."""
    known = [value for value in values if value is not None and not is_missing(value)]
    if not known:
        return MISSING
    decimals = decimals_of(known) if decimals is None else decimals
    low, high = number(min(known), decimals), number(max(known), decimals)
    return low if low == high else f"{low} to {high}"


def size(width: float, height: float, unit: str = "m") -> str:
    """Write width and height: ``1.2 m x 0.8 m``."""
    return f"{number(width, digits=4)} {unit} x {number(height, digits=4)} {unit}"


def count(n: int, thing: str, things: str = "") -> str:
    """Write a number of things: ``1 robot``, ``5 robots``, ``1,000 runs``; ``things`` is a plural other than with s."""
    return f"{whole(n)} {thing if n == 1 else things or f'{thing}s'}"


def verb(n: int, several: str, one: str = "") -> str:
    """Return the form of a verb for a number of things: ``verb(1, "vibrate")`` is "vibrates"; ``one`` is another."""
    return (one or f"{several}s") if n == 1 else several


def every(n: int, thing: str) -> str:
    """Write all of at least one thing: ``the robot``, ``both robots``, ``all 1,000 robots``."""
    return f"the {thing}" if n == 1 else f"both {thing}s" if n == 2 else f"all {count(n, thing)}"


def counts(numbers: Iterable[int], thing: str) -> str:
    """Write the range of numbers of things, at least one: ``1,000 runs`` if all are equal; ``100 to 1,000 runs``."""
    *others, last = sorted(set(numbers))
    return f"{others[0]:,} to {count(last, thing)}" if others else count(last, thing)


def listed(words: Iterable[str], word: str = "and") -> str:
    """Join words as a sentence does: ``a``, ``a and b``, ``a, b and c``; with semicolons if one has a comma itself."""
    *first, last = words
    if not first:
        return last
    if any(", " in each for each in (*first, last)):
        return f"{'; '.join(first)}; {word} {last}"
    return f"{', '.join(first)} {word} {last}"


def some(words: Sequence[str], most: int) -> str:
    """Join words as ``listed`` does, at most so many of them: ``a, b and 3 more``."""
    more = len(words) - most
    return listed([*words[:most], f"{more} more"] if more > 0 else words)
