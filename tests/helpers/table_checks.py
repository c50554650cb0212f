"""What a terminal must not show."""

from __future__ import annotations

from collections.abc import Sequence

from rich.cells import cell_len


def too_wide(lines: Sequence[str], width: int) -> list[str]:
    """Return lines beyond the width that a break at a space would have made narrower."""
    return [line for line in lines if cell_len(line) > width and " " in line.strip()]
