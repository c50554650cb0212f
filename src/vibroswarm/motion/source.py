"""The protocol of motion sources: where and when robots sampled, whatever moved them.

Motion (``motion_tables.Motion``) has these tables:

* ``samples``: one row per sample, sorted by run, time, robot. ``time_s`` is the end of the stop, when the sample is
  taken: the robot still stands in that control period, and moves in the next. ``stop_start_s`` is the start of that
  stop. ``drive_s``, ``turn_s``, ``avoid_s`` and ``stop_s`` add up to the time since the robot's previous sample (or
  since the start of the run); in ``blocked_s`` of ``drive_s`` it did not move. ``sample`` numbers a robot's samples in
  this order, from 0.
* ``ends``: one row per run and robot: the time up to which motion is known, the robot's pose at that time, and the
  start of the stop that it then makes, in which it hears nothing (null if it is not in such a stop).
* ``moves`` (on request): one row per drive, turn, avoidance or stop, from ``start_s`` to the robot's next row; sorted
  by run, time, robot. A move that a stop interrupts continues as another move after it; a stretch in which the robot is
  blocked, its wheels slipping, is a separate move with speed 0. ``pose.poses_of`` makes of it a row per control tick.

  - ``x_m``, ``y_m``, ``heading_rad``: the pose at the start. ``turned_rad``: the heading at the end of the move (or at
    the end of what is known) minus the heading at its start; whole turns included.
  - ``speed_m_s``, ``turn_rate_rad_s``: constant in a drive and in a stop; for a turn and an avoidance their means, as a
    controller changes them at each control period. The arc of that speed and turn rate leads exactly from a row's pose
    to the pose of the robot's next row.
  - ``ray_m``: the shortest ray when an avoidance begins; null for all other moves, and for the rest of an avoidance
    that a stop interrupted.

* ``failures``, of a source whose runs may fail: the time from which the robots of a failed run stand still, and why.
  Nothing is known of that run after that time; its robots sample no more, and count as undecided.

Times are whole control periods (ticks); round those of a log. At the ticks, bodies never overlap and never leave the
arena (those of MuJoCo by a millimetre). Motion never depends on the floor, the sensor, the messages or the decisions,
unless a strategy steers.

## Your own source

A source is a name and a function ``start(scenario, moves)`` that returns a ``MotionState``, which simulates run after
run. ``register(Source("name", start))`` makes it known, and ``simulate(..., motion="name")`` uses it. It gives rows
(``motion_tables.SAMPLE_ROW`` and others), of which the package makes tables. ``vibroswarm check`` says what is wrong
with them. Only our engines can be steered.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from vibroswarm.core.registry import Registry
from vibroswarm.core.user_code import errors_in
from vibroswarm.errors import InputError
from vibroswarm.motion.motion_tables import Collected, Failure, Motion, Rows, Sink
from vibroswarm.scenario import plugins
from vibroswarm.scenario.disturbance_fields import MOTION_FAULTS
from vibroswarm.scenario.scenario import Scenario

PIECE_S = 100.0
"""Length of the pieces in which motion advances if progress is reported, s."""


class MotionState(Protocol):
    """Runs of a scenario, one after the other."""

    tick: int
    """The next control period to simulate."""
    failure: Failure | None
    """Why the run failed, if it has."""

    def begin(self, seed: int, run: int) -> None:
        """Set the state to time 0 of a run; the same arguments give the same run, bit by bit.

        The sections ``[floor]``, ``[sensor]``, ``[strategy]``, ``[decision]`` and ``[network]`` of the scenario must
        not affect the motion; nor must ``run.t_end_s``, before that time.

        Args:
            seed: in [0, 2^63). run: below 2^32.
        """

    def advance(self, until: int, sink: Sink) -> None:
        """Simulate all control periods before the tick ``until``; pass new samples on, and moves that have ended.

        Each row is passed on once, in the order of the tables; moves may be passed on later, by ``finish`` at last.
        """

    def finish(self, sink: Sink) -> Rows:
        """Pass on the moves that are left, as if they ended at ``tick``; return the poses there (``END_ROW``)."""


@dataclass(frozen=True)
class Source:
    """A registered motion source."""

    name: str
    """Name by which scenarios and commands select the source."""
    start: Callable[[Scenario, bool], MotionState]
    """Returns what simulates runs of a scenario; the second argument says whether moves are wanted."""
    about: str = field(default="", compare=False)
    """What the source is, in a few words."""
    is_ours: bool = field(default=False, compare=False)
    """Whether it is an engine of this package."""
    source: str = field(default="", compare=False)
    """Text of the file that defines the source, if the file is not part of this package."""
    code: str = field(default="", compare=False)
    """Name of that file, name of the source in it, and the file's hash."""


def started(motion: str | Source, scenario: Scenario, moves: bool = False) -> MotionState:
    """Return what simulates runs of a scenario by a source, given by its name or itself."""
    found = motion if isinstance(motion, Source) else source(motion)
    for kind in () if found.is_ours else MOTION_FAULTS:
        if getattr(scenario.faults, kind):
            raise InputError(
                "this source of motion does not simulate robots that stop for good; 'event' and 'fixed-step' do",
                field=f"faults.{kind}",
            )
    with errors_in(found.code):
        return found.start(scenario, moves)


def moved(
    motion: str | Source,
    scenario: Scenario,
    seed: int,
    runs: Sequence[int],
    moves: bool = False,
    progress: Callable[[float], None] | None = None,
    until: Sequence[int] | None = None,
) -> Motion:
    """Simulate the motion of runs by the source ``motion``, up to the tick ``until`` or the end of the scenario."""
    state, rows = started(motion, scenario, moves), Collected(scenario.run.control_period_ms)
    piece = scenario.ticks if progress is None else max(1, int(PIECE_S / scenario.tick_s))
    with errors_in(motion.code if isinstance(motion, Source) else source(motion).code):
        for done, run in enumerate(runs):
            state.begin(seed, run)
            end = scenario.ticks if until is None else until[done]
            while state.tick < end:
                state.advance(min(state.tick + piece, end), rows.sink)
                if progress is not None:
                    progress((done + state.tick / end) / len(runs))
            rows.end(state)
    return rows.motion()


_registry = Registry[Source]("source of motion", "motion")
forget, names, known = _registry.forget, _registry.names, _registry.known


def register(source: Source) -> Source:
    """Register a source under its name, by which scenarios and commands then select it; return the source.

    Raises:
        InputError: a different source has the name.
    """
    return _registry.register(source)


def source(name: str) -> Source:
    """Return the source of that name, or of a file that is already loaded (``FILE.py:NAME`` with the file's hash).

    Raises:
        InputError: there is no such source, or its file is not loaded; the message suggests a similar name.
    """
    return plugins.found("motion", name)


plugins.KINDS["motion"] = plugins.Kind(Source, register, known, "vibroswarm.motion")
