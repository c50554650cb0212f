"""The protocol of motion sources: where and when robots sampled, whatever moved them.

A source of Motion (an engine, a recording, a camera track) gives these tables:

* ``samples``: one row per sample, sorted by run, time, robot. ``time_s`` is the end of the stop, when the
  sample is taken; ``stop_start_s`` when the robot stood still for it; ``drive_s``, ``turn_s``, ``avoid_s``,
  ``stop_s`` account for all the time since the robot's last sample (or the start).
* ``ends``: one row per run and robot: until when motion is known, where the robot is then, and when the stop
  under way began (null when it walks): a stop in which it hears nothing.
* ``segments`` (on request): arcs of constant speed and turn rate, from ``start_s`` to the robot's next row;
  sorted by run, time, robot. ``pose`` answers from it where anyone was at any time.
* ``moves`` (on request): one row per drive, turn, avoidance or stop, from ``start_s`` to the robot's next row; sorted
  by run, time, robot. A move that a stop interrupts continues as another move after it; a stretch in which the robot is
  blocked, its wheels slipping, is a separate move with speed 0.

  - ``x_m``, ``y_m``, ``heading_rad``: the pose at the start. ``turned_rad``: the heading at the end of the move, or at
    the end of what is known, less that at its start; whole turns included.
  - ``speed_m_s``, ``turn_rate_rad_s``: of a drive and a stop what they are all the time; of a turn and an avoidance
    their means, as a controller changes them at each control period. The arc of speed and turn rate leads from each
    row's pose to that of the next exactly; ``place_from_moves`` gives its accuracy in between.
  - ``ray_m``: the shortest ray when an avoidance begins; null for all other moves, and where an avoidance goes on.

* ``failures``, of a source whose runs may fail: since when the robots of a failed run stand, and why. What is known
  of that run ends there; its robots sample no more, and count as undecided.

Bodies never overlap and never leave the arena at the ticks of the control period, except as far as the source's
``tolerance`` says: a simulator of soft contact states how exact its tables are. Motion never depends on
the floor, the sensor, the messages or the decisions, unless a strategy steers.

## Your own source

A source is a name and a function ``init(scenario, seed, run, segments=False, moves=False)`` that gives a
``MotionState``: one run at time 0. ``register(Source("name", init))`` makes it known, and
``simulate(..., motion="name")`` uses it. A source that cannot give segments or moves leaves them out. What it need
not have: ``batch``, if it can move whole runs faster than one after the other, and ``to_sample`` and ``steer``
(``SteeredState``), without which no strategy can steer it.

A state hands each row over once, in the order of the tables: ``advance(until_s)`` gives the samples whose ``time_s``
lies before the new ``time_s`` and not before the old one. The control period that begins at ``time_s`` is yet to
come. Only moves are given twice: one that is under way at ``time_s`` is given as far as it has come, and again by the
next ``advance``; ``join`` keeps the latest.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.registry import Registry
from vibroswarm.errors import InputError, shown
from vibroswarm.motion.motion_tables import (
    ENDS,
    FAILURES,
    MOTION,
    MOVES,
    SEGMENTS,
    Motion,
    checked,
    checked_batch,
    join,
)
from vibroswarm.scenario import plugins
from vibroswarm.scenario.scenario import Scenario


class MotionState(Protocol):
    """A run that can be advanced and copied."""

    @property
    def time_s(self) -> float:
        """Time up to which motion is known, s: 0 at first, then a whole number of control periods."""

    def advance(self, until_s: float) -> Motion:
        """Advance to the first control period at or after ``until_s``, s; do nothing if it is past.

        Returns: the samples and segments that began since, the moves that were under way since, and the ends now.
        """

    def copy(self) -> MotionState:
        """Return an independent state from which motion continues in the same way."""


class SteeredState(MotionState, Protocol):
    """A run whose robots can be steered, for strategies that steer."""

    def to_sample(
        self,
        until_s: float,
        take: Callable[[NDArray[np.void]], None],
        take_moves: Callable[[NDArray[np.void]], None] | None = None,
        take_segments: Callable[[NDArray[np.void]], None] | None = None,
    ) -> bool:
        """Advance until just after the next control period at which a robot samples, or to ``until_s`` if none
        does.

        Args:
            take: given all samples of that period at once, rows of ``recorder.SAMPLE_ROW`` by robot.
            take_moves: given the moves that ended since, ``moves.MOVE_ROW``. take_segments: given the segments that
                began since, ``recorder.SEGMENT_ROW``.
        Returns: whether anyone samples at the last control period before ``time_s``.
        """

    def steer(self, robot: int, turn_deg: float, drive_ms: float) -> None:
        """Steer a robot that sampled in the last control period, see ``robot.walk.steered``."""


class Init(Protocol):
    """Creates a run at time 0."""

    def __call__(
        self, scenario: Scenario, seed: int, run: int, segments: bool = False, moves: bool = False
    ) -> MotionState:
        """Return a run at time 0. The same arguments give the same run, bit by bit.

        Args:
            scenario: fields of ``[floor]``, ``[sensor]``, ``[strategy]``, ``[decision]`` and ``[network]`` do not
                matter. seed: in [0, 2^63). run: its number, below 2^32. segments, moves: the tables wanted.
        """


class Batch(Protocol):
    """Moves whole runs."""

    def __call__(
        self, scenario: Scenario, seed: int, runs: Sequence[int], segments: bool = False, moves: bool = False
    ) -> Motion:
        """Return the runs to the scenario's end, as ``init`` and ``advance`` would give them, in the order of
        ``runs``."""


ROBOT_S: Final = 1.5e-4
"""Rough processor time of a robot's 1200 s in the event-driven engine, s."""


class Tolerance(NamedTuple):
    """How far a source may miss what it promises, at the ticks of the control period; 0: exact but for rounding."""

    overlap_m: float = 0.0
    """How deep bodies may be in each other or in a wall, m."""
    arc: float = 0.0
    """How far a segment or a move may end from where the next begins, in m and in rad."""
    stop_m: float = 0.0
    stop_rad: float = 0.0
    """How far a robot may be pushed, or roll, and turn, between the start of a stop and its sample."""


@dataclass(frozen=True)
class Source:
    """A registered motion source.

    Args:
        init: makes one run at time 0. batch: moves whole runs; without, one after the other by ``init``.
        about: what it is, in a few words.
    """

    name: str
    init: Init
    batch: Batch = None  # type: ignore[assignment]  # set in __post_init__
    about: str = field(default="", compare=False)
    tolerance: Tolerance = field(default=Tolerance(), compare=False)
    """What ``vibroswarm.testing`` allows it."""
    robot_s: float = field(default=ROBOT_S, compare=False)
    """Rough processor time of a robot's 1200 s, s: a study keeps what it has done after every batch, of some 10 s."""
    is_ours: bool = field(default=False, compare=False)
    """An engine of this package: its tables are checked by tests, not while it runs."""
    source: str = field(default="", compare=False)
    """Text of its file, if that is not part of this package."""
    code: str = field(default="", compare=False)
    """Name of that file, name of the source in it, and hash."""

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not callable(self.init):
            raise InputError(f"{shown(self.name)} has no name or no function init", field="source")
        if self.batch is None:
            object.__setattr__(self, "batch", partial(one_after_the_other, self.init))


def one_after_the_other(
    init: Init,
    scenario: Scenario,
    seed: int,
    runs: Sequence[int],
    segments: bool = False,
    moves: bool = False,
) -> Motion:
    """Return whole runs, each created by ``init``."""
    end_s = scenario.run.t_end_s
    return join([init(scenario, seed, run, segments=segments, moves=moves).advance(end_s) for run in runs])


_registry = Registry[Source]("source of motion", "motion")
forget, names, known = _registry.forget, _registry.names, _registry.known


def register(source: Source) -> Source:
    """Register a source by its name; return it. Layers below need no import of it.

    Raises:
        InputError: it is not a ``Source``, or the name is taken.
    """
    if not isinstance(source, Source):
        raise InputError(f"{shown(source)} is not a Source", field="source")
    return _registry.register(source)


def robot_s_of(name: str) -> float:
    """Return ``Source.robot_s`` of a source; ``ROBOT_S`` if its code is not loaded, as where a study is only shown."""
    found = _registry.known().get(plugins.name_in(name) if plugins.is_code(name) else name)
    return ROBOT_S if found is None else found.robot_s


def source(name: str) -> Source:
    """Return the source of that name, or of a loaded file (``FILE.py:NAME`` with its hash).

    Output of a source that is not ours is checked, and its errors are reported with file and line.

    Raises:
        InputError: there is none; the message suggests the nearest name.
    """
    if not plugins.is_code(name):
        plugins.known_for("motion", name)
        return _ready(_registry.get(name))
    known = _registry.known().get(plugins.name_in(name))
    if known is None or known.code != name:
        raise InputError(
            f"'{name.partition(plugins.HASH)[0]}' is not loaded; name its file by --motion, or add --trust to run "
            "the one that is named",
            field="motion",
        )
    return _ready(known)


def _ready(found: Source) -> Source:
    """Return a source whose output is checked, unless it is part of this package."""
    if found.is_ours:
        return found
    init, batch = partial(checked, found.init), found.batch
    if isinstance(batch, partial) and batch.func is one_after_the_other:
        return replace(found, init=init, batch=partial(one_after_the_other, init))
    return replace(found, init=init, batch=partial(checked_batch, batch))


plugins.KINDS["motion"] = plugins.Kind(Source, register, known, "vibroswarm.motion")

__all__ = [
    "ENDS",
    "FAILURES",
    "MOTION",
    "MOVES",
    "SEGMENTS",
    "Batch",
    "Init",
    "Motion",
    "MotionState",
    "Source",
    "SteeredState",
    "Tolerance",
    "forget",
    "join",
    "known",
    "names",
    "one_after_the_other",
    "register",
    "source",
]
