"""Compute for every message of a run whether each robot received it, lost it, or could not read it before the end.

The tables of a result hold only counts of messages. The log is recomputed from the samples with the run's random
numbers. A message is addressed to every robot but its sender, and has one state there: received, lost or not due.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.inference.agents import silent_ticks
from vibroswarm.inference.deliveries import Timeline, timeline_of
from vibroswarm.inference.replay import sent_messages
from vibroswarm.motion.motion_tables import Motion
from vibroswarm.result import Result

RECEIVED: Final = 0
"""The robot read the message."""
LOST: Final = 1
"""The network lost the message on its way to the robot."""
NOT_DUE: Final = 2
"""Not lost, but not read: it arrived after the last tick at which the robot read messages."""
OWN: Final = 3
"""The robot sent it."""


@dataclass(frozen=True, eq=False)
class MessageLog:
    """The messages of a run, in the order of time and sender; robots by number."""

    sender: NDArray[np.int64]
    """(messages,): number of the robot that sent it."""
    tick: NDArray[np.int64]
    """(messages,): tick at which it was sent."""
    arrival_tick: NDArray[np.int64]
    """(messages, robots): tick from which it can be read; -1: lost, or sent by this robot."""
    last_read_tick: NDArray[np.int64]
    """(robots,): last tick at which the robot read messages, before its radio was dead."""

    @cached_property
    def state(self) -> NDArray[np.uint8]:
        """State of each message at each robot: ``RECEIVED``, ``LOST``, ``NOT_DUE`` or ``OWN``, (messages, robots)."""
        # ``arrival_tick`` is -1 for the sender too; its state is set to ``OWN`` below.
        is_due = self.arrival_tick <= self.last_read_tick
        state = np.where(self.arrival_tick < 0, LOST, np.where(is_due, RECEIVED, NOT_DUE)).astype(np.uint8)
        state[np.arange(self.sender.size), self.sender] = OWN
        return state

    def counts(self) -> pl.DataFrame:
        """Count the messages.

        Returns: one row per robot with numbers of messages: sent (by this robot), and of those to this robot received,
            lost and not_due (not lost, but not read by the end).
        """
        kinds = {"sent": OWN, "received": RECEIVED, "lost": LOST, "not_due": NOT_DUE}
        robots = np.arange(self.state.shape[1], dtype=np.uint16)
        return pl.DataFrame(
            {"robot": robots, **{name: (self.state == kind).sum(axis=0) for name, kind in kinds.items()}}
        )


def message_log(result: Result, run: int = 0) -> MessageLog:
    """Recompute when each message of a simulated run arrived at each robot.

    Raises:
        InputError: the result has no moves although its network reads positions.
    """
    scenario, of_run = result.scenario, pl.col("run") == run
    assert result.seed is not None  # it was simulated
    moves = None if result.moves is None else result.moves.filter(of_run)
    motion = Motion(samples=result.motion.filter(of_run), ends=result.ends.filter(of_run), moves=moves)
    timeline = timeline_of(scenario, motion)
    sender, tick, arrival_tick = sent_messages(
        scenario, result.seed, timeline, result.observations.filter(of_run)
    )
    return MessageLog(
        sender=sender,
        tick=tick,
        arrival_tick=arrival_tick,
        last_read_tick=_last_read_tick(timeline, silent_ticks(scenario, result.seed, [run])[0]),
    )


def _last_read_tick(timeline: Timeline, silent_tick: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the last tick at which each robot read messages, (robots,): at which it walked with a working radio.

    Args:
        timeline: of the run. silent_tick: tick from which each robot's radio is dead, (robots,).
    """
    last = np.minimum(timeline.stops.walked_tick, silent_tick - 1)
    for i in range(last.size):
        own = timeline.rows.robot == i
        stop_tick, sample_tick = timeline.stops.stop_tick[own], timeline.stops.tick[own]
        # A robot stands from ``stop_tick`` to its sample. If its radio dies then, it last read before the stop.
        standing = (stop_tick <= last[i]) & (last[i] <= sample_tick)
        if standing.any():
            last[i] = stop_tick[standing][0] - 1
    return last
