"""Runs that the source of motion gave up, such as MuJoCo at numbers that are not finite.

Their robots stand from then on and count as undecided in every figure, so a study lists and counts them. A shard has
the table only if a run of it failed.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import polars as pl

from vibroswarm.core.tables import Schema
from vibroswarm.motion.source import FAILURES
from vibroswarm.study.spec import Cell

TABLE: Final = "failures"
"""Name of the table in a shard."""
FAILED_RUNS: Final[dict[str, Any]] = {"cell": pl.UInt32, **FAILURES}
"""One row per cell and failed run: since when its robots stand, and why."""
FAILED_ROWS: Final = Schema(FAILED_RUNS, frozenset(), ("cell", "run"))


def failed_rows(
    failures: pl.DataFrame | None, cells: Sequence[Sequence[int]], end_s: float
) -> list[pl.DataFrame]:
    """Return the table of some cells with the same motion; runs that fail after their end have not failed.

    Args:
        failures: of the motion, None if no run failed. cells: as ``BatchOutcomes`` has them. end_s: of their runs.
    """
    if failures is None:
        return []
    known = failures.filter(pl.col("time_s") < end_s)
    return [
        known.select(pl.lit(cell, dtype=pl.UInt32).alias("cell"), *FAILURES)
        for same in cells
        for cell in same
        if known.height > 0
    ]


def failed_words(cell: Cell, failed: pl.DataFrame, runs: int) -> str:
    """Write how many runs of a cell failed, with the first cause.

    Args:
        failed: ``FAILED_RUNS`` of the cell. runs: of the cell.
    """
    first = failed.sort("run").row(0, named=True)
    return (
        f"{failed.height:,} of {runs:,} runs of {cell.name} failed in the source of motion; their robots stand since "
        f"then and count as undecided (run {first['run']} at {first['time_s']:.4g} s: {first['reason']})."
    )
