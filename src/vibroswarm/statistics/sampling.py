"""Describe how a swarm samples: distances, intervals, effective number of samples, packet loss.

| name | symbol | equation |
|---|---|---|
| samples of a run on tiles | n | samples off all tiles do not count in effective samples |
| share of a run's samples on tile t | w_t | their sum over t is 1 |
| number of tiles, fill ratio | N, f | - |
| false positive, false negative | a, b | P(a still tile reads as 1), P(a vibrating tile reads as 0) |
| share of ones expected, of a run | q, O | f (1 - b) + (1 - f) a; over its samples |
| effective samples, over runs | n_eff | q (1 - q) / Var(O), over runs that each have a new random floor |
| effective samples, of visits | n_v | (N - 1) / (N sum w_t^2 - 1) |
| packet loss | - | 1 - heard / addressed |

n samples at independent, uniformly random places of new random floors have Var(O) = q (1 - q) / n. For random floors
with exactly f N vibrating tiles, and given the visits w, exactly

    Var(O | w) = (1 - a - b)^2 f (1 - f) / n_v + [f b (1 - b) + (1 - f) a (1 - a)] / n:

the variance between floors (tiles are drawn without replacement), and that of sensor errors. n_v is smaller if a
robot's next sample lies near its last, and larger if tiles are visited more evenly than by chance.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import ArrayLike, NDArray

from vibroswarm.core.numbers import percent
from vibroswarm.inference.outcomes import SHARES, SPENT, mean_by_run
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


def walk_figures(
    motion_samples: pl.DataFrame, observations: pl.DataFrame, tiles: int | None = None
) -> pl.DataFrame:
    """Compute one row of sampling figures for each run that has samples; null if not known.

    Args:
        motion_samples, observations: tables of a result, with the same rows, sorted by run and time.
        tiles: N, the number of tiles in the arena; None: the highest index of a tile that the run visited + 1.
    Returns: run; samples; avoid_per_sample_s, mean time spent avoiding per sample; distance_m and spacing_s, mean
        distance and time between consecutive samples of a robot; ones, share of readings of class 1; effective_samples,
        n_v (infinite at equal visits); shares of the robots' time up to their last samples (``outcomes.SHARES``).
    """
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
    """Compute ``walk_figures`` of one motion for many floors and sensors; what is of motion alone is computed once."""

    def __init__(self, motion_samples: pl.DataFrame) -> None:
        run = motion_samples["run"].to_numpy()
        # A run starts at row 0, if the table has rows, and wherever the run number changes.
        self.first = np.flatnonzero(np.append(run.size > 0, run[1:] != run[:-1]))
        self.count: NDArray[np.int64] = np.diff(np.append(self.first, run.size))
        avoid = motion_samples["avoid_s"].to_numpy().astype(np.float64)  # null becomes nan
        self.of_motion = {
            "run": run[self.first],
            "samples": self.count,
            "avoid_per_sample_s": mean_by_run(avoid, self.first),
            **self._steps(motion_samples),
        }

    def figures(
        self, tile: NDArray[np.int32], observation: NDArray[np.uint8], tiles: int | None = None
    ) -> dict[str, NDArray[Any]]:
        """Compute the columns of ``walk_figures`` for one floor and sensor, with nan in place of null."""
        if self.first.size == 0:
            return {name: np.empty(0) for name in WALK}
        ones = np.add.reduceat(observation == 1, self.first, dtype=np.int64) / self.count
        return {**self.of_motion, "ones": ones, "effective_samples": self._effective(tile, tiles)}

    def _effective(self, tile: NDArray[np.int32], tiles: int | None) -> NDArray[np.float64]:
        """Return n_v of each run, (runs,); nan if a run has no sample on a tile."""
        runs, width = self.first.size, int(tile.max(initial=0)) + 1
        key = np.repeat(np.arange(runs) * width, self.count) + tile  # one number for each run and tile
        visits = np.bincount(key[tile >= 0], minlength=runs * width).reshape(runs, width).astype(np.float64)
        with np.errstate(invalid="ignore"):  # 0 / 0 for a run without samples on tiles
            sum_of_squares = (visits * visits).sum(axis=1) / visits.sum(axis=1) ** 2
        if tiles is None:  # argmax finds the first visit in the reversed row
            return effective_samples(sum_of_squares, width - np.argmax(visits[:, ::-1] > 0, axis=1))
        return effective_samples(sum_of_squares, tiles)

    def _steps(self, samples: pl.DataFrame) -> dict[str, NDArray[np.float64]]:
        """Return mean distance and time between consecutive samples of a robot, (runs,) each; nan without any."""
        robot = samples["robot"].to_numpy()
        run = np.repeat(np.arange(self.first.size), self.count)
        group = run * (int(robot.max(initial=0)) + 1) + robot  # one number for each run and robot
        order = np.argsort(group, kind="stable")  # rows of a robot stay in the order of time
        same_robot = group[order][1:] == group[order][:-1]
        before, after = order[:-1][same_robot], order[1:][same_robot]
        steps = np.bincount(run[after], minlength=self.first.size)
        has_steps = steps > 0
        begin = (np.cumsum(steps) - steps)[has_steps]
        x, y, t = (samples[name].to_numpy() for name in ("x_m", "y_m", "time_s"))
        distance = np.sqrt((x[after] - x[before]) ** 2 + (y[after] - y[before]) ** 2)
        means = {}
        for name, values in (("distance_m", distance), ("spacing_s", t[after] - t[before])):
            means[name] = np.full(steps.size, np.nan)
            # Each run is summed by itself, so that its figure does not depend on other runs.
            means[name][has_steps] = np.add.reduceat(values, begin) / steps[has_steps] if begin.size else 0.0
        return means | self._shares(samples)

    def _shares(self, samples: pl.DataFrame) -> dict[str, NDArray[np.float64]]:
        """Return the shares of the robots' time (``outcomes.SHARES``), (runs,) each."""
        spent = {
            column: np.add.reduceat(samples[column].to_numpy().astype(np.float64), self.first)
            for column in SPENT.values()
        }
        passed = spent["drive_s"] + spent["turn_s"] + spent["avoid_s"] + spent["stop_s"]
        return {name: spent[column] / passed for name, column in SPENT.items()}


def effective_samples(sum_of_squares: ArrayLike, tiles: ArrayLike) -> NDArray[np.float64]:
    """Compute n_v from the sum of w_t^2 and N; infinite at equal visits, nan for one tile or without visits."""
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


SWITCHED_ON_LATE_S: Final = 60.0
"""A robot of a recording may have been switched on late if its first sample is this much later than another's."""


def packet_loss(result: Result) -> pl.DataFrame:
    """Count the messages addressed to, and received by, the robots of each run; compute the share that was lost.

    Each robot is taken to broadcast one message per sample, which arrives one control period later or not at all; so
    the share includes robots out of range, and means nothing for strategies that send at other times. Robots read
    messages only while they walk. So those sent at least two control periods before the receiver's last stop count as
    addressed to it; for robots that may have been switched on late, those since their first sample. Messages are
    counted by the index of samples, since a recording may lack rows.
    """
    tick_s = result.scenario.tick_s
    tick = np.rint(result.motion["time_s"].to_numpy() / tick_s).astype(np.int64)
    # One row per robot of each run: its last sample. ``messages_received`` counts from the start of the run, so the
    # last value is the robot's total, unless counting begins at its first sample.
    by_robot = result.motion.with_columns(
        heard=result.inference["messages_received"].cast(pl.Int64)
    ).group_by("run", "robot", maintain_order=True)
    last = by_robot.last()
    # A log does not say when robots were switched on; robots of a simulation hear from the start.
    after_s = pl.col("time_s") - pl.col("time_s").min().over("run")
    is_late = after_s > (SWITCHED_ON_LATE_S if result.seed is None else math.inf)
    begin = by_robot.first().filter(is_late)
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
    counts = pl.col("addressed", "heard").cast(pl.UInt32)
    return table.select("run", counts, packet_loss=loss)
