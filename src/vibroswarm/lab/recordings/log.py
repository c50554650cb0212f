"""The log of one session: samples and tracked positions in SI units.

| column | unit | content |
|---|---|---|
| line | - | line of the file, from 1 |
| robot | - | number of the robot in the log |
| time_s | s | since the start of the session; for a sample, the time at which its row was written |
| x_m, y_m, heading_rad | m, rad | x to the right, y up |
| energy | RMS | of the sample just taken |
| observation, message | 0, 1 | the bit read, the bit sent |
| alpha, beta, belief_below | - | after the sample; belief that the fill ratio is below the boundary |
| decision | - | -1 undecided, 0, 1 |
| sent | - | messages sent before this sample; robots send one per sample, so it is the number of the sample, from 0 |
| messages_received | - | messages received so far |
| avoid_total_s, stop_total_s | s | time spent avoiding and standing so far |
| place_x_m, place_y_m, place_spread_m | m | where the robot believed that it was, with its standard deviation |

A row with an energy is a sample, in a log without energies one with an observation; other rows are tracked positions.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import polars as pl

from vibroswarm.errors import InputError
from vibroswarm.lab.recordings.read_tables import Use

_LENGTH: Final = Use(pl.Float64, -1e4, 1e4, "a length within 10 km")
_DURATION: Final = Use(
    pl.Float64, 0.0, 1e7, "a time from 0 to 1e7 s (of other clocks, in a column map: first = 0)"
)
_WHOLE: Final = Use(pl.Int64, 0, 2**31, "a whole number from 0 on")
_BIT: Final = Use(pl.Int64, 0, 1, "0 or 1")
SAMPLES: Final[dict[str, Use]] = {
    "robot": _WHOLE._replace(required=True),
    "time_s": _DURATION._replace(required=True),
    "x_m": _LENGTH._replace(required=True),
    "y_m": _LENGTH._replace(required=True),
    "energy": Use(pl.Float64, 0.0, 1e9, "a number from 0 to 1e9"),
    "heading_rad": Use(pl.Float64, -1e9, 1e9, "an angle"),
    "observation": _BIT,
    "message": _BIT,
    "alpha": _WHOLE,
    "beta": _WHOLE,
    "belief_below": Use(pl.Float64, 0.0, 1.0, "a probability"),
    "decision": Use(pl.Int64, -1, 1, "-1, 0 or 1"),
    "sent": _WHOLE,
    "messages_received": _WHOLE,
    "avoid_total_s": _DURATION,
    "stop_total_s": _DURATION,
    "place_x_m": _LENGTH,
    "place_y_m": _LENGTH,
    "place_spread_m": Use(pl.Float64, 0.0, 1e4, "a length of 0 or more"),
}
"""Columns of a log's samples, beside ``line``; the table of the module's docstring explains them."""
TRACKS: Final = ("line", "robot", "time_s", "x_m", "y_m", "heading_rad")
"""Columns of a log's tracked positions."""
LATE_S: Final = 1.0
"""A row may have a time this much before that of an earlier row; if it is more, the file is not in order."""


@dataclass(frozen=True, eq=False)
class Log:
    """The log of one session."""

    name: str
    reader: str
    samples: pl.DataFrame
    """``line`` and the columns of ``SAMPLES``, by time."""
    tracks: pl.DataFrame
    """Columns of ``TRACKS``, by time; empty if positions are known at samples only."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    counts: Mapping[str, float] = field(default_factory=dict)
    robots: Mapping[str, int] = field(default_factory=dict)
    """The number that each robot got, by the name that it has in the file; empty: the file has numbers."""
    has_timestamps: bool = False
    """Whether times are counted from the first row, as those of timestamps are."""


def in_schema(rows: pl.DataFrame, schema: Mapping[str, Any]) -> pl.DataFrame:
    """Return the columns of a schema, in its types; those that are not there are null."""
    return rows.select(
        pl.col(name).cast(kind) if name in rows.columns else pl.lit(None, kind).alias(name)
        for name, kind in schema.items()
    )


def log_frame(rows: pl.DataFrame) -> pl.DataFrame:
    """Return rows with ``line`` and all columns of ``SAMPLES``."""
    return in_schema(rows, {"line": pl.UInt32} | {name: use.kind for name, use in SAMPLES.items()})


def log_of(rows: pl.DataFrame, name: str, reader: str, wraps_at: Mapping[str, float], **more: Any) -> Log:
    """Make a log of the rows of files: by time, without copies, and with counters that go on where they wrap.

    Args:
        rows: columns of ``SAMPLES`` that the files have, and ``file`` and ``line``, in the order of the files.
        wraps_at: value at which counters start again from 0, by column. more: further fields of the log.
    """
    own = rows.unique(pl.exclude("line"), keep="first", maintain_order=True)
    late = own.filter(pl.col("time_s").cum_max().over("file") - pl.col("time_s") > LATE_S)
    if late.height:
        raise InputError(
            f"its time, {late['time_s'][0]:g} s, is before that of an earlier row, by more than {LATE_S:g} s: the "
            "file holds two sessions, or its clock began again",
            field=f"{late['file'][0]}, row {late['line'][0]}",
        )
    frame, value = log_frame(own), "energy" if "energy" in rows.columns else "observation"
    by_time = frame.with_columns(file=own["file"]).sort("time_s", "line", maintain_order=True)
    samples, tracks = by_time.filter(pl.col(value).is_not_null()), by_time.filter(pl.col(value).is_null())
    for part in (samples, tracks):
        if (twice := part.filter(pl.struct("robot", "time_s").is_duplicated())).height:
            raise InputError(
                f"robot {twice['robot'][1]} is in two places, or took two samples, at {twice['time_s'][1]:g} s",
                field=f"{twice['file'][1]}, row {twice['line'][1]}",
            )
    steps = {use: pl.col(use).forward_fill().over("robot").diff().over("robot") for use in wraps_at}
    wraps = {use: (step < 0).cast(pl.Int64) for use, step in steps.items()}
    counts = {
        "rows": rows.height,
        "rows_repeated": rows.height - own.height,
        "counters_wrapped": sum(int(samples.select(one.sum()).item()) for one in wraps.values()),
        "samples": samples.height,
    }
    samples = samples.with_columns(
        pl.when(pl.col(use).is_not_null())
        .then((step + wraps_at[use] * wraps[use]).fill_null(pl.col(use)).cum_sum().over("robot"))
        .alias(use)
        for use, step in steps.items()
    )
    return Log(
        name,
        reader,
        log_frame(samples),
        tracks.select(TRACKS),
        counts=counts | more.pop("counts", {}),
        **more,
    )
