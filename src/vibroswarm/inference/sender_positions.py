"""Robot positions when a message is sent, computed from moves, for networks that read them.

The position of a robot that drives or stands is exact. A turning robot is taken to be where its turn began. Its centre
moves on a circle of a few millimetres only, and its turn rate is not known until the turn is over. So a closed loop,
which does not know it yet, computes the same positions as a replay of whole tables.

| name | symbol | unit | equation |
|---|---|---|---|
| chord | c | m | v t sin(w t / 2) / (w t / 2), along heading + w t / 2; v speed, w turn rate, t time since the start |
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.jit import allocating_kernel, inlined, read_only
from vibroswarm.errors import InputError
from vibroswarm.motion.geometry import wrapped_rad
from vibroswarm.robot.walk import DRIVE, KINDS


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
