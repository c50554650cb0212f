"""When tracked robots stand to take a sample, and by how much their clock differs from the camera's.

| name | equation |
|---|---|
| stands | within ``NEAR_M`` of, and ``NEAR_RAD`` turned from, where it was ``SHORTEST_S`` later and before |
| end of a stop | where the path after it, extrapolated back at its speed, leaves the place of the stop |
| clock offset | median over matched pairs of (time of a sample in the log - end of a stop) |
| its standard error | 1.2533 * 1.4826 MAD / sqrt(pairs): of a median of normal errors |
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.errors import InputError

Floats = NDArray[np.float64]

NEAR_M: Final = 0.002
NEAR_RAD: Final = 0.12
"""A tracked robot that stands moves less than this: noise of the camera."""
SHORTEST_S: Final = 0.8
"""Shorter stops are not counted; the paper's robots sample for 1 s."""
FAR_S: Final = 30.0
"""Clocks may differ by more than this, but matched samples lie within ``MATCH_S`` of the offset."""
EARLY_S: Final = 0.05
"""A stop may have ended so long before the last frame in which the robot is still near: ``NEAR_M`` at its speed."""
BIN_S: Final = 0.25
MATCH_S: Final = 0.5
LEAST_PAIRS: Final = 8

STOPS: Final = {
    "robot": pl.Int64,
    "start_s": pl.Float64,
    "end_s": pl.Float64,
    "x_m": pl.Float64,
    "y_m": pl.Float64,
}
"""Columns of a table of stops."""


@dataclass(frozen=True)
class ClockOffset:
    """By how much the robots' clock is ahead of the camera's, s, and how sure that is."""

    offset_s: float
    error_s: float
    """Standard error."""
    pairs: int
    """Samples of the log that are matched with a stop."""
    samples: int
    """Samples of the log while the camera ran."""


def stops_of(robot: int, time_s: Floats, x_m: Floats, y_m: Floats, heading_rad: Floats) -> pl.DataFrame:
    """Return the stops of one robot (``STOPS``).

    Args:
        time_s, x_m, y_m, heading_rad: (detections,), of increasing time.
    """
    stands = np.zeros(time_s.size, dtype=np.bool_)
    for k in range(time_s.size):
        j = int(np.searchsorted(time_s, time_s[k] + SHORTEST_S))
        if j >= time_s.size or time_s[j] > time_s[k] + 2.0 * SHORTEST_S:
            continue
        along = slice(k, j + 1)
        middle_x, middle_y = np.median(x_m[along]), np.median(y_m[along])
        near = np.hypot(x_m[along] - middle_x, y_m[along] - middle_y).max() < NEAR_M
        turned = np.abs(np.angle(np.exp(1j * (heading_rad[along] - heading_rad[k])))).max()
        if near and turned < NEAR_RAD:
            stands[along] = True
    edges = np.flatnonzero(np.diff(np.concatenate([[0], stands.astype(np.int8), [0]])))
    rows = []
    for first, after in edges.reshape(-1, 2):
        at = float(np.median(x_m[first:after])), float(np.median(y_m[first:after]))
        end_s = _end_of(first, after, at, time_s, x_m, y_m)
        rows.append((robot, float(time_s[first]), end_s, *at))
    return pl.DataFrame(rows, schema=STOPS, orient="row")


def _end_of(
    first: int, after: int, at: tuple[float, float], time_s: Floats, x_m: Floats, y_m: Floats
) -> float:
    """Return when a stop ended: distances after it, as a line in time, where they are 0."""
    away = np.hypot(x_m - at[0], y_m - at[1])
    moving = [k for k in range(after - 1, min(after + 12, time_s.size)) if away[k] > NEAR_M][:5]
    last_s = float(time_s[after - 1])
    if len(moving) < 3:
        return last_s
    slope, at_0 = np.polyfit(time_s[moving] - last_s, away[moving], 1)
    if slope <= 0.005:  # m/s: turns in place, or was hidden
        return last_s
    return last_s + float(np.clip(-at_0 / slope, -EARLY_S, time_s[moving[0]] - last_s))


def clock_offset(stops: pl.DataFrame, log: pl.DataFrame) -> ClockOffset:
    """Match the samples of a log with the stops that a camera saw.

    Args:
        stops: ``STOPS``. log: robot and time_s (by the robots' clock) of each sample.
    Raises:
        InputError: fewer than ``LEAST_PAIRS`` samples match.
    """
    lags = []
    for robot in log["robot"].unique().to_list():
        taken = log.filter(pl.col("robot") == robot)["time_s"].to_numpy()
        ended = stops.filter(pl.col("robot") == robot)["end_s"].to_numpy()
        lags.append((taken[:, None] - ended[None, :]).ravel())
    every = np.concatenate(lags) if lags else np.empty(0)
    if every.size == 0:
        raise InputError("no robot of the log stops in the video", field="--log")
    low = every.min() - BIN_S
    counts = np.bincount(((every - low) / BIN_S).astype(int), minlength=2)
    together = counts[:-1] + counts[1:]
    peak = low + BIN_S * (int(np.argmax(together)) + 1)
    for within in (BIN_S, MATCH_S, BIN_S):
        matched = every[np.abs(every - peak) < within]
        if matched.size:
            peak = float(np.median(matched))
    matched = every[np.abs(every - peak) < MATCH_S]
    if matched.size < LEAST_PAIRS:
        raise InputError(
            f"only {matched.size} of its samples match a stop in the video; are both of one session?",
            field="--log",
        )
    spread = 1.4826 * float(np.median(np.abs(matched - peak)))
    ends = stops["end_s"].to_numpy()
    own = log["time_s"].to_numpy() - peak
    during = int(((own >= ends.min() - MATCH_S) & (own <= ends.max() + MATCH_S)).sum())
    return ClockOffset(peak, 1.2533 * spread / matched.size**0.5, int(matched.size), during)
