"""Define a log: the samples and tracked positions of one session in SI units, with counts of repaired problems.

A reader is a function that takes a path and returns a ``Log`` (see ``log_readers``). It only converts units.
``in_order`` then checks the order of rows, counters and robots, for all readers in the same way.

| column | unit | content |
|---|---|---|
| line | - | line of the file, from 1, for error messages |
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

All columns may be null except line, robot, time_s, x_m, y_m and, of a sample, energy. A track (a tracked position) has
only those five and heading_rad.

Between positions of a camera a robot's path is taken as a straight line. The heading at a position is the direction of
the line that begins there, since most logs have no headings; those of tracks are not used. A
step of less than 2 mm counts as standing. It is not known whether a robot turned or avoided between two positions, so
every kind is ``drive``, except for stops.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.core.arrays import Bools, Floats
from vibroswarm.core.numbers import number
from vibroswarm.errors import InputError

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
    "place_x_m": pl.Float64,
    "place_y_m": pl.Float64,
    "place_spread_m": pl.Float64,
}
"""Types of the columns of a log's samples; the table of the module's docstring explains them."""
TRACKS: Final[dict[str, Any]] = {
    name: SAMPLES[name] for name in ("line", "robot", "time_s", "x_m", "y_m", "heading_rad")
}
"""Types of the columns of a log's tracked positions."""
REQUIRED: Final = ("robot", "time_s", "x_m", "y_m", "energy")
"""Columns that every log has."""
OWN_PLACE: Final = ("place_x_m", "place_y_m", "place_spread_m")
"""Columns of a robot's own place; a log has all of them or none."""
COUNTERS: Final = ("sent", "messages_received", "avoid_total_s", "stop_total_s")
"""Columns that only grow, unless the counter wraps: starts again from 0 at some value."""

COUNTED: Final[dict[str, tuple[str, str]]] = {
    "rows": ("row", " read"),
    "begins_late_s": (
        "",
        " s before the first row, of which nothing is known: times count from the clock's 0",
    ),
    "rows_repeated": ("repeated row", ": removed"),
    "rows_late": ("late row", " (by up to a second): sorted in"),
    "samples": ("sample", ""),
    "samples_lost": ("sample", " without a row, by the count of messages sent"),
    "counters_wrapped": ("wrap", " of counters: unwrapped"),
    "counters_odd": ("step", " of a time counter longer than the time passed: set null"),
    "posteriors_odd": ("sample", " with an alpha + beta other than prior, samples and messages received"),
    "tracking_gaps": ("gap", " in tracking of more than half a second: interpolated linearly"),
    "tracking_gap_longest_s": ("", " s, the longest such gap"),
    "robots_late": ("robot", " first seen more than a minute after another: taken to stand there until then"),
    "robots_gone": ("robot", " last seen more than a minute before the end"),
    "robots_unmoved": ("robot", " that never moved"),
    "positions_old": ("sample", " with a position older than the usual quarter of a second"),
    "position_oldest_s": ("", " s, the age of the oldest position"),
    "jumps": (
        "step",
        " over three times as fast as a robot's usual ones: markers were swapped or misread, or robots lifted",
    ),
    "off_the_floor": ("sample", " off all tiles; if these are many, state arena.width_m and arena.height_m"),
    "decisions_missing": (
        "sample",
        " without a decision, taken as not logged; where such cells mean undecided, a column map can say so: "
        'values = { "" = -1, ... }',
    ),
    "silent_s": ("", " s without a row of any robot: a pause, or a clock that jumped"),
    "rows_apart_s": ("", " s usually between two rows of a robot: times must be in seconds"),
}
"""Counts that are made while a log is read: what is counted (empty: a time), and what follows it."""


@dataclass(frozen=True, eq=False)
class Log:
    """The log of one session."""

    name: str
    """Name of the file."""
    reader: str
    """Name of the log's format."""
    samples: pl.DataFrame
    """Columns of ``SAMPLES``, in the order of the file; sorted by time after ``in_order``."""
    tracks: pl.DataFrame
    """Columns of ``TRACKS``; empty if positions are known at samples only."""
    wraps_at: Mapping[str, float] = field(default_factory=dict)
    """Counters that return to 0 at this value (in the column's unit)."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Fields of the scenario stated in the log."""
    counts: Mapping[str, float] = field(default_factory=dict)
    """Counts by key of ``COUNTED``."""
    has_timestamps: bool = False
    """Whether times are counted from the first row, as those of timestamps are."""


def log_frame(columns: Mapping[str, Any], schema: Mapping[str, Any]) -> pl.DataFrame:
    """Return a table with the columns of a schema, converted to its types.

    Args:
        columns: values by column name; columns that the schema does not have are left out. Without any column the table
            has one row, of nulls.
        schema: type of each column; a column without values is filled with null.
    """
    frame = pl.DataFrame(dict(columns))
    return frame.select(
        frame[name].cast(kind) if name in columns else pl.lit(None, dtype=kind).alias(name)
        for name, kind in schema.items()
    )


LATE_S: Final = 1.0
"""A row may have a time this much before that of an earlier row; if it is more, the file is not in order."""
RARE: Final = 0.01
"""If a robot has fewer rows than this share of the usual number, its number was misread."""
SLACK_S: Final = 1.0
"""A counter of time may grow by this more than the times of the rows, since rows may be written late."""
MOST_LOST: Final = 1000
"""A count of messages sent that grows by more than this between two rows is wrong, since so many rows are never lost;
so is one of messages received that grows by more than this times the number of other robots."""


def in_order(log: Log, robots: Sequence[int] | None = None) -> Log:
    """Check a log, sort it by time, remove repeated rows and unwrap its counters; return the new log.

    Args:
        robots: numbers of the robots in the arena; None: those in the log.
    Raises:
        InputError: rows more than a second out of order, two different rows of one robot at one time, unknown
            robots, a count of messages that falls or grows too much (``MOST_LOST``), or messages sent that some rows
            of a robot lack; the error names the row. (Impossible steps of a counter of time are set null.)
    """
    samples, late = _sorted(log.samples, log.name)
    tracks, late_tracks = _sorted(log.tracks, log.name)
    samples, repeated = _without_repeats(samples, log.name)
    tracks, repeated_tracks = _without_repeats(tracks, log.name)
    _check_robots(samples, tracks, robots, log.name)
    samples, of_counters = _with_counters_unwrapped(samples, log)
    counts = {
        **log.counts,
        "rows_late": late + late_tracks,
        "rows_repeated": repeated + repeated_tracks,
        **of_counters,
        "samples": samples.height,
    }
    return replace(log, samples=samples, tracks=tracks, counts=counts)


def _sorted(frame: pl.DataFrame, name: str) -> tuple[pl.DataFrame, int]:
    """Sort the rows of a file by time.

    Args:
        frame: rows in the order of the file. name: name of the file, for errors.
    Returns: the sorted rows; and the number of late rows. A late row stands in the file after a row of later time.
        Copies of the same row are never counted as late.
    Raises:
        InputError: a row is more than ``LATE_S`` late.
    """
    time = frame["time_s"].to_numpy()
    # A row may be written again later (such as a robot's last line). ``is_repeated`` is true for all its copies, the
    # first one included. They do not count as late, since they are counted as repeated when all copies but the first
    # are removed. They do not make other rows late either (-inf below), since a copy does not say where in the file
    # its time belongs.
    is_repeated = frame.select(pl.exclude("line")).is_duplicated().to_numpy()
    # How far the time of each row lies behind the latest time of the rows before it, s.
    behind = np.maximum.accumulate(np.where(is_repeated, -np.inf, time)) - time if time.size else time
    behind = np.where(is_repeated, 0.0, behind)
    if time.size and float(behind.max()) > LATE_S:
        k = int(np.argmax(behind > LATE_S))
        raise InputError(
            f"its time, {time[k]:g} s, is {behind[k]:.3g} s before that of an earlier row: the file is not ordered by "
            "time, holds two sessions, or its clock began again",
            field=f"{name}, row {frame['line'][k]}",
        )
    return frame.sort("time_s", "line", maintain_order=True), int((behind > 0).sum())


def _without_repeats(frame: pl.DataFrame, name: str) -> tuple[pl.DataFrame, int]:
    """Remove rows that repeat an earlier row; return the others and the number of removed rows.

    Raises:
        InputError: two different rows of one robot have the same time.
    """
    content = [name_of for name_of in frame.columns if name_of != "line"]
    first_rows = frame.unique(content, keep="first", maintain_order=True)
    same_time = first_rows.filter(first_rows.select("robot", "time_s").is_duplicated()).sort(
        "robot", "time_s", "line"
    )
    if same_time.height:
        robot, time_s = same_time["robot"][0], same_time["time_s"][0]
        raise InputError(
            f"robot {robot} is in two places, or took two samples, at {time_s:g} s "
            f"(also in row {same_time['line'][0]})",
            field=f"{name}, row {same_time['line'][1]}",
        )
    return first_rows, frame.height - first_rows.height


def _check_robots(
    samples: pl.DataFrame, tracks: pl.DataFrame, robots: Sequence[int] | None, name: str
) -> None:
    """Check that all robots of a log are known.

    Args:
        samples, tracks: rows of the log. robots: numbers of the known robots. If it is None, every robot is known
            unless it has hardly any rows (``RARE``), which shows that its number was misread. name: of the file.
    Raises:
        InputError: a robot is unknown; the error names its first row.
    """
    both = pl.concat([samples.select("robot", "line"), tracks.select("robot", "line")])
    rows = both.group_by("robot").agg(pl.len().alias("rows"), pl.col("line").min()).sort("line")
    if robots is not None:
        unknown = rows.filter(~pl.col("robot").is_in(list(robots)))
        words = f"there are {', '.join(map(str, robots))}"
    else:
        usual = float(rows["rows"].median() or 0.0)  # type: ignore[arg-type]
        unknown = rows.filter(pl.col("rows") < RARE * usual)
        words = f"the others have about {number(usual, 0)} rows each; name the robots with --known-robots"
    if unknown.height:
        robot, count, line = unknown.row(0)
        raise InputError(
            f"unknown robot {robot}, in {count} row{'' if count == 1 else 's'}; {words}",
            field=f"{name}, row {line}",
        )


def _with_counters_unwrapped(samples: pl.DataFrame, log: Log) -> tuple[pl.DataFrame, dict[str, float]]:
    """Unwrap the counters of each robot: undo their returns to 0.

    Args:
        samples: sorted by time. log: has the value at which each counter wraps (``wraps_at``).
    Returns: the samples with unwrapped counters; and counts: counters_wrapped, counters_odd (impossible steps of
        counters of time), samples_lost.
    Raises:
        InputError: the number of messages sent is missing in some rows of a robot, or a count of messages falls, or
            grows too much (``MOST_LOST``); the error names the row.
    """
    wrapped = odd = lost = 0
    # Copies, because arrays of polars are read-only.
    columns = {name: samples[name].cast(pl.Float64).to_numpy().copy() for name in COUNTERS}
    robot, time_s, line = (samples[name].to_numpy() for name in ("robot", "time_s", "line"))
    for each in np.unique(robot):
        own = np.flatnonzero(robot == each)
        for name, values in columns.items():
            if np.isnan(values[own]).all():
                continue
            of_time = name.endswith("_s")
            unknown = own[np.isnan(values[own])]
            if name == "sent" and unknown.size:
                raise InputError(
                    f"lacks the number of messages sent by robot {each}, which its other rows have",
                    field=f"{log.name}, row {line[unknown[0]]}",
                )
            values[own], wraps, wrong = unwrapped(
                values[own], log.wraps_at.get(name), time_s[own] if of_time else None
            )
            wrapped, odd = wrapped + wraps, odd + int(wrong.sum())
            if not of_time:
                step, others = np.diff(values[own]), max(np.unique(robot).size - 1, 1)
                most = MOST_LOST if name == "sent" else MOST_LOST * others
                fallen = step < (1 if name == "sent" else 0)  # each sample sends a message
                if fallen.any() or (step > most).any():
                    k = int(np.argmax(fallen | (step > most))) + 1
                    raise InputError(
                        f"robot {each} has {name.removeprefix('messages_')} {values[own][k - 1]:g} messages, and then "
                        f"{samples[name][int(own[k])]:g}; such a count only grows, by {most:,} at most",
                        field=f"{log.name}, row {line[own[k]]}",
                    )
            # The count of messages sent grows by 1 per sample, from 0; each further step is a lost sample.
            if name == "sent":
                lost += int((step - 1).sum() + values[own][0])
    counts: dict[str, float] = {"counters_wrapped": wrapped, "counters_odd": odd, "samples_lost": lost}
    new_columns = {
        name: pl.Series(name, values, nan_to_null=True).cast(samples.schema[name])
        for name, values in columns.items()
    }
    return samples.with_columns(**new_columns), counts


def unwrapped(
    values: Floats, wraps_at: float | None, time_s: Floats | None = None
) -> tuple[Floats, int, Bools]:
    """Unwrap a counter: add the value at which it wraps whenever it falls.

    Args:
        values: of the counter in the order of time, (rows,); nan where missing, but not everywhere.
        wraps_at: value at which it starts again from 0; None: never.
        time_s: times of the rows for a counter of time, else None. If such a counter falls although it does not wrap,
            or grows by more than the time passed (and ``SLACK_S``), which is impossible, the row becomes nan, and the
            counter continues from its last value. Other counters are not checked.
    Returns: the unwrapped values, (rows,); number of wraps; whether each row was set to nan, (rows,).
    """
    out, odd = values.copy(), np.zeros(values.size, dtype=np.bool_)
    not_missing = np.flatnonzero(~np.isnan(values))
    total, wraps = values[not_missing[0]], 0
    for before, k in pairwise(not_missing.tolist()):
        step = values[k] - values[before]
        if step < 0 and wraps_at is not None:
            wraps_now = np.ceil(-step / wraps_at)  # the fewest wraps that make the step 0 or more
            step += wraps_now * wraps_at
            wraps += int(wraps_now)
        if time_s is not None and not 0.0 <= step <= time_s[k] - time_s[before] + SLACK_S:
            odd[k], step = True, 0.0
        total += step
        out[k] = np.nan if odd[k] else total
    return out, wraps, odd


STANDING_M: Final = 0.002
"""Positions are accurate to a quarter of a millimetre; a smaller step has no usable direction."""
GAP_S: Final = 0.5
"""The camera sees a robot every 0.22 s or 0.44 s; an interval longer than this is a gap."""


def of_camera(tracks: pl.DataFrame, samples: pl.DataFrame) -> bool:
    """Return whether tracked positions of a session are a camera's, which sees robots more often than they sample.

    Fewer are rows of samples whose energy is missing.
    """
    return tracks.height > samples.height


def knots_of(track: pl.DataFrame, seen: pl.DataFrame, samples: pl.DataFrame) -> pl.DataFrame:
    """Return the known positions of one robot with their times: time_s, x_m, y_m, ordered by time.

    Args:
        track: the robot's tracked positions. seen: those of a camera; if there are none, the positions of its samples
            are used too, at the start and at the end of each stop.
        samples: the robot's rows of the motion table.
    """
    names = ["time_s", "x_m", "y_m"]
    if seen.height:
        return seen.select(names)
    # A stop may start at the time of the previous sample. One of the two positions is dropped, so that times increase.
    stops = samples.select(pl.col("stop_start_s").alias("time_s"), "x_m", "y_m")
    return (
        pl.concat([track.select(names), stops, samples.select(names)])
        .sort("time_s")
        .unique("time_s", keep="last", maintain_order=True)
    )


def poses_of(run: int, robot: int, knots: pl.DataFrame, samples: pl.DataFrame) -> pl.DataFrame:
    """Return the table of poses of one robot, at its known positions, with the column ``speed_m_s`` of the line to the
    next one.

    Until the time of its first position the robot stands there. The kind is "stop" if the middle of the time to the
    next position lies between the start of a stop and the sample at the end of this stop; otherwise it is "drive".

    Args:
        knots: known positions, from ``knots_of``, at least one. samples: the robot's rows of the motion table, by time.
    """
    time, x, y = (knots[name].to_numpy() for name in ("time_s", "x_m", "y_m"))
    if time.size and time[0] > 0.0:
        time, x, y = np.append(0.0, time), np.append(x[0], x), np.append(y[0], y)
    heading, speed = _courses(time, x, y)
    stop, end = samples["stop_start_s"].to_numpy(), samples["time_s"].to_numpy()
    middle = time + np.append(np.diff(time), 0.0) / 2
    # k: the first stop that has not ended by the middle of that time, or the number of stops if all have ended (then
    # the appended inf serves as the start of a stop).
    k = np.searchsorted(end, middle)
    stands = (k < end.size) & (middle > np.append(stop, np.inf)[k])
    kind = np.where(stands, "stop", "drive")
    columns: dict[str, Any] = {
        "run": np.full(time.size, run),
        "robot": np.full(time.size, robot),
        "time_s": time,
        "x_m": x,
        "y_m": y,
        "heading_rad": heading,
        "kind": kind.tolist(),
        "speed_m_s": speed,
    }
    return pl.DataFrame(columns)


def _courses(time: Floats, x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Return the heading, rad, and speed, m/s, from each position to the next, (positions,) each.

    A standing robot has the speed 0 and the heading of its latest move. Before its first move it has the heading of
    that move, and 0 if it never moves. The last position counts as standing.

    Args:
        time: s, increasing. x, y: m; (positions,) each.
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
    """Return the number of gaps in a robot's tracking (longer than ``GAP_S``), and the longest gap, s (0: no gaps)."""
    gaps = np.diff(time_s)
    gaps = gaps[gaps > GAP_S]
    return gaps.size, float(gaps.max(initial=0.0))
