"""The protocol of motion sources: where and when robots sampled, whatever moved them.

A source of motion (an engine, a recording, a camera track) gives these tables:

* ``samples``: one row per sample, sorted by run, time, robot. ``time_s`` is the end of the stop, when the sample is
  taken: the robot still stands in that control period, and moves in the next. ``stop_start_s`` is the start of that
  stop. ``drive_s``, ``turn_s``, ``avoid_s`` and ``stop_s`` add up to the time since the robot's previous sample (or
  since the start of the run). ``sample`` numbers a robot's samples in this order, from 0.
* ``ends``: one row per run and robot: the time up to which motion is known, the robot's pose at that time, and the
  start of the stop that it then makes, in which it hears nothing (null if it is not in such a stop).
* ``segments`` (on request): arcs of constant speed and turn rate, from ``start_s`` to the robot's next row;
  sorted by run, time, robot. ``pose`` returns any robot's pose at any time from this table.
* ``moves`` (on request): one row per drive, turn, avoidance or stop, from ``start_s`` to the robot's next row; sorted
  by run, time, robot. A move that a stop interrupts continues as another move after it; a stretch in which the robot is
  blocked, its wheels slipping, is a separate move with speed 0.

  - ``x_m``, ``y_m``, ``heading_rad``: the pose at the start. ``turned_rad``: the heading at the end of the move (or at
    the end of what is known) minus the heading at its start; whole turns included.
  - ``speed_m_s``, ``turn_rate_rad_s``: constant in a drive and in a stop; for a turn and an avoidance their means, as a
    controller changes them at each control period. The arc of that speed and turn rate leads exactly from a row's pose
    to the pose of the robot's next row. ``place_from_moves`` says how exact it is in between.
  - ``ray_m``: the shortest ray when an avoidance begins; null for all other moves, and for the rest of an avoidance
    that a stop interrupted.

* ``failures``, of a source whose runs may fail: the time from which the robots of a failed run stand still, and why.
  Nothing is known of that run after that time; its robots sample no more, and count as undecided.

Times are whole control periods (ticks); round those of a log. At the ticks, bodies never overlap and never leave the
arena. A simulator of soft contact states in its ``tolerance`` how far they may. Motion never depends on the floor, the
sensor, the messages or the decisions, unless a strategy steers.

## Your own source

A source is a name and a function ``init(scenario, seed, run, segments=False, moves=False)`` that returns a
``MotionState``: one run at time 0. ``register(Source("name", init))`` makes it known, and
``simulate(..., motion="name")`` uses it. A source that cannot give segments or moves returns None for them. Optional
are ``batch``, for a source that can simulate many runs faster than one after the other, and ``to_sample`` and ``steer``
(``SteeredState``), without which no strategy can steer the robots.

``advance(until_s)`` returns the samples whose ``time_s`` is at least the old ``time_s`` of the state and below its new
``time_s``; the control period that begins at ``time_s`` is not yet simulated. So each row is returned once, in the
order of the tables. Only a move that is under way at ``time_s`` is returned twice: as it is so far, and again by the
next ``advance``; ``join`` takes the later one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Final, NamedTuple, Protocol, Self

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
        """Time up to which motion has been simulated, s: a whole number of control periods; 0 at first."""

    def advance(self, until_s: float) -> Motion:
        """Simulate to the first control period at or after ``until_s``, s; do nothing if the run is already there.

        Returns: the samples taken and the segments begun in this call, the moves that ended in it or are under way,
            and the ends at the new ``time_s``.
        """

    def copy(self) -> Self:
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
        """Simulate until just after the next control period in which a robot samples, or to ``until_s`` if none does.

        Args:
            take: called with all samples of that period, rows of ``recorder.SAMPLE_ROW`` in the order of robots.
            take_moves: called with the moves that ended in this call, rows of ``moves.MOVE_ROW``.
            take_segments: called with the segments that began in this call, rows of ``recorder.SEGMENT_ROW``.
        Returns: whether any robot sampled. If so, it sampled in the last control period before the new ``time_s``.
        """

    def steer(self, robot: int, turn_deg: float, drive_ms: float) -> None:
        """Set the next turn and leg of a robot that sampled in the last control period; see ``robot.walk.steered``."""


class Init(Protocol):
    """Creates a run at time 0."""

    def __call__(
        self, scenario: Scenario, seed: int, run: int, segments: bool = False, moves: bool = False
    ) -> MotionState:
        """Return a run at time 0. The same arguments give the same run, bit by bit.

        Args:
            scenario: its sections ``[floor]``, ``[sensor]``, ``[strategy]``, ``[decision]`` and ``[network]`` must not
                affect the motion; nor must ``run.t_end_s``, before that time.
            seed: in [0, 2^63).
            run: the run's number, below 2^32.
            segments, moves: whether these tables are wanted.
        """


class Batch(Protocol):
    """Simulates whole runs."""

    def __call__(
        self, scenario: Scenario, seed: int, runs: Sequence[int], segments: bool = False, moves: bool = False
    ) -> Motion:
        """Simulate whole runs, each to the end of the scenario; return their tables, in the order of ``runs``.

        The tables are those that ``init`` and one call of ``advance`` would give for each run. ``runs`` has at least
        one number.
        """


ROBOT_S: Final = 1.5e-4
"""Rough processor time that the event engine takes to simulate one robot for 1200 s, s."""


class Tolerance(NamedTuple):
    """How far a source's tables may deviate from the protocol at the ticks; 0: not at all, except for rounding."""

    overlap_m: float = 0.0
    """How far bodies may overlap each other or a wall, m."""
    arc: float = 0.0
    """Distance that may be between the end of a segment or a move and the start of the next, in m and in rad."""
    stop_m: float = 0.0
    stop_rad: float = 0.0
    """How far a robot may move (be pushed, or roll), and turn, between the start of a stop and its sample."""


@dataclass(frozen=True)
class Source:
    """A registered motion source."""

    name: str
    """Name by which scenarios and commands select the source."""
    init: Init
    """Creates one run at time 0."""
    batch: Batch = None  # type: ignore[assignment]  # set in __post_init__
    """Simulates whole runs; by default they are simulated one after the other by ``init``."""
    about: str = field(default="", compare=False)
    """What the source is, in a few words."""
    tolerance: Tolerance = field(default=Tolerance(), compare=False)
    """Deviations that the checks of ``vibroswarm.testing`` accept."""
    footprint_m: tuple[float, float] | None = field(default=None, compare=False)
    """Length, along the heading, and width of its robots; None: they are discs of ``robot.body_radius_m``."""
    robot_s: float = field(default=ROBOT_S, compare=False)
    """Rough processor time to simulate one robot for 1200 s, s. If it is longer than that of the event engine, a study
    saves its results after each run."""
    is_ours: bool = field(default=False, compare=False)
    """Whether it is an engine of this package, whose tables are checked by tests and not while it runs."""
    source: str = field(default="", compare=False)
    """Text of the file that defines the source, if the file is not part of this package."""
    code: str = field(default="", compare=False)
    """Name of that file, name of the source in it, and the file's hash."""

    def __post_init__(self) -> None:
        """Refuse a source without a name or ``init``; set ``batch`` if it is None.

        Raises:
            InputError: the name is not a text, or ``init`` is not a function.
        """
        if not isinstance(self.name, str) or not callable(self.init):
            raise InputError(f"{shown(self.name)} has no name or no function init", field="source")
        if self.batch is None:
            # The dataclass is frozen, so its field cannot be set by an assignment.
            object.__setattr__(self, "batch", partial(one_after_the_other, self.init))


def one_after_the_other(
    init: Init,
    scenario: Scenario,
    seed: int,
    runs: Sequence[int],
    segments: bool = False,
    moves: bool = False,
) -> Motion:
    """Simulate whole runs, at least one, one after the other by ``init``; return them as one ``Motion``."""
    end_s = scenario.run.t_end_s
    return join([init(scenario, seed, run, segments=segments, moves=moves).advance(end_s) for run in runs])


_registry = Registry[Source]("source of motion", "motion")
forget, names, known = _registry.forget, _registry.names, _registry.known


def register(source: Source) -> Source:
    """Register a source under its name, by which scenarios and commands then select it; return the source.

    Raises:
        InputError: ``source`` is not a ``Source``, or a different source has the name.
    """
    if not isinstance(source, Source):
        raise InputError(f"{shown(source)} is not a Source", field="source")
    return _registry.register(source)


def if_loaded(name: str) -> Source | None:
    """Return the source of that name, or None if its code is not loaded, as when the results of a study are only shown.

    Args:
        name: the source's name, or a reference to its code: ``FILE.py:NAME``, with or without the file's hash.
    """
    return _registry.known().get(plugins.name_in(name) if plugins.is_code(name) else name)


def robot_s_of(name: str) -> float:
    """Return the rough processor time that a source needs to simulate one robot for 1200 s (``Source.robot_s``), s.

    If the source is not loaded (``if_loaded``), return ``ROBOT_S``, the time of the event engine.
    """
    found = if_loaded(name)
    return ROBOT_S if found is None else found.robot_s


def source(name: str) -> Source:
    """Return the source of that name, or of a file that is already loaded (``FILE.py:NAME`` with the file's hash).

    If the source is not ours, its tables are checked whenever it returns any, and errors in its code are reported with
    file and line.

    Raises:
        InputError: there is no such source, or its file is not loaded; the message suggests a similar name.
    """
    return _ready(plugins.found("motion", name))


def _ready(found: Source) -> Source:
    """Return ``found`` itself if it is an engine of this package, else a copy of it that checks its own tables."""
    if found.is_ours:
        return found
    init, batch = partial(checked, found.init), found.batch
    # If the source has no batch function of its own, its runs are created one after the other by the new ``init``,
    # which checks them.
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
