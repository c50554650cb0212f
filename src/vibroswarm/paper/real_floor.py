"""The floor of the study's real robots, as the recordings' ``world.txt`` has it."""

from __future__ import annotations

from typing import Any, Final

REAL_FLOOR: Final = "real-floor"
ROWS: Final = ("01010", "10010", "10101", "01101", "10010")
"""Rows from the top; 12 of 25 tiles vibrate."""


def real_floor() -> dict[str, Any]:
    """The fields of a scenario that put it there."""
    return {"floor.source": REAL_FLOOR, "floor.tiles": ROWS}
