"""Measure how robots turn and how far they get in undisturbed intervals: one drive between two samples, nothing else.

| name | symbol | unit | equation |
|---|---|---|---|
| undisturbed | - | - | no avoidance, and lasting the median of such intervals within ``CALM_S``: no turn either |
| turn | D | rad | change of the direction of the step from one undisturbed interval to the next, below ``MOST_TURN`` |
| own misalignment | m | - | D track / (2 L), L the length of the arc: what a straight robot lacks |
| its spread | s | - | interquartile range of D about the robot's median, / 1.349: insensitive to hidden turns |
| slow share | c | - | autocorrelation of D, clipped, over ``SLOW_LAGS`` samples |
| from sample to sample | - | - | s sqrt(2 (1 - c)): D is the mean of two intervals' turns |
| slow | - | - | s sqrt(c) |
| variation of distance | - | - | interquartile range about its line in time / 1.435 (triangular), / its median |

What matters to where robots sample is the turn from sample to sample, with starts and stops, not the slope of the
course in the middle of a drive, which is smaller.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

Floats = NDArray[np.float64]

CALM_S: Final = 0.3
LEAST_M: Final = 0.05
MOST_TURN: Final = np.radians(40.0)
"""A larger turn is one that the clock hides."""
SLOW_LAGS: Final = (4, 6, 8, 10, 12)
"""Samples: beyond what neighbouring intervals share, within a slow variation."""
CLIPPED: Final = 2.5
"""Deviations are clipped to so many spreads for autocorrelations."""
LEAST: Final = 30
"""Fewest turns of a robot in a session."""
IQR: Final = 1.349
"""Interquartile range of a standard normal distribution."""
IQR_TRIANGULAR: Final = 2.0 * (np.sqrt(6.0) - np.sqrt(3.0))
"""That of a triangular one of variance 1."""


def undisturbed(samples: pl.DataFrame) -> pl.DataFrame:
    """Return the undisturbed intervals that follow another one.

    Args:
        samples: of ``features.sample_table``, of any number of sessions.
    Returns:
        One row an interval: run, robot, index (of the sample that ends it), time_s, turn_rad, distance_m.
    """
    key = ["run", "robot"]
    free = pl.col("avoid_s") < 1e-9
    lasting = samples.filter(free)["spacing_s"].median()
    calm = free & ((pl.col("spacing_s") - lasting).abs() <= CALM_S) & (pl.col("distance_m") > LEAST_M)
    turn = pl.arctan2("dy_m", "dx_m").diff().over(key)
    marked = samples.sort("run", "robot", "time_s").with_columns(
        calm=calm.fill_null(False),
        turn_rad=(turn + np.pi) % (2.0 * np.pi) - np.pi,
        index=pl.int_range(pl.len()).over(key),
    )
    both = pl.col("calm") & pl.col("calm").shift(1).over(key).fill_null(False)
    chosen = marked.filter(both & (pl.col("turn_rad").abs() < MOST_TURN))
    return chosen.select("run", "robot", "index", "time_s", "turn_rad", "distance_m")


class Course(NamedTuple):
    """How one robot drives in one session: per interval, and in units of misalignment times 2 / track (1/m)."""

    turn_rad: float
    """Median turn from interval to interval."""
    bend_per_m: float
    """Median turn over the length of the arc."""
    spread_per_m: float
    slow_share: float
    distance_spread: float
    """Relative."""
    turns: int
    samples: int


def course_of(own: pl.DataFrame) -> Course | None:
    """Return the course of one robot in one session from its rows of ``undisturbed``; None if there are too few."""
    if own.height < LEAST:
        return None
    turn, distance, time = (own[name].to_numpy() for name in ("turn_rad", "distance_m", "time_s"))
    middle = float(np.median(turn))
    half = max(abs(middle) / 2.0, 1e-9)
    arc_m = float(np.median(distance)) * half / np.sin(half)
    spread = quartile_spread(turn - middle)
    line = np.polyval(np.polyfit(time, distance, 1), time)
    return Course(
        turn_rad=middle,
        bend_per_m=middle / arc_m,
        spread_per_m=spread / arc_m,
        slow_share=_slow_share(own["index"].to_numpy(), turn - middle, spread),
        distance_spread=quartile_spread(distance - line) * IQR / IQR_TRIANGULAR / float(np.median(distance)),
        turns=own.height,
        samples=int(own["index"][-1]) + 1,
    )


def quartile_spread(values: Floats) -> float:
    """Return the standard deviation of a normal distribution with the interquartile range of these values."""
    low, high = np.quantile(values, [0.25, 0.75])
    return float(high - low) / IQR


def _slow_share(index: NDArray[np.int64], deviation: Floats, spread: float) -> float:
    """Return the mean autocorrelation over ``SLOW_LAGS``, within [0, 1]; nan without pairs."""
    clipped = np.clip(deviation, -CLIPPED * spread, CLIPPED * spread)
    clipped = clipped - clipped.mean()
    by_index = np.full(int(index[-1]) + 1, np.nan)
    by_index[index] = clipped
    products = [by_index[lag:] * by_index[:-lag] for lag in SLOW_LAGS if lag < by_index.size]
    pairs = np.concatenate([each[np.isfinite(each)] for each in products]) if products else np.zeros(0)
    variance = float((clipped**2).mean())
    if not pairs.size or variance <= 0.0:
        return np.nan
    return float(np.clip(pairs.mean() / variance, 0.0, 1.0))
