"""How alike the bits of samples are: near each other on the floor, and one after the other; and what was lost.

| name | symbol | equation |
|---|---|---|
| correlogram | I(d) | mean over pairs at distance d of (o_i - m)(o_j - m), over the mean of (o_i - m)^2 |
| lag-1 correlation | r | the same over pairs of one robot's consecutive samples |
| packet loss | - | 1 - heard / addressed |

m is the run's own mean, which draws I down by about 1 / (samples - 1) even where nothing is alike. Pairs are of one
run, of any two robots; I is Moran's with the pairs at that distance as neighbours. The run is the unit: figures are
made for each run and averaged.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any, Final, Literal

import numpy as np
import polars as pl
from numpy.typing import ArrayLike, NDArray

from vibroswarm.analysis.intervals import Interval, mean_interval
from vibroswarm.errors import InputError
from vibroswarm.observation.model import vibrating_at
from vibroswarm.result import Result

Of = Literal["bits", "tiles"]

EXCHANGE: Final[dict[str, Any]] = {
    "run": pl.UInt32,
    "addressed": pl.UInt32,
    "heard": pl.UInt32,
    "packet_loss": pl.Float64,
}
"""Columns of ``packet_loss``."""


def correlogram(
    result: Result, edges_m: ArrayLike | None = None, of: Of = "bits", level: float = 0.95
) -> pl.DataFrame:
    """Correlation of the samples' values against the distance between their places.

    All pairs of a run are taken: about 20 ms a run of 1200 samples, so give some tens of runs.

    Args:
        edges_m: edges of the bins of distance, increasing, m; without it, a tenth of the shorter side of the arena.
        of: the bits that were read, or what lies below (1 where the tile vibrates): the floor without the sensor.
    Returns: from_m, to_m, pairs (mean a run), correlation, low, high (over runs); a row a bin, null where no pair is.
    Raises:
        InputError: edges that do not increase, a wrong ``of``.
    """
    if of not in ("bits", "tiles"):
        raise InputError(f"'{of}' has no correlogram; bits or tiles", field="of")
    arena = result.scenario.arena
    side_m = min(arena.width_m, arena.height_m)
    edges = np.linspace(0.0, side_m, 11) if edges_m is None else np.asarray(edges_m, dtype=np.float64)
    if edges.ndim != 1 or edges.size < 2 or not (np.diff(edges) > 0).all():
        raise InputError("give at least two distances that increase", field="edges_m")
    x, y = result.motion["x_m"].to_numpy(), result.motion["y_m"].to_numpy()
    values = _values(result, of)
    by_run = [
        _of_run(x[low:high], y[low:high], values[low:high], edges) for low, high in _bounds(result.motion)
    ]
    rows = []
    for k, (from_m, to_m) in enumerate(pairwise(edges.tolist())):
        interval = mean_interval([correlation[k] for correlation, _ in by_run], level)
        pairs = float(np.mean([number[k] for _, number in by_run])) if by_run else 0.0
        rows.append((from_m, to_m, pairs, *interval[:3]))
    names = ("from_m", "to_m", "pairs", "correlation", "low", "high")
    frame = pl.DataFrame(rows, schema=dict.fromkeys(names, pl.Float64), orient="row")
    finite = [pl.when(pl.col(name).is_finite()).then(pl.col(name)).alias(name) for name in names]
    return frame.with_columns(finite)


def _values(result: Result, of: Of) -> NDArray[np.float64]:
    if of == "bits":
        return result.observations["observation"].cast(pl.Float64).to_numpy()
    tile = result.observations["tile"].to_numpy()
    values = np.empty(tile.size)
    run = result.motion["run"].to_numpy()
    for low, high in _bounds(result.motion):
        values[low:high] = vibrating_at(result.floor(int(run[low])), tile[low:high])
    return values


def _bounds(samples: pl.DataFrame) -> list[tuple[int, int]]:
    """First and last row (not included) of each run of a table sorted by run."""
    run = samples["run"].to_numpy()
    first = np.flatnonzero(np.append(True, run[1:] != run[:-1])) if run.size else np.zeros(0, np.int64)
    return [(int(low), int(high)) for low, high in pairwise(np.append(first, run.size))]


def _of_run(
    x: NDArray[np.float64], y: NDArray[np.float64], values: NDArray[np.float64], edges: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Correlation in each bin (nan without pairs, or where all values are equal), and pairs; shapes (bins,)."""
    total, pairs = np.zeros(edges.size - 1), np.zeros(edges.size - 1, dtype=np.int64)
    deviation = values - values.mean()
    for i in range(values.size - 1):
        distance = np.hypot(x[i + 1 :] - x[i], y[i + 1 :] - y[i])
        inside = (distance >= edges[0]) & (distance < edges[-1])
        bins = np.searchsorted(edges, distance[inside], side="right") - 1
        pairs += np.bincount(bins, minlength=pairs.size)
        total += deviation[i] * np.bincount(bins, deviation[i + 1 :][inside], total.size)
    variance = float((deviation**2).mean())
    if variance <= 0.0:
        return np.full(total.size, np.nan), pairs
    with np.errstate(invalid="ignore", divide="ignore"):
        return total / pairs / variance, pairs


def lag_one(result: Result, level: float = 0.95) -> Interval:
    """Correlation of a robot's bit with its next, in each run over all robots; mean over runs."""
    ordered = result.observations.sort("run", "robot", "sample")
    robot = ordered.select(pl.struct("run", "robot").rle_id()).to_series().to_numpy()
    correlations = []
    for low, high in _bounds(ordered):
        bits = ordered["observation"][low:high].cast(pl.Float64).to_numpy()
        deviation = bits - bits.mean()
        same = robot[low + 1 : high] == robot[low : high - 1]
        products = (deviation[1:] * deviation[:-1])[same]
        variance = float((deviation**2).mean())
        correlations.append(float(products.mean()) / variance if products.size and variance > 0 else math.nan)
    return mean_interval(correlations, level)


def packet_loss(result: Result) -> pl.DataFrame:
    """Messages addressed to the robots of each run and those they heard, as far as that is clear.

    Only messages sent at least two control periods before the receiver's last stop began count: it had come past
    these, heard or not, when it took its last sample. What was sent later may still have been on its way, and a
    robot that never sampled says nothing. The share is of messages addressed to a robot, its own not among them.
    Samples count by their numbers, so that rows that a recording lost count too; where it does not tell what was
    received, heard and the share are null.
    """
    tick_s = result.scenario.tick_s
    tick = np.rint(result.motion["time_s"].to_numpy() / tick_s).astype(np.int64)
    last = (
        result.motion.with_columns(heard=result.inference["received"])
        .with_row_index("row")
        .group_by("run", "robot", maintain_order=True)
        .last()
    )
    begun = np.rint(last["stop_start_s"].to_numpy() / tick_s).astype(np.int64) - 2
    # One clock for all runs, so that one search answers for all.
    span = int(max(tick.max(initial=0), 0)) + 3
    clock = result.motion["run"].to_numpy().astype(np.int64) * span + tick
    of_run = last["run"].to_numpy().astype(np.int64)
    number = pl.col("sample").cast(pl.Int64)
    since = number - number.shift(1).over("run", "robot").fill_null(-1)  # 1, and more after lost rows
    so_far = np.append(0, np.cumsum(result.motion.select(since).to_series().to_numpy()))
    sent = so_far[np.searchsorted(clock, of_run * span + np.maximum(begun, -1), side="right")]
    sent -= so_far[np.searchsorted(clock, of_run * span, side="left")]
    own = last["sample"].to_numpy().astype(np.int64)  # all before its last, each long before that stop
    counted = last.select("run", "heard").with_columns(addressed=pl.Series(np.maximum(sent - own, 0)))
    untold = pl.col("heard").is_null().any()
    table = counted.group_by("run", maintain_order=True).agg(
        pl.col("addressed").sum(), pl.when(~untold).then(pl.col("heard").sum()).alias("heard")
    )
    loss = pl.when(pl.col("addressed") > 0).then(1.0 - pl.col("heard") / pl.col("addressed"))
    return table.with_columns(packet_loss=loss).select(list(EXCHANGE)).cast(EXCHANGE)  # type: ignore[arg-type]
