"""How the columns of a report's tables are headed and their numbers written."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from vibroswarm.core.notebook_view import NotebookView


@dataclass(frozen=True)
class Column(NotebookView):
    """The heading of a column and the format of its numbers."""

    title: str = ""
    """Heading; empty: the column's name."""
    unit: str = ""
    """Empty: "%" if percent."""
    digits: int = 3
    """Significant digits of the largest number; all numbers of a column have the same decimals. The CSV has all."""
    percent: bool = False
    """Whether a share from 0 to 1 is written in percent, or a difference of shares in percentage points."""
    prose: bool = False
    """Whether it holds sentences, which get extra width."""
    tones: Mapping[str, str] = field(default_factory=dict)
    """Tones of cells, of ``TONES``, by the longest matching beginning of their text."""
    decimals: int | None = None
    """Decimals of all numbers; by default one in percent, else by ``digits``."""
    limits: tuple[str, str] | None = None
    """Names of the columns with the lower and the upper limit, which stand in brackets behind each number."""
    p_value: bool = False
    """Whether numbers are p-values; those below 0.001 are written as such."""

    @property
    def units(self) -> str:
        """The unit of the heading."""
        return self.unit or ("%" if self.percent else "")


def decimals_of(values: Iterable[float | None], column: Column) -> int | None:
    """Return the decimals that all numbers of a column get; None if they differ too much in size for that."""
    if column.decimals is not None:
        return column.decimals
    if column.percent:
        return 1
    sizes = [abs(float(value)) for value in values if value is not None and math.isfinite(value)]
    if all(size.is_integer() for size in sizes):
        return 0
    largest = max(sizes)
    if not 1e-4 <= largest < 1e12:
        return None
    decimals = max(column.digits - 1 - math.floor(math.log10(largest)), 0)
    smallest = min(size for size in sizes if size > 0)
    if smallest < 0.5 * 10**-decimals:
        return None
    while decimals and all(f"{size:.{decimals}f}".endswith("0") for size in sizes):
        decimals -= 1  # settings such as 0.95 and 0.9 end there
    return decimals


def number_text(value: float, column: Column, decimals: int | None = None) -> str:
    """Write a number in the format of its column.

    Args:
        decimals: of ``decimals_of`` the column; None: as many as this number needs.
    """
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    if column.p_value:
        return "< 0.001" if value < 0.001 else f"{value:.3f}"
    if column.percent:
        value, decimals = 100 * value, 1 if decimals is None else decimals
    if decimals is not None and abs(value) < 10**12:
        text = f"{value:.{decimals}f}"
        text = text if float(text) else text.removeprefix("-")
    elif isinstance(value, int) or (float(value).is_integer() and abs(value) < 10**12):
        text = f"{int(value)}"
    elif abs(value) >= 10**column.digits and abs(value) < 10**12:
        text = f"{value:.0f}"
    else:
        text = f"{value:.{column.digits}g}"
    return text.replace("-", "−")
