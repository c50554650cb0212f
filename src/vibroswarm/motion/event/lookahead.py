"""Looking ahead: what its modules share.

Each function of ``wall_lookahead``, ``pair_lookahead`` and ``blocked_lookahead`` returns a tick that is never too late:
before it no ray is shorter than theta_c and no move is blocked. Distances shrink at bounded rates, so one look says for
how many ticks no other is needed (conservative advancement). What then happens at a tick is decided by the same
functions as in the fixed-step engine. ``tests/exact/test_lookahead_bounds.py`` compares each bound with stepping.

| name | unit | meaning |
|---|---|---|
| look | m | rays matter up to the shorter of range and theta_c |
| zone | m | below this distance (two radii and two longest steps) a move may bring two robots into contact |
| sight | m | rays see no robot beyond this distance, centre to centre |
| mid, chord | m, m a tick | approximate position: mid + chord n after n ticks; in a turn, mid is its pivot |
| position error | m | bound on the distance from there |
| gap | m | a distance that must not be used up |
| approach | m a tick | how fast a gap shrinks now |
| swerve | m a tick^2 | how much faster it may shrink with each tick |
"""

from __future__ import annotations

import math

from vibroswarm.core.jit import inlined
from vibroswarm.motion.event.trajectory import Planner, along_arc
from vibroswarm.motion.robot_params import Setup
from vibroswarm.robot.walk import DRIVE, STOP

SIDE_TICKS = 128.0
"""A wall or a robot nearby is looked at again after at most this many ticks."""

ROUNDING_M = 1e-12


@inlined
def set_chord(row: Planner, setup: Setup) -> None:
    """Set a plan's chord and position error, and a driver's pose at its ``self_event_tick``."""
    set_standing(row)
    if row.mode == STOP:
        return
    if row.mode == DRIVE:
        ticks = row.self_event_tick - row.tick
        x_m, y_m, heading_rad, sin_h, cos_h = along_arc(row, ticks * setup.tick_s)
        row.end_x_m, row.end_y_m, row.end_heading_rad = x_m, y_m, heading_rad
        row.end_sin_h, row.end_cos_h = sin_h, cos_h
        if not row.blocked:
            row.chord_x_m, row.chord_y_m = (x_m - row.x_m) / ticks, (y_m - row.y_m) / ticks
            bend = abs(row.rate_rad_s) * ticks * setup.tick_s
            row.position_error_m = row.max_step_m * ticks * (bend / 7.0 if bend < 1.0 else 1.0)
    elif not row.blocked:
        row.mid_x_m -= row.radius_m * row.sin_h
        row.mid_y_m += row.radius_m * row.cos_h
        row.position_error_m = abs(row.radius_m) + ROUNDING_M


@inlined
def set_standing(row: Planner) -> None:
    """Set the chord of a robot that stays where it is."""
    row.mid_x_m, row.mid_y_m = row.x_m, row.y_m
    row.chord_x_m = row.chord_y_m = row.position_error_m = 0.0


@inlined
def maybe_within(row: Planner, x_m: float, y_m: float, distance_m: float, tick: int) -> bool:
    """Whether a robot may be within a distance of a point at ``tick``, by its chord."""
    far = distance_m + row.position_error_m
    return bool(distance2_m2(row, x_m, y_m, tick) < far * far)


@inlined
def distance2_m2(row: Planner, x_m: float, y_m: float, tick: int) -> float:
    """Squared distance from a point to a robot's approximate position at ``tick``, m^2."""
    dx = row.mid_x_m + (tick - row.tick) * row.chord_x_m - x_m
    dy = row.mid_y_m + (tick - row.tick) * row.chord_y_m - y_m
    squared: float = dx * dx + dy * dy
    return squared


@inlined
def encounter_reach_m(row: Planner, setup: Setup, tick: int) -> float:
    """A robot further away than this at ``tick`` cannot matter before this one looks around again, m."""
    far: float = max(setup.zone_m, setup.sight_m)
    own_m = (row.self_event_tick - tick) * row.max_step_m
    return far + (own_m + (row.plan_end_tick - tick) * setup.longest_step_m)


@inlined
def wall_clearance_m(setup: Setup, x_m: float, y_m: float) -> float:
    """Distance from a point to the nearest wall, m."""
    return min(min(x_m, setup.width_m - x_m), min(y_m, setup.height_m - y_m))


@inlined
def avoidance_tick(row: Planner, setup: Setup) -> int:
    """The first tick of a driver's plan at which it heeds its rays: after a turn it may be blind for a while."""
    if setup.blind_ms <= 0.0:
        return int(row.tick + 1)
    return int(row.tick + 1 + max(0, math.ceil((row.sees_from_ms - row.driven_ms) / setup.tick_ms)))


@inlined
def ticks_until_closed(gap: float, approach: float, swerve: float) -> float:
    """Ticks before a gap is used up that shrinks by ``approach`` a tick, and by ``swerve`` more each tick."""
    if gap <= 0.0:
        return 0.0
    below = approach + math.sqrt(approach * approach + 2.0 * swerve * gap)
    return min(2.0 * gap / below, SIDE_TICKS)  # also bounds infinity, without a branch
