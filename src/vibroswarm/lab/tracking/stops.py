"""Find when tracked robots stand to take a sample, and match these stops with the samples of the robots' log.

Matching gives the offset of the robots' clock from the camera's clock. A robot drives on a control period after its
sample, so the end of its stop, seen by the camera, gives the time of the sample.

| name | equation |
|---|---|
| noise of a coordinate | 1.4826 median of abs(second differences) / sqrt(6): standard deviation of independent errors |
| a robot stands | ``SHORTEST_S`` within ``NOISES`` noises (at least ``LEAST_M``, ``LEAST_RAD``) of its median pose |
| moved since a stop | distance + ``LEVER_M`` times the angle turned |
| end of a stop | a line is fitted to the movement in the first frames afterwards; the end is where the line is 0 |
| clock offset | median over matched pairs of (time of a sample in the log - end of a stop) + control period |
| standard error of the offset | 1.2533 * 1.4826 MAD / sqrt(pairs): that of the median of normal errors |

MAD is the median absolute deviation; 1.4826 MAD is the standard deviation of normal errors, and 1.2533 = sqrt(pi / 2).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import polars as pl

from vibroswarm.core.arrays import Floats
from vibroswarm.errors import InputError

NOISES: Final = 6.0
"""A robot stands if its pose differs from the median pose by less than this many standard deviations of the noise."""
LEAST_M: Final = 0.0004
"""Less movement than this is always taken as standing, however little noise there is."""
LEAST_RAD: Final = 0.015
"""Less turn than this is always taken as standing, however little noise there is."""
LEVER_M: Final = 0.03
"""Distance that counts as much as a turn by 1 rad."""
SHORTEST_S: Final = 0.6
"""Shorter stops are not counted; the paper's robots sample for 1 s."""
AFTER: Final = 3
"""Number of frames after a stop to whose movement the line is fitted that gives the end."""
BIN_S: Final = 0.25
"""Differences of true pairs are within this of the clock offset."""
MATCH_S: Final = 0.5
"""A sample and the end of a stop match if they are at most this far apart, once the clocks are matched."""
LEAST_PAIRS: Final = 8
"""Fewest matches that determine a clock offset."""

STOPS: Final = {
    "robot": pl.Int64,
    "start_s": pl.Float64,
    "end_s": pl.Float64,
    "end_seen": pl.Boolean,
    "x_m": pl.Float64,
    "y_m": pl.Float64,
}
"""Columns of a table of stops: times on the video's clock, and the median position. If the end was not seen, since the
robot was hidden or the video over, ``end_s`` is when the robot was last seen standing."""


@dataclass(frozen=True)
class ClockOffset:
    """By how much the robots' clock is ahead of the camera's, s, and how sure that is."""

    offset_s: float
    error_s: float
    pairs: int


def stops_of(robot: int, time_s: Floats, x_m: Floats, y_m: Floats, heading_rad: Floats) -> pl.DataFrame:
    """Return the stops of one robot (``STOPS``) from its pose at each detection, (detections,)."""
    heading = np.unwrap(heading_rad)
    near_m = max(NOISES * max(_noise(x_m), _noise(y_m)), LEAST_M)
    near_rad = max(NOISES * _noise(heading), LEAST_RAD)
    # Whether the robot stands at each detection: that is, whether the detection is part of a stretch of SHORTEST_S in
    # which the robot stays near its median pose. A stretch begins at each detection.
    stands = np.zeros(time_s.size, dtype=np.bool_)
    for first in range(time_s.size):
        last = int(np.searchsorted(time_s, time_s[first] + SHORTEST_S))
        # No stretch: the video ends before SHORTEST_S is over, or there is a gap (the next detection is much later).
        if last >= time_s.size or time_s[last] > time_s[first] + 2.0 * SHORTEST_S:
            continue
        stretch = slice(first, last + 1)
        away = np.hypot(x_m[stretch] - np.median(x_m[stretch]), y_m[stretch] - np.median(y_m[stretch]))
        turned = np.abs(heading[stretch] - np.median(heading[stretch]))
        if away.max() < near_m and turned.max() < near_rad:
            stands[stretch] = True
    # ``stands`` changes at the first detection of a stop and at the first one after it: pairs of indices.
    edges = np.flatnonzero(np.diff(np.concatenate([[0], stands.astype(np.int8), [0]])))
    rows = []
    for begin, after in edges.reshape(-1, 2):
        x, y, towards = (float(np.median(values[begin:after])) for values in (x_m, y_m, heading))
        moved = np.hypot(x_m - x, y_m - y) + LEVER_M * np.abs(heading - towards)
        end_s, end_seen = _end_of(after, time_s, moved)
        rows.append((robot, float(time_s[begin]), end_s, end_seen, x, y))
    return pl.DataFrame(rows, schema=STOPS, orient="row")


def _noise(values: Floats) -> float:
    """Return the standard deviation of a coordinate's noise; 0 with fewer than 5 values.

    Second differences, which a steady movement does not change, have 6 times the variance of the noise: 1 + 4 + 1.
    """
    if values.size < 5:
        return 0.0
    return 1.4826 * float(np.median(np.abs(np.diff(values, 2)))) / 6**0.5


def _end_of(after: int, time_s: Floats, moved: Floats) -> tuple[float, bool]:
    """Return when a stop ended, s, and whether that was seen; if not, when the robot was last seen standing.

    Args:
        after: index of the first detection after the stop. moved: how far the robot is from its pose in the stop at
            each detection, (detections,), m.
    """
    last_s, usual_s = float(time_s[after - 1]), float(np.median(np.diff(time_s)))
    since_s = time_s[after : after + AFTER] - last_s
    since_s = since_s[
        since_s < (AFTER + 0.5) * usual_s
    ]  # without those that are late because frames are missing
    if since_s.size < 2 or since_s[0] > 1.5 * usual_s:  # the video is over, or the next frame is missing
        return last_s, False
    # The robot drove off between that frame and the next one: where a line through its movement is 0, or in the middle
    # if there is no rising line.
    slope, at_last = np.polyfit(since_s, moved[after : after + since_s.size], 1)
    began_s = np.clip(-at_last / slope, 0.0, since_s[0]) if slope > 0.0 else 0.5 * since_s[0]
    return last_s + float(began_s), True


def clock_offset(stops: pl.DataFrame, log: pl.DataFrame, control_period_s: float = 0.0) -> ClockOffset:
    """Find by how much the robots' clock is ahead of the camera's, from the samples of a log and the stops seen.

    Every sample of a robot is paired with every stop of this robot. The differences in time of the true pairs are all
    about equal: their median in the window of twice ``BIN_S`` that has the most.

    Args:
        log: robot and time_s (by the robots' clock) of each sample. control_period_s: time from a sample to the end
            of its stop, s.
    """
    stops = stops.filter(pl.col("end_seen"))
    pairs = log.select("robot", "time_s").join(stops.select("robot", "end_s"), on="robot")
    differences = (pairs["time_s"] - pairs["end_s"]).to_numpy()
    if differences.size == 0:
        raise InputError("no robot of the log stops in the video", field="--log")
    ordered = np.sort(differences)
    in_window = np.searchsorted(ordered, ordered + 2.0 * BIN_S) - np.arange(ordered.size)
    first = int(np.argmax(in_window))
    peak = float(np.median(ordered[first : first + in_window[first]]))
    matched = ordered[np.abs(ordered - peak) < MATCH_S]
    if matched.size < LEAST_PAIRS:
        raise InputError(
            f"only {matched.size} of its samples match a stop in the video; are both of one session?",
            field="--log",
        )
    spread_s = 1.4826 * float(np.median(np.abs(matched - peak)))  # standard deviation, robust to wrong pairs
    # ``peak`` compares samples with ends of stops, and a stop ends one control period after its sample.
    return ClockOffset(peak + control_period_s, 1.2533 * spread_s / matched.size**0.5, int(matched.size))
