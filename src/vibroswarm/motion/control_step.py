"""One control period of a swarm in named phases: sense, control, move, contact.

A robot's move is here its way in one control period. Each phase changes ``Swarm``, the whole state between two ticks,
in place. ``setup`` is the scenario's parameters (``robot_params.Setup``), ``i`` the number of a robot. Random numbers
of a robot's walk are drawn ahead and stored in its row (``dice_...``). They are addressed by the number of legs or of
avoidances begun, so a robot's walk does not depend on the order in which robots are simulated.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import allocating_kernel, inlined, inner, kernel
from vibroswarm.core.rng import ALONE, AVOIDANCE, FIRST, OF_HEADING, OF_SITE, PLACEMENT, WALK, uniform
from vibroswarm.motion.geometry import arc, disc_distance, wall_distance
from vibroswarm.motion.robot_params import AT_ONCE, Setup, draw_speed_factors, draw_veer_shifts, misalignment
from vibroswarm.robot.walk import (
    AVOID,
    DRIVE,
    STOP,
    TURN,
    Dice,
    WalkState,
    begin_walk,
    looks,
    walk_step,
    wheel_commands_percent,
)

ROBOT = np.dtype(
    [(name, np.float64) for name in ("x_m", "y_m", "heading_rad", "from_x_m", "from_y_m", "from_heading_rad")]
    + [(name, np.float64) for name in ("misalignment", "speed_factor", "battery")]
    + [(name, np.float64) for name in ("speed_m_s", "rate_rad_s", "gyro_deg", "nearest_mm")]
    + [(name, np.int64) for name in ("stop_tick", "stop_ticks", "drive_ticks", "turn_ticks", "avoid_ticks")]
    + [(name, np.float64) for name in ("dice_leg", "dice_turn", "dice_avoid")]
    + [(name, np.float64, (AT_ONCE,)) for name in ("speed_factors", "veer_shifts")]
    + [("drawn", np.float64, (2, AT_ONCE))]
    + [(name, np.int64) for name in ("mode", "resume", "sampled", "driven_ms", "timer_ms", "stopped_ms")]
    + [(name, np.int64) for name in ("legs", "avoidances", "samples", "blocked")]
    + [(name, np.int64) for name in ("fails_tick", "silent_tick", "failed", "blocked_ticks")]
    + [
        (name, np.float64)
        for name in ("leg_ms", "error_deg", "integral_deg_s", "next_leg_ms", "sees_from_ms", "ray_forward_m")
    ]
)
"""One robot between two ticks.

* ``x_m`` to ``heading_rad``: its pose; ``from_``: after ``contact``, its pose one tick before.
* ``misalignment``, ``speed_factor``, ``battery``: its own wheel parameters.
* ``speed_m_s``, ``rate_rad_s``: of the current control period; if the move is blocked, speed 0 and ``blocked`` 1.
* ``gyro_deg``, ``nearest_mm``: readings of gyro and rays. ``ray_forward_m``: how far ahead its rays start.
* ``stop_tick``: when its latest stop began; for a robot that has failed, see ``fail``. ``stop_ticks`` to
  ``avoid_ticks``: control periods spent in each mode since its latest sample.
* ``dice_``: its ``Dice``. ``speed_factors``, ``veer_shifts``: its speed factors, and the shifts of its
  misalignment, from AT_ONCE consecutive samples on. ``drawn``: room for their random numbers.
* ``mode`` to ``samples``, ``leg_ms`` to ``next_leg_ms``: the ``WalkState`` of its program. ``sees_from_ms``: driving
  time from which it uses its rays.
* ``fails_tick``, ``silent_tick``: ticks from which it stands for good, and from which it is silent too (NEVER_FAILS:
  never). ``failed``: 1 if it stands for good now.
* ``blocked_ticks``: of ``drive_ticks``, those in which the move was blocked.
"""

NEVER_FAILS: Final = 2**40
"""A tick beyond all runs; also the end of the plan of a robot that stands for good."""

Swarm = NDArray[np.void]
"""The robots of one run: ``ROBOT``, shape (robots,). One array: compiled code passes it on at no cost."""


@inlined
def load(swarm: Swarm, i: int) -> WalkState:
    """Return the state of robot ``i``'s program."""
    row = swarm[i]
    return WalkState(
        row.mode, row.resume, row.sampled != 0, row.leg_ms, row.driven_ms, row.timer_ms, row.stopped_ms,
        row.error_deg, row.integral_deg_s, row.legs, row.avoidances, row.samples, row.next_leg_ms,
    )  # fmt: skip


@inlined
def store(swarm: Swarm, i: int, state: WalkState) -> None:
    """Write the state of robot ``i``'s program into its row; the inverse of ``load``."""
    row = swarm[i]
    row.mode, row.resume, row.sampled = state.mode, state.resume, state.sampled
    row.leg_ms, row.driven_ms, row.timer_ms = state.leg_ms, state.driven_ms, state.timer_ms
    row.stopped_ms, row.error_deg, row.integral_deg_s = (
        state.stopped_ms,
        state.error_deg,
        state.integral_deg_s,
    )
    row.legs, row.avoidances, row.samples = state.legs, state.avoidances, state.samples
    row.next_leg_ms = state.next_leg_ms


@inner
def roll(swarm: Swarm, i: int, seed: int, run: int, legs: int, avoidances: int) -> None:
    """Draw the random numbers of robot ``i``'s next leg, turn and avoidance."""
    roll_leg(swarm, i, seed, run, legs)
    roll_avoidance(swarm, i, seed, run, avoidances)


@inner
def roll_leg(swarm: Swarm, i: int, seed: int, run: int, legs: int) -> None:
    """Draw the random numbers of robot ``i``'s next leg (index 2 legs) and of the turn before that leg (2 legs - 1)."""
    swarm[i].dice_leg = uniform(seed, run, i, WALK, 2 * legs, ALONE)
    swarm[i].dice_turn = uniform(seed, run, i, WALK, 2 * legs - 1, ALONE)


@inner
def roll_avoidance(swarm: Swarm, i: int, seed: int, run: int, avoidances: int) -> None:
    """Draw the random number of robot ``i``'s next avoidance, addressed by the number of avoidances begun."""
    swarm[i].dice_avoid = uniform(seed, run, i, AVOIDANCE, avoidances, ALONE)


@kernel
def begin(swarm: Swarm, setup: Setup, speeds: NDArray[np.float64], seed: int, run: int) -> bool:
    """Set the state at tick 0: robots placed, standing, their first leg drawn; return whether all found a place."""
    for i in range(swarm.size):
        swarm[i].heading_rad = math.pi * (2.0 * uniform(seed, run, i, PLACEMENT, FIRST, OF_HEADING) - 1.0)
        swarm[i].misalignment = misalignment(setup, seed, run, i)
        swarm[i].samples = 0
        swarm[i].ray_forward_m = setup.ray_forward_m
        # ``robot_params.give_each`` sets the ticks of robots that fail.
        swarm[i].fails_tick = swarm[i].silent_tick = NEVER_FAILS
        refresh(swarm, setup, speeds, seed, run, i, 0)  # at tick 0
        clear_account(swarm, i)
        swarm[i].stop_ticks = 1  # the robot stands for the control period of tick 0
        swarm[i].gyro_deg = 0.0
        swarm[i].stop_tick = 0  # the tick at which this stop began
        # The walk begins with a leg, so only the leg's number is used here; 0.5 stands for those of turn and avoidance.
        # ``roll`` then draws the numbers of the next leg, turn and avoidance.
        first = Dice(uniform(seed, run, i, WALK, FIRST, ALONE), 0.5, 0.5)
        store(swarm, i, begin_walk(setup, first))
        roll(swarm, i, seed, run, swarm[i].legs, swarm[i].avoidances)
    return place(swarm, setup, seed, run)


@inner
def place(swarm: Swarm, setup: Setup, seed: int, run: int) -> bool:
    """Place the robots at random in the start region, without overlap; return False if one finds no room in 1000
    tries."""
    # Bounds of the start region: x from left to right, y from low to high.
    left, right, low, high = setup.start[0], setup.start[1], setup.start[2], setup.start[3]
    for i in range(swarm.size):
        placed = False
        for attempt in range(1000):
            swarm[i].x_m = left + (right - left) * uniform(seed, run, i, PLACEMENT, 2 * attempt, ALONE)
            swarm[i].y_m = low + (high - low) * uniform(seed, run, i, PLACEMENT, 2 * attempt + 1, ALONE)
            # Only the robots 0 to i - 1 have their places yet: compare with these first ``i`` robots.
            if not touches(swarm, setup, i, i, swarm[i].x_m, swarm[i].y_m):
                placed = True
                break
        if not placed:
            return False
    return True


@allocating_kernel
def place_on_lattice(swarm: Swarm, setup: Setup, seed: int, run: int) -> None:
    """Place the robots on different random sites of a lattice that fills the start region (Fisher-Yates shuffle)."""
    # ``setup.start`` holds the bounds of the start region: least x, greatest x, least y, greatest y.
    columns, rows = setup.lattice[0], setup.lattice[1]
    sites = np.arange(columns * rows)
    # Distances between neighbouring sites. A single column (or row) has the number 0, so its distance does not matter.
    pitch_x = (setup.start[1] - setup.start[0]) / max(columns - 1, 1)
    pitch_y = (setup.start[3] - setup.start[2]) / max(rows - 1, 1)
    for i in range(swarm.size):
        # Swap ``sites[i]`` with a random one of sites[i], sites[i + 1], ..., which no robot has taken yet. Sites are
        # numbered row by row.
        other = i + int((sites.size - i) * uniform(seed, run, i, PLACEMENT, FIRST, OF_SITE))
        sites[i], sites[other] = sites[other], sites[i]
        swarm[i].x_m = setup.start[0] + pitch_x * (sites[i] % columns)
        swarm[i].y_m = setup.start[2] + pitch_y * (sites[i] // columns)


@inner
def touches(swarm: Swarm, setup: Setup, i: int, count: int, x_m: float, y_m: float) -> bool:
    """Return whether robot ``i``, placed at (x_m, y_m), would overlap another one of the first ``count`` robots."""
    # Bodies overlap if the squared distance of their centres is below this.
    least_squared_m2 = 4.0 * setup.radius_m * setup.radius_m
    for j in range(count):
        dx, dy = swarm[j].x_m - x_m, swarm[j].y_m - y_m
        if j != i and dx * dx + dy * dy < least_squared_m2:
            return True
    return False


@kernel
def sense(swarm: Swarm, setup: Setup) -> None:
    """Set ``nearest_mm``, the shortest ray (infinite if ``is_blind``), of each robot whose program reads it now."""
    for i in range(swarm.size):
        if setup.blind_ms > 0.0 and is_blind(swarm, i):
            swarm[i].nearest_mm = math.inf
        elif looks(load(swarm, i), setup, swarm[i].gyro_deg):
            swarm[i].nearest_mm = 1000.0 * nearest_m(swarm, setup, i)


@inner
def is_blind(swarm: Swarm, i: int) -> bool:
    """Return whether robot ``i`` ignores its rays: while it turns or avoids, and for ``blind_ms`` of driving then."""
    row = swarm[i]
    mode = row.resume if row.mode == STOP else row.mode  # a stop may interrupt a turn
    return bool(mode != DRIVE or row.driven_ms < row.sees_from_ms)


@inner
def note_turns_end(swarm: Swarm, setup: Setup, i: int, before: WalkState, after: WalkState) -> None:
    """Set ``sees_from_ms``, the driving time from which robot ``i`` uses its rays again, if a turn has just ended."""
    mode_before = before.resume if before.mode == STOP else before.mode
    if mode_before != DRIVE and after.mode == DRIVE:
        # The driving time of the coming period is already counted in ``after``.
        swarm[i].sees_from_ms = after.driven_ms - setup.tick_ms + setup.blind_ms


@kernel
def nearest_m(swarm: Swarm, setup: Setup, i: int) -> float:
    """Return the shortest of robot ``i``'s rays to a wall or to another robot, m; infinite beyond ``look_m``."""
    # Only walls and robots that a ray can reach are tried. ``ray_reach_m``: how far rays reach from the robot's centre.
    x, y, reach = swarm[i].x_m, swarm[i].y_m, setup.ray_reach_m
    near_wall = x < reach or y < reach or setup.width_m - x < reach or setup.height_m - y < reach
    shortest_m = math.inf
    ahead_x, ahead_y = math.cos(swarm[i].heading_rad), math.sin(swarm[i].heading_rad)
    if near_wall:
        shortest_m = rays_to_walls(setup, swarm[i].ray_forward_m, x, y, ahead_x, ahead_y)
    reach += setup.disc_radius_m
    for j in range(swarm.size):
        dx, dy = swarm[j].x_m - x, swarm[j].y_m - y
        if j != i and dx * dx + dy * dy < reach * reach:
            disc = rays_to_disc(
                setup, swarm[i].ray_forward_m, x, y, ahead_x, ahead_y, swarm[j].x_m, swarm[j].y_m
            )
            shortest_m = min(shortest_m, disc)
    return shortest_m if shortest_m <= setup.look_m else math.inf


@inlined
def ray(
    setup: Setup, k: int, forward_m: float, x_m: float, y_m: float, ahead_x: float, ahead_y: float
) -> tuple[float, float, float, float]:
    """Return start and direction in the arena (x, y, x, y) of ray ``k``; arguments as of ``rays_to_walls``."""
    from_x = x_m + forward_m * ahead_x - setup.ray_side_m[k] * ahead_y
    from_y = y_m + forward_m * ahead_y + setup.ray_side_m[k] * ahead_x
    dx = ahead_x * setup.ray_cos[k] - ahead_y * setup.ray_sin[k]
    return from_x, from_y, dx, ahead_y * setup.ray_cos[k] + ahead_x * setup.ray_sin[k]


@inner
def rays_to_walls(
    setup: Setup, forward_m: float, x_m: float, y_m: float, ahead_x: float, ahead_y: float
) -> float:
    """Return the shortest ray to a wall, m, for a robot at (x_m, y_m) that faces the unit vector (ahead_x, ahead_y)."""
    shortest_m = math.inf
    for k in range(setup.ray_side_m.size):
        from_x, from_y, dx, dy = ray(setup, k, forward_m, x_m, y_m, ahead_x, ahead_y)
        shortest_m = min(shortest_m, wall_distance(from_x, from_y, dx, dy, setup.width_m, setup.height_m))
    return shortest_m


@inner
def rays_to_disc(
    setup: Setup, forward_m: float, x_m: float, y_m: float, ahead_x: float, ahead_y: float,
    disc_x_m: float, disc_y_m: float,
) -> float:  # fmt: skip
    """Return the shortest ray to another robot, a disc at (disc_x_m, disc_y_m), m; infinite if every ray misses it."""
    shortest_m = math.inf
    for k in range(setup.ray_side_m.size):
        from_x, from_y, dx, dy = ray(setup, k, forward_m, x_m, y_m, ahead_x, ahead_y)
        shortest_m = min(
            shortest_m, disc_distance(from_x, from_y, dx, dy, disc_x_m, disc_y_m, setup.disc_radius_m)
        )
    return shortest_m


@kernel
def control(swarm: Swarm, setup: Setup, seed: int, run: int, tick: int) -> int:
    """Step each robot's program, and set the speed and turn rate that follow; return how many robots sample."""
    sampling = 0
    for i in range(swarm.size):
        sampling += control_one(swarm, setup, seed, run, tick, i)
    return sampling


@inlined
def control_one(swarm: Swarm, setup: Setup, seed: int, run: int, tick: int, i: int) -> int:
    """Step robot ``i``'s program, and set the speed and turn rate that follow; return 1 if it samples, else 0."""
    before = load(swarm, i)
    row = swarm[i]
    # A robot whose failure is due during a stop still completes the stop and takes its sample, and fails at its next
    # step. A robot that has failed (``row.failed``) stays in mode STOP without a sample; ``fail`` handles each of its
    # further steps.
    if tick >= row.fails_tick and (before.mode != STOP or before.sampled or row.failed):
        fail(swarm, i, tick)
        return 0
    dice = Dice(row.dice_leg, row.dice_turn, row.dice_avoid)
    after = walk_step(before, setup, row.gyro_deg, row.nearest_mm, dice)
    store(swarm, i, after)
    if after.legs != before.legs:
        roll_leg(swarm, i, seed, run, after.legs)
    if after.avoidances != before.avoidances:
        roll_avoidance(swarm, i, seed, run, after.avoidances)
    if after.mode == STOP and before.mode != STOP:
        row.stop_tick = tick
    if setup.blind_ms > 0.0:
        note_turns_end(swarm, setup, i, before, after)
    left, right = wheel_commands_percent(after, setup)  # % of full speed
    m_s_per_percent = 0.01 * setup.full_speed_m_s * row.speed_factor * row.battery
    left_m_s = left * m_s_per_percent * (1.0 - row.misalignment)  # Eq. 19a
    right_m_s = right * m_s_per_percent * (1.0 + row.misalignment)  # Eq. 19b
    track_m = setup.drive_track_m if after.mode == DRIVE else setup.turn_track_m
    row.speed_m_s = 0.5 * (left_m_s + right_m_s)
    row.rate_rad_s = (right_m_s - left_m_s) / track_m
    return 1 if after.sampled else 0


@inlined
def fail(swarm: Swarm, i: int, tick: int) -> None:
    """Make robot ``i`` stand for good from this tick on, as if in a stop that never ends with a sample.

    ``stop_tick`` of a standing robot is the tick from which it hears no messages, or -1 while it hears them: a failed
    robot hears until its ``silent_tick``.
    """
    row = swarm[i]
    if not row.failed:
        if row.mode != STOP or tick < row.silent_tick:
            row.stop_tick = -1
        row.failed, row.mode, row.sampled = 1, STOP, 0
    if row.stop_tick < 0 and tick >= row.silent_tick:
        row.stop_tick = tick
    row.speed_m_s = row.rate_rad_s = 0.0


@kernel
def move(swarm: Swarm, setup: Setup) -> None:
    """Write the pose that each robot would have at the next tick, if nothing were in its way, to ``from_...``."""
    for i in range(swarm.size):
        row = swarm[i]
        row.gyro_deg = math.degrees(row.rate_rad_s * setup.tick_s)
        if row.mode == STOP:
            row.from_x_m, row.from_y_m, row.from_heading_rad = row.x_m, row.y_m, row.heading_rad
        else:
            row.from_x_m, row.from_y_m, row.from_heading_rad = arc(
                row.x_m, row.y_m, row.heading_rad, row.speed_m_s, row.rate_rad_s, setup.tick_s
            )


@kernel
def blocked(swarm: Swarm, setup: Setup, i: int) -> bool:
    """Return whether robot ``i``'s move, whose end ``move`` has written, would end in a wall or in another robot."""
    x, y, r = swarm[i].from_x_m, swarm[i].from_y_m, setup.radius_m
    if x < r or y < r or x > setup.width_m - r or y > setup.height_m - r:
        return True
    return touches(swarm, setup, i, swarm.size, x, y)


@kernel
def contact(swarm: Swarm, setup: Setup) -> None:
    """Move the robots, in order, to the poses of ``move``, unless blocked; ``from_...`` is then the pose before."""
    for i in range(swarm.size):
        swarm[i].blocked = 0
        if swarm[i].speed_m_s != 0.0 and blocked(swarm, setup, i):
            swarm[i].speed_m_s, swarm[i].blocked = 0.0, 1
            swarm[i].from_x_m, swarm[i].from_y_m = swarm[i].x_m, swarm[i].y_m
        # Exchange the two poses: ``from_...`` held the new pose until now, and holds the old one from now on.
        swarm[i].x_m, swarm[i].from_x_m = swarm[i].from_x_m, swarm[i].x_m
        swarm[i].y_m, swarm[i].from_y_m = swarm[i].from_y_m, swarm[i].y_m
        swarm[i].heading_rad, swarm[i].from_heading_rad = swarm[i].from_heading_rad, swarm[i].heading_rad


@inner
def refresh(
    swarm: Swarm, setup: Setup, speeds: NDArray[np.float64], seed: int, run: int, i: int, tick: int
) -> None:
    """Update what changes at a sample of robot ``i``: speed factor, misalignment (veer) and battery."""
    index = swarm[i].samples % AT_ONCE
    if index == 0:  # all of the AT_ONCE factors drawn before are used up
        draw_speed_factors(
            swarm[i].speed_factors, swarm[i].drawn, setup, speeds, seed, run, i, swarm[i].samples
        )
    swarm[i].speed_factor = swarm[i].speed_factors[index]
    if setup.misalignment_wander + setup.misalignment_drift > 0.0:
        before = swarm[i].veer_shifts[index - 1 if index > 0 else AT_ONCE - 1]
        if index == 0:
            draw_veer_shifts(swarm[i].veer_shifts, swarm[i].drawn, setup, seed, run, i, swarm[i].samples)
        # Before the first sample the misalignment stays: ``robot_params.begin_veer`` adds the first shift.
        if swarm[i].samples > 0:
            swarm[i].misalignment += swarm[i].veer_shifts[index] - before
    swarm[i].battery = 1.0 - tick * setup.tick_s / setup.battery_life_s


@kernel
def account(swarm: Swarm) -> None:
    """Add the current control period to each robot's time in its mode."""
    for i in range(swarm.size):
        row = swarm[i]
        if row.mode == DRIVE:
            row.drive_ticks += 1
            row.blocked_ticks += row.blocked
        elif row.mode == TURN:
            row.turn_ticks += 1
        elif row.mode == AVOID:
            row.avoid_ticks += 1
        else:
            row.stop_ticks += 1


@inner
def clear_account(swarm: Swarm, i: int) -> None:
    """Set robot ``i``'s times in each mode to 0, as they are counted since its latest sample."""
    row = swarm[i]
    row.drive_ticks = row.turn_ticks = row.avoid_ticks = row.stop_ticks = row.blocked_ticks = 0
