"""A log put in order, for all readers alike: time, repeated rows, robots, counters; what was mended is counted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.errors import InputError
from vibroswarm.lab.log import COUNTERS, Log

LATE_S: Final = 1.0
"""A row may come so much after a later one; beyond, the file is not in order."""
RARE: Final = 0.01
"""A robot with fewer rows than this share of the others' is taken for a misread number."""
SLACK_S: Final = 1.0
"""A counter of time may run ahead of the rows' times by this (rows are late, not early)."""
MOST_LOST: Final = 1000
"""A count of messages that jumps by more has not lost rows, but is wrong."""


def in_order(log: Log, robots: Sequence[int] | None = None) -> Log:
    """The same log with its rows in the order of time, each once, and its counters unwrapped.

    Args:
        robots: those that there are; None: those in the log.
    Raises:
        InputError: rows more than a second out of order, two different rows of one robot at one time, unknown
            robots, a counter that falls; with the row's number.
    """
    told = dict(log.told)
    samples, late = _sorted(log.samples, log.name)
    tracks, late_tracks = _sorted(log.tracks, log.name)
    samples, again = _once(samples, log.name)
    tracks, again_tracks = _once(tracks, log.name)
    told |= {"rows_late": late + late_tracks, "rows_repeated": again + again_tracks}
    _check_robots(samples, tracks, robots, log.name)
    samples, more = _counted(samples, log)
    told |= more | {"samples": samples.height}
    return replace(log, samples=samples, tracks=tracks, told=told)


def _sorted(frame: pl.DataFrame, name: str) -> tuple[pl.DataFrame, int]:
    time = frame["time_s"].to_numpy()
    # A row that stands again later (as a robot's last line does) is not late: it is left out in ``_once``.
    seen = frame.select(pl.exclude("line")).is_duplicated().to_numpy()
    behind = np.maximum.accumulate(np.where(seen, -np.inf, time)) - time if time.size else time
    behind = np.where(seen, 0.0, behind)
    if time.size and float(behind.max()) > LATE_S:
        k = int(np.argmax(behind > LATE_S))
        raise InputError(
            f"its time, {time[k]:g} s, is {behind[k]:.3g} s before that of a row above: the file is not in the order "
            "of time, or holds two sessions",
            field=f"{name}, row {frame['line'][k]}",
        )
    return frame.sort("time_s", "line", maintain_order=True), int((behind > 0).sum())


def _once(frame: pl.DataFrame, name: str) -> tuple[pl.DataFrame, int]:
    content = [one for one in frame.columns if one != "line"]
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
    both = pl.concat([samples.select("robot", "line"), tracks.select("robot", "line")])
    rows = both.group_by("robot").agg(pl.len().alias("rows"), pl.col("line").min()).sort("line")
    if robots is not None:
        unknown = rows.filter(~pl.col("robot").is_in(list(robots)))
        words = f"there are {', '.join(map(str, robots))}"
    else:
        usual = float(rows["rows"].median() or 0.0)  # type: ignore[arg-type]
        unknown = rows.filter(pl.col("rows") < RARE * usual)
        words = f"the others have some {usual:.0f} rows each; say which robots there are with --robots"
    if unknown.height:
        robot, count, line = unknown.row(0)
        raise InputError(
            f"unknown robot {robot}, in {count} row{'' if count == 1 else 's'}; {words}",
            field=f"{name}, row {line}",
        )


def _counted(samples: pl.DataFrame, log: Log) -> tuple[pl.DataFrame, dict[str, float]]:
    """Counters unwrapped robot by robot."""
    wrapped = odd = lost = 0
    columns = {name: samples[name].cast(pl.Float64).to_numpy().copy() for name in COUNTERS}
    robot, time_s, line = (samples[name].to_numpy() for name in ("robot", "time_s", "line"))
    for one in np.unique(robot):
        own = np.flatnonzero(robot == one)
        for name, values in columns.items():
            if np.isnan(values[own]).all():
                continue
            of_time = name.endswith("_s")
            untold = own[np.isnan(values[own])]
            if name == "sent" and untold.size:
                raise InputError(
                    f"does not say how many messages robot {one} has sent, as its other rows do",
                    field=f"{log.name}, row {line[untold[0]]}",
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
                        f"robot {one} has {name} {values[own][k - 1]:g} messages, and then "
                        f"{samples[name][int(own[k])]:g}",
                        field=f"{log.name}, row {line[own[k]]}",
                    )
            if name == "sent":
                lost += int((step - 1).sum() + values[own][0])
    told: dict[str, float] = {"counters_wrapped": wrapped, "counters_odd": odd, "samples_lost": lost}
    found = {
        name: pl.Series(name, values, nan_to_null=True).cast(samples.schema[name])
        for name, values in columns.items()
    }
    return samples.with_columns(**found), told


def unwrapped(
    values: NDArray[np.float64], wraps_at: float | None, time_s: NDArray[np.float64] | None = None
) -> tuple[NDArray[np.float64], int, NDArray[np.bool_]]:
    """A counter that goes on growing where it wrapped; how often it did; which of its steps are set null.

    Args:
        values: (rows,), nan where it was not read. wraps_at: it goes back to 0 there; None: never.
        time_s: (rows,): when, of a counter of time. A step longer than the time gone by cannot be: from there on the
            counter goes on from its last value, and that row is nan.
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
