"""Thin trajectories for a page: a few knots, and circular arcs between them.

A table of segments has exact poses, but one row for each control tick in which a turn slows down. It is thinned to
*knots* (time, x, y, heading, kind of segment), between which the page draws circular arcs. At the share u of the time
from knot 0 (position p0, heading h0) to knot 1, with the heading difference d and the chord c between the positions,

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

PIECE_S, PIECE_M, PIECE_RAD = 0.5, 0.025, np.radians(15)
"""Largest time, distance and turn between points of a segment that are compared."""
MOST_PIECES = 1000
"""Largest number of pieces of a segment. Longer ones than 25 m are mostly of a log in other units, such as mm for m."""

KINDS = ("drive", "turn", "avoid", "stop")
"""Usual kinds of segments; a table may have others."""

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
    """Thin one run's table of segments to knots.

    Args:
        segments: robot, start_s, x_m, y_m, heading_rad, speed_m_s, turn_rate_rad_s, kind; in any order.
        t_end_s: when each robot's last segment ends, s.
    Returns: one track per robot that has a segment before ``t_end_s``, sorted by robot; and the names of the kinds,
        into which ``Track.kind`` is an index.
    """
    names = [*KINDS, *sorted(set(segments["kind"].cast(pl.String).unique()) - set(KINDS))]
    found = []
    # One robot at a time, as the points of all robots take several times the memory of the table.
    for (robot,), own in segments.filter(pl.col("start_s") < t_end_s).group_by("robot"):
        kind, knots = _points(own.sort("start_s", maintain_order=True), t_end_s, names)
        keep = _thin(kind, knots)
        found.append(Track(robot, knots[keep], kind[keep]))
    return sorted(found, key=lambda track: track.robot), names


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


def _points(table: pl.DataFrame, t_end_s: float, names: list[str]) -> tuple[NDArray[np.int64], Floats]:
    """Divide each segment of a robot into at most MOST_PIECES, at most ``PIECE_S``, ``PIECE_M`` and ``PIECE_RAD`` long.

    The points of a segment are its start and points inside. Its end is a point too if it is the last, or if the next
    segment begins elsewhere.

    Args:
        table: the robot's segments sorted by start. t_end_s: end of the last, s. names: of the kinds.
    Returns: kind as an index into ``names``, (points,); time, x, y, heading, (points, 4).
    """
    kind = table["kind"].cast(pl.String).cast(pl.Enum(names)).to_physical().to_numpy().astype(np.int64)
    columns = ["start_s", "x_m", "y_m", "heading_rad", "speed_m_s", "turn_rate_rad_s"]
    start, x, y, heading, speed, rate = table.select(columns).to_numpy().astype(np.float64).T
    duration_s = np.append(start[1:], t_end_s) - start
    ends_at = _on_arc(x, y, heading, speed, rate, duration_s)
    unwrapped = _unwrapped(heading, end=ends_at[2])
    ends_at[2] += unwrapped - heading  # the heading at the end is changed by the same whole turns
    heading = unwrapped
    needs_end = np.append(_jumps(np.stack([x, y, heading]), ends_at), True)

    # Pieces of each segment: as many as its duration, its length and its turn require, and at least one.
    pieces = np.max(
        [duration_s / PIECE_S, np.abs(speed) * duration_s / PIECE_M, np.abs(rate) * duration_s / PIECE_RAD], 0
    )
    pieces = np.clip(np.ceil(pieces), 1, MOST_PIECES).astype(np.int64)
    count = pieces + needs_end  # points of each segment
    row = np.repeat(np.arange(len(count)), count)  # the segment of each point
    nth = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)  # its index in the segment
    elapsed_s = duration_s[row] * nth / pieces[row]
    pose = _on_arc(x[row], y[row], heading[row], speed[row], rate[row], elapsed_s)
    return kind[row], np.stack([start[row] + elapsed_s, *pose], axis=1)


def _on_arc(x: Floats, y: Floats, heading: Floats, speed: Floats, rate: Floats, elapsed_s: Floats) -> Floats:
    """Return x, y, heading, (3, n), after ``elapsed_s`` at constant speed and turn rate; arguments (n,) each."""
    half = rate * elapsed_s / 2
    chord = speed * elapsed_s * np.sinc(half / np.pi)  # sin(half) / half
    return np.stack(
        [x + chord * np.cos(heading + half), y + chord * np.sin(heading + half), heading + 2 * half]
    )


def _jumps(starts: Floats, ends: Floats) -> NDArray[np.bool_]:
    """Return whether the next segment begins more than 0.1 mm or half a degree from where this one ends.

    Both arguments: x, y and heading, (3, segments). Returns: (segments - 1,).
    """
    x, y, heading = np.abs(starts[:, 1:] - ends[:, :-1])
    return np.asarray((np.hypot(x, y) > 1e-4) | (heading > np.radians(0.5)))


def _unwrapped(heading: Floats, end: Floats) -> Floats:
    """Return the headings at the starts of segments, changed by whole turns to follow the end of the segment before.

    Headings are in rad, (segments,) each.
    """
    # Whole turns between the end of a segment and the start of the next.
    jumps = np.append(0.0, np.round((heading[1:] - end[:-1]) / (2 * np.pi)))
    return np.asarray(heading - 2 * np.pi * np.cumsum(jumps))


def _thin(kind: NDArray[np.int64], knots: Floats) -> NDArray[np.bool_]:
    """Choose the points of a robot to keep as knots.

    The first knots are: the first and last point, each point at which the kind of segment changes, and the points
    before and after each jump. Then, repeatedly, the point with the largest error between each two neighbouring knots
    becomes a knot, until the arcs between knots pass all other points within the tolerances.

    Args:
        kind: kind of segment of each point, (points,), at least one point. knots: time, x, y, heading of each point,
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
