"""What a reader of logs gives: one session's samples and tracks in SI units, and what was told along the way.

A reader is a function from a path to a ``Log`` (see ``readers``). It turns units and unwraps nothing: order, counters
and robots are checked once, for all readers, in ``order``.

| column | unit | what |
|---|---|---|
| line | - | of the file, 1 is its first: for messages |
| robot | - | as the log calls it |
| time_s | s | since the session began; of a sample, when its row was written |
| x_m, y_m, heading_rad | m, rad | x to the right, y up |
| energy | RMS | of the sample just taken |
| observation, message | 0, 1 | the bit read, the bit sent |
| alpha, beta, belief | - | after the sample; belief in less than the boundary |
| decision | - | -1 undecided, 0, 1 |
| sent | - | messages sent before this sample, which is the number of the sample |
| received | - | messages received so far |
| avoid_total_s, stop_total_s | s | spent avoiding and standing so far |

All but the first six of a sample and the first five of a track may be null.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import polars as pl

SAMPLES: Final[dict[str, Any]] = {
    "line": pl.UInt32,
    "robot": pl.Int64,
    "time_s": pl.Float64,
    "x_m": pl.Float64,
    "y_m": pl.Float64,
    "energy": pl.Float64,
    "heading_rad": pl.Float64,
    "observation": pl.Int64,
    "message": pl.Int64,
    "alpha": pl.Int64,
    "beta": pl.Int64,
    "belief": pl.Float64,
    "decision": pl.Int64,
    "sent": pl.Int64,
    "received": pl.Int64,
    "avoid_total_s": pl.Float64,
    "stop_total_s": pl.Float64,
}
TRACKS: Final[dict[str, Any]] = {
    name: SAMPLES[name] for name in ("line", "robot", "time_s", "x_m", "y_m", "heading_rad")
}
REQUIRED: Final = ("robot", "time_s", "x_m", "y_m", "energy")
COUNTERS: Final = ("sent", "received", "avoid_total_s", "stop_total_s")
"""Columns that only grow, and that may wrap."""

TOLD: Final[dict[str, str]] = {
    "rows": "rows read",
    "rows_repeated": "rows that stand twice: the second left out",
    "rows_late": "rows that came late (by up to a second): put in their place",
    "samples": "samples",
    "samples_lost": "samples whose row is missing, by the count of messages sent",
    "counters_wrapped": "times a counter wrapped: made good",
    "counters_odd": "steps of a time counter that do not fit the time that went by: set null",
    "posteriors_odd": "samples whose alpha + beta is not the prior, the samples and the messages received",
    "tracking_gaps": "gaps in tracking of more than half a second: bridged by a straight line",
    "tracking_gap_longest_s": "s, the longest such gap",
    "positions_old": "samples whose position is more than a quarter of a second older than usual",
    "position_oldest_s": "s, the oldest position beyond the usual age",
    "off_the_floor": "samples off all tiles",
}
"""What may be counted in a log, and what each number says."""


@dataclass(frozen=True, eq=False)
class Log:
    """One session as it was read."""

    name: str
    """Of the file."""
    reader: str
    samples: pl.DataFrame
    """Columns of ``SAMPLES``, in the order of the file."""
    tracks: pl.DataFrame
    """Columns of ``TRACKS``; of no rows where places are known at samples only."""
    wraps_at: Mapping[str, float] = field(default_factory=dict)
    """Counters that go back to 0 at this value (in the column's unit)."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Fields of the scenario that the log itself states."""
    told: Mapping[str, float] = field(default_factory=dict)
    """Keys of ``TOLD`` with their numbers."""


def log_frame(columns: Mapping[str, Any], schema: Mapping[str, Any]) -> pl.DataFrame:
    """A frame of these columns, those that are missing null, in the order of the schema."""
    frame = pl.DataFrame(dict(columns))
    return frame.select(
        frame[name].cast(kind) if name in columns else pl.lit(None, dtype=kind).alias(name)
        for name, kind in schema.items()
    )
