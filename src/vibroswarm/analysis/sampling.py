"""Describe how a swarm samples: distances, intervals, effective number of samples, correlations, packet loss.

A bit is the 0 or 1 that a sample reads.

| name | symbol | equation |
|---|---|---|
| samples of a run on tiles | n | samples off all tiles do not count in effective samples |
| share of a run's samples on tile t | w_t | their sum over t is 1 |
| number of tiles, fill ratio | N, f | - |
| false positive, false negative | a, b | P(a still tile reads as 1), P(a vibrating tile reads as 0) |
| share of ones expected | q | f (1 - b) + (1 - f) a |
| share of ones of a run | O | over its samples |
| effective samples, over runs | n_eff | q (1 - q) / Var(O), over runs that each have a new random floor |
| effective samples, of visits | n_v | (N - 1) / (N sum w_t^2 - 1) |

**Effective samples.** n samples at independent, uniformly random places of new random floors have
Var(O) = q (1 - q) / n. n_eff is the n that would give the observed variance. It can also be computed from the visits of
a single run. For random floors with exactly f N vibrating tiles, and given the visits w, exactly

    Var(O | w) = (1 - a - b)^2 f (1 - f) / n_v + [f b (1 - b) + (1 - f) a (1 - a)] / n.

The first term is the variance between floors (tiles are drawn without replacement), the second that of sensor errors.
n_eff is then q (1 - q) / Var(O | w).

n_v is 1 / sum w_t^2, corrected for the finite number of tiles; 1 / sum w_t^2 is the number of tiles which, visited
equally often, would give this sum. For n independent uniform places 1 / n_v has the mean 1 / n. n_v is smaller if a
robot's next sample lies near its last, and larger if tiles are visited more evenly than by chance. It is infinite if
all tiles are visited equally often: then the samples of a perfect sensor give the fill ratio exactly.

**Correlations and losses.**

| name | symbol | equation |
|---|---|---|
| correlogram | I(d) | mean over pairs at distance d of (o_i - m)(o_j - m), divided by the mean of (o_i - m)^2 |
| lag-1 correlation | r | the same over pairs of consecutive samples of one robot |
| packet loss | - | 1 - heard / addressed |

o_i is the bit of sample i and m the mean of the run's bits; of more than two classes, products and squares of r are
summed over the indicators of all classes, which is the same for two. Since m comes from the same bits, I is about
-1 / (samples - 1) without any correlation. Both samples of a pair are of one run, of the same or different robots; I
is Moran's I with the pairs at that distance as neighbours. The run is the unit: figures are computed for each run and
averaged.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from typing import Any, Final, Literal

import numpy as np
import polars as pl
from numpy.typing import ArrayLike, NDArray

from vibroswarm.analysis.intervals import Interval, mean_interval, within
from vibroswarm.core.numbers import percent
from vibroswarm.errors import InputError, check_choice
from vibroswarm.inference.outcomes import SHARES, SPENT, mean_by_run
from vibroswarm.observation.observe import kinds_at
from vibroswarm.result import Result

WALK: Final[dict[str, Any]] = {
    "run": pl.UInt32,
    "samples": pl.UInt32,
    "avoid_per_sample_s": pl.Float64,
    "distance_m": pl.Float64,
    "spacing_s": pl.Float64,
    "ones": pl.Float64,
    "effective_samples": pl.Float64,
    **SHARES,
}
"""Columns of ``walk_figures``."""

_TABLE_PER_SAMPLE: Final = 4
"""Visits are counted in a dense table of runs by tiles up to this number of entries per sample."""
_SMALL_TABLE: Final = 4096
"""Entries of the dense table that are allowed in addition, however few samples there are."""


def walk_figures(
    motion_samples: pl.DataFrame, observations: pl.DataFrame, tiles: int | None = None
) -> pl.DataFrame:
    """Compute one row of sampling figures for each run that has samples.

    Args:
        motion_samples, observations: tables of a result, with the same rows, sorted by run and time.
        tiles: N, the number of tiles in the arena. By default each run takes the highest index of a visited tile + 1,
            which is N unless the last tile was never sampled.
    Returns: run; samples; avoid_per_sample_s, mean time spent avoiding per sample (null if the source cannot know it);
        distance_m and spacing_s, mean distance and time between consecutive samples of a robot (null if no robot has
        two); ones, share of readings of class 1; effective_samples, n_v (null without samples on tiles, infinite if
        all tiles are visited equally often); the shares of the robots' time up to their last samples
        (``outcomes.SHARES``; null if the source cannot know them).
    Raises:
        ValueError: the two tables have different numbers of rows.
        InputError: ``tiles`` is smaller than an index of a visited tile + 1.
    """
    if motion_samples.height != observations.height:
        raise ValueError("the tables of motion and of observations must have the same rows")
    tile, observation = (observations[name].to_numpy() for name in ("tile", "observation"))
    figures = Walk(motion_samples).figures(tile, observation, tiles)
    return pl.DataFrame(figures).fill_nan(None).cast(WALK)  # type: ignore[arg-type]


BLOCKED: Final = 0.1
"""Share of the time from which commands warn that robots are blocked."""


def blocked_words(share: float | None) -> str:
    """Write that robots were blocked for this share of their time; empty below ``BLOCKED``, and if it is not known."""
    if share is None or not share >= BLOCKED:
        return ""
    return (
        f"robots were blocked for {percent(share)} of the time: they drove against a wall or another robot that their "
        "rays did not see."
    )


class Walk:
    """Compute ``walk_figures`` of one motion for many floors and sensors; figures of motion alone are computed once.

    ``first`` is the index of each run's first row, ``count`` its number of rows, (runs,) each.

    Args:
        motion_samples: table of a result, sorted by run and time.
    """

    def __init__(self, motion_samples: pl.DataFrame) -> None:
        run = motion_samples["run"].to_numpy()
        # A run starts at row 0, if the table has rows, and wherever the run number changes.
        self.first = np.flatnonzero(np.append(run.size > 0, run[1:] != run[:-1]))
        self.count: NDArray[np.int64] = np.diff(np.append(self.first, run.size))
        # The columns that depend on motion only.
        self.of_motion = {"run": run[self.first], "samples": self.count, **self._steps(motion_samples)}
        # Cache of the last call: the arguments tile and tiles, and n_v of each run.
        self._effective: tuple[NDArray[np.int32], int | None, NDArray[np.float64]] | None = None

    def figures(
        self, tile: NDArray[np.int32], observation: NDArray[np.uint8], tiles: int | None = None
    ) -> dict[str, NDArray[Any]]:
        """Compute the columns of ``walk_figures`` for one floor and sensor, with nan in place of null.

        Args:
            tile, observation: columns of the table of observations, (rows,) each. tiles: number of tiles in the arena;
                None: for each run the highest index of a visited tile + 1.
        Raises:
            InputError: ``tiles`` is smaller than an index of a visited tile + 1.
        """
        if self.first.size == 0:
            return {name: np.empty(0) for name in WALK}
        ones = np.add.reduceat(observation == 1, self.first, dtype=np.int64) / self.count
        return {**self.of_motion, "ones": ones, "effective_samples": self._effective_of(tile, tiles)}

    def _effective_of(self, tile: NDArray[np.int32], tiles: int | None) -> NDArray[np.float64]:
        """Return n_v of each run, (runs,).

        The last result is cached: callers compute several sensors on one floor and pass the same array ``tile`` each
        time, so an identity test recognises it.
        """
        cached = self._effective
        if cached is None or cached[0] is not tile or cached[1] != tiles:
            # A run without samples on tiles divides 0 by 0.
            with np.errstate(invalid="ignore", divide="ignore"):
                n_v = _effective(tile, self.first, self.count, tiles)
            cached = self._effective = (tile, tiles, n_v)
        return cached[2]

    def _steps(self, samples: pl.DataFrame) -> dict[str, NDArray[np.float64]]:
        """Compute the columns of ``walk_figures`` that need places and times of samples, (runs,) each."""
        if samples.is_empty():  # ``figures`` then returns empty columns, and ``_consecutive`` needs a row
            return {}
        before, after = _consecutive(samples, self.first, self.count)
        x, y, t = (samples[name].to_numpy() for name in ("x_m", "y_m", "time_s"))
        per_step = _mean_of_steps(after, self.first)
        spent = {
            column: np.add.reduceat(samples[column].to_numpy().astype(np.float64), self.first)
            for column in SPENT.values()
        }
        passed = spent["drive_s"] + spent["turn_s"] + spent["avoid_s"] + spent["stop_s"]
        distance = np.sqrt((x[after] - x[before]) ** 2 + (y[after] - y[before]) ** 2)
        avoid = samples["avoid_s"].to_numpy().astype(np.float64)  # null becomes nan
        return {
            "avoid_per_sample_s": mean_by_run(avoid, self.first),
            "distance_m": per_step(distance),
            "spacing_s": per_step(t[after] - t[before]),
            **{name: spent[column] / passed for name, column in SPENT.items()},
        }


def _consecutive(
    samples: pl.DataFrame, first: NDArray[np.int64], count: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return all pairs of consecutive samples of a robot as row indices (before, after), (pairs,) each.

    Pairs are ordered by run, robot and time. Rows are sorted by run and time, so a stable sort by run and robot groups
    each robot's rows in the order of time.

    Args:
        samples: at least one row. first, count: first row of each run and number of its rows, (runs,) each.
    """
    robot = samples["robot"].to_numpy()
    robots = int(robot.max()) + 1
    group = np.repeat(np.arange(first.size) * robots, count) + robot  # one number for each run and robot
    if first.size * robots < 2**16:
        group = group.astype(np.uint16)  # numpy sorts these faster
    order = np.argsort(group, kind="stable")
    sorted_group = group[order]
    same_robot = sorted_group[1:] == sorted_group[:-1]
    return order[:-1][same_robot], order[1:][same_robot]


def _mean_of_steps(
    after: NDArray[np.int64], first: NDArray[np.int64]
) -> Callable[[NDArray[np.float64]], NDArray[np.float64]]:
    """Return a function that averages values of steps over each run; nan for a run without steps.

    A step is a pair of consecutive samples of a robot. The function takes an array with one value per step, in the
    order of ``after``, and returns the means, (runs,).

    Args:
        after: row of the later sample of each step, from ``_consecutive``. first: first row of each run, (runs,).
    """
    # bounds[r]: index of the first step of run r; the last bound is the number of steps. Rows and steps are ordered by
    # run, so this is the first step whose ``after`` is first[r], the first row of run r, or higher. Within a run steps
    # are ordered by robot, so ``after`` is not sorted; the search is therefore in its running maximum. A run without
    # steps has the same bound as the next run. The appended row is higher than all of ``after``, which gives the last
    # bound.
    bounds = np.searchsorted(np.maximum.accumulate(after), np.append(first, after.max(initial=0) + 1))
    steps = np.diff(bounds)

    def mean(values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Average one value per step over each run, (runs,)."""
        # Each run is summed by itself (no running sum over runs), so that its figure does not depend on other runs.
        means, has_steps = np.full(steps.size, np.nan), steps > 0
        if has_steps.any():
            means[has_steps] = np.add.reduceat(values, bounds[:-1][has_steps]) / steps[has_steps]
        return means

    return mean


def _effective(
    tile: NDArray[np.int32], first: NDArray[np.int64], count: NDArray[np.int64], tiles: int | None
) -> NDArray[np.float64]:
    """Compute n_v of each run, shape (runs,); nan if a run has no sample on a tile.

    Args:
        tile: index of each sample's tile, -1 off all tiles, (rows,). first, count: first row of each run and number of
            its rows, (runs,) each. tiles: N; None: for each run the highest index of a visited tile + 1.
    """
    # In all runs the indices of tiles are below ``width``.
    run_count, width = first.size, int(tile.max(initial=0)) + 1
    key = np.repeat(np.arange(run_count) * width, count) + tile  # one number for each run and tile
    if tile.min(initial=0) < 0:  # the key of tile -1 would be that of the last tile of the run before
        key = key[tile >= 0]
    # Visits are counted in a dense table of runs by tiles; if it would be mostly empty, only visited tiles are listed.
    if run_count * width <= _TABLE_PER_SAMPLE * key.size + _SMALL_TABLE:
        visits = np.bincount(key, minlength=run_count * width).reshape(run_count, width).astype(np.float64)
        squares, on_tiles = (visits * visits).sum(axis=1), visits.sum(axis=1)
        # Index of the last tile with a visit: argmax finds the first visit in the reversed row.
        last_visited = width - 1 - np.argmax(visits[:, ::-1] > 0, axis=1)
    else:
        keys, times = np.unique(key, return_counts=True)
        run_of_key, visits_of_key = keys // width, times.astype(np.float64)
        squares = np.bincount(run_of_key, visits_of_key**2, run_count)
        on_tiles = np.bincount(run_of_key, visits_of_key, run_count)
        last_visited = np.zeros(run_count, dtype=np.int64)
        # Keys are sorted, so the last visited tile of a run is written last, and stays.
        last_visited[run_of_key] = keys % width
    # Sum of w_t^2. It is nan (0 / 0) for a run without samples on tiles, so that ``last_visited`` has no effect there.
    sum_of_squares = squares / on_tiles**2
    if tiles is None:
        return effective_samples(sum_of_squares, last_visited + 1)
    if tiles < width:
        raise InputError(
            f"{tiles} is too few, since tile {width - 1} was sampled; at least {width}", field="tiles"
        )
    return effective_samples(sum_of_squares, tiles)


def effective_samples(sum_of_squares: ArrayLike, tiles: ArrayLike) -> NDArray[np.float64]:
    """Compute n_v, the effective number of samples, from how evenly the tiles were visited.

    It is infinite if all tiles are visited equally often, and nan for a single tile or without visits.

    Args:
        sum_of_squares: sum of w_t^2 over tiles, w_t the share of a run's samples on tile t; nan without visits.
        tiles: N, the number of tiles. The two arguments broadcast.
    """
    s, number = np.asarray(sum_of_squares, dtype=np.float64), np.asarray(tiles, dtype=np.float64)
    excess = number * s - 1.0  # 0 at equal visits, but for rounding
    with np.errstate(invalid="ignore", divide="ignore"):
        n_v = (number - 1.0) / np.where(np.abs(excess) < 1e-12, 0.0, excess)
    return np.asarray(np.where(np.isnan(s), np.nan, n_v))


def effective_with_sensor(
    samples: ArrayLike,
    effective_visits: ArrayLike,
    fill_ratio: float,
    false_positive: float,
    false_negative: float,
) -> NDArray[np.float64]:
    """Compute n_eff = q (1 - q) / Var(O | w), the effective samples of runs including the sensor's errors.

    Args:
        samples: n, number of samples on tiles. effective_visits: n_v, from ``effective_samples``; each is an array
            (runs,) or a number. fill_ratio: f.
        false_positive, false_negative: a and b, the error rates of the sensor.
    Returns: n_eff of each run, or of the one run; nan if n_v is nan, or if all samples must read the same (q is 0 or
        1); infinite for a sensor without errors and an infinite n_v.
    """
    n, visits = np.asarray(samples, dtype=np.float64), np.asarray(effective_visits, dtype=np.float64)
    f, a, b = fill_ratio, false_positive, false_negative
    q = f * (1 - b) + (1 - f) * a
    with np.errstate(invalid="ignore", divide="ignore"):
        of_floor = (1 - a - b) ** 2 * f * (1 - f) / visits  # first part of Var(O | w)
        of_sensor = (f * b * (1 - b) + (1 - f) * a * (1 - a)) / n  # second part
        return np.asarray(q * (1 - q) / (of_floor + of_sensor))  # n_eff


Of = Literal["bits", "tiles"]
"""Which values of samples are correlated: what they read, or whether the tile below vibrates."""

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
    """Compute the correlogram I(d): the correlation of the values of two samples by the distance between them.

    All pairs of samples of a run are used. That takes about 20 ms per run of 1200 samples, so some tens of runs take a
    second.

    Args:
        result: whose samples are correlated.
        edges_m: edges of the bins of distance, increasing, m; by default 10 bins up to the shorter side of the arena.
        of: "bits": the values that were read; "tiles": 1 if the tile below vibrates, else 0, without sensor errors.
        level: confidence level of the limits.
    Returns: one row per bin: from_m (included), to_m (excluded), pairs (mean number per run), correlation (mean over
        runs), low, high (its limits). A run has a correlation in a bin if it has pairs in it and its values are not all
        equal. The last three columns are null if no run has one, and low and high are null if only one run has.
    Raises:
        InputError: fewer than two edges, edges that do not increase, another ``of``, or a level outside (0, 1).
    """
    check_choice(of, "of", ("bits", "tiles"))
    arena = result.scenario.arena
    side_m = min(arena.width_m, arena.height_m)
    edges = np.linspace(0.0, side_m, 11) if edges_m is None else np.asarray(edges_m, dtype=np.float64)
    if edges.ndim != 1 or edges.size < 2 or not (np.diff(edges) > 0).all():
        raise InputError("give at least two distances that increase", field="edges_m")
    x, y = result.motion["x_m"].to_numpy(), result.motion["y_m"].to_numpy()
    values = _values(result, of)
    by_run = [
        _correlogram_of_run(x[low:high], y[low:high], values[low:high], edges)
        for low, high in _bounds(result.motion)
    ]
    rows = []
    for k, (from_m, to_m) in enumerate(pairwise(edges.tolist())):  # bin by bin
        interval = mean_interval([correlation[k] for correlation, _ in by_run], level)
        pairs = float(np.mean([number[k] for _, number in by_run])) if by_run else 0.0
        rows.append((from_m, to_m, pairs, *interval[:3]))
    names = ("from_m", "to_m", "pairs", "correlation", "low", "high")
    frame = pl.DataFrame(rows, schema=dict.fromkeys(names, pl.Float64), orient="row")
    null_unless_finite = [pl.when(pl.col(name).is_finite()).then(pl.col(name)).alias(name) for name in names]
    return frame.with_columns(null_unless_finite)


def _values(result: Result, of: Of) -> NDArray[np.float64]:
    """Return the value of each sample, (samples,): its bit, or for "tiles" 1 if its tile vibrates, else 0."""
    if of == "bits":
        return result.observations["observation"].cast(pl.Float64).to_numpy()
    tile = result.observations["tile"].to_numpy()
    values = np.empty(tile.size)
    run, time_s = result.motion["run"].to_numpy(), result.motion["time_s"].to_numpy()
    for low, high in _bounds(result.motion):
        values[low:high] = kinds_at(result.floor(int(run[low])), tile[low:high], time_s[low:high]) == 1
    return values


def _bounds(samples: pl.DataFrame) -> list[tuple[int, int]]:
    """Return (first row, last row + 1) of each run in a table sorted by run."""
    run = samples["run"].to_numpy()
    first = np.flatnonzero(np.append(True, run[1:] != run[:-1])) if run.size else np.zeros(0, np.int64)
    return [(int(low), int(high)) for low, high in pairwise(np.append(first, run.size))]


def _correlogram_of_run(
    x: NDArray[np.float64], y: NDArray[np.float64], values: NDArray[np.float64], edges: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Compute the correlation I(d) and the number of pairs in each bin of distance of one run.

    Args:
        x, y: places of the samples, m. values: of the samples; (samples,) each. edges: of the bins, m, (bins + 1,).
    Returns: correlations (nan in a bin without pairs, or if all values are equal) and numbers of pairs, (bins,) each.
    """
    total, pairs = np.zeros(edges.size - 1), np.zeros(edges.size - 1, dtype=np.int64)
    deviation = values - values.mean()
    for i in range(values.size - 1):  # sample i with all later samples, so that each pair counts once
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
    """Compute the correlation of what consecutive samples of a robot read (lag-1 correlation), averaged over runs.

    The pairs of all robots of a run count together. Runs without consecutive samples, and runs whose readings are all
    equal, are left out; the interval is undefined (nan) if no run is left.
    """
    ordered = result.observations.sort("run", "robot", "sample")
    # A number that is the same in all rows of one robot in one run.
    robot = ordered.select(pl.struct("run", "robot").rle_id()).to_series().to_numpy()
    readings = result.scenario.sensor.readings
    classes = np.arange(readings) if readings > 2 else np.ones(1)
    correlations = []
    for low, high in _bounds(ordered):
        read = ordered["observation"][low:high].to_numpy()[:, None] == classes
        deviation = read - read.mean(axis=0)
        same_robot = robot[low + 1 : high] == robot[low : high - 1]
        products = (deviation[1:] * deviation[:-1]).sum(axis=1)[same_robot]
        variance = float((deviation**2).sum(axis=1).mean())
        correlations.append(float(products.mean()) / variance if products.size and variance > 0 else math.nan)
    return within(mean_interval(correlations, level), -1.0, 1.0)


SWITCHED_ON_LATE_S: Final = 60.0
"""A robot of a recording may have been switched on late if its first sample is this much later than another's."""


def late_robots(result: Result) -> pl.DataFrame:
    """Return which robots of a recording may have been switched on late, by their first samples.

    A log does not say when robots were switched on. Before its first sample such a robot may have missed messages just
    because it was off. Robots of a simulation hear from the start, however late they first sample.

    Returns: run and robot of each.
    """
    first = result.motion.group_by("run", "robot").agg(pl.col("time_s").min())
    after_s = pl.col("time_s") - pl.col("time_s").min().over("run")
    return first.filter(after_s > (SWITCHED_ON_LATE_S if result.seed is None else math.inf)).select(
        "run", "robot"
    )


def packet_loss(result: Result) -> pl.DataFrame:
    """Count the messages addressed to, and received by, the robots of each run; compute the share that was lost.

    Each robot is taken to broadcast one message per sample, which arrives one control period later or not at all. So
    the share includes robots out of range, and is not meaningful for strategies that send at other times or for
    networks that delay messages. Robots read messages only while they walk: for the last time one control period before
    a stop, when they read messages sent at least one period earlier. So of the other robots' messages, those sent at
    least two control periods before the receiver's last stop began are counted as addressed to it: it had read each of
    these by its last sample, unless the message was lost. Robots without samples do not count, and of robots that may
    have been switched on late (``late_robots``) only the messages since their first sample.

    A recording may lack rows of samples whose messages were sent nevertheless. So messages are counted by the index
    ``sample`` of a robot's samples, not by rows.

    Returns: one row per run that has samples, in the columns ``EXCHANGE``. heard and packet_loss are null if a
        recording does not contain the number of received messages; packet_loss is also null if no message was
        addressed.
    """
    tick_s = result.scenario.tick_s
    tick = np.rint(result.motion["time_s"].to_numpy() / tick_s).astype(np.int64)
    # One row per robot of each run: its last sample. ``messages_received`` counts from the start of the run, so the
    # last value is the robot's total, unless counting begins at its first sample.
    by_robot = result.motion.with_columns(
        heard=result.inference["messages_received"].cast(pl.Int64)
    ).group_by("run", "robot", maintain_order=True)
    last = by_robot.last()
    begin = by_robot.first().join(late_robots(result), on=["run", "robot"], how="semi")
    begin = last.select("run", "robot").join(begin, on=["run", "robot"], how="left", maintain_order="left")

    def last_tick_counted(stop_start_s: pl.Series) -> NDArray[np.int64]:
        return np.maximum(np.rint(stop_start_s.to_numpy() / tick_s).astype(np.int64) - 2, -1)

    # One clock for all runs, in which each run has ``span`` ticks, so that one search serves all runs. A last counted
    # tick below 0 (a stop in the first ticks) is replaced by -1. No sample has this tick: the clock has 2 ticks between
    # the last possible sample of a run and the next run's tick 0.
    span = int(max(tick.max(initial=0), 0)) + 3
    clock = result.motion["run"].to_numpy().astype(np.int64) * span + tick
    run_start = last["run"].to_numpy().astype(np.int64) * span
    # Messages that each row stands for: 1, and more after rows that were lost. A robot's first sample has index 0.
    index = pl.col("sample").cast(pl.Int64)
    messages = index - index.shift(1).over("run", "robot").fill_null(-1)
    sent_before = np.append(0, np.cumsum(result.motion.select(messages).to_series().to_numpy()))
    # Messages of all robots of the run from its start, or from where counting begins, to the last counted tick.
    sent = sent_before[
        np.searchsorted(clock, run_start + last_tick_counted(last["stop_start_s"]), side="right")
    ]
    begun = last_tick_counted(begin["stop_start_s"].fill_null(0.0))
    sent -= sent_before[np.searchsorted(clock, run_start + begun, side="right")]
    # Among them are the receiver's own messages, one for each sample before its last; the index of the last sample is
    # the number of these.
    own = last["sample"].to_numpy().astype(np.int64)
    # If rows just before the last sample were lost, their messages count with the last sample, which is too late for
    # ``sent`` but not for ``own``. So the difference may be negative.
    is_unknown = begin["stop_start_s"].is_not_null() & begin["heard"].is_null()
    heard = (last["heard"] - begin["heard"].fill_null(0)).set(is_unknown, None)
    counted = last.select("run", heard=heard).with_columns(addressed=pl.Series(np.maximum(sent - own, 0)))
    unknown = pl.col("heard").is_null().any()
    table = counted.group_by("run", maintain_order=True).agg(
        pl.col("addressed").sum(), pl.when(~unknown).then(pl.col("heard").sum()).alias("heard")
    )
    loss = pl.when(pl.col("addressed") > 0).then(1.0 - pl.col("heard") / pl.col("addressed"))
    return table.with_columns(packet_loss=loss).select(list(EXCHANGE)).cast(EXCHANGE)  # type: ignore[arg-type]
