"""What is kept of each robot beside its strategy's own state, and the world as its strategy is told of it."""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.compiled import inlined, zero_rows
from vibroswarm.draws import (
    ALONE,
    BEGINNING,
    FIRST,
    HEARING,
    LOSS,
    MESSAGE,
    NETWORK,
    STEERING,
    TIMER,
    uniform,
)
from vibroswarm.inference.generate import arrays_for
from vibroswarm.networks.base import Network
from vibroswarm.observation.boundary import geometry_of, readings_boundary
from vibroswarm.observation.reading import error_rates
from vibroswarm.scenario import Scenario
from vibroswarm.strategies.base import Strategy
from vibroswarm.strategies.bayes import GATES
from vibroswarm.strategies.belief_table import beliefs
from vibroswarm.strategies.world import Draws, World

AGENT = np.dtype(
    [(name, np.int64) for name in ("decision", "samples", "sent", "received", "timers", "heard", "ones", "own_ones")]
    + [(name, np.int64) for name in ("opinion", "row", "tick", "sample_tick", "due_tick")]
    + [(name, np.float64) for name in ("decided_s", "first_decided_s", "belief", "belief_at_decision")]
)  # fmt: skip
"""One robot: its decision (-1: none); how many samples it has taken, messages it has sent and received, timers it has
had; how many of the run's messages it has come past, ones received, ones among its own; its opinion, which may change;
the row of its last sample, the ticks of its last own event and its last sample, and at which its timer is due; when its
decision came to stand, and when it first had one; its belief at its last own event, and when its decision came to
stand."""

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
"""What became of each robot. ``belief`` is at the moment of decision, or at the last own sample or timer of a robot
that never decided; alpha, beta (null where a strategy keeps none) and received are at the end."""


class Swarm(NamedTuple):
    """Rows of some runs' robots, (runs * robots,) each."""

    agents: NDArray[np.void]
    states: NDArray[np.void]
    """Of the strategy's ``State``."""
    arrays: Any
    """A tuple of arrays, (runs * robots, size) each."""
    params: NDArray[np.void]
    """(robots,) of the strategy's ``Params``."""


def world_of(scenario: Scenario, counts: int) -> World:
    """The world as robot 0 knows it.

    Args:
        counts: the most that a posterior may hold, beside its prior.
    Raises:
        InputError: a boundary that cannot be tested by readings.
    """
    decision, arena = scenario.decision, scenario.arena
    rows, columns, tile_width_m, tile_height_m, left_m, bottom_m = geometry_of(scenario)
    positive, negative = 0.0, 0.0
    if decision.boundary_of == "tiles":
        own = error_rates(scenario.sensor)
        given = (decision.assumed_false_positive, decision.assumed_false_negative)
        positive, negative = (mine if one is None else one for one, mine in zip(given, own, strict=True))
    boundary = readings_boundary(scenario)
    return World(
        robot=0,
        robots=scenario.swarm.robots,
        t_end_s=scenario.run.t_end_s,
        tick_s=scenario.tick_s,
        tick_ms=scenario.run.control_period_ms,
        width_m=arena.width_m,
        height_m=arena.height_m,
        rows=int(rows),
        columns=int(columns),
        tile_width_m=tile_width_m,
        tile_height_m=tile_height_m,
        left_m=left_m,
        bottom_m=bottom_m,
        decision_boundary=decision.decision_boundary,
        boundary=boundary,
        credible_threshold=decision.credible_threshold,
        min_observations=decision.min_observations,
        gate=GATES.index(decision.gate),
        gate_counts_current=decision.gate_counts_current,
        revise=decision.revise,
        prior_alpha=decision.prior_alpha,
        prior_beta=decision.prior_beta,
        false_positive=float(positive),
        false_negative=float(negative),
        hold_s=decision.hold_s,
        beliefs=beliefs(boundary, decision.prior_alpha + decision.prior_beta + counts),
    )


@inlined
def world_for(w: World, i: int) -> World:
    """The world as robot ``i`` knows it."""
    return World(
        i, w.robots, w.t_end_s, w.tick_s, w.tick_ms, w.width_m, w.height_m, w.rows, w.columns, w.tile_width_m,
        w.tile_height_m, w.left_m, w.bottom_m, w.decision_boundary, w.boundary, w.credible_threshold,
        w.min_observations, w.gate, w.gate_counts_current, w.revise, w.prior_alpha, w.prior_beta, w.false_positive,
        w.false_negative, w.hold_s, w.beliefs,
    )  # fmt: skip


def empty_swarm(strategy: Strategy, network: Network, scenario: Scenario, runs: int) -> Swarm:
    """Rows for so many runs, to be begun."""
    robots = scenario.swarm.robots
    params = zero_rows(robots, strategy.params_type)
    params[:] = strategy.params_row(scenario.strategy.params)
    arrays = arrays_for(strategy, network, runs * robots, sizes_of(scenario))
    return Swarm(
        zero_rows(runs * robots, AGENT), zero_rows(runs * robots, strategy.state_type), arrays, params
    )


def sizes_of(scenario: Scenario) -> dict[str, int]:
    """What the sizes of a strategy's arrays may be made of."""
    rows, columns = geometry_of(scenario)[:2]
    robots = scenario.swarm.robots
    return {"robots": robots, "rows": int(rows), "columns": int(columns), "tiles": int(rows * columns)}


@inlined
def begin_agent(row: Any) -> None:
    """Undecided, nothing heard."""
    row.decision, row.samples, row.sent, row.received, row.timers = -1, 0, 0, 0, 0
    row.heard, row.ones, row.own_ones = 0, 0, 0
    row.opinion, row.row, row.tick, row.sample_tick, row.due_tick = -1, -1, 0, 0, 0
    row.decided_s, row.first_decided_s, row.belief, row.belief_at_decision = np.nan, np.nan, np.nan, np.nan


@inlined
def of_beginning(seed: int, run: int, i: int) -> Draws:
    """Numbers for ``begin`` of robot ``i``."""
    return Draws(seed, run, i, BEGINNING, FIRST, ALONE, 0, -1.0)


@inlined
def of_sample(seed: int, run: int, i: int, number: int, first: float) -> Draws:
    """Numbers for ``on_sample``; those of soft feedback's messages."""
    return Draws(seed, run, i, MESSAGE, number, ALONE, 0, first)


@inlined
def of_message(seed: int, run: int, i: int, sender: int, number: int) -> Draws:
    """Numbers for ``on_message``: of the receiver, the sender and its message."""
    return Draws(seed, run, i, HEARING, number, sender, 16, -1.0)


@inlined
def of_timer(seed: int, run: int, i: int, number: int) -> Draws:
    """Numbers for ``on_timer``."""
    return Draws(seed, run, i, TIMER, number, ALONE, 0, -1.0)


@inlined
def of_steering(seed: int, run: int, i: int, number: int) -> Draws:
    """Numbers for ``steer``."""
    return Draws(seed, run, i, STEERING, number, ALONE, 0, -1.0)


@inlined
def of_network(seed: int, run: int, receiver: int, sender: int, number: int) -> Draws:
    """Numbers for ``lost``: of the receiver, the sender and its message."""
    return Draws(seed, run, receiver, LOSS, number, sender, 16, -1.0)


@inlined
def of_sending(seed: int, run: int, sender: int, number: int) -> Draws:
    """Numbers for ``send``: of the sender and its message."""
    return Draws(seed, run, sender, NETWORK, number, ALONE, 0, -1.0)


@inlined
def is_lost(seed: int, run: int, receiver: int, sender: int, number: int, loss: float) -> bool:
    """Whether the sender's message of this number does not reach the receiver."""
    return loss > 0.0 and loss_number(seed, run, receiver, sender, number) < loss


@inlined
def loss_number(seed: int, run: int, receiver: int, sender: int, number: int) -> float:
    """The uniform number of a message and a receiver: below ``loss`` it does not arrive."""
    return uniform(seed, run, receiver, LOSS, number, sender)


def final_columns(swarm: Swarm) -> dict[str, NDArray[Any]]:
    """The columns of ``FINALS`` but run and robot, and ``sent``, (runs * robots,) each; nan where there is none."""
    agents, states = swarm.agents, swarm.states
    decided = agents["decision"] != -1
    kept = states.dtype.names or ()
    counts = {
        name: states[name].astype(np.float64) if name in kept else np.full(agents.size, np.nan)
        for name in ("alpha", "beta")
    }
    return {
        "decision": agents["decision"].astype(np.int8),
        "decision_time_s": np.where(decided, agents["decided_s"], np.nan),
        "belief_at_decision": agents["belief_at_decision"].copy(),
        "belief": np.where(decided, agents["belief_at_decision"], agents["belief"]),
        **counts,
        "samples": agents["samples"].astype(np.uint32),
        "sent": agents["sent"].astype(np.uint32),
        "received": agents["received"].astype(np.uint32),
    }


def final_frame(ends: pl.DataFrame, swarm: Swarm) -> pl.DataFrame:
    """What became of each robot, in the order of the ends."""
    kinds = {**FINALS, "sent": pl.UInt32}
    columns = final_columns(swarm).items()
    found = [as_column(name, column, kinds[name]) for name, column in columns]
    return pl.DataFrame([ends["run"], ends["robot"], *found])


def as_column(name: str, values: NDArray[Any], kind: Any) -> pl.Series:
    """A column of a table, what is not a number being null; by no thread of polars, which a forked process lacks."""
    if values.dtype == np.float64 and kind != pl.Float64:
        if np.isnan(values).any():
            return pl.Series(name, [None if np.isnan(one) else int(one) for one in values], dtype=kind)
        values = values.astype(np.int64)
    return pl.Series(name, values, dtype=kind, nan_to_null=values.dtype == np.float64)
