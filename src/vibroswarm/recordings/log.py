"""Define a log: one session's samples and tracks in SI units, with counts of what was repaired.

A reader is a function from a path to a ``Log`` (see ``readers``). It converts units only; order, counters and
robots are checked here by ``in_order``, for all readers alike.

| column | unit | content |
|---|---|---|
| line | - | line of the file, from 1; for messages |
| robot | - | as the log names it |
| time_s | s | since the start of the session; for a sample, when its row was written |
| x_m, y_m, heading_rad | m, rad | x to the right, y up |
| energy | RMS | of the sample just taken |
| observation, message | 0, 1 | the bit read, the bit sent |
| alpha, beta, belief_below | - | after the sample; belief that the fill ratio is below the boundary |
| decision | - | -1 undecided, 0, 1 |
| sent | - | messages sent before this sample, which is the number of the sample |
| messages_received | - | messages received so far |
| avoid_total_s, stop_total_s | s | time spent avoiding and standing so far |

All but the first six columns of a sample and the first five of a track may be null.

A camera's positions are interpolated by straight lines, as a segment table. Heading is the direction of the path
(cameras and logs do not record it, and turning in place is invisible); a step of less than 2 mm counts as standing.
Whether a robot turned or avoided between two positions is unknown: all but stops is ``drive``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.errors import InputError
from vibroswarm.motion.source import SEGMENTS

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
    "belief_below": pl.Float64,
    "decision": pl.Int64,
    "sent": pl.Int64,
    "messages_received": pl.Int64,
    "avoid_total_s": pl.Float64,
    "stop_total_s": pl.Float64,
}
TRACKS: Final[dict[str, Any]] = {
    name: SAMPLES[name] for name in ("line", "robot", "time_s", "x_m", "y_m", "heading_rad")
}
REQUIRED: Final = ("robot", "time_s", "x_m", "y_m", "energy")
COUNTERS: Final = ("sent", "messages_received", "avoid_total_s", "stop_total_s")
"""Columns that only grow, and may wrap."""

COUNTED: Final[dict[str, str]] = {
    "rows": "rows read",
    "rows_repeated": "repeated rows: removed",
    "rows_late": "late rows (by up to a second): sorted in",
    "samples": "samples",
    "samples_lost": "samples without a row, by the count of messages sent",
    "counters_wrapped": "wraps of counters: unwrapped",
    "counters_odd": "steps of a time counter that exceed the time passed: set null",
    "posteriors_odd": "samples whose alpha + beta is not the prior, the samples and the messages received",
    "tracking_gaps": "gaps in tracking of more than half a second: interpolated linearly",
    "tracking_gap_longest_s": "s, the longest such gap",
    "positions_old": "samples whose position is more than a quarter of a second older than usual",
    "position_oldest_s": "s, the oldest position beyond the usual age",
    "off_the_floor": "samples off all tiles",
}
"""What is counted while a log is read, and the description of each count."""


@dataclass(frozen=True, eq=False)
class Log(NotebookView):
    """One session as it was read."""

    name: str
    """Name of the file."""
    reader: str
    samples: pl.DataFrame
    """Columns of ``SAMPLES``, in the order of the file."""
    tracks: pl.DataFrame
    """Columns of ``TRACKS``; empty if positions are known at samples only."""
    wraps_at: Mapping[str, float] = field(default_factory=dict)
    """Counters that return to 0 at this value (in the column's unit)."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Fields of the scenario stated in the log."""
    counts: Mapping[str, float] = field(default_factory=dict)
    """Counts by key of ``COUNTED``."""


def log_frame(columns: Mapping[str, Any], schema: Mapping[str, Any]) -> pl.DataFrame:
    """Return the table with the columns of a schema; missing ones are null."""
    frame = pl.DataFrame(dict(columns))
    return frame.select(
        frame[name].cast(kind) if name in columns else pl.lit(None, dtype=kind).alias(name)
        for name, kind in schema.items()
    )


LATE_S: Final = 1.0
"""A row may come this much after a later one; beyond it, the file is out of order."""
RARE: Final = 0.01
"""A robot with a smaller share of rows than this, relative to the others, is a misread number."""
SLACK_S: Final = 1.0
"""A counter of time may run ahead of the rows' times by this (rows are late, not early)."""
MOST_LOST: Final = 1000
"""If a count of messages jumps by more, it is wrong; no rows were lost."""


def in_order(log: Log, robots: Sequence[int] | None = None) -> Log:
    """Sort a log by time, drop repeated rows and unwrap its counters.

    Args:
        robots: the robots in the arena; None: those in the log.
    Raises:
        InputError: rows more than a second out of order, two different rows of one robot at one time, unknown
            robots, a counter that falls; names the row.
    """
    counts = dict(log.counts)
    samples, late = _sorted(log.samples, log.name)
    tracks, late_tracks = _sorted(log.tracks, log.name)
    samples, again = _once(samples, log.name)
    tracks, again_tracks = _once(tracks, log.name)
    counts |= {"rows_late": late + late_tracks, "rows_repeated": again + again_tracks}
    _check_robots(samples, tracks, robots, log.name)
    samples, more = _counted(samples, log)
    counts |= more | {"samples": samples.height}
    return replace(log, samples=samples, tracks=tracks, counts=counts)


def _sorted(frame: pl.DataFrame, name: str) -> tuple[pl.DataFrame, int]:
    """Sort rows by time and count late ones; refuse rows that are too late."""
    time = frame["time_s"].to_numpy()
    # A repeated row (such as a robot's last line) is not late: ``_once`` removes it.
    seen = frame.select(pl.exclude("line")).is_duplicated().to_numpy()
    behind = np.maximum.accumulate(np.where(seen, -np.inf, time)) - time if time.size else time
    behind = np.where(seen, 0.0, behind)
    if time.size and float(behind.max()) > LATE_S:
        k = int(np.argmax(behind > LATE_S))
        raise InputError(
            f"its time, {time[k]:g} s, is {behind[k]:.3g} s before that of an earlier row: the file is not ordered by "
            "time, or holds two sessions",
            field=f"{name}, row {frame['line'][k]}",
        )
    return frame.sort("time_s", "line", maintain_order=True), int((behind > 0).sum())


def _once(frame: pl.DataFrame, name: str) -> tuple[pl.DataFrame, int]:
    """Remove repeated rows and count them; refuse two different rows of a robot at one time."""
    content = [name_of for name_of in frame.columns if name_of != "line"]
    kept = frame.unique(content, keep="first", maintain_order=True)
    twice = kept.filter(kept.select("robot", "time_s").is_duplicated()).sort("robot", "time_s", "line")
    if twice.height:
        robot, time_s = twice["robot"][0], twice["time_s"][0]
        raise InputError(
            f"robot {robot} is in two places, or took two samples, at {time_s:g} s (also in row {twice['line'][0]})",
            field=f"{name}, row {twice['line'][1]}",
        )
    return kept, frame.height - kept.height


def _check_robots(
    samples: pl.DataFrame, tracks: pl.DataFrame, robots: Sequence[int] | None, name: str
) -> None:
    """Refuse robots that are not in ``robots``; if it is None, those with hardly any rows, whose number was misread."""
    both = pl.concat([samples.select("robot", "line"), tracks.select("robot", "line")])
    rows = both.group_by("robot").agg(pl.len().alias("rows"), pl.col("line").min()).sort("line")
    if robots is not None:
        unknown = rows.filter(~pl.col("robot").is_in(list(robots)))
        words = f"there are {', '.join(map(str, robots))}"
    else:
        usual = float(rows["rows"].median() or 0.0)  # type: ignore[arg-type]
        unknown = rows.filter(pl.col("rows") < RARE * usual)
        words = f"the others have about {usual:.0f} rows each; name the robots with --robots"
    if unknown.height:
        robot, count, line = unknown.row(0)
        raise InputError(
            f"unknown robot {robot}, in {count} row{'' if count == 1 else 's'}; {words}",
            field=f"{name}, row {line}",
        )


def _counted(samples: pl.DataFrame, log: Log) -> tuple[pl.DataFrame, dict[str, float]]:
    """Unwrap the counters of each robot; return the samples, and counts of wraps, odd steps and lost samples.

    Raises:
        InputError: the number of messages sent is missing in some rows, or a count of messages falls or jumps.
    """
    wrapped = odd = lost = 0
    columns = {name: samples[name].cast(pl.Float64).to_numpy().copy() for name in COUNTERS}
    robot, time_s, line = (samples[name].to_numpy() for name in ("robot", "time_s", "line"))
    for number in np.unique(robot):
        own = np.flatnonzero(robot == number)
        for name, values in columns.items():
            if np.isnan(values[own]).all():
                continue
            of_time = name.endswith("_s")
            unknown = own[np.isnan(values[own])]
            if name == "sent" and unknown.size:
                raise InputError(
                    f"lacks the number of messages sent by robot {number}, which its other rows have",
                    field=f"{log.name}, row {line[unknown[0]]}",
                )
            values[own], times, wrong = unwrapped(
                values[own], log.wraps_at.get(name), time_s[own] if of_time else None
            )
            wrapped, odd = wrapped + times, odd + int(wrong.sum())
            if not of_time:
                step = np.diff(values[own])
                fallen = step < (1 if name == "sent" else 0)
                if fallen.any() or (step > MOST_LOST).any():
                    k = int(np.argmax(fallen | (step > MOST_LOST))) + 1
                    raise InputError(
                        f"robot {number} has {name} {values[own][k - 1]:g} messages, and then "
                        f"{samples[name][int(own[k])]:g}",
                        field=f"{log.name}, row {line[own[k]]}",
                    )
            if name == "sent":
                lost += int((step - 1).sum() + values[own][0])
    counts: dict[str, float] = {"counters_wrapped": wrapped, "counters_odd": odd, "samples_lost": lost}
    new_columns = {
        name: pl.Series(name, values, nan_to_null=True).cast(samples.schema[name])
        for name, values in columns.items()
    }
    return samples.with_columns(**new_columns), counts


def unwrapped(
    values: NDArray[np.float64], wraps_at: float | None, time_s: NDArray[np.float64] | None = None
) -> tuple[NDArray[np.float64], int, NDArray[np.bool_]]:
    """Unwrap a counter; return its values, the number of wraps, and for each row whether it was set to NaN.

    Args:
        values: (rows,), NaN where missing, but not in all. wraps_at: value at which it returns to 0; None: never.
        time_s: (rows,): times, for a counter of time. A step longer than the time passed is impossible: that row
            becomes NaN, and the counter continues from its last value.
    """
    out, odd = values.copy(), np.zeros(values.size, dtype=np.bool_)
    read = np.flatnonzero(~np.isnan(values))
    total, times = values[read[0]], 0
    for before, k in pairwise(read.tolist()):
        step = values[k] - values[before]
        if step < 0 and wraps_at is not None:
            turns = np.ceil(-step / wraps_at)
            step += turns * wraps_at
            times += int(turns)
        if time_s is not None and not 0.0 <= step <= time_s[k] - time_s[before] + SLACK_S:
            odd[k], step = True, 0.0
        total += step
        out[k] = np.nan if odd[k] else total
    return out, times, odd


STANDING_M: Final = 0.002
"""Positions are accurate to a quarter of a millimetre; a smaller step has no usable direction."""
GAP_S: Final = 0.5
"""The camera sees a robot every 0.22 s or 0.44 s; a longer interval is a gap."""

Floats = NDArray[np.float64]


def knots_of(track: pl.DataFrame, samples: pl.DataFrame) -> pl.DataFrame:
    """Return when and where one robot was known to be: time_s, x_m, y_m, ordered by time.

    Args:
        track: its tracked positions; if there are none, its samples' positions at both ends of each stop are used.
        samples: its rows of the motion table.
    """
    names = ["time_s", "x_m", "y_m"]
    if track.height:
        return track.select(names)
    stops = samples.select(pl.col("stop_start_s").alias("time_s"), "x_m", "y_m")
    return (
        pl.concat([stops, samples.select(names)])
        .sort("time_s")
        .unique("time_s", keep="last", maintain_order=True)
    )


def segments_of(run: int, robot: int, knots: pl.DataFrame, samples: pl.DataFrame) -> pl.DataFrame:
    """Return the segment table of one robot: straight lines between its positions.

    Until the first position it stands there. A segment is a stop if its middle lies within the stop of a sample.
    """
    time, x, y = (knots[name].to_numpy() for name in ("time_s", "x_m", "y_m"))
    if time.size and time[0] > 0.0:
        time, x, y = np.append(0.0, time), np.append(x[0], x), np.append(y[0], y)
    heading, speed = _courses(time, x, y)
    stop, end = samples["stop_start_s"].to_numpy(), samples["time_s"].to_numpy()
    middle = time + np.append(np.diff(time), 0.0) / 2
    k = np.searchsorted(end, middle)
    stands = (k < end.size) & (middle > np.append(stop, np.inf)[k])
    kind = np.where(stands, "stop", "drive")
    columns: dict[str, Any] = {
        "run": np.full(time.size, run),
        "robot": np.full(time.size, robot),
        "start_s": time,
        "x_m": x,
        "y_m": y,
        "heading_rad": heading,
        "speed_m_s": speed,
        "turn_rate_rad_s": np.zeros(time.size),
        "kind": kind.tolist(),
    }
    return pl.DataFrame(columns, schema=SEGMENTS, strict=False)


def _courses(time: Floats, x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Return the heading, rad, and speed, m/s, from each position to the next, (positions,) each.

    Where a robot stands its speed is 0 and it keeps its heading: the latest, or before it moves the first one, or 0 if
    it never moves. The last position counts as standing.
    """
    dx, dy, dt = np.diff(x), np.diff(y), np.diff(time)
    step = np.hypot(dx, dy)
    moves = step >= STANDING_M
    heading = np.append(np.where(moves, np.arctan2(dy, dx), np.nan), np.nan)
    speed = np.append(np.divide(step, dt, out=np.zeros_like(step), where=moves & (dt > 0)), 0.0)
    known = np.flatnonzero(~np.isnan(heading))
    if known.size == 0:
        return np.zeros(time.size), speed
    latest = np.maximum(np.searchsorted(known, np.arange(time.size), side="right") - 1, 0)
    return heading[known[latest]], speed


def gaps_of(time_s: Floats) -> tuple[int, float]:
    """Return the number of gaps longer than ``GAP_S`` in a robot's tracking, and the longest, s (0 without gaps)."""
    gaps = np.diff(time_s)
    gaps = gaps[gaps > GAP_S]
    return gaps.size, float(gaps.max(initial=0.0))
