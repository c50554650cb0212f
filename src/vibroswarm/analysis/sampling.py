"""How a swarm samples: how far apart, how often, how evenly, and how many independent samples that is worth.

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
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import ArrayLike, NDArray

from vibroswarm.errors import InputError

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
"""Visits are counted in a table of runs by tiles while that has at most so many fields a sample."""


def walk_figures(
    motion_samples: pl.DataFrame, observations: pl.DataFrame, tiles: int | None = None
) -> pl.DataFrame:
    """One row a run of how its robots sampled; a run in which nobody sampled has none.

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


class Walk:
    """``walk_figures`` of one motion for many floors and sensors: what does not depend on those is worked out once.

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
        """The columns of ``walk_figures``, a value a run that has samples; not a number in place of null.

        Args:
            tile, observation: (rows,), of the observation table. tiles: as ``walk_figures`` has them.
        """
        if self.first.size == 0:
            return {name: np.empty(0) for name in WALK}
        ones = np.add.reduceat(observation, self.first, dtype=np.int64) / self.count
        return {**self.of_motion, "ones": ones, "effective_samples": self._effective_of(tile, tiles)}

    def _effective_of(self, tile: NDArray[np.int32], tiles: int | None) -> NDArray[np.float64]:
        known = self._effective
        if known is None or known[0] is not tile or known[1] != tiles:
            with np.errstate(invalid="ignore", divide="ignore"):
                worth = _effective(tile, self.first, self.count, tiles)
            known = self._effective = (tile, tiles, worth)
        return known[2]

    def _steps(self, samples: pl.DataFrame) -> dict[str, NDArray[np.float64]]:
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
    """Rows of each sample and of the same robot's next, both of shape (pairs,), ordered by run and robot.

    Rows are brought together by robot with a sort on 16 bits (which costs little) of rows that are sorted by run and
    time already.
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
    """Means over the steps of each run, from values in the order of ``_consecutive``; nan without steps."""
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
    """Mean of each run's values that are numbers, shape (runs,)."""
    known = ~np.isnan(values)
    if known.all():
        return np.asarray(np.add.reduceat(values, first) / np.diff(np.append(first, values.size)))
    total = np.add.reduceat(np.where(known, values, 0.0), first)
    return np.asarray(total / np.add.reduceat(known.astype(np.int64), first))


def _effective(
    tile: NDArray[np.int32], first: NDArray[np.int64], count: NDArray[np.int64], tiles: int | None
) -> NDArray[np.float64]:
    """n_v of each run, shape (runs,)."""
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
    """n_v from sum w_t^2 and the number of tiles, shape as they broadcast; nan for a floor of one tile."""
    s, number = np.asarray(sum_of_squares, dtype=np.float64), np.asarray(tiles, dtype=np.float64)
    excess = number * s - 1.0
    with np.errstate(invalid="ignore", divide="ignore"):
        worth = (number - 1.0) / np.where(np.abs(excess) < 1e-12, 0.0, excess)
    return np.asarray(np.where(np.isnan(s), np.nan, worth))


def effective_with_sensor(
    samples: ArrayLike,
    effective_visits: ArrayLike,
    fill_ratio: float,
    false_positive: float,
    false_negative: float,
) -> NDArray[np.float64]:
    """q (1 - q) / Var(O | w): n_eff of runs with these samples and n_v, the sensor's errors taken in.

    Args:
        samples, effective_visits: n and n_v, shape (runs,) or one each. The three others are f, a and b, shares.
    """
    n, visits = np.asarray(samples, dtype=np.float64), np.asarray(effective_visits, dtype=np.float64)
    f, a, b = fill_ratio, false_positive, false_negative
    q = f * (1 - b) + (1 - f) * a
    with np.errstate(invalid="ignore", divide="ignore"):
        of_floor = (1 - a - b) ** 2 * f * (1 - f) / visits
        of_sensor = (f * b * (1 - b) + (1 - f) * a * (1 - a)) / n
        return np.asarray(q * (1 - q) / (of_floor + of_sensor))
