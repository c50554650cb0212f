"""Every message of a run, and what became of it at each robot: received, lost, or not due before the end.

The tables of a result hold only counts; this is recomputed from them with the run's random numbers. Every message
addressed to a robot is in one state: sent = received + lost + not due.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.jit import read_only
from vibroswarm.errors import InputError
from vibroswarm.inference.deliveries import timeline_of
from vibroswarm.inference.replay import sent_messages
from vibroswarm.inference.replay_arrays import Rows, Stops
from vibroswarm.inference.sender_positions import NO_TRACKS
from vibroswarm.inference.shared_deliveries import compute_deliveries
from vibroswarm.motion.source import Motion
from vibroswarm.networks import network as network_of
from vibroswarm.result import Result

RECEIVED: Final = 0
LOST: Final = 1
NOT_DUE: Final = 2
"""It would have been read after the run's end, or by a robot that was standing when the run ended."""
OWN: Final = 3
"""The robot sent it."""
MAX_ENTRIES: Final = 50_000_000
"""Messages times robots of a log."""


@dataclass(frozen=True, eq=False)
class MessageLog:
    """The messages of a run, in the order of time and sender; robots by number."""

    tick_s: float
    sender: NDArray[np.int64]
    tick: NDArray[np.int64]
    """(messages,): when it was sent."""
    arrival_tick: NDArray[np.int64]
    """(messages, robots): tick from which it can be read; -1: lost, or sent by this robot."""
    last_read_tick: NDArray[np.int64]
    """(robots,): last tick at which the robot read messages."""

    @property
    def time_s(self) -> NDArray[np.float64]:
        """When each message was sent, (messages,)."""
        return np.asarray(self.tick * self.tick_s)

    @cached_property
    def state(self) -> NDArray[np.uint8]:
        """``RECEIVED``, ``LOST``, ``NOT_DUE`` or ``OWN``, (messages, robots)."""
        is_due = self.arrival_tick <= self.last_read_tick
        state = np.where(self.arrival_tick < 0, LOST, np.where(is_due, RECEIVED, NOT_DUE)).astype(np.uint8)
        state[np.arange(self.sender.size), self.sender] = OWN
        return state

    def counts(self, until_s: float = np.inf) -> pl.DataFrame:
        """Count the messages sent until a time, a row per robot: sent, addressed, received, lost, not_due."""
        state = self.state[self.time_s <= until_s]
        own, received, lost, not_due = (
            (state == kind).sum(axis=0) for kind in (OWN, RECEIVED, LOST, NOT_DUE)
        )
        robots = np.arange(state.shape[1], dtype=np.uint16)
        columns = {"sent": own, "addressed": state.shape[0] - own, "received": received, "lost": lost}
        return pl.DataFrame({"robot": robots, **columns, "not_due": not_due})


def log_size(result: Result, run: int = 0) -> int:
    """Return messages times robots of a run."""
    sent = result.robots.filter(pl.col("run") == run)["sent"].sum()
    return int(sent) * result.scenario.swarm.robots


def message_log(result: Result, run: int = 0) -> MessageLog:
    """Return the messages of a run of a simulation.

    Raises:
        InputError: the result is a recording, has no such run, or no moves although its network reads positions; or
            there are too many messages.
    """
    scenario, of_run = result.scenario, pl.col("run") == run
    ends = result.ends.filter(of_run)
    if result.seed is None:
        raise InputError("is a recording, and does not tell which messages were lost", field="result")
    if ends.is_empty():
        raise InputError(f"the result has no run {run}", field="run")
    moves = None if result.moves is None else result.moves.filter(of_run)
    motion = Motion(result.motion.filter(of_run), ends, None, moves)
    timeline = timeline_of(scenario, motion)
    sender, tick = sent_messages(scenario, result.seed, timeline, result.observations.filter(of_run))
    robots, messages = scenario.swarm.robots, sender.size
    if messages * robots > MAX_ENTRIES:
        raise InputError(f"{messages} messages to {robots} robots are too many to list", field="run")
    log = np.full((messages, robots), -1, dtype=np.int64)
    nothing = read_only(np.zeros(messages, dtype=np.int64))
    rows = Rows(
        read_only(np.array([0, messages])),
        read_only(np.array([run], dtype=np.int64)),
        read_only(sender.astype(np.uint16)),
        read_only(np.zeros(messages, dtype=np.uint32)),
        read_only(np.zeros(messages)),
        read_only(np.zeros((messages, 3), dtype=np.int32)),
        read_only(np.zeros((robots, 3), dtype=np.int32)),
    )
    of_motion = timeline.stops
    unused = read_only(np.zeros(messages, dtype=np.int32))
    stops = Stops(
        read_only(tick), nothing, unused, of_motion.first, of_motion.walked_tick, of_motion.known_tick
    )
    tracks = timeline.tracks if network_of(scenario.network.name).reads_positions else NO_TRACKS
    compute_deliveries(scenario, result.seed, rows, stops, tracks, log)
    return MessageLog(scenario.tick_s, sender, tick, log, of_motion.walked_tick)
