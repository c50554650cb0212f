"""What every command prints with: JSON, tables, and values with their intervals."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from rich.console import Console

    from vibroswarm.analysis.intervals import Interval

TEXT_WIDTH: Final = 100
"""Of paragraphs."""
TABLE_WIDTH: Final = 170
"""Of tables that do not go to a terminal."""


def print_json(document: Any) -> None:
    """Print one JSON document."""
    print(json.dumps(document, indent=2, allow_nan=False))


def print_paragraph(text: str) -> None:
    """Print text, broken into lines."""
    from textwrap import fill

    print(fill(text, TEXT_WIDTH))


def console() -> Console:
    """A console on stdout."""
    from rich.console import Console

    return Console(
        file=sys.stdout, highlight=False, markup=False, width=None if sys.stdout.isatty() else TABLE_WIDTH
    )


def print_table(columns: Sequence[str], rows: Iterable[Sequence[object]], *, texts: int = 1) -> None:
    """Print a table; the first ``texts`` columns are aligned to the left, all others to the right."""
    print("\n".join(table_lines(columns, rows, texts=texts)))


def table_lines(columns: Sequence[str], rows: Iterable[Sequence[object]], *, texts: int = 1) -> list[str]:
    """The lines that ``print_table`` prints."""
    from rich.table import Table

    table = Table(box=None, pad_edge=False, header_style="bold", show_header=any(columns))
    for place, name in enumerate(columns):
        is_text = place < texts
        table.add_column(name, justify="left" if is_text else "right", overflow="fold", no_wrap=not is_text)
    for row in rows:
        table.add_row(*map(str, row))
    out = console()
    with out.capture() as captured:
        out.print(table)
    return [line.rstrip() for line in captured.get().splitlines()]


def with_interval(value: Interval | None, form: str, *, scale: float = 1.0, unit: str = "") -> str:
    """``44.1 % [41.0, 47.2]``; ``-`` without a value, and no brackets without an interval.

    Args:
        form: format specification of each number, such as ``.1f``.
        scale: factor on each number.
        unit: behind the estimate.
    """
    if value is None or value.estimate != value.estimate:
        return "-"
    estimate, low, high = (f"{scale * number:{form}}" for number in (value.estimate, value.low, value.high))
    return f"{estimate}{unit}" if value.low != value.low else f"{estimate}{unit} [{low}, {high}]"


def percent(share: Interval | None, form: str = ".1f") -> str:
    """A share with its interval, in percent."""
    return with_interval(share, form, scale=100.0, unit=" %")
