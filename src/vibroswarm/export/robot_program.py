"""The program of one robot: template of what is exported, with a strategy's functions in place of ``default_hooks``.

A robot is told the time by ``step`` (once a control period), its turn by the gyro, the shortest ray, readings or
acceleration, and messages. Numbers of chance are addressed as in the simulation: a robot that measures and hears the
same does the same, bit by bit.

Order in a control period: a robot that walks hears the messages that came since it last walked, then its timer is
called; one that stands hears nothing until it walks again; a sample ends a stop. What it sends at a period can be heard
from the next one on.
"""

from __future__ import annotations

import math
from typing import Any, Final

from vibroswarm.core.rng import (
    ALONE,
    AVOIDANCE,
    FIRST,
    LOCALISATION,
    OF_TOLD_HEADING,
    OF_TOLD_X,
    OF_TOLD_Y,
    WALK,
    uniform,
)
from vibroswarm.export.robot_memory import (
    LOCALISER,
    PARAMS,
    RMS_THRESHOLD,
    SENSING,
    SENSING_BLIND_MS,
    WALKER,
    WORLD,
    Message,
    Robot,
)
from vibroswarm.inference.agents import (
    begin_draws,
    message_draws,
    sample_draws,
    steering_draws,
    timer_draws,
    world_of_robot,
)
from vibroswarm.inference.default_hooks import (
    HAS_STEER,
    HAS_TIMER,
    begin,
    belief,
    decision,
    next_s,
    on_message,
    on_sample,
    on_timer,
    steer,
)
from vibroswarm.localisation.odometry import normal
from vibroswarm.robot import localisation, pose_mixture
from vibroswarm.robot.sensing import begin_sense, observation, readings, sense_step
from vibroswarm.robot.walk import (
    AVOID,
    DRIVE,
    STOP,
    Dice,
    begin_walk,
    looks,
    steered,
    walk_step,
    wheel_commands_percent,
)
from vibroswarm.strategies.world import Reading

HAS_PLACES: Final = False
"""Whether the robot estimates where it is."""
INBOX: Final = 16
"""Messages that are kept while a robot stands."""
UNKNOWN_M: Final = math.nan

begin_places, add_drive, add_turn, add_obstacle, add_sample = (
    pose_mixture.begin,
    localisation.drive,
    localisation.turn,
    localisation.obstacle,
    localisation.sampled,
)

API: Final = (
    "start", "told_pose", "looks_now", "step", "left_percent", "right_percent", "accelerate", "observed",
    "sample", "receive", "moved", "stopped", "hear", "time_s", "timer", "told_simulated",
)  # fmt: skip
"""Functions that a program around it calls."""


def start(r: Robot, seed: int, run: int, number: int) -> None:
    """Start robot ``number`` at time 0, standing; ``r`` is all zeros before."""
    r.seed, r.run, r.number = seed, run, number
    r.world = world_of_robot(WORLD, number)
    r.walk = begin_walk(WALKER, Dice(uniform(seed, run, number, WALK, FIRST, ALONE), 0.5, 0.5))
    roll(r)
    r.sense = begin_sense()
    r.decision, r.belief, r.decided_s = -1, math.nan, math.nan
    r.move_ray_m = math.nan
    begin(r.state, r.arrays, begin_draws(seed, run, number), PARAMS, r.world)


def told_pose(r: Robot, x_m: float, y_m: float, heading_rad: float) -> None:
    """Tell the robot where it starts: place, m, and heading, rad, anticlockwise from x."""
    if HAS_PLACES:
        word = 1 + math.floor(uniform(r.seed, r.run, r.number, LOCALISATION, FIRST, ALONE) * 4294967295.0)
        begin_places(r.place, LOCALISER, min(word, 4294967295), x_m, y_m, heading_rad)


def told_error(r: Robot, peer: int, spread: float) -> float:
    """Return the error of a start that a robot is told, as simulated."""
    return spread * normal(r.seed, r.run, r.number, LOCALISATION, FIRST, peer)


def told_simulated(r: Robot, x_m: float, y_m: float, heading_rad: float) -> None:
    """Tell the robot its start with the errors that the simulation draws for it."""
    if HAS_PLACES:
        told_pose(
            r,
            x_m + told_error(r, OF_TOLD_X, LOCALISER.start_spread_m),
            y_m + told_error(r, OF_TOLD_Y, LOCALISER.start_spread_m),
            heading_rad + told_error(r, OF_TOLD_HEADING, LOCALISER.start_heading_spread_rad),
        )


def roll(r: Robot) -> None:
    """Draw the numbers of the next leg, the turn before it, and the next avoidance."""
    r.dice = Dice(
        uniform(r.seed, r.run, r.number, WALK, 2 * r.walk.legs, ALONE),
        uniform(r.seed, r.run, r.number, WALK, 2 * r.walk.legs - 1, ALONE),
        uniform(r.seed, r.run, r.number, AVOIDANCE, r.walk.avoidances, ALONE),
    )


def time_s(r: Robot) -> float:
    """Return the time, s."""
    return r.tick * r.world.tick_ms / 1000.0


def looks_now(r: Robot, gyro_deg: float) -> bool:
    """Return whether the next ``step`` reads the rays."""
    return looks(r.walk, WALKER, gyro_deg)


def is_blind(r: Robot) -> bool:
    """Return whether the rays are ignored: in a turn, and for some driving time after it."""
    mode = r.walk.resume if r.walk.mode == STOP else r.walk.mode
    return mode != DRIVE or r.walk.driven_ms < r.sees_from_ms


def step(r: Robot, gyro_deg: float, nearest_mm: float) -> bool:
    """Do one control period; True: take the sample now, and call ``sample`` before the next step.

    Args:
        gyro_deg: turned since the last step, anticlockwise positive. nearest_mm: the shortest ray; read only if
            ``looks_now``.
    """
    r.tick += 1
    r.sends = False
    before = r.walk
    seen_mm = math.inf if SENSING_BLIND_MS > 0.0 and is_blind(r) else nearest_mm
    r.walk = walk_step(before, WALKER, gyro_deg, seen_mm, r.dice)
    if r.walk.legs != before.legs or r.walk.avoidances != before.avoidances:
        roll(r)
    if SENSING_BLIND_MS > 0.0:
        was = before.resume if before.mode == STOP else before.mode
        if was != DRIVE and r.walk.mode == DRIVE:
            r.sees_from_ms = r.walk.driven_ms - WALKER.tick_ms + SENSING_BLIND_MS
    begins_stop = r.walk.mode == STOP and before.mode != STOP
    if HAS_PLACES:
        r.move_turned_deg += gyro_deg
        begins_avoidance = r.walk.avoidances != before.avoidances
        if r.walk.mode != before.mode or begins_avoidance:
            end_move(r, before.mode)
            if begins_avoidance:  # one that goes on after a sample met nothing new
                r.move_ray_m = seen_mm / 1000.0
    if begins_stop:
        r.sense = begin_sense()
        if HAS_PLACES:
            stopped(r)
    if r.walk.mode == STOP:
        return r.walk.sampled
    read_inbox(r)
    if HAS_TIMER and next_s(r.state) * 1000.0 / r.world.tick_ms - 1e-9 <= r.tick:
        timer(r)
    return False


def left_percent(r: Robot) -> float:
    """Return the command of the left wheel until the next step, % of full speed."""
    left, _ = wheel_commands_percent(r.walk, WALKER)
    return left


def right_percent(r: Robot) -> float:
    """Return the command of the right wheel until the next step, % of full speed."""
    _, right = wheel_commands_percent(r.walk, WALKER)
    return right


def accelerate(r: Robot, ax: float, ay: float, az: float) -> None:
    """Process a reading of the accelerometer, at ``SENSING.rate_hz``; only those after settling in a stop count."""
    stands = r.walk.mode == STOP and r.walk.stopped_ms >= SENSING.settle_ms
    if stands and r.sense.taken < readings(SENSING):
        r.sense = sense_step(r.sense, SENSING, ax, ay, az)


def observed(r: Robot) -> int:
    """Return the observation of this stop: 1 if the acceleration's RMS is above the threshold."""
    return observation(r.sense, RMS_THRESHOLD)


def sample(r: Robot, reading: int) -> None:
    """Process a sample: update the belief, decide; ``r.sends`` says whether ``r.out`` is to be sent to all."""
    t_s, k = time_s(r), r.samples
    if HAS_PLACES:
        x = Reading(
            reading, t_s, k, r.estimate[0], r.estimate[1], r.estimate[2], r.estimate[3], int(r.estimate[4]),
            r.estimate[5], r.estimate[6], r.estimate[7], r.estimate[8],
        )  # fmt: skip
        process(r, x, k)
    else:
        unknown = Reading(
            reading, t_s, k, UNKNOWN_M, UNKNOWN_M, UNKNOWN_M, UNKNOWN_M, k, UNKNOWN_M, UNKNOWN_M, UNKNOWN_M,
            UNKNOWN_M,
        )  # fmt: skip
        process(r, unknown, k)
    r.samples += 1
    r.sampled_s = t_s


def process(r: Robot, x: Reading, k: int) -> None:
    """Call the strategy with sample ``k``."""
    r.out = Message()
    r.sends = on_sample(
        r.state, r.arrays, x, r.out, sample_draws(r.seed, r.run, r.number, k, -1.0), PARAMS, r.world
    )
    after_event(r)
    if HAS_STEER:
        turn_deg, drive_ms = steer(
            r.state, r.arrays, x, steering_draws(r.seed, r.run, r.number, k), PARAMS, r.world
        )
        r.walk = steered(r.walk, turn_deg, drive_ms)


def timer(r: Robot) -> None:
    """Call the strategy's timer."""
    r.out = Message()
    r.sends = on_timer(
        r.state,
        r.arrays,
        time_s(r),
        r.out,
        timer_draws(r.seed, r.run, r.number, r.timers),
        PARAMS,
        r.world,
    )
    r.timers += 1
    after_event(r)


def after_event(r: Robot) -> None:
    """Note belief and decision after a sample or timer, and count what is sent."""
    r.belief = belief(r.state, r.arrays, PARAMS, r.world)
    found = decision(r.state, r.arrays, PARAMS, r.world)
    if found != r.decision:
        r.decision = found
        r.decided_s = time_s(r)
    if r.sends:
        r.sent += 1


def receive(r: Robot, sender: int, number: int, message: Message) -> bool:
    """Keep a message until the robot walks; False if there is no room, and it is lost.

    Args:
        sender: number of the robot that sent it. number: index among its messages, from 0.
    """
    if r.waiting == INBOX:
        r.dropped += 1
        return False
    r.inbox[r.waiting] = message
    r.inbox_sender[r.waiting], r.inbox_number[r.waiting] = sender, number
    r.waiting += 1
    return True


def read_inbox(r: Robot) -> None:
    """Hear the messages that wait."""
    for k in range(r.waiting):
        hear(r, r.inbox_sender[k], r.inbox_number[k], r.inbox[k])
    r.waiting = 0


def hear(r: Robot, sender: int, number: int, message: Message) -> None:
    """Hear a message now."""
    on_message(
        r.state,
        r.arrays,
        message,
        sender,
        time_s(r),
        message_draws(r.seed, r.run, r.number, sender, number),
        PARAMS,
        r.world,
    )
    r.heard += 1


def end_move(r: Robot, kind: int) -> None:
    """End the drive, turn or avoidance that was under way, and begin the next."""
    duration_s = time_s(r) - r.move_start_s
    moved(
        r,
        kind,
        duration_s,
        math.radians(r.move_turned_deg),
        r.move_ray_m,
        r.move_after_drive,
        r.walk.mode == AVOID,
    )
    r.move_after_drive = kind == DRIVE and duration_s > 1.5 * r.world.tick_s
    r.move_start_s, r.move_turned_deg = time_s(r), 0.0
    r.move_ray_m = math.nan


def moved(
    r: Robot,
    kind: int,
    duration_s: float,
    turned_rad: float,
    ray_m: float,
    after_drive: bool,
    at_obstacle: bool,
) -> None:
    """Tell localisation of a move that has ended.

    Args:
        kind: DRIVE, TURN, AVOID or STOP. turned_rad: as the gyro measured. ray_m: shortest ray as an avoidance began;
            nan: none began. after_drive: whether a drive of two periods or more was before it. at_obstacle: whether an
            avoidance follows.
    """
    if HAS_PLACES:
        if kind == DRIVE:
            add_drive(r.place, LOCALISER, duration_s, turned_rad, r.sampled_s, at_obstacle)
        elif kind != STOP:
            if not math.isnan(ray_m):
                add_obstacle(r.place, LOCALISER, ray_m, after_drive)
            add_turn(r.place, LOCALISER, duration_s, turned_rad)


def stopped(r: Robot) -> None:
    """Tell localisation that a stop for a sample has begun."""
    if HAS_PLACES:
        add_sample(r.place, LOCALISER, r.estimate)


def hear_bit(s: Any, a: Any, m: Any, sender: int, t_s: float, d: Any, p: Any, w: Any) -> None:
    """Count a bit, for strategies that count bits."""
    on_counts(s, m.bit, 1 - m.bit, p, w)


def no_belief(s: Any, a: Any, p: Any, w: Any) -> float:
    """Return nan: the strategy keeps no belief."""
    return math.nan


def timer_of_state(s: Any) -> float:
    """Return the time at which the timer is due, s."""
    found: float = s.next_s
    return found


def on_counts(s: Any, ones: int, zeros: int, p: Any, w: Any) -> None:
    """Stand for a strategy's function."""


def belief_of_posterior(alpha: int, beta: int, w: Any) -> float:
    """Return the belief, computed each time: a robot has no table of beliefs."""
    return posterior_below(alpha, beta, w.boundary)


def posterior_below(alpha: int, beta: int, boundary: float) -> float:
    """Stand for ``robot.belief.belief_below``."""
    return math.nan
