"""Replay of a strategy over the samples of a run, messages and all.

Without loss everybody hears everything, so what a robot has received follows from how many ones all have sent so
far, less its own; with loss it is heard message by message, and who loses what is drawn once for all strategies.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.compiled import inner, kernel, read_only, signed, unsigned, zero_rows
from vibroswarm.inference.minds import (
    MIND,
    begin_minds,
    come_to,
    final_frame,
    hear,
    load_mind,
    mind_program,
    sample_with,
    store_mind,
)
from vibroswarm.inference.timeline import HEARD_ROWS, LAST_OWN, OTHERS, Reach, Timeline, in_lane, timeline_of
from vibroswarm.motion.contract import Motion
from vibroswarm.scenario import Scenario
from vibroswarm.strategies.belief_table import Beliefs, belief_of, beliefs
from vibroswarm.strategies.program import SOFT, Mind, MindProgram

INFERENCE: Final[dict[str, Any]] = {
    "run": pl.UInt32,
    "robot": pl.UInt16,
    "sample": pl.UInt32,
    "message": pl.UInt8,
    "alpha": pl.UInt32,
    "beta": pl.UInt32,
    "received": pl.UInt32,
    "belief": pl.Float64,
    "decision": pl.Int8,
}


class Columns(NamedTuple):
    """The columns of the inference table that are not the motion's, (rows,) each."""

    message: NDArray[np.uint8]
    alpha: NDArray[np.uint32]
    beta: NDArray[np.uint32]
    received: NDArray[np.uint32]
    belief: NDArray[np.float64]
    decision: NDArray[np.int8]


def empty_columns(rows: int) -> Columns:
    """Columns to be written."""
    return Columns(
        message=np.empty(rows, dtype=np.uint8),
        alpha=np.empty(rows, dtype=np.uint32),
        beta=np.empty(rows, dtype=np.uint32),
        received=np.empty(rows, dtype=np.uint32),
        belief=np.empty(rows),
        decision=np.empty(rows, dtype=np.int8),
    )


@inner
def write_row(columns: Columns, k: int, minds: NDArray[np.void], i: int) -> None:
    """The inference table's row of the sample that robot ``i`` has just taken."""
    mind = minds[i]
    columns.message[k], columns.decision[k], columns.received[k] = mind.message, mind.decision, mind.received
    columns.alpha[k], columns.beta[k], columns.belief[k] = mind.alpha, mind.beta, mind.belief


@inner
def hear_all(
    minds: NDArray[np.void],
    i: int,
    heard: NDArray[np.int32],
    ones_sent: NDArray[np.int32],
    own_ones: NDArray[np.int32],
) -> Mind:
    """``come_to`` of robot ``i`` that has come past so many messages (a row of ``Timeline.heard``), none of them lost.

    Args:
        ones_sent: (rows + 1,): ones among the run's messages before each row. own_ones: (rows,): ones among the
            sender's messages up to each row.
    """
    ones = ones_sent[unsigned(heard[HEARD_ROWS])]
    if heard[LAST_OWN] >= 0:
        ones -= own_ones[unsigned(heard[LAST_OWN])]
    return come_to(minds, i, ones, signed(heard[OTHERS]))


@kernel
def replay_runs(
    bounds: NDArray[np.int64],
    runs: NDArray[np.int64],
    robot: NDArray[np.uint16],
    sample: NDArray[np.uint32],
    heard: NDArray[np.int32],
    heard_at_end: NDArray[np.int32],
    observation: NDArray[np.uint8],
    numbers: NDArray[np.float64],
    minds: NDArray[np.void],
    message: NDArray[np.uint8],
    ones_sent: NDArray[np.int32],
    own_ones: NDArray[np.int32],
    ones_reached: NDArray[np.uint64],
    columns: Columns,
    program: MindProgram,
    beliefs: Beliefs,
    seed: int,
    loss: float,
    reach: Reach,
) -> None:
    """The runs, one after the other, each from the prior to its end.

    Args:
        bounds to heard_at_end: of the ``Timeline``. observation: (rows,). numbers: (rows,) for the messages of
            soft feedback, else of any length.
        minds: (runs * robots,), overwritten. message: (rows,), overwritten. ones_sent: (rows of the longest run
            + 1,), own_ones: (rows of the longest run,) and ones_reached: (rows of the longest run + 1, words):
            scratch.
        columns: overwritten; of no rows: only the minds are wanted. reach: ``Timeline.reach``.
    """
    robots = minds.size // max(runs.size, 1)
    in_full = columns.belief.size > 0
    begin_minds(minds, program)
    ones_sent[0] = 0
    words, told = unsigned(reach.words.shape[1]), reach.words.shape[1] > 0
    for w in range(words):
        ones_reached[0, w] = 0
    for r in range(runs.size):
        low, high, run = bounds[r], bounds[r + 1], runs[r]
        swarm = minds[r * robots : (r + 1) * robots]
        senders, samples, bits = robot[low:high], sample[low:high], message[low:high]
        for m in range(unsigned(high - low)):
            k, after = unsigned(low) + m, m + unsigned(1)
            i = unsigned(robot[k])
            if told:
                ones = in_lane(ones_reached[unsigned(heard[k, HEARD_ROWS])], signed(i))
                mind = come_to(swarm, i, ones, signed(reach.others[k]))
            elif loss > 0.0:
                hear(swarm, signed(i), heard[k, HEARD_ROWS], senders, samples, bits, seed, run, loss)
                mind = load_mind(swarm, i)
            else:
                mind = hear_all(swarm, i, heard[k], ones_sent, own_ones)
            u = numbers[k] if program.strategy == SOFT else 0.5
            seen = signed(observation[k])
            bit = sample_with(mind, swarm, i, signed(k), seen, u, program, beliefs, in_full)
            message[k] = bit
            ones_sent[after] = ones_sent[m] + bit
            own_ones[m] = swarm[i].own_ones
            for w in range(words):
                more = reach.words[k, w] if bit == 1 else np.uint64(0)
                ones_reached[after, w] = ones_reached[m, w] + more
            if in_full:
                write_row(columns, k, swarm, i)
        for i in range(robots):
            if swarm[i].own > 0 and not in_full:
                swarm[i].belief = belief_of(beliefs, swarm[i].alpha, swarm[i].beta)
            last = heard_at_end[r * robots + i]
            if told:
                at_end = signed(reach.others_at_end[r * robots + i])
                store_mind(swarm, i, come_to(swarm, i, in_lane(ones_reached[last[HEARD_ROWS]], i), at_end))
            elif loss > 0.0:
                hear(swarm, i, last[HEARD_ROWS], senders, samples, bits, seed, run, loss)
            else:
                store_mind(swarm, i, hear_all(swarm, i, last, ones_sent, own_ones))


def infer(
    scenario: Scenario, seed: int, motion: Motion | Timeline, observations: pl.DataFrame
) -> tuple[pl.DataFrame, pl.DataFrame]:
    """The inference table, and what became of each robot (``minds.FINALS``).

    Args:
        motion: or its timeline, made once for many strategies.
        observations: the observation table of the motion, row by row.
    Raises:
        ValueError: the rows of motion and observations are not the same.
    """
    timeline = timeline_of(scenario, motion)
    columns = empty_columns(timeline.robot.size)
    finals = _replayed(scenario, seed, timeline, observations, columns)
    return inference_frame(timeline.samples, columns), finals


def outcomes(
    scenario: Scenario, seed: int, motion: Motion | Timeline, observations: pl.DataFrame
) -> pl.DataFrame:
    """What became of each robot, as ``infer`` has it, without the inference table."""
    return _replayed(scenario, seed, timeline_of(scenario, motion), observations, empty_columns(0))


def replay_to(
    minds: NDArray[np.void], scenario: Scenario, seed: int, timeline: Timeline, observation: NDArray[np.uint8]
) -> None:
    """``outcomes`` as rows: what the robots have in mind at the end of each run.

    Args:
        minds: (runs * robots,) of ``minds.MIND``, overwritten. observation: (rows,), of the timeline's samples.
    """
    _replay(minds, scenario, seed, timeline, observation, empty_columns(0))


def _replayed(
    scenario: Scenario, seed: int, timeline: Timeline, observations: pl.DataFrame, columns: Columns
) -> pl.DataFrame:
    if not _same_rows(timeline.samples, observations):
        raise ValueError("the observation table has not the rows of the motion table")
    minds = zero_rows(timeline.runs.size * timeline.robots, MIND)
    _replay(minds, scenario, seed, timeline, observations["observation"].to_numpy(), columns)
    return final_frame(timeline.ends, minds, timeline.time_s)


def _replay(
    minds: NDArray[np.void],
    scenario: Scenario,
    seed: int,
    timeline: Timeline,
    observation: NDArray[np.uint8],
    columns: Columns,
) -> None:
    program, rows = mind_program(scenario), timeline.robot.size
    reach = timeline.reach(seed, scenario.network.loss)
    counts = program.prior_alpha + program.prior_beta + timeline.longest
    replay_runs(
        timeline.bounds,
        timeline.runs,
        timeline.robot,
        timeline.sample,
        timeline.heard,
        timeline.heard_at_end,
        read_only(observation),
        timeline.message_numbers(seed) if program.strategy == SOFT else np.empty(0),
        minds,
        columns.message if columns.message.size else np.empty(rows, dtype=np.uint8),
        np.empty(timeline.longest + 1, dtype=np.int32),
        np.empty(timeline.longest, dtype=np.int32),
        np.empty((timeline.longest + 1, reach.words.shape[1]), dtype=np.uint64),
        columns,
        program,
        beliefs(program.boundary, counts),
        seed,
        scenario.network.loss,
        reach,
    )


def _same_rows(samples: pl.DataFrame, observations: pl.DataFrame) -> bool:
    if samples.height != observations.height:
        return False
    return all(_same(samples[name].to_numpy(), observations[name].to_numpy()) for name in samples.columns)


def _same(one: NDArray[Any], other: NDArray[Any]) -> bool:
    # An observation table is made with the columns of its motion table: one memory, nothing to compare.
    at_one_place = one.__array_interface__["data"][0] == other.__array_interface__["data"][0]
    return (at_one_place and one.dtype == other.dtype) or np.array_equal(one, other)


def inference_frame(samples: pl.DataFrame, columns: Columns) -> pl.DataFrame:
    """The inference table, in the order of the motion table; the columns may have more rows."""
    key = [samples[name] for name in ("run", "robot", "sample")]
    found = [pl.Series(name, column[: samples.height]) for name, column in columns._asdict().items()]
    return pl.DataFrame([*key, *found])
