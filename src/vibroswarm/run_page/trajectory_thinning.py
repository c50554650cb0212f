"""Thin trajectories for a page: a few knots, and circular arcs between them.

A table of poses has a row for each control tick. It is thinned to *knots* (time, x, y, heading, kind); between these
the page draws circular arcs. At the share u of the time from knot 0 (position p0, heading h0) to knot 1, with the
heading difference d and the chord c between the positions,

    heading = h0 + d u
    position = p0 + c, rotated by d (u - 1) / 2 and multiplied by sin(d u / 2) / sin(d / 2).

This is exact for constant speed and turn rate. Elsewhere knots are chosen so that it errs by at most a tolerance.

| name | unit | shape |
|---|---|---|
| knots | s, m, m, rad | (n, 4): time, x, y, heading; a heading does not jump by whole turns ("unwrapped") |
| kind | index into the names of kinds | (n,), holds from its knot to the next |
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import polars as pl
from numpy.typing import NDArray

POSITION_TOLERANCE_M = 0.0005
"""Largest error of a position at the points that are compared; between them and with rounding, less than twice as
large."""
HEADING_TOLERANCE_RAD = np.radians(1.5)
"""Largest error of a heading at the points that are compared; between them and with rounding, less than twice as
large."""

WIDEST_RAD = 0.9 * np.pi
"""Largest turn of an arc between two knots."""

SEEN_S = 0.1
"""Poses further apart than this are those that a camera saw; the path between them is a straight line."""

KINDS = ("drive", "turn", "avoid", "stop")
"""Kinds of moves."""

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


def tracks(poses: pl.DataFrame) -> tuple[list[Track], list[str]]:
    """Thin one run's table of poses to knots.

    Returns: one track per robot, sorted by robot; and the names of the kinds, into which ``Track.kind`` is an index.
    """
    found = []
    for (robot,), own in poses.group_by("robot"):
        kind, knots = _points(own.sort("time_s"))
        keep = _thin(kind, knots)
        found.append(Track(int(robot), knots[keep], kind[keep]))
    return sorted(found, key=lambda track: track.robot), list(KINDS)


def along(start: Floats, end: Floats, time_s: Floats) -> Floats:
    """Return poses on the arcs between pairs of knots, by the equations of the module's docstring.

    If both knots of a pair have the same time, the pose is that of the first.

    Args:
        start, end: (..., 4) time, x, y, heading of the knots before and after each time.
        time_s: (...) times between them, s.
    Returns: (..., 4) time, x, y, heading.
    """
    duration_s = end[..., 0] - start[..., 0]
    share = np.divide(time_s - start[..., 0], duration_s, out=np.zeros_like(duration_s), where=duration_s > 0)
    turned = end[..., 3] - start[..., 3]
    half = turned / 2
    # A straight line is used in place of an arc that hardly turns (sin(half) is near 0), and of an arc that turns by
    # more than half a turn, where the equation fails.
    is_arc = (np.abs(half) > 1e-6) & (np.abs(half) <= np.pi / 2)
    # The chord between the knots is multiplied by ``reach`` and rotated by ``tilt``.
    reach = np.divide(np.sin(half * share), np.sin(half), out=share.copy(), where=is_arc)
    tilt = np.where(is_arc, half * (share - 1), 0.0)
    across, up = end[..., 1] - start[..., 1], end[..., 2] - start[..., 2]
    cos, sin = reach * np.cos(tilt), reach * np.sin(tilt)
    x, y = start[..., 1] + across * cos - up * sin, start[..., 2] + across * sin + up * cos
    return np.stack([time_s, x, y, start[..., 3] + turned * share], axis=-1)


def _points(own: pl.DataFrame) -> tuple[NDArray[np.int64], Floats]:
    """Return a robot's poses by time: kind as an index, (points,); time, x, y, heading, (points, 4).

    Where poses are far apart, another point ends the line from one to the next, with the heading of its start.
    """
    kind = own["kind"].cast(pl.Enum(KINDS)).to_physical().to_numpy().astype(np.int64)
    knots = own.select("time_s", "x_m", "y_m", "heading_rad").to_numpy().astype(np.float64)
    knots[:, 3] = np.unwrap(knots[:, 3])
    far = np.flatnonzero(np.diff(knots[:, 0]) > SEEN_S)
    ends = np.column_stack([knots[far + 1, :3], knots[far, 3]])
    return np.insert(kind, far + 1, kind[far]), np.insert(knots, far + 1, ends, axis=0)


def _thin(kind: NDArray[np.int64], knots: Floats) -> NDArray[np.bool_]:
    """Choose the points of a robot to keep as knots.

    The first knots are: the first and last point, each point at which the kind changes, and the points
    before and after each jump. Then, repeatedly, the point with the largest error between each two neighbouring knots
    becomes a knot, until the arcs between knots pass all other points within the tolerances.

    Args:
        kind: kind of each point, (points,), at least one point. knots: time, x, y, heading of each point,
            (points, 4), sorted by time.
    Returns: whether each point is kept, (points,).
    """
    jump = np.diff(knots[:, 0], prepend=-1.0) <= 0  # two points at the same time
    keep: NDArray[np.bool_] = jump | (np.diff(kind, prepend=-1) != 0)  # the first point too: no kind is -1
    keep |= np.append(jump[1:], True)  # the points before jumps, and the last point
    point = np.arange(len(knots))  # of the arcs that may still err by too much
    while point.size:
        kept = np.flatnonzero(keep)
        # Index in ``kept`` of the knot at, or before, each point.
        arc = np.searchsorted(kept, point, side="right") - 1
        before, after = kept[arc], kept[np.minimum(arc + 1, len(kept) - 1)]
        off = knots[point] - along(knots[before], knots[after], knots[point, 0])
        badness = np.hypot(off[:, 1], off[:, 2]) / POSITION_TOLERANCE_M
        badness = np.maximum(badness, np.abs(off[:, 3]) / HEADING_TOLERANCE_RAD)
        # ``along`` draws arcs of up to half a turn, which rounding may exceed. So an arc near half a turn is divided at
        # its middle point: that has the largest badness there, above any error (in units of the tolerance).
        is_wide = np.abs(knots[after, 3] - knots[before, 3]) > WIDEST_RAD
        from_knot = np.minimum(point - before, after - point)
        badness = np.where(point == before, 0.0, np.where(is_wide, 1e6 + from_knot, badness))
        is_first = np.diff(arc, prepend=-1) != 0
        worst = np.maximum.reduceat(badness, np.flatnonzero(is_first))[np.cumsum(is_first) - 1]
        keep[point[(badness > 1) & (badness == worst)]] = True
        point = point[worst > 1]
    return keep
