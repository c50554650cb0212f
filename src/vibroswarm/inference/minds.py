"""The minds of a swarm as rows of numbers, and what happens to one of them: it hears, it samples.

Replay and the whole run do both by these functions.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.compiled import inner, kernel, signed
from vibroswarm.draws import LOSS, uniform
from vibroswarm.observation.boundary import readings_boundary
from vibroswarm.scenario import Scenario
from vibroswarm.strategies.belief_table import Beliefs, belief_of
from vibroswarm.strategies.program import (
    GATES,
    STRATEGIES,
    Mind,
    MindProgram,
    begin_mind,
    conclude,
    needs_belief,
    observe,
    receive,
)

MIND = np.dtype(
    [(name, np.int64) for name in ("alpha", "beta", "decision", "own", "received", "message")]
    + [("heard", np.int64), ("ones", np.int64), ("own_ones", np.int64), ("decided_row", np.int64)]
    + [("belief", np.float64), ("belief_at_decision", np.float64)]
)
"""One robot's ``Mind``; how many of the run's messages it has come past, ones received, ones among its own messages;
the row of the sample at which its decision came to stand (-1: none); its belief at its last sample, and then."""

FINALS: Final[dict[str, Any]] = {
    "run": pl.UInt32,
    "robot": pl.UInt16,
    "decision": pl.Int8,
    "decision_time_s": pl.Float64,
    "belief_at_decision": pl.Float64,
    "belief": pl.Float64,
    "alpha": pl.UInt32,
    "beta": pl.UInt32,
    "samples": pl.UInt32,
    "received": pl.UInt32,
}
"""What became of each robot. ``belief`` is at the moment of decision, or at the last sample of a robot that never
decided; alpha, beta and received are at the end."""


def mind_program(scenario: Scenario) -> MindProgram:
    """The parameters of deciding and saying, as the robot's program reads them."""
    decision, strategy = scenario.decision, scenario.strategy
    return MindProgram(
        strategy=STRATEGIES.index(strategy.name),
        eta=strategy.eta,
        kappa=strategy.kappa,
        boundary=readings_boundary(scenario),
        credible_threshold=decision.credible_threshold,
        min_observations=decision.min_observations,
        gate=GATES.index(decision.gate),
        gate_counts_current=decision.gate_counts_current,
        revise=decision.revise,
        prior_alpha=decision.prior_alpha,
        prior_beta=decision.prior_beta,
    )


@inner
def load_mind(minds: NDArray[np.void], i: int) -> Mind:
    """Row ``i`` as the robot's program sees it."""
    row = minds[i]
    return Mind(row.alpha, row.beta, row.decision, row.own, row.received, row.message)


@inner
def store_mind(minds: NDArray[np.void], i: int, mind: Mind) -> None:
    """The reverse of ``load_mind``."""
    row = minds[i]
    row.alpha, row.beta, row.decision = mind.alpha, mind.beta, mind.decision
    row.own, row.received, row.message = mind.own, mind.received, mind.message


@kernel
def begin_minds(minds: NDArray[np.void], program: MindProgram) -> None:
    """All robots at the prior, nothing heard."""
    first = begin_mind(program)
    for i in range(minds.size):
        store_mind(minds, i, first)
        row = minds[i]
        row.heard, row.ones, row.own_ones, row.decided_row = 0, 0, 0, -1
        row.belief, row.belief_at_decision = np.nan, np.nan


@inner
def lost(seed: int, run: int, receiver: int, sender: int, index: int, loss: float) -> bool:
    """Whether the sender's message of its sample ``index`` does not reach the receiver."""
    return loss > 0.0 and loss_number(seed, run, receiver, sender, index) < loss


@inner
def loss_number(seed: int, run: int, receiver: int, sender: int, index: int) -> float:
    """The uniform number of a message and a receiver: below ``loss`` it does not arrive."""
    return uniform(seed, run, receiver, LOSS, index, sender)


@inner
def hear(
    minds: NDArray[np.void],
    i: int,
    until: int,
    senders: NDArray[np.uint16],
    samples: NDArray[np.uint32],
    bits: NDArray[np.uint8],
    seed: int,
    run: int,
    loss: float,
) -> None:
    """Robot ``i`` reads, message by message, what it has not come past of the run's first ``until`` messages.

    Args:
        senders, samples, bits: (messages,), in the order of sending.
    """
    ones = zeros = 0
    for k in range(minds[i].heard, until):
        sender, bit = signed(senders[k]), signed(bits[k])
        if sender != i and not lost(seed, run, i, sender, signed(samples[k]), loss):
            ones += bit
            zeros += 1 - bit
    minds[i].heard = until
    if ones + zeros > 0:
        store_mind(minds, i, receive(load_mind(minds, i), ones, zeros))


@inner
def come_to(minds: NDArray[np.void], i: int, ones: int, heard: int) -> Mind:
    """What robot ``i`` has in mind when it has heard so many messages in all, of which so many are ones; not stored."""
    mind, new_ones = load_mind(minds, i), ones - minds[i].ones
    minds[i].ones = ones
    return receive(mind, new_ones, heard - mind.received - new_ones)


@inner
def take_sample(
    minds: NDArray[np.void],
    i: int,
    row: int,
    observation: int,
    u: float,
    program: MindProgram,
    beliefs: Beliefs,
    in_full: bool,
) -> int:
    """Robot ``i`` observes, updates, tests and composes; gives its message.

    Args:
        row: of the sample in the motion table. u: the uniform number of its message.
        in_full: also find the belief where nothing depends on it.
    """
    mind = load_mind(minds, i)
    return sample_with(mind, minds, i, row, observation, u, program, beliefs, in_full)


@inner
def sample_with(
    mind: Mind,
    minds: NDArray[np.void],
    i: int,
    row: int,
    observation: int,
    u: float,
    program: MindProgram,
    beliefs: Beliefs,
    in_full: bool,
) -> int:
    """``take_sample`` of a robot that has this in mind, and not what stands in its row."""
    seen = observe(mind, observation)
    belief = np.nan
    if in_full or needs_belief(seen, program):
        belief = belief_of(beliefs, seen.alpha, seen.beta)
    mind = conclude(seen, belief, observation, u, program)
    if mind.decision != seen.decision:
        minds[i].decided_row, minds[i].belief_at_decision = row, belief
    minds[i].belief = belief
    minds[i].own_ones += mind.message
    store_mind(minds, i, mind)
    return mind.message


def final_columns(minds: NDArray[np.void], time_s: NDArray[np.float64]) -> dict[str, NDArray[Any]]:
    """The columns of ``FINALS`` but run and robot, each of the shape of ``minds``; not a number where there is none.

    Args:
        time_s: (rows,) of the samples.
    """
    decided = minds["decision"] != -1
    decision_time_s = np.full(minds.shape, np.nan)
    decision_time_s[decided] = time_s[minds["decided_row"][decided]]
    return {
        "decision": minds["decision"].astype(np.int8),
        "decision_time_s": decision_time_s,
        "belief_at_decision": minds["belief_at_decision"].copy(),
        "belief": np.where(decided, minds["belief_at_decision"], minds["belief"]),
        "alpha": minds["alpha"].astype(np.uint32),
        "beta": minds["beta"].astype(np.uint32),
        "samples": minds["own"].astype(np.uint32),
        "received": minds["received"].astype(np.uint32),
    }


def final_frame(ends: pl.DataFrame, minds: NDArray[np.void], time_s: NDArray[np.float64]) -> pl.DataFrame:
    """What became of each robot, in the order of the ends.

    Args:
        time_s: (rows,) of the samples.
    """
    columns = final_columns(minds, time_s).items()
    found = [pl.Series(name, column, nan_to_null=column.dtype == np.float64) for name, column in columns]
    return pl.DataFrame([ends["run"], ends["robot"], *found])
