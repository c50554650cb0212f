"""Looking ahead: what all of it shares.

Each function of ``walls``, ``meetings`` and ``held`` gives a tick that is never too late: before it no ray is shorter
than theta_c and no move is blocked. Distances shrink at bounded rates, so from one look it is known for how many ticks
there is no need of another (conservative advancement); what then happens at a tick is decided by the same functions as
in the fixed-step engine.

| name | unit | what it is |
|---|---|---|
| look | m | rays matter up to the shorter of range and theta_c |
| zone | m | nearer than this (two radii and two longest steps), a move may bring two robots into contact |
| sight | m | rays see nothing of a robot further away than this, centre to centre |
| mid, chord | m, m a tick | about where a robot is: mid + chord n after n ticks of its plan; mid is a turn's pivot |
| slack | m | how far beside that it may be |
| gap | m | a distance that must not be used up |
| approach | m a tick | how fast a gap shrinks now |
| swerve | m a tick^2 | how much faster it may shrink with each tick |
"""

from __future__ import annotations

import math

from vibroswarm.compiled import inlined
from vibroswarm.motion.body import Setup
from vibroswarm.motion.plans import Planner, along_arc
from vibroswarm.robot.walk import DRIVE, STOP

SIDE_TICKS = 128.0
"""A wall, or another robot that is near, is looked at again after so many ticks at most."""

ROUNDING_M = 1e-12


@inlined
def prepare_to_look(row: Planner, setup: Setup) -> None:
    """Where about a plan that reaches to its ``own_tick`` takes the robot; a driver's pose there."""
    stand_still(row)
    if row.mode == STOP:
        return
    if row.mode == DRIVE:
        ticks = row.own_tick - row.tick
        x_m, y_m, heading_rad, sin_h, cos_h = along_arc(row, ticks * setup.tick_s)
        row.own_x_m, row.own_y_m, row.own_heading_rad = x_m, y_m, heading_rad
        row.own_sin_h, row.own_cos_h = sin_h, cos_h
        if not row.blocked:
            row.chord_x_m, row.chord_y_m = (x_m - row.x_m) / ticks, (y_m - row.y_m) / ticks
            bend = abs(row.rate_rad_s) * ticks * setup.tick_s
            row.slack_m = row.rate_m * ticks * (bend / 7.0 if bend < 1.0 else 1.0)
    elif not row.blocked:
        row.mid_x_m -= row.radius_m * row.sin_h
        row.mid_y_m += row.radius_m * row.cos_h
        row.slack_m = abs(row.radius_m) + ROUNDING_M


@inlined
def stand_still(row: Planner) -> None:
    """About where a robot is that stays where it is."""
    row.mid_x_m, row.mid_y_m = row.x_m, row.y_m
    row.chord_x_m = row.chord_y_m = row.slack_m = 0.0


@inlined
def maybe_within(row: Planner, x_m: float, y_m: float, distance_m: float, tick: int) -> bool:
    """Whether a robot may be within a distance of a point at ``tick``, by its chord."""
    far = distance_m + row.slack_m
    return bool(apart2(row, x_m, y_m, tick) < far * far)


@inlined
def apart2(row: Planner, x_m: float, y_m: float, tick: int) -> float:
    """Squared distance of a point from where about a robot is at ``tick``, m^2."""
    dx = row.mid_x_m + (tick - row.tick) * row.chord_x_m - x_m
    dy = row.mid_y_m + (tick - row.tick) * row.chord_y_m - y_m
    squared: float = dx * dx + dy * dy
    return squared


@inlined
def to_wall_m(setup: Setup, x_m: float, y_m: float) -> float:
    """How far a point is from the nearest wall, m."""
    return min(min(x_m, setup.width_m - x_m), min(y_m, setup.height_m - y_m))


@inlined
def heeds_tick(row: Planner, setup: Setup) -> int:
    """The first tick after its plan's at which a robot that drives heeds its rays: not at once after a turn."""
    if setup.blind_ms <= 0.0:
        return int(row.tick + 1)
    return int(row.tick + 1 + max(0, math.ceil((row.sees_from_ms - row.driven_ms) / setup.tick_ms)))


@inlined
def side_ticks(gap: float, approach: float, swerve: float) -> float:
    """Ticks before a gap that shrinks by ``approach`` a tick, and by ``swerve`` more each tick, is used up."""
    if gap <= 0.0:
        return 0.0
    below = approach + math.sqrt(approach * approach + 2.0 * swerve * gap)
    return min(2.0 * gap / below, SIDE_TICKS)  # infinite ones too: no branch that would be hard to predict
