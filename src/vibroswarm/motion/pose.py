"""Position of a robot at any time, from a table of segments or of moves."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import ArrayLike, NDArray

from vibroswarm.core.angles import wrapped
from vibroswarm.errors import InputError, check_kind, shown, whole_number_of


def pose(segments: pl.DataFrame, run: int, robot: int, time_s: ArrayLike) -> NDArray[np.float64]:
    """Return the position and heading of one robot of one run at given times.

    Args:
        segments: a segment table (see ``source``): exact arcs, each from its ``start_s`` to the next, in order of time.
        time_s: times from 0 on, s, any shape. The last arc is continued for ever, so results at times beyond the end
            of the run are not meaningful.
    Returns: float64 of shape (\\*time_s.shape, 3): x (m), y (m), heading (rad, in [-pi, pi)).
    Raises:
        InputError: the table lacks a column, run or robot, or a time is nan, no number, or before the robot's first
            segment.
    """
    return _along_arcs(segments, run, robot, time_s, "segment")


def place_from_moves(moves: pl.DataFrame, run: int, robot: int, time_s: ArrayLike) -> NDArray[np.float64]:
    """Return the position of one robot of one run at given times, from its moves.

    The position is exact while the robot drives or stands, and where a turn begins and ends. Within a turn, the robot's
    centre moves on a circle of radius m_d turn_track / 2 (m_d: its misalignment). The position is calculated as if the
    turn rate were constant, so its error is at most the diameter of that circle. All this does not hold for robots that
    MuJoCo moves: each of their moves is an arc fitted to the robot's poses (``physics.arcs``).

    Args:
        moves: a table of moves (see ``source``).
        time_s: times, s, as for ``pose``.
    Returns: float64 of shape (\\*time_s.shape, 2): x, y (m).
    Raises:
        InputError: the table lacks a column, run or robot, or a time is nan, no number, or before the robot's first
            move.
    """
    return _along_arcs(moves, run, robot, time_s, "move")[..., :2]


def _along_arcs(
    arcs: pl.DataFrame, run: int, robot: int, time_s: ArrayLike, what: str
) -> NDArray[np.float64]:
    """Return the poses of one robot at given times, on the arcs in a table of segments or of moves; see ``pose``.

    Args:
        arcs: the table. what: what one of its rows is, for errors: "segment" or "move".
    """
    check_kind(arcs, pl.DataFrame, f"{what}s", "a table; simulate with segments=True or moves=True")
    if missing := [name for name in ("run", "robot", *ARC) if name not in arcs.columns]:
        raise InputError(
            f"has no column '{missing[0]}'; give the table of {what}s of a result", field=f"{what}s"
        )
    run, robot = whole_number_of(run, "run", 0, 2**32 - 1), whole_number_of(robot, "robot", 0, 2**16 - 1)
    own = arcs.filter((pl.col("run") == run) & (pl.col("robot") == robot))
    if own.height == 0:
        raise InputError(f"the table has no {what} of robot {robot} in run {run}", field="robot")
    try:
        times = np.asarray(time_s, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{shown(time_s)} is not a time; give numbers in s", field="time_s") from None
    start = own["start_s"].to_numpy()
    if times.size and not float(times.min()) >= start[0]:  # ``not ... >=`` is true for NaN too
        raise InputError(f"{times.min():g} s is before the first {what}, at {start[0]:g} s", field="time_s")
    return on_arcs({name: own[name].to_numpy() for name in ARC}, times)


ARC: Final = ("start_s", "x_m", "y_m", "heading_rad", "speed_m_s", "turn_rate_rad_s")
"""Columns of an arc."""


def on_arcs(arcs: Mapping[str, NDArray[np.float64]], times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the poses of a robot, (..., 3), at times, s, none of which is before its first arc.

    Args:
        arcs: the columns ``ARC`` of its arcs, (arcs,) each.
    """
    start = arcs["start_s"]
    row = np.searchsorted(start, times, side="right") - 1  # the latest arc that begins at or before each time
    x_m, y_m, heading_rad = (arcs[name][row] for name in ("x_m", "y_m", "heading_rad"))
    elapsed = times - start[row]
    # An arc's end lies at the distance ``chord`` from its start, in the direction midway between its first and last
    # heading. NumPy's sinc(x) is sin(pi x) / (pi x), hence the division by pi.
    half = 0.5 * arcs["turn_rate_rad_s"][row] * elapsed
    chord = arcs["speed_m_s"][row] * elapsed * np.sinc(half / np.pi)
    along = heading_rad + half
    return np.stack(
        [x_m + chord * np.cos(along), y_m + chord * np.sin(along), wrapped(heading_rad + 2.0 * half)], axis=-1
    )
