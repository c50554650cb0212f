"""What the terminal and the page say of a search, in the same words."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

from vibroswarm.analysis.intervals import Interval
from vibroswarm.optimize.archive import Archive
from vibroswarm.optimize.truth import Scored

REASONS: Final = 3
"""Reasons of failures that are told; ``result.json`` has more."""
GRID_LUCK: Final = "not told apart from it, run by run. Which of them is lowest is luck."
"""Of a grid's cells beside the lowest."""


def failures_said(failed: int) -> str:
    """How many runs of a search ``failed``, and what that costs their candidates."""
    return (
        "none failed" if not failed else f"{failed:,} runs FAILED; a candidate with a failed run cannot win"
    )


def fresh_failures_said(scored: Scored) -> str:
    """How many fresh runs failed; empty if none did."""
    if not scored.failed:
        return ""
    return f"{scored.failed:,} fresh runs of the {scored.name} FAILED and are in no figure"


def reasons(archive: Archive) -> list[str]:
    """Why runs failed: the first reasons, each once, in order."""
    return sorted({c.why for c in archive.candidates if c.why})[:REASONS]


def value_said(value: Any) -> str:
    """One value of a field: numbers in six digits."""
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def values_said(values: dict[str, Any]) -> str:
    """Fields by their last names, with their values."""
    return ", ".join(f"{name.rpartition('.')[2]} {value_said(value)}" for name, value in values.items())


def short_names(names: Sequence[str]) -> dict[str, str]:
    """Fields by their last names; whole where two end alike."""
    last = [name.rpartition(".")[2] for name in names]
    return {name: end if last.count(end) == 1 else name for name, end in zip(names, last, strict=True)}


def interval_said(value: Interval, *, sign: bool = False) -> str:
    """``16.9 [14.6, 19.3]``; ``-`` where it is not defined."""
    if math.isnan(value.estimate):
        return "-"
    mark = "+" if sign else ""
    return f"{value.estimate:{mark}.4g} [{value.low:{mark}.4g}, {value.high:{mark}.4g}]"
