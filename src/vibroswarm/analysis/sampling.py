"""Describe how a swarm samples: distances, intervals, evenness, and the effective number of samples.

| name | symbol | unit | equation |
|---|---|---|---|
| samples of a run on tiles | n | - | those off all tiles count in no figure of evenness |
| share of a run's samples on tile t | w_t | - | sum over t is 1 |
| tiles | N | - | |
| fill ratio | f | - | |
| false positive, false negative | a, b | - | a still tile reads as 1, a vibrating one as 0 |
| share of ones expected | q | - | f (1 - b) + (1 - f) a |
| share of ones of a run | O | - | over its samples |
| effective samples, over runs | n_eff | - | q (1 - q) / Var(O), over runs with floors drawn anew |
| effective samples, of visits | n_v | - | (N - 1) / (N sum w_t^2 - 1) |

**Effective samples.** n samples at independent, uniformly random places of a floor drawn anew have
Var(O) = q (1 - q) / n; n_eff is the n that would give the variance seen. It can be had from one run's visits too:
for floors with exactly f N vibrating tiles thrown at random, and given the visits w,

    Var(O | w) = (1 - a - b)^2 f (1 - f) / n_v + [f b (1 - b) + (1 - f) a (1 - a)] / n,

exactly: the first part is the luck of the floor under the visits (draws without replacement), the second the sensor's.
n_v is 1 / sum w_t^2 (as many tiles as are looked at equally) with the finite number of tiles taken in. It is n on
average for n independent uniform places (1 / n_v has mean 1 / n), less where a robot's next sample falls near its last,
more where tiles are visited more evenly than by chance, and infinite when all are visited equally often: then a
perfect sensor knows the fill ratio. With the places' n_v and the sensor's n, q (1 - q) / Var(O | w) is n_eff.

How alike the bits of samples are: near each other on the floor, and one after the other; and what was lost.

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
from collections.abc import Callable
from itertools import pairwise
from typing import Any, Final, Literal

import numpy as np
import polars as pl
from numpy.typing import ArrayLike, NDArray

from vibroswarm.analysis.intervals import Interval, mean_interval
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.errors import InputError
from vibroswarm.observation.observe import vibrating_at
from vibroswarm.result import Result

WALK: Final[dict[str, Any]] = {
    "run": pl.UInt32,
    "samples": pl.UInt32,
    "avoid_per_sample_s": pl.Float64,
    "distance_m": pl.Float64,
    "spacing_s": pl.Float64,
    "ones": pl.Float64,
    "effective_samples": pl.Float64,
}
"""Columns of ``walk_figures``."""

_TABLE_PER_SAMPLE: Final = 4
"""Visits are counted in a dense table of runs by tiles up to this number of entries per sample."""


def walk_figures(
    motion_samples: pl.DataFrame, observations: pl.DataFrame, tiles: int | None = None
) -> pl.DataFrame:
    """Compute one row of sampling figures for each run; a run without samples has none.

    Args:
        motion_samples, observations: tables of a result, with the same rows.
        tiles: tiles in the arena, the N above. Without it each run takes one more than the highest tile index that
            it visited, which is N unless the last tile was never sampled.
    Returns: run, samples, avoid_per_sample_s (null where the source cannot know it), distance_m and spacing_s (mean
        over consecutive samples of a robot; null where no robot has two), ones (share of all samples),
        effective_samples (n_v of the module's head; null without samples on tiles, infinite at equal visits).
    Raises:
        ValueError: the two tables have not the same number of rows.
    """
    if motion_samples.height != observations.height:
        raise ValueError("motion and observations have not the same rows")
    tile, observation = (observations[name].to_numpy() for name in ("tile", "observation"))
    figures = Walk(motion_samples).figures(tile, observation, tiles)
    return pl.DataFrame(figures).fill_nan(None).cast(WALK)  # type: ignore[arg-type]


class Walk(NotebookView):
    """``walk_figures`` of one motion for many floors and sensors; what does not depend on these is computed once.

    Args:
        motion_samples: table of a result.
    """

    def __init__(self, motion_samples: pl.DataFrame) -> None:
        run = motion_samples["run"].to_numpy()
        self.first = np.flatnonzero(np.append(run.size > 0, run[1:] != run[:-1]))
        self.count: NDArray[np.int64] = np.diff(np.append(self.first, run.size))
        self.of_motion = {"run": run[self.first], "samples": self.count, **self._steps(motion_samples)}
        self._effective: tuple[NDArray[np.int32], int | None, NDArray[np.float64]] | None = None

    def figures(
        self, tile: NDArray[np.int32], observation: NDArray[np.uint8], tiles: int | None = None
    ) -> dict[str, NDArray[Any]]:
        """Compute the columns of ``walk_figures`` for each run with samples; nan instead of null.

        Args:
            tile, observation: (rows,), of the observation table. tiles: as ``walk_figures`` has them.
        """
        if self.first.size == 0:
            return {name: np.empty(0) for name in WALK}
        ones = np.add.reduceat(observation, self.first, dtype=np.int64) / self.count
        return {**self.of_motion, "ones": ones, "effective_samples": self._effective_of(tile, tiles)}

    def _effective_of(self, tile: NDArray[np.int32], tiles: int | None) -> NDArray[np.float64]:
        """Return n_v of each run; cached, since several sensors share a floor."""
        known = self._effective
        if known is None or known[0] is not tile or known[1] != tiles:
            with np.errstate(invalid="ignore", divide="ignore"):
                worth = _effective(tile, self.first, self.count, tiles)
            known = self._effective = (tile, tiles, worth)
        return known[2]

    def _steps(self, samples: pl.DataFrame) -> dict[str, NDArray[np.float64]]:
        """Compute the figures that depend on motion only, by run."""
        if samples.is_empty():
            return {}
        before, after = _consecutive(samples, self.first, self.count)
        x, y, t = (samples[name].to_numpy() for name in ("x_m", "y_m", "time_s"))
        per_step = _mean_of_steps(after, self.first)
        distance = np.sqrt((x[after] - x[before]) ** 2 + (y[after] - y[before]) ** 2)
        avoid = samples["avoid_s"].to_numpy().astype(np.float64)  # null: not a number
        with np.errstate(invalid="ignore", divide="ignore"):
            return {
                "avoid_per_sample_s": _mean_of_known(avoid, self.first),
                "distance_m": per_step(distance),
                "spacing_s": per_step(t[after] - t[before]),
            }


def _consecutive(
    samples: pl.DataFrame, first: NDArray[np.int64], count: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the rows of each sample and of the same robot's next, both (pairs,), ordered by run and robot.

    The rows are sorted by run and time; a stable sort by run and robot groups each robot's rows in the order of time.
    It uses 16-bit keys where these suffice, which is faster.
    """
    robot = samples["robot"].to_numpy()
    robots = int(robot.max()) + 1
    group = np.repeat(np.arange(first.size) * robots, count) + robot
    if first.size * robots < 2**16:
        group = group.astype(np.uint16)
    order = np.argsort(group, kind="stable")
    sorted_group = group[order]
    same = sorted_group[1:] == sorted_group[:-1]
    return order[:-1][same], order[1:][same]


def _mean_of_steps(
    after: NDArray[np.int64], first: NDArray[np.int64]
) -> Callable[[NDArray[np.float64]], NDArray[np.float64]]:
    """Return a function that averages the steps of each run, in the order of ``_consecutive``; nan without steps."""
    # Rows of a run stay together there, so the smallest row of a run's steps or of a later one tells where it ends.
    bounds = np.searchsorted(np.maximum.accumulate(after), np.append(first, after.max(initial=0) + 1))
    steps = np.diff(bounds)

    def mean(values: NDArray[np.float64]) -> NDArray[np.float64]:
        # Summed run by run, and nothing else with them, so that no figure depends on the runs beside it.
        means, some = np.full(steps.size, np.nan), steps > 0
        if some.any():
            means[some] = np.add.reduceat(values, bounds[:-1][some]) / steps[some]
        return means

    return mean


def _mean_of_known(values: NDArray[np.float64], first: NDArray[np.int64]) -> NDArray[np.float64]:
    """Average each run's values that are not nan, shape (runs,); nan if a run has none."""
    known = ~np.isnan(values)
    if known.all():
        return np.asarray(np.add.reduceat(values, first) / np.diff(np.append(first, values.size)))
    total = np.add.reduceat(np.where(known, values, 0.0), first)
    return np.asarray(total / np.add.reduceat(known.astype(np.int64), first))


def _effective(
    tile: NDArray[np.int32], first: NDArray[np.int64], count: NDArray[np.int64], tiles: int | None
) -> NDArray[np.float64]:
    """Compute n_v of each run, shape (runs,); nan if a run has no sample on a tile."""
    run_count, width = first.size, int(tile.max(initial=0)) + 1
    key = np.repeat(np.arange(run_count) * width, count) + tile
    if tile.min(initial=0) < 0:
        key = key[tile >= 0]
    if run_count * width <= _TABLE_PER_SAMPLE * key.size + 4096:
        visits = np.bincount(key, minlength=run_count * width).reshape(run_count, width).astype(np.float64)
        squares, on_tiles = (visits * visits).sum(axis=1), visits.sum(axis=1)
        highest = width - 1 - np.argmax(visits[:, ::-1] > 0, axis=1)
    else:
        keys, times = np.unique(key, return_counts=True)
        of_key, weights = keys // width, times.astype(np.float64)
        squares = np.bincount(of_key, weights**2, run_count)
        on_tiles = np.bincount(of_key, weights, run_count)
        highest = np.zeros(run_count, dtype=np.int64)
        highest[of_key] = keys % width  # sorted, so that the highest of a run is written last
    if tiles is None:
        return effective_samples(squares / on_tiles**2, highest + 1)
    if tiles < width:
        raise InputError(f"{tiles} tiles, but tile {width - 1} was sampled", field="tiles")
    return effective_samples(squares / on_tiles**2, tiles)


def effective_samples(sum_of_squares: ArrayLike, tiles: ArrayLike) -> NDArray[np.float64]:
    """Compute n_v from sum w_t^2 and the number of tiles, broadcasting; infinite at equal visits, nan for one tile."""
    s, number = np.asarray(sum_of_squares, dtype=np.float64), np.asarray(tiles, dtype=np.float64)
    excess = number * s - 1.0
    with np.errstate(invalid="ignore", divide="ignore"):
        worth = (number - 1.0) / np.where(np.abs(excess) < 1e-12, 0.0, excess)  # n_v
    return np.asarray(np.where(np.isnan(s), np.nan, worth))


def effective_with_sensor(
    samples: ArrayLike,
    effective_visits: ArrayLike,
    fill_ratio: float,
    false_positive: float,
    false_negative: float,
) -> NDArray[np.float64]:
    """Compute n_eff = q (1 - q) / Var(O | w) of runs with these samples and n_v, including the sensor's errors.

    Args:
        samples, effective_visits: n and n_v, shape (runs,) or one each. The three others are f, a and b, shares.
    """
    n, visits = np.asarray(samples, dtype=np.float64), np.asarray(effective_visits, dtype=np.float64)
    f, a, b = fill_ratio, false_positive, false_negative
    q = f * (1 - b) + (1 - f) * a
    with np.errstate(invalid="ignore", divide="ignore"):
        of_floor = (1 - a - b) ** 2 * f * (1 - f) / visits  # first part of Var(O | w)
        of_sensor = (f * b * (1 - b) + (1 - f) * a * (1 - a)) / n  # second part
        return np.asarray(q * (1 - q) / (of_floor + of_sensor))  # n_eff


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
    """Correlate the values of samples as a function of the distance between them.

    All pairs of a run are taken: about 20 ms per run of 1200 samples, so give some tens of runs.

    Args:
        edges_m: edges of the bins of distance, increasing, m; without it, a tenth of the shorter side of the arena.
        of: the bits that were read, or what lies below (1 where the tile vibrates): the floor without the sensor.
    Returns: from_m, to_m, pairs (mean per run), correlation, low, high (over runs); one row per bin, null without
        pairs.
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
    """Return the bit of each sample, or 1 where its tile vibrates."""
    if of == "bits":
        return result.observations["observation"].cast(pl.Float64).to_numpy()
    tile = result.observations["tile"].to_numpy()
    values = np.empty(tile.size)
    run = result.motion["run"].to_numpy()
    for low, high in _bounds(result.motion):
        values[low:high] = vibrating_at(result.floor(int(run[low])), tile[low:high])
    return values


def _bounds(samples: pl.DataFrame) -> list[tuple[int, int]]:
    """Return the first row and one past the last of each run in a table sorted by run."""
    run = samples["run"].to_numpy()
    first = np.flatnonzero(np.append(True, run[1:] != run[:-1])) if run.size else np.zeros(0, np.int64)
    return [(int(low), int(high)) for low, high in pairwise(np.append(first, run.size))]


def _of_run(
    x: NDArray[np.float64], y: NDArray[np.float64], values: NDArray[np.float64], edges: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Compute the correlation in each bin (nan without pairs or variance) and the pairs; shapes (bins,)."""
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
        return total / pairs / variance, pairs  # I(d)


def lag_one(result: Result, level: float = 0.95) -> Interval:
    """Compute the correlation of consecutive bits of a robot, over all robots of a run; its mean over runs.

    Runs without consecutive samples, or whose bits are all equal, are left out.
    """
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
    """Count the messages addressed to the robots of each run and those received; compute the share lost.

    Only messages sent at least two control periods before the receiver's last stop began count: when it took its last
    sample, each of these had been received or lost. Later ones may still have been on their way. Robots that never
    sampled are left out, and a robot's own messages are not addressed to it. Messages are counted by the numbers of
    samples, so that those whose rows a recording lost count too. If a recording does not contain what was received in
    a run, ``heard`` and ``packet_loss`` are null; ``packet_loss`` is also null if no message counts.
    """
    tick_s = result.scenario.tick_s
    tick = np.rint(result.motion["time_s"].to_numpy() / tick_s).astype(np.int64)
    last = (
        result.motion.with_columns(heard=result.inference["messages_received"])
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
    unknown = pl.col("heard").is_null().any()
    table = counted.group_by("run", maintain_order=True).agg(
        pl.col("addressed").sum(), pl.when(~unknown).then(pl.col("heard").sum()).alias("heard")
    )
    loss = pl.when(pl.col("addressed") > 0).then(1.0 - pl.col("heard") / pl.col("addressed"))
    return table.with_columns(packet_loss=loss).select(list(EXCHANGE)).cast(EXCHANGE)  # type: ignore[arg-type]
