"""Poses of robots at each control tick, from their moves, and at any time, from their poses."""

from __future__ import annotations

from typing import Final

import numpy as np
import polars as pl
from numpy.typing import ArrayLike, NDArray

from vibroswarm.core.arrays import wrapped
from vibroswarm.core.ticks import tick_at
from vibroswarm.errors import InputError
from vibroswarm.motion.motion_tables import POSES

ARC: Final = ("start_s", "x_m", "y_m", "heading_rad", "speed_m_s", "turn_rate_rad_s")
"""Columns of an arc, which a move is."""


def poses_of(moves: pl.DataFrame, ends: pl.DataFrame, tick_ms: int) -> pl.DataFrame:
    """Return the table ``poses``: for each robot a row at each control tick up to its end, sorted by run, robot, time.

    Poses are exact while a robot drives or stands, and where a turn begins and ends. Within a turn the turn rate is
    taken as constant; the robot's centre moves on a circle of radius m_d turn_track / 2 (m_d: its misalignment).
    For robots that MuJoCo moves, each move is an arc fitted to the robot's path (``physics.arcs``).
    """
    end_s = {(run, robot): end_s for run, robot, end_s in ends.select("run", "robot", "end_s").iter_rows()}
    parts = []
    for (run, robot), own in moves.group_by("run", "robot", maintain_order=True):
        time_s = np.arange(tick_at(end_s[run, robot], tick_ms) + 1) * tick_ms / 1000.0
        start, x, y, heading, speed, rate = (own[name].to_numpy() for name in ARC)
        row = np.searchsorted(start, time_s, side="right") - 1  # the latest move that has begun
        elapsed_s = time_s - start[row]
        # An arc's end lies at the distance ``chord`` from its start, in the direction midway between its first and last
        # heading. NumPy's sinc(x) is sin(pi x) / (pi x), hence the division by pi.
        half = 0.5 * rate[row] * elapsed_s
        chord, along = speed[row] * elapsed_s * np.sinc(half / np.pi), heading[row] + half
        columns = {
            "time_s": time_s,
            "x_m": x[row] + chord * np.cos(along),
            "y_m": y[row] + chord * np.sin(along),
            "heading_rad": wrapped(heading[row] + 2.0 * half),
            "kind": own["kind"].gather(row),
        }
        parts.append(
            pl.DataFrame(columns).select(
                pl.lit(run, pl.UInt32).alias("run"), pl.lit(robot, pl.UInt16).alias("robot"), pl.all()
            )
        )
    return pl.concat(parts).cast(pl.Schema(POSES))


def pose(poses: pl.DataFrame, run: int, robot: int, time_s: ArrayLike) -> NDArray[np.float64]:
    """Return the position and heading of one robot of one run at given times, linear between two rows of a table.

    Args:
        poses: the table ``poses`` of a result. time_s: times, s, any shape; beyond the table, the robot stands.
    Returns: float64 of shape (\\*time_s.shape, 3): x (m), y (m), heading (rad, in [-pi, pi)).
    Raises:
        InputError: the table has no such robot.
    """
    own, times = (
        poses.filter(pl.col("run") == run, pl.col("robot") == robot),
        np.asarray(time_s, dtype=np.float64),
    )
    if own.height == 0:
        raise InputError(f"the table has no robot {robot} in run {run}", field="robot")
    x, y, heading = (own[name].to_numpy().astype(np.float64) for name in ("x_m", "y_m", "heading_rad"))
    at = [np.interp(times, own["time_s"].to_numpy(), values) for values in (x, y, np.unwrap(heading))]
    return np.stack([at[0], at[1], wrapped(at[2])], axis=-1)
