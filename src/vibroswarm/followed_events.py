"""The event-driven engine and what follows a run as one kernel: a search of thousands of runs never waits for Python.

Only to be faster: moving and following by turns, each by its own kernel, comes to the same (tested).
"""

from __future__ import annotations

import math
from typing import TypeGuard

import numpy as np
from numpy.typing import NDArray

from vibroswarm.compiled import branching_kernel
from vibroswarm.inference.follow import Follower, Notes, follow
from vibroswarm.motion.body import Setup
from vibroswarm.motion.event import EventRun, events
from vibroswarm.motion.neighbours import SMALL_SWARM
from vibroswarm.motion.plans import Planners
from vibroswarm.motion.record import Record
from vibroswarm.observation.ground import Ground
from vibroswarm.strategies.belief_table import Beliefs
from vibroswarm.strategies.program import MindProgram


@branching_kernel
def events_until_decided(
    planners: Planners, wakes: NDArray[np.int64], near: NDArray[np.uint32], places: NDArray[np.float64],
    apart: NDArray[np.float64], awake: NDArray[np.uint32], standing: Planners, setup: Setup,
    speeds: NDArray[np.float64], record: Record, seed: int, run: int, tick: int, until: int, look_ticks: int,
    ground: Ground, notes: Notes, minds: NDArray[np.void], program: MindProgram, beliefs: Beliefs, loss: float,
    even_then: bool,
) -> int:  # fmt: skip
    """From event to event until all have decided, as seen every so many ticks, or to ``until``; gives the tick.

    Args:
        even_then: go on when all have decided.
    """
    while tick < until and (even_then or notes.undecided[1] < 0):
        tick = events(
            planners, wakes, near, places, apart, awake, standing, setup, speeds, record, seed, run,
            min(tick + look_ticks, until),
        )  # fmt: skip
        rows = record.samples[: record.filled[0]]
        follow(rows, ground, notes, minds, program, beliefs, seed, run, loss)
        record.filled[0] = 0
    return tick


def can_follow(state: object) -> TypeGuard[EventRun]:
    """Whether ``follow_until_decided`` does with this run: its robots are few, and only samples are kept."""
    if not isinstance(state, EventRun):
        return False
    kept = state.record.segments.size + state.record.moves.size
    return state.swarm.size <= SMALL_SWARM and kept == 0


def follow_until_decided(
    state: EventRun, follower: Follower, until_s: float, look_s: float, even_then: bool = False
) -> None:
    """Move a run, and follow it, until all have decided, as seen every ``look_s``, or to the tick at ``until_s``.

    Args:
        state: one that ``can_follow``. follower: of the same run, as far. even_then: go on when all have decided.
    """
    until, look_ticks = (math.ceil(time_s * 1000.0 / state.tick_ms - 1e-9) for time_s in (until_s, look_s))
    state.tick = events_until_decided(
        state.swarm, state.wakes, state.near, state.places, state.apart, state.awake, state.standing, state.setup,
        state.speeds, state.record, state.seed, state.run, max(state.tick, 1), until, max(look_ticks, 1),
        follower.ground, follower.notes, follower.minds, follower.program, follower.beliefs, follower.loss,
        even_then,
    )  # fmt: skip
