"""A run followed as it moves: samples are read and replayed as they come, until nothing more can be decided.

It gives what motion to the end, observation and replay give one after the other, and a test holds it to that; but no
table is made, and who follows knows when all have decided.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.compiled import kernel, signed, zero_rows
from vibroswarm.draws import ALONE, MESSAGE, uniform
from vibroswarm.inference.minds import MIND, begin_minds, hear, load_mind, mind_program, sample_with
from vibroswarm.inference.replay import hear_all
from vibroswarm.inference.timeline import HEARD_ROWS, write_heard
from vibroswarm.observation.ground import Ground, read
from vibroswarm.scenario import Scenario
from vibroswarm.strategies.belief_table import Beliefs, beliefs
from vibroswarm.strategies.program import SOFT, MindProgram


class Notes(NamedTuple):
    """What is known of a run's samples so far, in the order of time; (room,) each but where it is said."""

    robot: NDArray[np.uint16]
    sample: NDArray[np.uint32]
    tick: NDArray[np.int64]
    previous: NDArray[np.int32]
    """The robot's row before; -1: none."""
    heard: NDArray[np.int32]
    """(room, 3): as of ``Timeline``."""
    message: NDArray[np.uint8]
    ones_sent: NDArray[np.int32]
    """(room + 1,): ones among the messages before each row."""
    own_ones: NDArray[np.int32]
    estimate: NDArray[np.float64]
    """Mean of the robot's posterior after the sample."""
    latest: NDArray[np.int32]
    """(robots,): the robot's last row; -1: none."""
    own: NDArray[np.int32]
    """(robots,): how many it has taken."""
    filled: NDArray[np.int64]
    """(1,): how many rows there are."""
    undecided: NDArray[np.int64]
    """(2,): how many robots are undecided; the tick at which none was any more (-1: some are)."""


def empty_notes(robots: int, room: int) -> Notes:
    """Notes for so many samples."""
    return Notes(
        robot=np.empty(room, dtype=np.uint16),
        sample=np.empty(room, dtype=np.uint32),
        tick=np.empty(room, dtype=np.int64),
        previous=np.empty(room, dtype=np.int32),
        heard=np.empty((room, 3), dtype=np.int32),
        message=np.empty(room, dtype=np.uint8),
        ones_sent=np.zeros(room + 1, dtype=np.int32),
        own_ones=np.empty(room, dtype=np.int32),
        estimate=np.empty(room),
        latest=np.empty(robots, dtype=np.int32),
        own=np.empty(robots, dtype=np.int32),
        filled=np.zeros(1, dtype=np.int64),
        undecided=np.zeros(2, dtype=np.int64),
    )


@kernel
def begin_notes(notes: Notes, minds: NDArray[np.void], program: MindProgram) -> None:
    """Nobody has sampled, all are at the prior."""
    begin_minds(minds, program)
    notes.filled[0] = 0
    notes.latest[:] = -1
    notes.own[:] = 0
    notes.undecided[0], notes.undecided[1] = minds.size, -1


@kernel
def follow(
    rows: NDArray[np.void],
    ground: Ground,
    notes: Notes,
    minds: NDArray[np.void],
    program: MindProgram,
    beliefs: Beliefs,
    seed: int,
    run: int,
    loss: float,
) -> None:
    """Take in the samples that came next.

    Args:
        rows: ``motion.record.SAMPLE_ROW``. minds: (robots,).
    """
    for n in range(rows.size):
        row, k = rows[n], notes.filled[0]
        i, index = signed(row.robot), signed(row.sample)
        _, bit, _, _ = read(ground, row.x_m, row.y_m, seed, run, i, index)
        notes.robot[k], notes.sample[k], notes.tick[k] = row.robot, row.sample, row.tick
        notes.previous[k] = notes.latest[i]
        until, last_own, own = row.stop_tick - 2, notes.latest[i], notes.own[i]
        write_heard(notes.heard[k], notes.heard, notes.previous, notes.tick, 0, k, until, last_own, own)
        if loss > 0.0:
            until = notes.heard[k, HEARD_ROWS]
            hear(minds, i, until, notes.robot, notes.sample, notes.message, seed, run, loss)
            mind = load_mind(minds, i)
        else:
            mind = hear_all(minds, i, notes.heard[k], notes.ones_sent, notes.own_ones)
        u = uniform(seed, run, i, MESSAGE, index, ALONE) if program.strategy == SOFT else 0.5
        message = sample_with(mind, minds, i, k, bit, u, program, beliefs, False)
        notes.message[k] = message
        notes.ones_sent[k + 1] = notes.ones_sent[k] + message
        notes.own_ones[k] = minds[i].own_ones
        notes.estimate[k] = minds[i].alpha / (minds[i].alpha + minds[i].beta)
        notes.latest[i] = k
        notes.own[i] += 1
        notes.filled[0] += 1
        if mind.decision == -1 and minds[i].decision != -1:
            notes.undecided[0] -= 1
            if notes.undecided[0] == 0:
                notes.undecided[1] = row.tick


@kernel
def decided_at(
    notes: Notes,
    minds: NDArray[np.void],
    tick_ms: int,
    decision: NDArray[np.int64],
    time_s: NDArray[np.float64],
) -> float:
    """What the robots have decided so far and when, s; gives when the last of them has, infinite if not all have.

    Args:
        decision, time_s: (robots,), written; -1 and not a number where undecided.
    """
    last_s = 0.0
    for i in range(minds.size):
        decision[i], time_s[i] = minds[i].decision, np.nan
        if minds[i].decision == -1:
            last_s = np.inf
        else:
            time_s[i] = notes.tick[minds[i].decided_row] * tick_ms / 1000.0
            last_s = max(last_s, time_s[i])
    return last_s


@kernel
def estimates_at(
    notes: Notes, program: MindProgram, tick_ms: int, end_s: float, estimate: NDArray[np.float64]
) -> None:
    """The robots' posterior means after their last own samples up to ``end_s``, into an array of (robots,)."""
    estimate[:] = program.prior_alpha / (program.prior_alpha + program.prior_beta)
    for k in range(notes.filled[0]):
        if notes.tick[k] * tick_ms / 1000.0 <= end_s:
            estimate[signed(notes.robot[k])] = notes.estimate[k]


class Follower:
    """Follows runs of a scenario, one after the other."""

    def __init__(self, scenario: Scenario, seed: int) -> None:
        tick_ms, robots = scenario.run.control_period_ms, scenario.swarm.robots
        between = (
            1 + int(scenario.sample.sample_interval_ms // tick_ms) + int(scenario.sample.stop_ms // tick_ms)
        )
        room = robots * (scenario.ticks // between + 2)
        self.seed, self.tick_ms, self.tick_s, self.loss = (
            seed,
            tick_ms,
            scenario.tick_s,
            scenario.network.loss,
        )
        self.program = mind_program(scenario)
        self.beliefs = beliefs(
            self.program.boundary, self.program.prior_alpha + self.program.prior_beta + room
        )
        self.notes, self.minds = empty_notes(robots, room), zero_rows(robots, MIND)

    def begin(self, run: int, ground: Ground) -> None:
        """Go to the start of a run."""
        self.run, self.ground = run, ground
        begin_notes(self.notes, self.minds, self.program)

    def take(self, rows: NDArray[np.void]) -> None:
        """Take in the samples that came next (``motion.record.SAMPLE_ROW``)."""
        follow(
            rows,
            self.ground,
            self.notes,
            self.minds,
            self.program,
            self.beliefs,
            self.seed,
            self.run,
            self.loss,
        )

    def decided(self, decision: NDArray[np.int64], time_s: NDArray[np.float64]) -> float:
        """What the robots have decided so far and when, s; gives when the last of them has, infinite if not all have.

        Args:
            decision, time_s: (robots,), written; -1 and not a number where undecided.
        """
        return decided_at(self.notes, self.minds, self.tick_ms, decision, time_s)

    def estimates(self, end_s: float, estimate: NDArray[np.float64]) -> None:
        """The robots' posterior means after their last own samples up to ``end_s``, into an array of (robots,)."""
        estimates_at(self.notes, self.program, self.tick_ms, end_s, estimate)

    @property
    def all_decided_s(self) -> float | None:
        """When the last robot decided for the first time, s; None while there are undecided ones."""
        tick = int(self.notes.undecided[1])
        return None if tick < 0 else tick * self.tick_ms / 1000.0


def may_revise(scenario: Scenario) -> bool:
    """Whether a robot that has decided may decide otherwise later."""
    return scenario.decision.revise and scenario.strategy.name == "soft"
