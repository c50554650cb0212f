"""Thin trajectories for a page: few knots with arcs in between.

A segment table has exact positions, but one row for each control tick of a turn's tail.
It is thinned to *knots* (time, x, y, heading, kind) between which the page draws circular arcs:
at the share u of the way from knot 0 to knot 1, with the heading difference d and the chord c,

    heading = h0 + d u
    position = p0 + c rotated by d (u - 1) / 2, times sin(d u / 2) / sin(d / 2)

which is exact on an arc of constant speed and turn rate, and off by no more than the tolerance elsewhere.

| name | unit | shape |
|---|---|---|
| knots | s, m, m, rad (unwrapped) | (n, 4): time, x, y, heading |
| kind | index into the names of kinds | (n,), holds from its knot to the next |
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import polars as pl
from numpy.typing import NDArray

POSITION_TOLERANCE_M = 0.0005
HEADING_TOLERANCE_RAD = np.radians(1.5)
"""Largest thinning errors at compared points; with rounding, and elsewhere, less than twice as large."""

WIDEST_RAD = 0.9 * np.pi
"""Largest turn of an arc between two knots."""

PIECE_S, PIECE_M, PIECE_RAD = 0.5, 0.025, np.radians(15)
"""Largest distances between compared points along an arc."""

KINDS = ("drive", "turn", "avoid", "stop")

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Track:
    """One robot's knots.

    Args:
        robot: its number in the tables.
        knots: (n, 4) float64: time (s, never falling), x, y (m), heading (rad, unwrapped).
        kind: (n,) index into the kinds' names, from this knot to the next.
    """

    robot: int
    knots: Floats
    kind: NDArray[np.int64]


def tracks(segments: pl.DataFrame, t_end_s: float) -> tuple[list[Track], list[str]]:
    """Thin one run's segment table to knots.

    Args:
        segments: robot, start_s, x_m, y_m, heading_rad, speed_m_s, turn_rate_rad_s, kind; any order.
        t_end_s: when each robot's last segment ends, s.
    Returns: one track per robot that has a segment before ``t_end_s``, by robot; the kinds' names.
    """
    names = [*KINDS, *sorted(set(segments["kind"].cast(pl.String)) - set(KINDS))]
    table = segments.filter(pl.col("start_s") < t_end_s).sort("robot", "start_s", maintain_order=True)
    if table.is_empty():
        return [], names
    robot, kind, knots = _points(table, t_end_s, names)
    keep = _thin(robot, kind, knots)
    robot, kind, knots = robot[keep], kind[keep], knots[keep]
    first = np.flatnonzero(np.diff(robot, prepend=-1))
    parts = zip(np.split(knots, first[1:]), np.split(kind, first[1:]), strict=True)
    return [Track(int(robot[at]), *part) for at, part in zip(first, parts, strict=True)], names


def along(start: Floats, end: Floats, time_s: Floats) -> Floats:
    """Return the pose between two knots: a circular arc in time (see above).

    Args:
        start, end: (..., 4) time, x, y, heading of the knots around each time.
        time_s: (...) times between them, s.
    Returns: (..., 4) time, x, y, heading.
    """
    duration_s = end[..., 0] - start[..., 0]
    share = np.divide(time_s - start[..., 0], duration_s, out=np.zeros_like(duration_s), where=duration_s > 0)
    turned = end[..., 3] - start[..., 3]
    half = turned / 2
    bent = (np.abs(half) > 1e-6) & (np.abs(half) <= np.pi / 2)  # beyond half a turn an arc is ill defined
    reach = np.divide(np.sin(half * share), np.sin(half), out=share.copy(), where=bent)
    tilt = np.where(bent, half * (share - 1), 0.0)
    across, up = end[..., 1] - start[..., 1], end[..., 2] - start[..., 2]
    cos, sin = reach * np.cos(tilt), reach * np.sin(tilt)
    x, y = start[..., 1] + across * cos - up * sin, start[..., 2] + across * sin + up * cos
    return np.stack([time_s, x, y, start[..., 3] + turned * share], axis=-1)


def _points(
    table: pl.DataFrame, t_end_s: float, names: list[str]
) -> tuple[NDArray[np.int64], NDArray[np.int64], Floats]:
    """Return the points along every segment, close enough to see all that it does: robot, kind, knots."""
    robot = table["robot"].to_numpy().astype(np.int64)
    kind = table["kind"].cast(pl.String).cast(pl.Enum(names)).to_physical().to_numpy().astype(np.int64)
    columns = ["start_s", "x_m", "y_m", "heading_rad", "speed_m_s", "turn_rate_rad_s"]
    start, x, y, heading, speed, rate = table.select(columns).to_numpy().astype(np.float64).T
    last = np.append(robot[1:] != robot[:-1], True)
    duration_s = np.where(last, t_end_s, np.append(start[1:], t_end_s)) - start
    ends_at = _on_arc(x, y, heading, speed, rate, duration_s)
    continued = _unwrapped(heading, ends_at[2], np.append(True, last[:-1]))
    broken = last | _jumps(np.stack([x, y, continued]), ends_at + [[0], [0], [1]] * (continued - heading))
    heading = continued

    pieces = np.max(
        [duration_s / PIECE_S, np.abs(speed) * duration_s / PIECE_M, np.abs(rate) * duration_s / PIECE_RAD], 0
    )
    pieces = np.maximum(np.ceil(pieces), 1).astype(np.int64)
    count = pieces + broken
    row = np.repeat(np.arange(len(robot)), count)
    nth = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    elapsed_s = duration_s[row] * nth / pieces[row]
    pose = _on_arc(x[row], y[row], heading[row], speed[row], rate[row], elapsed_s)
    return robot[row], kind[row], np.stack([start[row] + elapsed_s, *pose], axis=1)


def _on_arc(x: Floats, y: Floats, heading: Floats, speed: Floats, rate: Floats, elapsed_s: Floats) -> Floats:
    """Return (3, n) x, y, heading after ``elapsed_s`` at constant speed and turn rate."""
    half = rate * elapsed_s / 2
    chord = speed * elapsed_s * np.sinc(half / np.pi)  # sin(half) / half
    return np.stack(
        [x + chord * np.cos(heading + half), y + chord * np.sin(heading + half), heading + 2 * half]
    )


def _jumps(starts: Floats, ends: Floats) -> NDArray[np.bool_]:
    """Return whether the next segment begins elsewhere than this one ends: by 0.1 mm or half a degree."""
    x, y, heading = np.abs(np.roll(starts, -1, axis=1) - ends)
    return np.asarray((np.hypot(x, y) > 1e-4) | (heading > np.radians(0.5)))


def _unwrapped(heading: Floats, end: Floats, first: NDArray[np.bool_]) -> Floats:
    """Return the headings at the starts of segments without jumps of whole turns from the end of the segment before.

    Args:
        heading, end: at the start and the end of each segment, rad. first: whether it is the first of its robot.
    """
    jumps = np.append(0.0, np.round((heading[1:] - end[:-1]) / (2 * np.pi)))
    turns: Floats = np.cumsum(np.where(first, 0.0, jumps))
    since = np.maximum.accumulate(np.where(first, np.arange(len(turns)), 0))
    return np.asarray(heading - 2 * np.pi * (turns - turns[since]))


def _thin(robot: NDArray[np.int64], kind: NDArray[np.int64], knots: Floats) -> NDArray[np.bool_]:
    """Return which points to keep, (points,).

    These are the points where a track or kind begins or the robot jumps, and then the worst point between each two kept
    ones, until arcs between kept points meet all others within the tolerances.
    """
    first = np.diff(robot, prepend=-1) != 0
    jump = np.diff(knots[:, 0], prepend=-1.0) <= 0
    keep: NDArray[np.bool_] = first | jump | (np.diff(kind, prepend=-1) != 0)
    keep |= np.append((first | jump)[1:], True)
    while True:
        kept = np.flatnonzero(keep)
        gap = np.cumsum(keep) - 1
        after = kept[np.minimum(gap + 1, len(kept) - 1)]
        off = knots - along(knots[kept[gap]], knots[after], knots[:, 0])
        badness = np.hypot(off[:, 1], off[:, 2]) / POSITION_TOLERANCE_M
        badness = np.maximum(badness, np.abs(off[:, 3]) / HEADING_TOLERANCE_RAD)
        # Near half a turn, rounding could take an arc over the turn up to which ``along`` bends: halve it.
        wide = np.abs(knots[after, 3] - knots[kept[gap], 3]) > WIDEST_RAD
        halfway = np.minimum(np.arange(len(knots)) - kept[gap], after - np.arange(len(knots)))
        badness = np.where(keep, 0.0, np.where(wide, 1e6 + halfway, badness))
        worst = np.maximum.reduceat(badness, kept)[gap]
        new = (badness > 1) & (badness == worst)
        if not new.any():
            return keep
        keep |= new
