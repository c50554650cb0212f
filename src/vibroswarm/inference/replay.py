"""Replay of a strategy over the samples of a run, messages and all.

All hear all. A bit sent at tick k is read at the receiver's first walking tick after k, never during its
stop; ties are read in robot order, and each message and receiver is lost with probability ``loss``. So a
robot whose stop began at tick s (and that last walked at s - 1) has read, when it samples, what was sent
up to tick s - 2.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.compiled import kernel, zero_rows
from vibroswarm.draws import ALONE, LOSS, MESSAGE, uniform
from vibroswarm.motion.contract import Motion
from vibroswarm.robot.believe import Posterior
from vibroswarm.scenario import Scenario
from vibroswarm.strategies.program import (
    GATES,
    SOFT,
    STRATEGIES,
    Mind,
    MindProgram,
    begin_mind,
    receive,
    sample,
)

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

MIND = np.dtype(
    [("alpha", np.int64), ("beta", np.int64), ("belief", np.float64), ("log_term", np.float64)]
    + [(name, np.int64) for name in ("decision", "own", "received", "message", "ones", "zeros", "heard")]
)
"""One robot's ``Mind``, and how many of the run's messages it has come past."""


def mind_program(scenario: Scenario) -> MindProgram:
    """The parameters of deciding and saying, as the robot's program reads them."""
    decision, strategy = scenario.decision, scenario.strategy
    return MindProgram(
        strategy=STRATEGIES.index(strategy.name),
        eta=strategy.eta,
        kappa=strategy.kappa,
        boundary=decision.decision_boundary,
        credible_threshold=decision.credible_threshold,
        min_observations=decision.min_observations,
        gate=GATES.index(decision.gate),
        gate_counts_current=decision.gate_counts_current,
        revise=decision.revise,
        prior_alpha=decision.prior_alpha,
        prior_beta=decision.prior_beta,
    )


@kernel
def load_mind(minds: NDArray[np.void], i: int) -> Mind:
    """Row ``i`` as the robot's program sees it."""
    row = minds[i]
    posterior = Posterior(row.alpha, row.beta, row.belief, row.log_term)
    return Mind(posterior, row.decision, row.own, row.received, row.message, row.ones, row.zeros)


@kernel
def store_mind(minds: NDArray[np.void], i: int, mind: Mind) -> None:
    """The reverse of ``load_mind``."""
    row = minds[i]
    row.alpha, row.beta = mind.posterior.alpha, mind.posterior.beta
    row.belief, row.log_term = mind.posterior.belief, mind.posterior.log_term
    row.decision, row.own = mind.decision, mind.own
    row.received, row.message = mind.received, mind.message
    row.ones, row.zeros = mind.ones, mind.zeros


@kernel
def begin_minds(minds: NDArray[np.void], program: MindProgram) -> None:
    """All robots at the prior, nothing heard."""
    first = begin_mind(program)
    for i in range(minds.size):
        store_mind(minds, i, first)
        minds[i].heard = 0


@kernel
def lost(seed: int, run: int, receiver: int, sender: int, index: int, loss: float) -> bool:
    """Whether the sender's message of its sample ``index`` does not reach the receiver."""
    return loss > 0.0 and uniform(seed, run, receiver, LOSS, index, sender) < loss


@kernel
def hear(
    minds: NDArray[np.void],
    i: int,
    until_tick: int,
    sent: NDArray[np.int64],
    count: int,
    seed: int,
    run: int,
    loss: float,
) -> None:
    """Robot ``i`` reads what was sent up to ``until_tick`` and not yet read.

    Args:
        sent: (messages, 4): tick, sender, sample, bit, in the order of sending; ``count`` are there so far.
    """
    k, ones, zeros = minds[i].heard, 0, 0
    while k < count and sent[k, 0] <= until_tick:
        sender, bit = sent[k, 1], sent[k, 3]
        if sender != i and not lost(seed, run, i, sender, sent[k, 2], loss):
            ones += bit
            zeros += 1 - bit
        k += 1
    minds[i].heard = k
    if ones + zeros > 0:
        store_mind(minds, i, receive(load_mind(minds, i), ones, zeros))


@kernel
def take_sample(
    minds: NDArray[np.void], i: int, index: int, observation: int, program: MindProgram, seed: int, run: int
) -> None:
    """Robot ``i`` observes, updates, tests and composes; ``index`` is the number of its sample."""
    u = 0.5
    if program.strategy == SOFT:  # the others say nothing by chance
        u = uniform(seed, run, i, MESSAGE, index, ALONE)
    store_mind(minds, i, sample(load_mind(minds, i), observation, u, program))


@kernel
def write_row(out: NDArray[np.void], k: int, minds: NDArray[np.void], i: int) -> None:
    """The inference table's row of the sample just taken."""
    row, mind = out[k], minds[i]
    row.message, row.decision, row.received = mind.message, mind.decision, mind.received
    row.alpha, row.beta, row.belief = mind.alpha, mind.beta, mind.belief


INFERENCE_ROW = np.dtype(
    [
        ("message", np.uint8),
        ("alpha", np.uint32),
        ("beta", np.uint32),
        ("received", np.uint32),
        ("belief", np.float64),
        ("decision", np.int8),
    ]
)


@kernel
def replay_run(
    samples: NDArray[np.int64],
    last_heard_tick: NDArray[np.int64],
    minds: NDArray[np.void],
    sent: NDArray[np.int64],
    out: NDArray[np.void],
    program: MindProgram,
    seed: int,
    run: int,
    loss: float,
) -> None:
    """One run from the prior to its end.

    Args:
        samples: (samples, 5): tick, robot, sample, stop tick, observation; sorted by tick, then robot.
        last_heard_tick: (robots,): what was sent up to this tick has been read at the end of the run.
        minds: (robots,), overwritten. sent: (samples, 4) of scratch. out: (samples,) of ``INFERENCE_ROW``.
    """
    begin_minds(minds, program)
    for k in range(samples.shape[0]):
        tick, i, index = samples[k, 0], samples[k, 1], samples[k, 2]
        hear(minds, i, samples[k, 3] - 2, sent, k, seed, run, loss)
        take_sample(minds, i, index, samples[k, 4], program, seed, run)
        sent[k, 0], sent[k, 1], sent[k, 2], sent[k, 3] = tick, i, index, minds[i].message
        write_row(out, k, minds, i)
    for i in range(minds.size):
        hear(minds, i, last_heard_tick[i], sent, samples.shape[0], seed, run, loss)


@kernel
def replay_runs(
    samples: NDArray[np.int64],
    bounds: NDArray[np.int64],
    runs: NDArray[np.int64],
    last_heard_tick: NDArray[np.int64],
    minds: NDArray[np.void],
    sent: NDArray[np.int64],
    out: NDArray[np.void],
    program: MindProgram,
    seed: int,
    loss: float,
) -> None:
    """``replay_run`` for each of ``runs``, whose samples are the rows from ``bounds[r]`` to ``bounds[r + 1]``.

    Args:
        last_heard_tick, minds: (runs * robots,), run by run. The others as ``replay_run`` has them.
    """
    robots = minds.size // runs.size
    for r in range(runs.size):
        low, high = bounds[r], bounds[r + 1]
        of_run = slice(r * robots, (r + 1) * robots)
        replay_run(
            samples[low:high],
            last_heard_tick[of_run],
            minds[of_run],
            sent,
            out[low:high],
            program,
            seed,
            runs[r],
            loss,
        )


def to_ticks(times_s: pl.Series, tick_ms: int) -> NDArray[np.int64]:
    """The ticks nearest to the times, shape (rows,)."""
    return np.rint(times_s.to_numpy() * (1000.0 / tick_ms)).astype(np.int64)


def infer(
    scenario: Scenario, seed: int, motion: Motion, observations: pl.DataFrame
) -> tuple[pl.DataFrame, pl.DataFrame]:
    """The inference table and the final posteriors, from a motion and its observation table (same rows).

    Raises:
        ValueError: the rows of motion and observations are not the same.
    """
    key = ["run", "robot", "sample"]
    if not motion.samples.select(key).equals(observations.select(key)):
        raise ValueError("the observation table has not the rows of the motion table")
    tick_ms, robots = scenario.run.control_period_ms, scenario.swarm.robots
    table = np.empty((motion.samples.height, 5), dtype=np.int64)
    table[:, 0] = to_ticks(motion.samples["time_s"], tick_ms)
    table[:, 1] = motion.samples["robot"].to_numpy()
    table[:, 2] = motion.samples["sample"].to_numpy()
    table[:, 3] = to_ticks(motion.samples["stop_start_s"], tick_ms)
    table[:, 4] = observations["observation"].to_numpy()
    runs = motion.ends["run"].to_numpy()[::robots].astype(np.int64)
    bounds = np.searchsorted(motion.samples["run"].to_numpy(), np.append(runs, 2**32))
    heard = heard_at_end(motion.ends, tick_ms)
    minds = zero_rows(heard.size, MIND)
    out = zero_rows(table.shape[0], INFERENCE_ROW)
    sent = np.zeros((int(np.diff(bounds).max(initial=0)), 4), dtype=np.int64)
    replay_runs(
        table, bounds, runs, heard, minds, sent, out, mind_program(scenario), seed, scenario.network.loss
    )
    return inference_frame(motion.samples, out), final_frame(motion.ends, minds)


def heard_at_end(ends: pl.DataFrame, tick_ms: int) -> NDArray[np.int64]:
    """What was sent up to this tick has been read when the run ends, shape (robots,).

    A robot that walks last walked at the tick before the end; one that stands, before its stop began.
    """
    standing_since = ends["stop_start_s"].fill_null(ends["end_s"])
    return to_ticks(standing_since, tick_ms) - 2


def inference_frame(samples: pl.DataFrame, rows: NDArray[np.void]) -> pl.DataFrame:
    """The inference table, in the order of the motion table."""
    columns = {name: pl.Series(rows[name].copy()) for name in INFERENCE_ROW.names or ()}
    frame = samples.select("run", "robot", "sample").with_columns(**columns)
    return frame.select(list(INFERENCE)).cast(INFERENCE)  # type: ignore[arg-type]


def final_frame(ends: pl.DataFrame, minds: NDArray[np.void]) -> pl.DataFrame:
    """The posteriors at the end of the runs, in the order of the ends."""
    return ends.select("run", "robot").with_columns(
        alpha=pl.Series((minds["alpha"] + minds["ones"]).astype(np.uint32)),
        beta=pl.Series((minds["beta"] + minds["zeros"]).astype(np.uint32)),
        received=pl.Series(minds["received"].astype(np.uint32)),
    )
