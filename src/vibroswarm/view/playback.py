"""What is where at a time: poses of robots, beliefs and samples of one run, from the tables of a result."""

from __future__ import annotations

from typing import Final

import numpy as np
import polars as pl
from numpy.typing import ArrayLike, NDArray

from vibroswarm.errors import InputError
from vibroswarm.motion.pose import pose
from vibroswarm.result import Result

Floats = NDArray[np.float64]

UNKNOWN: Final = 0.5
"""Belief before the first sample."""


class Playback:
    """One run of a result.

    Args:
        result: with segments; without, robots go straight from sample to sample. run: its number.
    Raises:
        InputError: there is no such run, or nothing in it to show.
    """

    def __init__(self, result: Result, run: int) -> None:
        self.result, self.run, self.floor = result, run, result.floor(run)
        of_run = pl.col("run") == run
        self.robots = result.scenario.swarm.robots
        self.end_s = float(result.ends.filter(of_run)["end_s"].max() or 0.0)  # type: ignore[arg-type]
        samples = result.motion.filter(of_run)
        if samples.is_empty():
            raise InputError(f"run {run} has no sample", field="run")
        key = ["run", "robot", "sample"]
        samples = samples.join(result.observations, on=key).join(result.inference, on=key).sort("time_s")
        self.sample_s = samples["time_s"].to_numpy()
        self.places = samples.select("x_m", "y_m").to_numpy()
        self.readings = samples["observation"].cast(pl.Int64).to_numpy()
        self._samples = [samples.filter(pl.col("robot") == robot) for robot in range(self.robots)]
        segments = None if result.segments is None else result.segments.filter(of_run)
        self._segments = (
            None
            if segments is None
            else [segments.filter(pl.col("robot") == robot) for robot in range(self.robots)]
        )

    @property
    def is_exact(self) -> bool:
        """Whether poses are known at all times, rather than at samples only."""
        return self._segments is not None

    def poses(self, robot: int, time_s: ArrayLike) -> Floats:
        """Return x, y (m) and heading (rad) of a robot, (times, 3)."""
        times = np.atleast_1d(np.asarray(time_s, dtype=np.float64))
        if self._segments is not None:
            return pose(self._segments[robot], self.run, robot, times)
        own = self._samples[robot]
        if own.is_empty():
            return np.full((times.size, 3), np.nan)
        at, x, y = (own[name].to_numpy() for name in ("time_s", "x_m", "y_m"))
        k = np.clip(np.searchsorted(at, times, side="right") - 1, 0, max(at.size - 2, 0))
        following = np.minimum(k + 1, at.size - 1)
        heading = np.arctan2(y[following] - y[k], x[following] - x[k])
        return np.stack([np.interp(times, at, x), np.interp(times, at, y), heading], axis=1)

    def belief(self, robot: int, time_s: float) -> tuple[float, int]:
        """Return a robot's belief that the fill ratio is below the boundary, and its decision (-1: none)."""
        own = self._samples[robot]
        k = int(own["time_s"].search_sorted(time_s, side="right")) - 1
        if k < 0:
            return UNKNOWN, -1
        belief, decision = own["belief_below"][k], own["decision"][k]
        return UNKNOWN if belief is None else float(belief), -1 if decision is None else int(decision)

    def samples_by(self, time_s: float) -> int:
        """Return how many samples the swarm has taken up to a time."""
        return int(np.searchsorted(self.sample_s, time_s, side="right"))
