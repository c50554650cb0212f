"""Memory of one robot and constants of its program: placeholders, which an exporter replaces."""

from __future__ import annotations

from typing import Any, Final

from vibroswarm.robot.sensing import SenseState
from vibroswarm.robot.walk import Dice, WalkState
from vibroswarm.strategies.world import World

PARAMS: Final[Any] = None
"""Parameters of the strategy."""
WORLD: Final[Any] = None
"""``strategies.world.World``: what robot 0 knows about its task."""
WALKER: Final[Any] = None
"""``robot.walk.WalkProgram``."""
SENSING: Final[Any] = None
"""``robot.sensing.SenseProgram``."""
BORDERS: Final[Any] = None
"""``robot.sensing.ClassBorders``."""
SENSOR: Final[Any] = None
"""Parameters of the robot's own sensor."""
RMS_THRESHOLD: Final = 0.0
"""Energy above which a robot reads 1."""
SENSING_BLIND_MS: Final = 0.0
"""Driving time after a turn or avoidance for which the rays are ignored; 0: they never are."""
INBOX: Final = 16
"""Greatest number of messages that are kept until they are heard."""


class Numbers:
    """What a sample of the robot's own sensor measures."""


class Message:
    """A message of the strategy."""


class State:
    """What the strategy remembers."""


class Arrays:
    """The strategy's arrays."""


class Robot:
    """A robot: who it is, what its parts remember, and what it has just decided and sends."""

    seed: int
    """Seed of the simulation whose random numbers the robot draws."""
    run: int
    """Number of the run of that simulation."""
    number: int
    """Number of the robot, from 0."""
    tick: int
    """Number of control periods since the start."""
    missed: int
    """Number of ticks without a step."""
    world: World
    """What the robot knows about its task."""
    walk: WalkState
    """What the walk remembers from tick to tick."""
    dice: Dice
    """Uniform numbers for the next leg, turn and avoidance."""
    sense: SenseState
    """What the accelerometer's program remembers from reading to reading."""
    reading: int
    """Reading of the present stop, or until the next of the last; ``robot_program.UNREAD`` if it is not known yet."""
    state: Any
    """State of the strategy."""
    arrays: Any
    """Arrays of the strategy."""
    out: Any
    """The message to send, if ``sends``."""
    sends: bool
    """Whether the last step or sample has a message to send."""
    decision: int
    """0: the share of vibrating tiles is below the boundary, 1: above it, or the kind decided for; -1: undecided."""
    belief: float
    """Belief that the share of vibrating tiles is below the boundary, after the last sample or timer."""
    decided_s: float
    """Time of the current decision, s; nan before the first."""
    samples: int
    """Number of samples so far."""
    sent: int
    """Number of messages sent."""
    heard: int
    """Number of messages passed to the strategy."""
    timers: int
    """Number of calls of ``on_timer``."""
    first_message: int
    """Index of the oldest message of the inbox."""
    waiting: int
    """Number of messages in the inbox."""
    dropped: int
    """Number of messages lost because the inbox was full."""
    inbox: Any
    """Messages received and not heard yet, in a ring from ``first_message`` on."""
    inbox_sender: Any
    """The sender of each message in the inbox."""
    inbox_number: Any
    """The index of each message in the inbox among its sender's messages, from 0."""
    sampled_s: float
    """Time of the last sample, s; 0 before the first."""
    sees_from_ms: float
    """Driving time in the present leg from which on the rays are used again."""
