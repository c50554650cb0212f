"""What a table in the terminal must not lose, whatever its layout."""

from __future__ import annotations

import re
from collections.abc import Sequence

from vibroswarm.cli.tables import Table, cell_width, layout

NUMBER = re.compile(r"[+-]?\d[\d.,]*")
WIDTHS = (60, 80, 100, 140)


def lost(table: Table, lines: Sequence[str]) -> list[str]:
    """Return names of rows and numbers that are not there whole; a name may be broken between words."""
    text = " ".join(" ".join(lines).split())
    cells = [" ".join(cell.split()) for row in table.rows for cell in row]
    names = [" ".join(cell.split()) for row in table.rows for cell in row[: table.names]]
    there = NUMBER.findall(text)
    numbers = [number for cell in cells for number in NUMBER.findall(cell) if number not in there]
    words = text.split()
    return [name for name in names if not all(word in words for word in name.split())] + numbers


def too_wide(lines: Sequence[str], width: int) -> list[str]:
    """Return lines beyond the width that a break at a space would have made narrower."""
    return [line for line in lines if cell_width(line) > width and " " in line.strip()]


def check_table(table: Table) -> None:
    """Check a table at several widths."""
    for width in WIDTHS:
        lines = layout(table, width)
        assert lost(table, lines) == [], f"at {width} columns"
        assert too_wide(lines, width) == []
