"""Position of a robot at any time, from a table of segments or of moves."""

from __future__ import annotations

import numpy as np
import polars as pl
from numpy.typing import ArrayLike, NDArray

from vibroswarm.core.fork_guard import check_threads
from vibroswarm.errors import InputError, check_kind, shown, whole_number_of


def pose(segments: pl.DataFrame, run: int, robot: int, time_s: ArrayLike) -> NDArray[np.float64]:
    """Return the position and heading of one robot of one run.

    Args:
        segments: a segment table (see ``source``): exact arcs, each from its ``start_s`` to the next.
        time_s: times from 0 on, s, any shape. After the last segment's start its arc goes on, so times
            beyond the end of the run are not meaningful.
    Returns: float64 of shape (\\*time_s.shape, 3): x (m), y (m), heading (rad, in [-pi, pi)).
    Raises:
        InputError: no such run or robot in the table, or a time before its first segment.
    """
    return _along_arcs(segments, run, robot, time_s, "segment")


def place_from_moves(moves: pl.DataFrame, run: int, robot: int, time_s: ArrayLike) -> NDArray[np.float64]:
    """Return the position of one robot of one run, from its moves.

    It is exact for a robot that drives or stands, and where a turn begins and ends. Within a turn it lies on the
    circle of radius m_d turn_track / 2 on which the centre moves, as if the turn rate were constant: off by the
    circle's diameter at most.

    Args:
        moves: a table of moves (see ``source``). time_s: as for ``pose``.
    Returns: float64 of shape (\\*time_s.shape, 2): x, y (m).
    Raises:
        InputError: no such run or robot in the table, or a time before its first move.
    """
    return _along_arcs(moves, run, robot, time_s, "move")[..., :2]


def _along_arcs(
    arcs: pl.DataFrame, run: int, robot: int, time_s: ArrayLike, what: str
) -> NDArray[np.float64]:
    """Return poses on the arcs of the rows of a table of segments or of moves."""
    check_threads()
    check_kind(arcs, pl.DataFrame, f"{what}s", "a table; simulate with segments=True or moves=True")
    run, robot = whole_number_of(run, "run", 0, 2**32 - 1), whole_number_of(robot, "robot", 0, 2**16 - 1)
    own = arcs.filter((pl.col("run") == run) & (pl.col("robot") == robot))
    if own.height == 0:
        raise InputError(f"the table has no {what} of robot {robot} in run {run}", field="robot")
    try:
        times = np.asarray(time_s, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{shown(time_s)} is not a time; give numbers in s", field="time_s") from None
    start = own["start_s"].to_numpy()
    if times.size and not float(times.min()) >= start[0]:
        raise InputError(f"{times.min():g} s is before the first {what}, at {start[0]:g} s", field="time_s")
    k = np.searchsorted(start, times, side="right") - 1
    column = {name: own[name].to_numpy()[k] for name in ("x_m", "y_m", "heading_rad")}
    elapsed = times - start[k]
    half = 0.5 * own["turn_rate_rad_s"].to_numpy()[k] * elapsed
    chord = own["speed_m_s"].to_numpy()[k] * elapsed * np.sinc(half / np.pi)
    along = column["heading_rad"] + half
    heading = column["heading_rad"] + 2.0 * half
    return np.stack(
        [
            column["x_m"] + chord * np.cos(along),
            column["y_m"] + chord * np.sin(along),
            (heading + np.pi) % (2.0 * np.pi) - np.pi,
        ],
        axis=-1,
    )
