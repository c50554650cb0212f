"""The program of one robot: the template that is exported to C.

An exporter replaces the functions of ``default_hooks`` by a strategy's hooks, and the constants of ``robot_memory`` by
those of a scenario. A robot ``r`` is a ``robot_memory.Robot``, which the functions change in place. The surrounding
program calls the functions named in ``API``: ``step`` once per tick (control period) with the angle turned, by the
gyro, and the shortest ray; ``accelerate`` with readings of the accelerometer; ``sample`` with an observation; and
``receive`` with messages. Random numbers have the same addresses as in the simulation, so a robot that measures and
hears the same does the same, bit by bit, where the log-gamma of its C library is that of the simulation.

Order in a tick: a robot that walks hears the messages received since it last walked, then its timer is called if it is
due. A robot that stands hears nothing until it walks again. A stop ends with a sample. A message sent in a tick can be
heard from the next tick on.
"""

from __future__ import annotations

import math
from typing import Any, Final

from vibroswarm.core.rng import ALONE, AVOIDANCE, FIRST, WALK, uniform
from vibroswarm.export.robot_memory import (
    BORDERS,
    INBOX,
    PARAMS,
    RMS_THRESHOLD,
    SENSING,
    SENSING_BLIND_MS,
    SENSOR,
    WALKER,
    WORLD,
    Message,
    Numbers,
    Robot,
)
from vibroswarm.inference.agents import (
    begin_draws,
    message_draws,
    sample_draws,
    timer_draws,
    world_of_robot,
)
from vibroswarm.inference.default_hooks import (
    HAS_TIMER,
    begin,
    belief,
    decision,
    next_s,
    on_message,
    on_sample,
    on_timer,
)
from vibroswarm.robot.sensing import begin_sense, class_read, observation, readings, sense_step
from vibroswarm.robot.sensing import energy as energy_of
from vibroswarm.robot.walk import (
    DRIVE,
    STOP,
    Dice,
    begin_walk,
    looks,
    walk_step,
    wheel_commands_percent,
)
from vibroswarm.strategies.world import Reading

READS_CLASSES: Final = False
"""Whether the robot's readings are classes that it remembers, and not whether an energy is above a threshold."""
UNREAD: Final = -1
"""Reading of a stop before its sample."""
UNKNOWN_M: Final = math.nan
"""Place of the robot, which its strategy does not read."""

API: Final = (
    "looks_now", "step", "left_percent", "right_percent", "accelerate", "observed", "sample", "receive", "missed",
    "time_s", "energy", "class_of", "class_of_numbers", "start",
)  # fmt: skip
"""Functions that the surrounding program calls."""
PARTS: Final = ("hear", "timer")
"""Parts of ``step``, which only tests call from outside."""
OF_VALUES: Final = ("class_of",)
"""Those that only robots have that measure values with a sensor of their own, and read them as classes."""
OF_NUMBERS: Final = ("class_of_numbers",)
"""Those that only robots have whose own sensor measures several numbers."""


def start(r: Robot, seed: int, run: int, number: int) -> None:
    """Start a robot at time 0, standing. All of ``r`` must be zero before."""
    r.seed, r.run, r.number = seed, run, number
    r.world = world_of_robot(WORLD, number)
    # Only the number of the first leg is used; ``roll`` then draws those of the next leg, turn and avoidance.
    r.walk = begin_walk(WALKER, Dice(uniform(seed, run, number, WALK, FIRST, ALONE), 0.5, 0.5))
    roll(r)
    r.sense = begin_sense()
    r.decision, r.belief, r.decided_s = -1, math.nan, math.nan
    begin(r.state, r.arrays, begin_draws(seed, run, number), PARAMS, r.world)


def roll(r: Robot) -> None:
    """Draw the uniform numbers of the next leg, of the turn before it, and of the next avoidance."""
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

    If ``r.sends`` is then true, send ``r.out`` to all robots.
    """
    if not abs(gyro_deg) < math.inf:  # false for NaN too, which would stay in the angle still to turn
        gyro_deg = 0.0
    r.sends = False
    r.tick += 1
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
    if r.walk.mode == STOP:
        if before.mode != STOP:
            r.sense = begin_sense()
            if READS_CLASSES:
                r.reading = UNREAD
        return r.walk.sampled
    read_inbox(r)
    # The time of the timer in ticks, with a margin for rounding.
    if HAS_TIMER and next_s(r.state) * 1000.0 / r.world.tick_ms - 1e-9 <= r.tick:
        timer(r)
    return False


def missed(r: Robot, ticks: int) -> None:
    """Note that so many ticks passed without a step, because the surrounding program was late."""
    r.tick += ticks
    r.missed += ticks


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

    Before the first reading of the stop the RMS is 0. A robot that reads classes returns -1 (``UNREAD``) until its
    sample.
    """
    if READS_CLASSES:
        return r.reading
    return observation(r.sense, RMS_THRESHOLD)


def energy(r: Robot) -> float:
    """Return the energy of this stop, or until the next of the last: the RMS that ``observed`` compares."""
    return energy_of(r.sense)


def class_of(r: Robot, value: float) -> int:
    """Return the class that the robot's own sensor reads of a value that it measured, as the simulated sensor does."""
    return class_read(BORDERS, value)


def class_of_numbers(r: Robot, numbers: Numbers) -> int:
    """Return the class that the robot's own sensor reads of the numbers that it measured, in the order of its file."""
    return class_of_sensor(numbers, SENSOR)


def class_of_sensor(v: Any, p: Any) -> int:
    """Stand for the function ``class_of`` of the robot's own sensor."""
    return 0


def sample(r: Robot, reading: int) -> None:
    """Take a sample, whose observation is ``reading``, 0 or 1, or a class: update the belief by it, and decide.

    If ``r.sends`` is then true, send ``r.out`` to all robots.
    """
    if READS_CLASSES:
        r.reading = reading
    t_s, k = time_s(r), r.samples
    unknown = Reading(
        reading, t_s, k, UNKNOWN_M, UNKNOWN_M, UNKNOWN_M, UNKNOWN_M, k, UNKNOWN_M, UNKNOWN_M, UNKNOWN_M,
        UNKNOWN_M, UNKNOWN_M, UNKNOWN_M,
    )  # fmt: skip
    process(r, unknown, k)
    r.samples += 1
    r.sampled_s = t_s


def process(r: Robot, x: Reading, k: int) -> None:
    """Call the strategy's ``on_sample`` with reading ``x`` of sample ``k``."""
    r.out = Message()
    # -1.0: the first random number of the call is not known in advance.
    r.sends = on_sample(
        r.state, r.arrays, x, r.out, sample_draws(r.seed, r.run, r.number, k, -1.0), PARAMS, r.world
    )
    after_event(r)


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
    """Keep a message until the robot walks; return False if the inbox is full, and the message is lost."""
    if r.waiting == INBOX:
        r.dropped += 1
        return False
    k = (r.first_message + r.waiting) % INBOX
    r.inbox[k] = message
    r.inbox_sender[k], r.inbox_number[k] = sender, number
    r.waiting += 1
    return True


def read_inbox(r: Robot) -> None:
    """Hear the messages of the inbox, in the order in which they came, and remove them."""
    for _ in range(r.waiting):
        k = r.first_message
        hear(r, r.inbox_sender[k], r.inbox_number[k], r.inbox[k])
        r.first_message = (k + 1) % INBOX
        r.waiting -= 1


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
    """Return the belief that the share of ones, with posterior Beta(alpha, beta), is below the boundary."""
    return posterior_below(alpha, beta, w.boundary)


def posterior_below(alpha: int, beta: int, boundary: float) -> float:
    """Return nan: the exporter puts ``robot.belief.belief_below`` in place of this function."""
    return math.nan
