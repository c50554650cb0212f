"""The contract of ``Motion``: where and when robots sampled, whatever moved them.

A source of Motion (an engine, a recording, a camera track) gives these tables:

* ``samples``: one row a sample, sorted by run, time, robot. ``time_s`` is the end of the stop, when the
  sample is taken; ``stop_start_s`` when the robot stood still for it; ``drive_s``, ``turn_s``, ``avoid_s``,
  ``stop_s`` account for all the time since the robot's last sample (or the start).
* ``segments`` (on request): arcs of constant speed and turn rate, from ``start_s`` to the robot's next row;
  sorted by run, time, robot. ``pose`` answers from it where anyone was at any time.
* ``ends``: one row a run and robot: until when motion is known, where the robot is then, and when the stop
  under way began (null when it walks): a stop in which it hears nothing.

Bodies never overlap and never leave the arena at the ticks of the control period. Motion never depends on
the floor, the sensor, the messages or the decisions.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, Protocol

import polars as pl

from vibroswarm.errors import InputError, nearest, shown
from vibroswarm.forked import check_threads
from vibroswarm.scenario import Scenario

MOTION: Final[dict[str, Any]] = {
    "run": pl.UInt32,
    "robot": pl.UInt16,
    "sample": pl.UInt32,
    "stop_start_s": pl.Float64,
    "time_s": pl.Float64,
    "x_m": pl.Float64,
    "y_m": pl.Float64,
    "heading_rad": pl.Float64,
    "drive_s": pl.Float32,
    "turn_s": pl.Float32,
    "avoid_s": pl.Float32,
    "stop_s": pl.Float32,
}
SEGMENTS: Final[dict[str, Any]] = {
    "run": pl.UInt32,
    "robot": pl.UInt16,
    "start_s": pl.Float64,
    "x_m": pl.Float64,
    "y_m": pl.Float64,
    "heading_rad": pl.Float64,
    "speed_m_s": pl.Float64,
    "turn_rate_rad_s": pl.Float64,
    "kind": pl.Enum(["drive", "turn", "avoid", "stop"]),
}
ENDS: Final[dict[str, Any]] = {
    "run": pl.UInt32,
    "robot": pl.UInt16,
    "end_s": pl.Float64,
    "x_m": pl.Float64,
    "y_m": pl.Float64,
    "heading_rad": pl.Float64,
    "stop_start_s": pl.Float64,
}


@dataclass(frozen=True)
class Motion:
    """The tables of a source, see the head of this module."""

    samples: pl.DataFrame
    ends: pl.DataFrame
    segments: pl.DataFrame | None = None


class MotionState(Protocol):
    """One run that can be advanced: ``advance`` gives what is new up to a time, ``copy`` a branch of it."""

    @property
    def time_s(self) -> float:
        """Until when motion is known."""

    def advance(self, until_s: float) -> Motion:
        """Move on to ``until_s`` and give the samples and segments that began since, and the ends then."""

    def copy(self) -> MotionState:
        """A state from which motion goes on in the same way, and that does not change with this one."""


@dataclass(frozen=True)
class Source:
    """A source of Motion by name: ``init`` makes one run at time 0, ``batch`` moves whole ones."""

    name: str
    init: Callable[[Scenario, int, int, bool], MotionState]
    """(scenario, seed, run, segments wanted) -> state."""
    batch: Callable[[Scenario, int, Sequence[int], bool], Motion]
    """(scenario, seed, runs, segments wanted) -> whole runs to the scenario's end."""
    about: str = field(default="", compare=False)


_SOURCES: dict[str, Source] = {}


def register(source: Source) -> None:
    """Make a source known by its name, so that what stands below needs no import from above."""
    _SOURCES[source.name] = source


def source(name: str) -> Source:
    """The source of that name.

    Raises:
        InputError: there is none; the nearest is named.
    """
    if not isinstance(name, str) or name not in _SOURCES:
        raise InputError(
            f"there is no source of motion {shown(name)}{nearest(name, _SOURCES)}"
            f" (there are {', '.join(sorted(_SOURCES))})",
            field="motion",
        )
    return _SOURCES[name]


def join(pieces: Sequence[Motion]) -> Motion:
    """Pieces of motion, in the order of runs and of time within a run, as one.

    The ends of a run are those of its last piece.
    """
    check_threads()
    ends = pl.concat([piece.ends for piece in pieces])
    ends = ends.group_by("run", "robot", maintain_order=True).last()
    segments = [piece.segments for piece in pieces if piece.segments is not None]
    return Motion(
        pl.concat([piece.samples for piece in pieces]),
        ends.select(list(ENDS)),
        pl.concat(segments) if segments else None,
    )
