"""Infer the threshold and the sample interval with which robots ran from their logs.

| name | symbol | inferred from |
|---|---|---|
| rms_threshold | theta_E | energies E of samples whose bit is certain (logged, or alpha or beta did not grow) |
| sample_interval_ms | tau | time between undisturbed samples, minus the stop and two ticks |

Between two samples of a robot alpha grows by the number of ones among its own bit and the bits received, and beta by
the number of zeros. So the own bit was 0 if alpha did not grow, and 1 if beta did not grow.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
import polars as pl

from vibroswarm.core.arrays import Floats
from vibroswarm.recordings.read import Log

TICKS_S: Final = 0.04
"""Two ticks of the simulator: undisturbed samples are tau + stop + two ticks apart."""
USUAL_S: Final = 0.3
"""Intervals without avoidance are the usual one if they differ by no more from the most frequent duration, s."""
FAR: Final = 0.25
"""Bounds of theta_E that are apart by a larger share of the upper one are far apart: it is their middle."""
CONTRADICT: Final = 0.02
"""Share of samples that may contradict a threshold."""


class Inferred(NamedTuple):
    """One inferred setting, from ``number`` samples or intervals; None: undetermined."""

    name: str
    value: Any = None
    low: float | None = None
    high: float | None = None
    number: int = 0


def infer_settings(
    logs: Sequence[Log], prior: tuple[int, int] = (1, 1), stop_s: float = 1.0
) -> list[Inferred]:
    """Infer theta_E and tau.

    Args:
        prior: alpha and beta before the first observation. stop_s: duration of a stop for tau, if times spent standing
            are not logged, s.
    """
    between = _intervals_of(logs, prior)
    return [_infer_threshold(between), _infer_tau(between, stop_s)]


def _intervals_of(logs: Sequence[Log], prior: tuple[int, int]) -> pl.DataFrame:
    # A change is null if its column is not logged, and at a robot's first row, except that at sample 0 alpha and beta
    # grow from the prior, and the messages sent from -1. ``whole``: no row is missing since the previous sample, as
    # far as the count of messages sent tells.
    def step(name: str, first: float | None = None) -> pl.Expr:
        value = pl.col(name).cast(pl.Float64)
        return value - pl.coalesce(value.shift(1).over("robot"), pl.when(pl.col("sent") == 0).then(first))

    return pl.concat(
        log.samples.sort("robot", "time_s").select(
            "energy", bit="observation",
            new_alpha=step("alpha", first=prior[0]),
            new_beta=step("beta", first=prior[1]),
            whole=(step("sent", first=-1.0) == 1).fill_null(False) | pl.col("sent").is_null(),
            spacing_s=step("time_s"),
            avoid_s=step("avoid_total_s"),
            stop_s=step("stop_total_s"),
        )
        for log in logs
    )  # fmt: skip


def _infer_threshold(between: pl.DataFrame) -> Inferred:
    # theta_E lies between the largest energy that was read as 0 and the smallest that was read as 1. It may equal the
    # former, but not the latter, as a bit is 1 if E > theta_E. If no threshold agrees with all samples, it is the one
    # that the fewest contradict, if these are few.
    name, known = "sensor.rms_threshold", between.drop_nulls("energy")
    read_zero, read_one = pl.col("bit") == 0, pl.col("bit") == 1
    if known["bit"].null_count() == known.height:
        read_zero, read_one = (pl.col("whole") & (pl.col(grown) == 0) for grown in ("new_alpha", "new_beta"))
    zeros, ones = (known.filter(read)["energy"].sort().to_numpy() for read in (read_zero, read_one))
    undetermined = Inferred(name, number=zeros.size + ones.size)
    if zeros.size == 0 or ones.size == 0:
        return undetermined
    # Contradictory samples, counted for a threshold at each energy: zeros above it, and ones up to it.
    edges = np.unique(np.concatenate([zeros, ones]))
    above = zeros.size - np.searchsorted(zeros, edges, side="right")
    errors = above + np.searchsorted(ones, edges, side="right")
    best = int(np.argmin(errors))
    if errors[best] > CONTRADICT * undetermined.number:
        return undetermined
    low, high = float(edges[best]), float(edges[min(best + 1, edges.size - 1)])
    value = _beside(low, high, at_low=zeros.size >= ones.size)
    return undetermined._replace(value=value, low=low, high=high)


def _beside(low: float, high: float, at_low: bool) -> float:
    # The number with two decimals in [low, high) nearest to the bound of more samples; or the middle.
    near = math.ceil(low * 100 - 1e-9) / 100 if at_low else (math.ceil(high * 100 - 1e-9) - 1) / 100
    is_near = high - low <= FAR * high and low - 1e-12 <= near < high
    return near if is_near else (low + high) / 2


def _infer_tau(between: pl.DataFrame, stop_s: float) -> Inferred:
    # From the time between samples without avoidance, or between all samples if avoidance is not logged; undetermined
    # with fewer than 20 such intervals.
    name = "sample.sample_interval_ms"
    calm = between.filter(pl.col("whole"), pl.col("spacing_s").is_not_null())
    if between["avoid_s"].null_count() < between.height:
        calm = calm.filter(pl.col("avoid_s") == 0)
    spacing = calm["spacing_s"].to_numpy()
    usual = _usual_of(spacing) if spacing.size >= 20 else spacing[:0]
    if usual.size < 2:  # one interval has no standard deviation
        return Inferred(name, number=usual.size)
    stops_s = calm["stop_s"].drop_nulls().to_numpy()
    tau_s = float(usual.mean()) - (float(np.median(stops_s)) if stops_s.size else stop_s) - TICKS_S
    if tau_s <= 0.0:  # intervals do not hold a stop
        return Inferred(name, number=usual.size)
    error_s = float(usual.std(ddof=1)) / math.sqrt(usual.size) + 0.01  # times are logged to 0.01 s
    # Two standard errors on each side. A robot whose control loop is faster than the simulator's takes less than two
    # ticks of 20 ms in addition, so its tau may be up to TICKS_S longer.
    low, high = tau_s - 2 * error_s, tau_s + TICKS_S + 2 * error_s
    return Inferred(name, round(1000 * _roundest(low, high), 3), 1000 * low, 1000 * high, usual.size)


def _roundest(low: float, high: float) -> float:
    # The number in [low, high) with the fewest decimals; 1e-9 and 1e-12 keep rounding errors from excluding ``low``.
    for digits in range(7):
        scale = 10.0**digits
        first = math.ceil(low * scale - 1e-9) / scale
        if low - 1e-12 <= first < high:
            return first
    return (low + high) / 2


def _usual_of(spacing_s: Floats) -> Floats:
    # The durations near the most frequent one: an interval is longer if the robot first had to finish a turn. Find the
    # window of width USUAL_S (two neighbouring bins of a histogram) with the most intervals.
    edges = np.arange(0.0, spacing_s.max() + USUAL_S, USUAL_S / 2)
    in_windows = np.convolve(np.histogram(spacing_s, edges)[0], [1, 1], "valid")
    middle_s = edges[int(np.argmax(in_windows))] + USUAL_S / 2
    # The edges are those of bins, which may cut the usual intervals anywhere. A log with rows every 0.2 s has intervals
    # on both sides of the true one, of which only the mean is right: so take them around the window's median.
    middle_s = float(np.median(spacing_s[np.abs(spacing_s - middle_s) <= USUAL_S / 2]))
    return spacing_s[np.abs(spacing_s - middle_s) <= USUAL_S]
