"""A motion as replay reads it: its samples and stops and, for networks that read them, positions at a message.

The position of a robot that drives or stands is exact. A turning robot is taken to be where its turn began. Its centre
moves on a circle of a few millimetres only, and its turn rate is not known until the turn is over. So a closed loop,
which does not know it yet, computes the same positions as a replay of whole tables.

| name | symbol | unit | equation |
|---|---|---|---|
| chord | c | m | v t sin(w t / 2) / (w t / 2), along heading + w t / 2; v speed, w turn rate, t time since the start |
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Final, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.jit import allocating_kernel, inlined, kernel, read_only, signed
from vibroswarm.core.rng import ALONE, MESSAGE, uniform
from vibroswarm.errors import InputError
from vibroswarm.inference.replay_arrays import NO_ESTIMATES, Rows, Stops
from vibroswarm.localisation.locate import estimate, estimates_key, is_estimated
from vibroswarm.motion.geometry import wrapped_rad
from vibroswarm.motion.motion_tables import Motion
from vibroswarm.networks import network
from vibroswarm.robot.walk import DRIVE, KINDS
from vibroswarm.scenario.scenario import Scenario


class Tracks(NamedTuple):
    """Moves of some runs' robots, robot by robot, in order of time; (moves,) each unless stated."""

    bounds: NDArray[np.int64]
    """(runs * robots + 1,): the robot in row e has the moves from ``bounds[e]`` to ``bounds[e + 1]``."""
    tick: NDArray[np.int64]
    """Tick at which the move starts."""
    x_m: NDArray[np.float64]
    """Place at the start of the move, x."""
    y_m: NDArray[np.float64]
    """Place at the start of the move, y."""
    heading_rad: NDArray[np.float64]
    """Heading at the start of the move."""
    speed_m_s: NDArray[np.float64]
    """Speed of the centre, taken to be 0 in a turn or stop."""
    rate_rad_s: NDArray[np.float64]
    """Turn rate, taken to be 0 in a turn or stop."""
    at: NDArray[np.int64]
    """(runs * robots,): index of the move in which each robot was at the last call of ``positions_at``, which
    changes it in place."""


def _tracks(whose: NDArray[np.int64], robots: int, *columns: NDArray[np.int64 | np.float64]) -> Tracks:
    """Return moves as tracks: sorted by robot, with ``at`` set to each robot's first move."""
    order = np.argsort(whose, kind="stable")
    bounds = np.searchsorted(whose[order], np.arange(robots + 1))
    tick, x_m, y_m, heading_rad, speed_m_s, rate_rad_s = (read_only(column[order]) for column in columns)
    first = bounds[:-1].astype(np.int64)  # a copy, because ``positions_at`` changes it
    return Tracks(
        bounds=read_only(bounds.astype(np.int64)),
        tick=tick,
        x_m=x_m,
        y_m=y_m,
        heading_rad=heading_rad,
        speed_m_s=speed_m_s,
        rate_rad_s=rate_rad_s,
        at=first,
    )


NO_TRACKS: Final[Any] = 0
"""In place of ``Tracks`` for networks that do not read positions: kernels take time to compile for each array."""


def tracks_of(moves: pl.DataFrame | None, runs: NDArray[np.int64], robots: int, tick_ms: int) -> Tracks:
    """Convert a table of moves to tracks. Shapes: ``runs`` (runs,)."""
    if moves is None:
        raise InputError(
            "reads positions, but this motion has no moves; choose another network, or motion with moves",
            field="network.name",
        )
    run = np.searchsorted(runs, moves["run"].to_numpy())  # index of each move's run
    # Only a robot that drives changes its place here; a turning robot is taken to stay.
    drives = (moves["kind"] == KINDS[DRIVE]).to_numpy()
    speed_m_s, rate_rad_s = (moves[name].to_numpy() for name in ("speed_m_s", "turn_rate_rad_s"))
    return _tracks(
        run * robots + moves["robot"].to_numpy(),
        runs.size * robots,
        np.rint(moves["start_s"].to_numpy() * (1000.0 / tick_ms)).astype(np.int64),
        *(moves[name].to_numpy() for name in ("x_m", "y_m", "heading_rad")),
        np.where(drives, speed_m_s, 0.0),
        np.where(drives, rate_rad_s, 0.0),
    )


def tracks_of_rows(rows: NDArray[np.void], robots: int) -> Tracks:
    """Convert the moves of one run so far to tracks."""
    drives = rows["kind"] == DRIVE  # a robot that turns is taken to stay where it is
    # Tables hold wrapped headings, so these are wrapped too: positions are then exactly those computed from a table.
    return _tracks(
        rows["robot"].astype(np.int64),
        robots,
        rows["tick"],
        rows["x_m"],
        rows["y_m"],
        wrapped(rows["heading_rad"].copy()),  # copied to be contiguous, as a field of records is not
        np.where(drives, rows["speed_m_s"], 0.0),
        np.where(drives, rows["rate_rad_s"], 0.0),
    )


@allocating_kernel
def wrapped(headings: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return headings wrapped to [-pi, pi), as in tables, rad, in a new array."""
    out = np.empty_like(headings)
    for k in range(headings.size):
        out[k] = wrapped_rad(headings[k])
    return out


@inlined
def positions_at(
    tracks: Tracks, first: int, tick: int, tick_ms: int, x_m: NDArray[np.float64], y_m: NDArray[np.float64]
) -> None:
    """Write the robots' positions at a tick; ``tracks.at`` moves forwards only, so calls are in order of time."""
    for i in range(x_m.size):
        e = first + i
        k = tracks.at[e]
        while k + 1 < tracks.bounds[e + 1] and tracks.tick[k + 1] <= tick:
            k += 1
        tracks.at[e] = k
        t_s = (tick - tracks.tick[k]) * tick_ms / 1000.0
        half = 0.5 * tracks.rate_rad_s[k] * t_s
        chord = tracks.speed_m_s[k] * t_s
        if abs(half) > 1e-9:  # else the arc is a straight line, and the division might be 0 / 0
            chord *= math.sin(half) / half
        along = tracks.heading_rad[k] + half
        x_m[i] = tracks.x_m[k] + chord * math.cos(along)
        y_m[i] = tracks.y_m[k] + chord * math.sin(along)


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
