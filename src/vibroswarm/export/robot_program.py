"""The program of one robot: the template that is exported to C.

An exporter replaces the functions of ``default_hooks`` by a strategy's hooks, and the constants of ``robot_memory`` by
those of a scenario. A robot ``r`` is a ``robot_memory.Robot``, which the functions change in place. The surrounding
program calls the functions named in ``API``: ``step`` once per tick (control period) with the angle turned, by the
gyro, and the shortest ray; ``accelerate`` with readings of the accelerometer, or ``sample`` with an observation; and
``receive`` with messages. Random numbers have the same addresses as in the simulation, so a robot that measures and
hears the same does the same, bit by bit.

Order in a tick: a robot that walks hears the messages received since it last walked, then its timer is called if it is
due. A robot that stands hears nothing until it walks again. A stop ends with a sample. A message sent in a tick can be
heard from the next tick on.
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
"""Greatest number of messages that are kept while a robot stands."""
UNKNOWN_M: Final = math.nan
"""Place of a robot that does not estimate it; its strategy does not read it."""

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
"""Functions that the surrounding program calls."""


def start(r: Robot, seed: int, run: int, number: int) -> None:
    """Start a robot at time 0, standing. All of ``r`` must be zero before.

    Args:
        seed, run, number: seed of the simulation, number of the run, and number of the robot, which give its random
            numbers.
    """
    r.seed, r.run, r.number = seed, run, number
    r.world = world_of_robot(WORLD, number)
    # Only the number of the first leg is used; ``roll`` then draws those of the next leg, turn and avoidance.
    r.walk = begin_walk(WALKER, Dice(uniform(seed, run, number, WALK, FIRST, ALONE), 0.5, 0.5))
    roll(r)
    r.sense = begin_sense()
    r.decision, r.belief, r.decided_s = -1, math.nan, math.nan
    r.move_ray_m = math.nan
    begin(r.state, r.arrays, begin_draws(seed, run, number), PARAMS, r.world)


def told_pose(r: Robot, x_m: float, y_m: float, heading_rad: float) -> None:
    """Tell the robot where it starts: place, m, and heading, rad, anticlockwise from x.

    It is called after ``start``, which sets the address of random numbers. A robot that does not estimate its place
    ignores it.
    """
    if HAS_PLACES:
        # State of localisation's own random numbers: a whole number from 1 to 2^32 - 1. min() is needed in single
        # precision, where the product may be rounded up.
        word = 1 + math.floor(uniform(r.seed, r.run, r.number, LOCALISATION, FIRST, ALONE) * 4294967295.0)
        begin_places(r.place, LOCALISER, min(word, 4294967295), x_m, y_m, heading_rad)


def told_error(r: Robot, peer: int, spread: float) -> float:
    """Return a random error of x, y or heading at the start: normal, with standard deviation ``spread``.

    The simulation draws the same error. ``peer`` selects the coordinate: ``OF_TOLD_X``, ``OF_TOLD_Y`` or
    ``OF_TOLD_HEADING``.
    """
    return spread * normal(r.seed, r.run, r.number, LOCALISATION, FIRST, peer)


def told_simulated(r: Robot, x_m: float, y_m: float, heading_rad: float) -> None:
    """Tell the robot its true start (place, m, and heading, rad) plus the errors that the simulation draws for it."""
    if HAS_PLACES:
        told_pose(
            r,
            x_m + told_error(r, OF_TOLD_X, LOCALISER.start_spread_m),
            y_m + told_error(r, OF_TOLD_Y, LOCALISER.start_spread_m),
            heading_rad + told_error(r, OF_TOLD_HEADING, LOCALISER.start_heading_spread_rad),
        )


def roll(r: Robot) -> None:
    """Draw the uniform numbers of the next leg, of the turn before it, and of the next avoidance.

    In the addresses of a walk, index 2 k is leg k and index 2 k - 1 is the turn before leg k.
    """
    r.dice = Dice(
        uniform(r.seed, r.run, r.number, WALK, 2 * r.walk.legs, ALONE),
        uniform(r.seed, r.run, r.number, WALK, 2 * r.walk.legs - 1, ALONE),
        uniform(r.seed, r.run, r.number, AVOIDANCE, r.walk.avoidances, ALONE),
    )


def time_s(r: Robot) -> float:
    """Return the time since the start, s."""
    return r.tick * r.world.tick_ms / 1000.0


def looks_now(r: Robot, gyro_deg: float) -> bool:
    """Return whether the next ``step``, called with the same ``gyro_deg``, needs the shortest ray."""
    return looks(r.walk, WALKER, gyro_deg)


def is_blind(r: Robot) -> bool:
    """Return whether the rays are ignored: in a turn or avoidance, and for some driving time after it.

    In a stop, it depends on the mode in which the robot will go on after the stop. The function is called only if
    ``SENSING_BLIND_MS`` is above 0; otherwise a robot never ignores its rays.
    """
    mode = r.walk.resume if r.walk.mode == STOP else r.walk.mode
    return mode != DRIVE or r.walk.driven_ms < r.sees_from_ms


def step(r: Robot, gyro_deg: float, nearest_mm: float) -> bool:
    """Do one tick; return True to take the sample now, and then call ``sample`` before the next step.

    If it returns False and ``r.sends`` is true, send ``r.out`` to all robots: the message of the timer.

    Args:
        gyro_deg: angle turned since the last step, anticlockwise positive. nearest_mm: the shortest ray; used only if
            ``looks_now(r, gyro_deg)`` was true before the step.
    """
    r.tick += 1
    r.sends = False
    before = r.walk
    # A robot that ignores its rays sees no obstacle at any distance.
    seen_mm = math.inf if SENSING_BLIND_MS > 0.0 and is_blind(r) else nearest_mm
    r.walk = walk_step(before, WALKER, gyro_deg, seen_mm, r.dice)
    # A new leg or avoidance has used the numbers in r.dice, so new ones are drawn.
    if r.walk.legs != before.legs or r.walk.avoidances != before.avoidances:
        roll(r)
    if SENSING_BLIND_MS > 0.0:
        # was: the mode until now or, in a stop, the mode in which the robot was to go on.
        was = before.resume if before.mode == STOP else before.mode
        # A turn or avoidance has ended; driven_ms counts the present tick already, so one tick is subtracted.
        if was != DRIVE and r.walk.mode == DRIVE:
            r.sees_from_ms = r.walk.driven_ms - WALKER.tick_ms + SENSING_BLIND_MS
    begins_stop = r.walk.mode == STOP and before.mode != STOP
    if HAS_PLACES:
        r.move_turned_deg += gyro_deg
        # A move ends when the mode changes, or when one avoidance follows another.
        begins_avoidance = r.walk.avoidances != before.avoidances
        if r.walk.mode != before.mode or begins_avoidance:
            end_move(r, before.mode)
            # An avoidance that goes on after a sample has met no new obstacle: move_ray_m stays nan, as set by
            # ``end_move``.
            if begins_avoidance:
                r.move_ray_m = seen_mm / 1000.0
    if begins_stop:
        r.sense = begin_sense()
        if HAS_PLACES:
            stopped(r)
    if r.walk.mode == STOP:
        return r.walk.sampled
    read_inbox(r)
    # The time of the timer in ticks, with a margin for rounding.
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
    """Process a reading of the accelerometer, made at ``SENSING.rate_hz``: acceleration along three axes.

    The unit is that of ``RMS_THRESHOLD``. Readings count only in a stop, after the robot has settled, and up to the
    number that a sample takes.
    """
    stands = r.walk.mode == STOP and r.walk.stopped_ms >= SENSING.settle_ms
    if stands and r.sense.taken < readings(SENSING):
        r.sense = sense_step(r.sense, SENSING, ax, ay, az)


def observed(r: Robot) -> int:
    """Return the observation of this stop: 1 if the RMS of the filtered acceleration is above the threshold, else 0.

    Before the first reading of the stop the RMS is 0.
    """
    return observation(r.sense, RMS_THRESHOLD)


def sample(r: Robot, reading: int) -> None:
    """Process a sample: update the belief and decide; if ``r.sends`` is then true, send ``r.out`` to all robots.

    Args:
        reading: the observation, 0 or 1.
    """
    t_s, k = time_s(r), r.samples
    # ``estimate`` holds the fields of a ``Reading`` from x_m on, in order: pose and spread of the robot; then number,
    # place and spreads of the lagged sample, the one taken ``localisation.lag`` samples ago.
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
    """Call the strategy's ``on_sample``, and ``steer`` if it has one, with reading ``x`` of sample ``k``."""
    r.out = Message()
    # -1.0: the first random number of the call is not known in advance.
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
    """Call the strategy's ``on_timer``; if ``r.sends`` is then true, ``r.out`` is to be sent."""
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
    """Store the belief, and a new decision with its time, after a sample or timer; count the message if one is sent."""
    r.belief = belief(r.state, r.arrays, PARAMS, r.world)
    found = decision(r.state, r.arrays, PARAMS, r.world)
    if found != r.decision:
        r.decision = found
        r.decided_s = time_s(r)
    if r.sends:
        r.sent += 1


def receive(r: Robot, sender: int, number: int, message: Message) -> bool:
    """Keep a message until the robot walks; return False if the inbox is full, and the message is lost.

    Args:
        sender: number of the robot that sent the message. number: index among that robot's messages, from 0.
    """
    if r.waiting == INBOX:
        r.dropped += 1
        return False
    r.inbox[r.waiting] = message
    r.inbox_sender[r.waiting], r.inbox_number[r.waiting] = sender, number
    r.waiting += 1
    return True


def read_inbox(r: Robot) -> None:
    """Hear the messages in the inbox, in the order in which they came, and empty it."""
    for k in range(r.waiting):
        hear(r, r.inbox_sender[k], r.inbox_number[k], r.inbox[k])
    r.waiting = 0


def hear(r: Robot, sender: int, number: int, message: Message) -> None:
    """Pass a message to the strategy now; the arguments are those of ``receive``.

    A message changes the strategy's state only: ``r.belief`` and ``r.decision`` stay until the next sample or timer.
    """
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
    """End the move of a kind (DRIVE, TURN, AVOID or STOP) that was under way, and begin the next."""
    duration_s = time_s(r) - r.move_start_s
    # The last argument says whether an avoidance follows.
    moved(
        r,
        kind,
        duration_s,
        math.radians(r.move_turned_deg),
        r.move_ray_m,
        r.move_after_drive,
        r.walk.mode == AVOID,
    )
    # Only a drive of two ticks or more counts, as in ``localisation.locate``: a drive of one tick before an avoidance
    # means that the robot had turned in place. 1.5 allows for rounding of the times.
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
    """Tell localisation of a move that has ended; without effect in a robot that does not estimate its place.

    Args:
        kind: DRIVE, TURN, AVOID or STOP. turned_rad: angle turned in the move, by the gyro. ray_m: shortest ray when
            the move began as an avoidance; nan if it did not. after_drive: whether the move before was a drive of two
            ticks or more. at_obstacle: whether an avoidance follows.
    """
    if HAS_PLACES:
        if kind == DRIVE:
            add_drive(r.place, LOCALISER, duration_s, turned_rad, r.sampled_s, at_obstacle)
        elif kind != STOP:
            if not math.isnan(ray_m):
                add_obstacle(r.place, LOCALISER, ray_m, after_drive)
            add_turn(r.place, LOCALISER, duration_s, turned_rad)


def stopped(r: Robot) -> None:
    """Tell localisation that a stop for a sample has begun; it writes ``r.estimate``."""
    if HAS_PLACES:
        add_sample(r.place, LOCALISER, r.estimate)


# ``hear_bit``, ``no_belief`` and ``timer_of_state`` take the place of hooks, and ``belief_of_posterior`` that of
# ``strategies.world.belief_below`` (``assembly``). ``on_counts`` and ``posterior_below`` are themselves replaced.
# Arguments of one letter are those of the hooks (``inference.default_hooks``).


def hear_bit(s: Any, a: Any, m: Any, sender: int, t_s: float, d: Any, p: Any, w: Any) -> None:
    """Hear a one-bit message, for strategies that have ``on_counts`` in place of ``on_message``."""
    on_counts(s, m.bit, 1 - m.bit, p, w)


def no_belief(s: Any, a: Any, p: Any, w: Any) -> float:
    """Return nan: the strategy keeps no belief."""
    return math.nan


def timer_of_state(s: Any) -> float:
    """Return the time at which the timer is due, s; called only if the strategy has a timer."""
    found: float = s.next_s
    return found


def on_counts(s: Any, ones: int, zeros: int, p: Any, w: Any) -> None:
    """Do nothing: the exporter puts the strategy's ``on_counts`` in place of this function."""


def belief_of_posterior(alpha: int, beta: int, w: Any) -> float:
    """Return the belief that the share of ones, with posterior Beta(alpha, beta), is below the boundary.

    It is computed at each call: an exported robot has no table of beliefs.
    """
    return posterior_below(alpha, beta, w.boundary)


def posterior_below(alpha: int, beta: int, boundary: float) -> float:
    """Return nan: the exporter puts ``robot.belief.belief_below`` in place of this function."""
    return math.nan
