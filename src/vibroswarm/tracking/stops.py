"""When tracked robots stand to take a sample, by how much their clock differs from the camera's, and how samples fit.

| name | equation |
|---|---|
| noise of a coordinate | 1.4826 median of the size of second differences / sqrt(6): of independent errors |
| stands | within ``NOISES`` noises (at least ``LEAST_M``, ``LEAST_RAD``) of the medians over ``SHORTEST_S`` |
| moved since a stop | distance + ``LEVER_M`` times the angle |
| end of a stop | when a line through what it moved in the first frames after it is 0 |
| clock offset | median over matched pairs of (time of a sample in the log - end of a stop) + control period |
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

NOISES: Final = 6.0
LEAST_M: Final = 0.0004
LEAST_RAD: Final = 0.015
"""A tracked robot that stands moves less than this, however little noise there is."""
LEVER_M: Final = 0.03
SHORTEST_S: Final = 0.6
"""Shorter stops are not counted; the paper's robots sample for 1 s."""
AFTER: Final = 3
"""Frames after a stop that its end is found from."""
BIN_S: Final = 0.25
MATCH_S: Final = 0.5
LEAST_PAIRS: Final = 8

STOPS: Final = {
    "robot": pl.Int64,
    "start_s": pl.Float64,
    "end_s": pl.Float64,
    "end_seen": pl.Boolean,
    "x_m": pl.Float64,
    "y_m": pl.Float64,
}
"""Columns of a table of stops; an end is not seen if the robot is hidden then, or the video over."""


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
    control_period_s: float = 0.0
    """How long after a sample a robot drives on: the end of a stop is so much later."""


def stops_of(robot: int, time_s: Floats, x_m: Floats, y_m: Floats, heading_rad: Floats) -> pl.DataFrame:
    """Return the stops of one robot (``STOPS``).

    Args:
        time_s, x_m, y_m, heading_rad: (detections,), of increasing time.
    """
    heading = np.unwrap(heading_rad)
    near_m = max(NOISES * max(_noise(x_m), _noise(y_m)), LEAST_M)
    near_rad = max(NOISES * _noise(heading), LEAST_RAD)
    stands = np.zeros(time_s.size, dtype=np.bool_)
    for k in range(time_s.size):
        j = int(np.searchsorted(time_s, time_s[k] + SHORTEST_S))
        if j >= time_s.size or time_s[j] > time_s[k] + 2.0 * SHORTEST_S:
            continue
        along = slice(k, j + 1)
        away = np.hypot(x_m[along] - np.median(x_m[along]), y_m[along] - np.median(y_m[along]))
        turned = np.abs(heading[along] - np.median(heading[along]))
        if away.max() < near_m and turned.max() < near_rad:
            stands[along] = True
    edges = np.flatnonzero(np.diff(np.concatenate([[0], stands.astype(np.int8), [0]])))
    rows = []
    for first, after in edges.reshape(-1, 2):
        x, y, towards = (float(np.median(of[first:after])) for of in (x_m, y_m, heading))
        moved = np.hypot(x_m - x, y_m - y) + LEVER_M * np.abs(heading - towards)
        rows.append((robot, float(time_s[first]), *_end_of(after, time_s, moved), x, y))
    return pl.DataFrame(rows, schema=STOPS, orient="row")


def _noise(values: Floats) -> float:
    """Return the standard deviation of the noise of a coordinate, by its second differences; 0 if too few."""
    if values.size < 5:
        return 0.0
    return 1.4826 * float(np.median(np.abs(np.diff(values, 2)))) / 6**0.5


def _end_of(after: int, time_s: Floats, moved: Floats) -> tuple[float, bool]:
    """Return when a stop ended, s, and whether that was seen; if not, when the robot was last seen standing.

    Args:
        after: index of the first detection after the stop. moved: (detections,): how far the robot moved since, m.
    """
    last_s = float(time_s[after - 1])
    usual_s = float(np.median(np.diff(time_s)))
    going = after + np.flatnonzero(time_s[after : after + AFTER] - last_s < (AFTER + 0.5) * usual_s)
    if going.size == 0 or time_s[after] - last_s > 1.5 * usual_s:
        return last_s, False
    step_s = float(time_s[after]) - last_s
    slope, at_0 = np.polyfit(time_s[going] - last_s, moved[going], 1) if going.size > 1 else (0.0, 0.0)
    return last_s + (float(np.clip(-at_0 / slope, 0.0, step_s)) if slope > 0.0 else 0.5 * step_s), True


def clock_offset(stops: pl.DataFrame, log: pl.DataFrame, control_period_s: float = 0.0) -> ClockOffset:
    """Match the samples of a log with the stops that a camera saw.

    Args:
        stops: ``STOPS``. log: robot and time_s (by the robots' clock) of each sample.
        control_period_s: how long after a sample a robot drives on.
    Raises:
        InputError: fewer than ``LEAST_PAIRS`` samples match.
    """
    stops = stops.filter(pl.col("end_seen"))
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
    return ClockOffset(
        peak + control_period_s,
        1.2533 * spread / matched.size**0.5,
        int(matched.size),
        during,
        control_period_s,
    )


FAR_S: Final = 3.0
SAMPLES_MATCHED: Final = {
    "robot": pl.Int64, "time_s": pl.Float64, "stop_end_s": pl.Float64, "residual_s": pl.Float64,
}  # fmt: skip
"""A row a sample: when it was taken on the video's clock; the end of its stop, null without one; and by how much the
sample is later than a control period before that, null too if the end was not seen."""


def match_samples(
    stops: pl.DataFrame, samples: pl.DataFrame, offset: ClockOffset
) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Match each sample with the nearest end of a stop of its robot, within ``MATCH_S``; each stop at most once.

    A sample during a stop whose end was hidden, or ``FAR_S`` after it was seen last, belongs to that stop.

    Args:
        stops: ``STOPS``. samples: robot and time_s (by the robots' clock).
    Returns: ``SAMPLES_MATCHED``, in the order of time, and the stops that no sample matches.
    """
    rows: list[tuple[int, float, float | None, float | None]] = []
    unmatched = []
    for robot in sorted({*stops["robot"].unique().to_list(), *samples["robot"].unique().to_list()}):
        of_robot = stops.filter(pl.col("robot") == robot)
        own = of_robot.filter(pl.col("end_seen"))
        hidden = of_robot.filter(~pl.col("end_seen")).select("start_s", "end_s").rows()
        ends = own["end_s"].to_numpy() - offset.control_period_s  # when it has sampled
        taken = np.sort(samples.filter(pl.col("robot") == robot)["time_s"].to_numpy() - offset.offset_s)
        apart = np.abs(taken[:, None] - ends[None, :])
        partner: dict[int, int] = {}
        for flat in np.argsort(apart, axis=None, kind="stable").tolist():
            sample, stop = divmod(flat, max(ends.size, 1))
            if apart[sample, stop] > MATCH_S:
                break
            if sample not in partner and stop not in partner.values():
                partner[sample] = stop
        for k, time_s in enumerate(taken.tolist()):
            during = [end for start, end in hidden if start <= time_s <= end + FAR_S]
            if k in partner:
                rows.append(
                    (robot, time_s, float(own["end_s"][partner[k]]), time_s - float(ends[partner[k]]))
                )
            else:
                rows.append((robot, time_s, during[0] if during else None, None))
        free = [k not in set(partner.values()) for k in range(ends.size)]
        unmatched.append(own.filter(pl.Series(free, dtype=pl.Boolean)))
    matched = pl.DataFrame(rows, schema=SAMPLES_MATCHED, orient="row").sort("time_s", "robot")
    return matched, pl.concat(unmatched).sort("end_s", "robot") if unmatched else stops.clear()
