"""Memory of one robot, and the constants of its program; the exporter fills in what depends on strategy and scenario.

In Python these classes and values only stand for what is exported.
"""

from __future__ import annotations

from typing import Any, Final

from vibroswarm.robot.sensing import SenseState
from vibroswarm.robot.walk import Dice, WalkState
from vibroswarm.strategies.world import World

PARAMS: Final[Any] = None
"""Of the strategy."""
WORLD: Final[Any] = None
WALKER: Final[Any] = None
"""``robot.walk.WalkProgram``."""
SENSING: Final[Any] = None
"""``robot.sensing.SenseProgram``."""
LOCALISER: Final[Any] = None
"""``robot.pose_mixture.LocalisationProgram``."""
RMS_THRESHOLD: Final = 0.0
SENSING_BLIND_MS: Final = 0.0


class Message:
    """A message of the strategy."""


class State:
    """What the strategy remembers."""


class Arrays:
    """Its arrays."""


class Robot:
    """A robot: who it is, what its parts remember, and what it has just decided and sends."""

    seed: int
    run: int
    number: int
    tick: int
    """Control periods since the start."""
    world: World
    walk: WalkState
    dice: Dice
    sense: SenseState
    state: Any
    arrays: Any
    out: Any
    """The message to send, if ``sends``."""
    sends: bool
    decision: int
    """-1: undecided; 0, 1: fewer, more vibrate than the boundary."""
    belief: float
    """That the share lies below the boundary, at the last sample or timer."""
    decided_s: float
    samples: int
    sent: int
    heard: int
    timers: int
    waiting: int
    """Messages in the inbox."""
    dropped: int
    """Messages lost for lack of room."""
    inbox: Any
    inbox_sender: Any
    inbox_number: Any
    sampled_s: float
    sees_from_ms: float
    place: Any
    """``robot.pose_mixture.Mixture``."""
    estimate: Any
    """``robot.pose_mixture.ESTIMATE``."""
    move_start_s: float
    move_turned_deg: float
    move_ray_m: float
    move_after_drive: bool
