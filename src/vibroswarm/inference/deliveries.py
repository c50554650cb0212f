"""A motion as replay reads it."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.jit import allocating_kernel, kernel, read_only, signed
from vibroswarm.core.rng import ALONE, MESSAGE, uniform
from vibroswarm.inference.replay_arrays import NO_ESTIMATES, Rows, Stops
from vibroswarm.inference.sender_positions import Tracks, tracks_of
from vibroswarm.localisation.locate import estimate, estimates_key, is_estimated
from vibroswarm.motion.motion_tables import Motion
from vibroswarm.networks import network
from vibroswarm.scenario.scenario import Scenario


@dataclass(frozen=True, eq=False)
class Timeline:
    """The samples of a motion, run by run, and how many messages of the run the robot had heard at each."""

    samples: pl.DataFrame
    """run, robot and sample of the rows."""
    ends: pl.DataFrame
    """Table of the ends of the robots' motion."""
    rows: Rows
    """What kernels read of the samples."""
    robots: int
    """Number of robots of a run."""
    tick_ms: int
    """Control period."""
    stop_start_s: NDArray[np.float64]
    """(rows,): when the robot stopped for the sample."""
    x_m: NDArray[np.float64]
    """(rows,): true x at the sample."""
    y_m: NDArray[np.float64]
    """(rows,): true y at the sample."""
    heading_rad: NDArray[np.float64]
    """(rows,): true heading at the sample."""
    moves: pl.DataFrame | None = None
    """Table of moves; None if the motion has none."""
    _message_uniforms: dict[int, NDArray[np.float64]] = field(default_factory=dict, repr=False)
    _estimates: dict[Any, NDArray[np.float64]] = field(default_factory=dict, repr=False)

    @cached_property
    def stops(self) -> Stops:
        """When robots stand (``replay_arrays.Stops``), computed from the times of samples and of ends."""
        per_s, rows = 1000.0 / self.tick_ms, self.rows
        tick, stop_tick = (
            np.rint(column * per_s).astype(np.int64) for column in (rows.time_s, self.stop_start_s)
        )
        following = np.empty(tick.size, dtype=np.int32)
        first = np.full(rows.runs.size * self.robots, -1, dtype=np.int32)
        link(rows.bounds, rows.robot, self.robots, following, first)
        # known: tick at which each run ends; empty if there are no runs.
        end_tick = np.rint(self.ends["end_s"].to_numpy() * per_s).astype(np.int64)
        known = end_tick.reshape(-1, self.robots).max(axis=1) if end_tick.size else end_tick
        # A robot walks until the tick before its end or, if it stands at the end, the tick before its stop began.
        stop_start_s, end_s = self.ends["stop_start_s"].to_numpy(), self.ends["end_s"].to_numpy()
        standing_since_s = np.where(np.isnan(stop_start_s), end_s, stop_start_s)
        walked = np.rint(standing_since_s * per_s).astype(np.int64) - 1
        return Stops(
            tick=read_only(tick),
            stop_tick=read_only(stop_tick),
            following=read_only(following),
            first=read_only(first),
            walked_tick=read_only(walked),
            known_tick=read_only(known),
        )

    @cached_property
    def tracks(self) -> Tracks:
        """Moves from which the robots' positions at any tick are computed."""
        return tracks_of(self.moves, self.rows.runs, self.robots, self.tick_ms)

    @property
    def longest(self) -> int:
        """Number of rows of the longest run."""
        return int(np.diff(self.rows.bounds).max(initial=0))

    def message_uniforms(self, seed: int) -> NDArray[np.float64]:
        """Return the first random number of ``on_sample`` at each sample, (rows,); the result is cached by seed."""
        rows = self.rows
        if seed not in self._message_uniforms:
            self._message_uniforms[seed] = message_uniforms(
                seed, rows.runs, rows.bounds, rows.robot, rows.sample
            )
        return self._message_uniforms[seed]

    def estimates(self, scenario: Scenario, seed: int) -> NDArray[np.float64]:
        """Return the places that robots believe in at each sample, cached; no rows if they know them."""
        if not is_estimated(scenario):
            return NO_ESTIMATES
        key = estimates_key(scenario, seed)
        if key not in self._estimates:
            self._estimates[key] = read_only(
                estimate(scenario, seed, self.samples, self.stop_start_s, self.rows.time_s, self.moves)
            )
        return self._estimates[key]


def needs_moves(scenario: Scenario) -> bool:
    """Return whether a scenario's network or localisation reads the table of moves."""
    return network(scenario.network.name).reads_positions or is_estimated(scenario)


def timeline_of(scenario: Scenario, motion: Motion | Timeline) -> Timeline:
    """Return the timeline of a motion, sorted by run, time and robot, or the timeline itself."""
    if isinstance(motion, Timeline):
        return motion
    tick_ms, robots = scenario.run.control_period_ms, scenario.swarm.robots
    samples, ends = motion.samples, motion.ends
    highest = int(samples["robot"].to_numpy().max(initial=0))
    if highest >= robots:
        raise ValueError(f"samples name robot {highest}; there are {robots} robots, numbered from 0")
    runs = ends["run"].to_numpy()[::robots]
    bounds = np.append(np.searchsorted(samples["run"].to_numpy(), runs), samples.height)
    names = ("robot", "sample", "time_s", "stop_start_s", "x_m", "y_m", "heading_rad")
    column = {name: read_only(samples[name].to_numpy()) for name in names}
    return Timeline(
        samples=pl.DataFrame([samples[name] for name in ("run", "robot", "sample")]),
        ends=ends,
        rows=Rows(
            bounds=read_only(bounds),
            runs=read_only(runs.astype(np.int64)),
            robot=column["robot"],
            sample=column["sample"],
            time_s=column["time_s"],
        ),
        robots=robots,
        tick_ms=tick_ms,
        stop_start_s=column["stop_start_s"],
        x_m=column["x_m"],
        y_m=column["y_m"],
        heading_rad=column["heading_rad"],
        moves=motion.moves,
    )


@kernel
def link(
    bounds: NDArray[np.int64], robot: NDArray[np.uint16], robots: int, following: NDArray[np.int32],
    first: NDArray[np.int32],
) -> None:  # fmt: skip
    """Write ``Stops.following`` and ``Stops.first``, which holds -1 everywhere before."""
    for r in range(bounds.size - 1):
        for k in range(bounds[r + 1] - 1, bounds[r] - 1, -1):
            e = r * robots + signed(robot[k])
            following[k], first[e] = first[e], k - bounds[r]


@allocating_kernel
def message_uniforms(
    seed: int,
    runs: NDArray[np.int64],
    bounds: NDArray[np.int64],
    robot: NDArray[np.uint16],
    sample: NDArray[np.uint32],
) -> NDArray[np.float64]:
    """Return the first number of ``on_sample`` (``u(d, 0)``) at each sample, once for all strategies, (rows,)."""
    out = np.empty(robot.size, dtype=np.float64)
    for r in range(runs.size):
        for k in range(bounds[r], bounds[r + 1]):
            out[k] = uniform(seed, runs[r], signed(robot[k]), MESSAGE, signed(sample[k]), ALONE)
    return out
