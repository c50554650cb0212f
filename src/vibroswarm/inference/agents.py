"""Per-robot bookkeeping beside the strategy's own state, the robots' view of the world, and their random numbers."""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.jit import inlined, zero_rows
from vibroswarm.core.rng import (
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
from vibroswarm.core.ticks import tick_at
from vibroswarm.faults import onset_s, working
from vibroswarm.inference.generated_kernels import arrays_for
from vibroswarm.networks.base import Network
from vibroswarm.observation.decision_boundary import geometry_of, readings_boundary
from vibroswarm.observation.energy_model import error_rates
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.strategies import strategy as strategy_of
from vibroswarm.strategies.base import Strategy
from vibroswarm.strategies.bayes import GATES
from vibroswarm.strategies.world import Draws, World, beliefs

AGENT = np.dtype(
    [(name, np.int64) for name in ("decision", "samples", "sent", "received", "timers", "heard", "ones", "own_ones")]
    + [(name, np.int64) for name in ("opinion", "row", "tick", "sample_tick", "due_tick")]
    + [(name, np.float64) for name in ("decided_s", "first_decided_s", "belief", "belief_at_decision")]
)  # fmt: skip
"""One robot. ``decision``: -1 while undecided; ``opinion``: likewise, and may still change. ``samples``, ``sent``,
``received``, ``timers``: how many so far. ``heard``: index of the next unread message of the run. ``ones``,
``own_ones``: ones received, ones among its own messages. ``row``: row of its last sample. ``tick``,
``sample_tick``, ``due_tick``: of its last own event, its last sample, and its timer. ``decided_s``,
``first_decided_s``: when its current decision was made, and its first. ``belief``, ``belief_at_decision``:
after its last own event, and when the current decision was made."""

FINALS: Final[dict[str, Any]] = {
    "run": pl.UInt32,
    "robot": pl.UInt16,
    "decision": pl.Int8,
    "decision_time_s": pl.Float64,
    "belief_at_decision": pl.Float64,
    "belief_below": pl.Float64,
    "alpha": pl.UInt32,
    "beta": pl.UInt32,
    "samples": pl.UInt32,
    "messages_received": pl.UInt32,
}
"""The final state of each robot. ``belief_below`` is at the moment of decision or, for a robot that never decided,
at its last sample or timer; alpha, beta (null if the strategy keeps none) and messages_received are at the end."""


FAILURE = np.dtype([("opposite_from_s", np.float64), ("silent_tick", np.int64), ("works", np.int64)])
"""Faults of a robot that concern its messages. ``opposite_from_s``: it sends the opposite from then on (inf: never).
``silent_tick``: its radio is dead from this tick on. ``works``: 1 if its opinion has to agree with the others' before
the swarm has decided: robots without any fault, or all if each has one."""
NEVER_TICK: Final = 2**62


class Swarm(NamedTuple):
    """State of all robots of some runs, (runs * robots,) rows each."""

    agents: NDArray[np.void]
    states: NDArray[np.void]
    """Of the strategy's ``State``."""
    arrays: Any
    """A tuple of arrays, (runs * robots, size) each."""
    params: NDArray[np.void]
    """(robots,) of the strategy's ``Params``."""
    failures: NDArray[np.void]
    """``FAILURE``."""


def strategy_used(scenario: Scenario) -> Strategy:
    """Return the scenario's strategy, or the variant of it that its parameters require.

    Raises:
        InputError: the strategy's parameters do not fit together.
    """
    named, arena = strategy_of(scenario.strategy.name), scenario.arena
    if named.variant is None:
        return named
    longest_mm = math.ceil(1000.0 * max(arena.width_m, arena.height_m))
    return named.variant(scenario.strategy.params, sizes_of(scenario) | {"longest_mm": longest_mm})


def world_of(scenario: Scenario, counts: int) -> World:
    """Return the world as robot 0 knows it.

    Args:
        counts: upper bound on a posterior's counts, without its prior.
    Raises:
        InputError: a boundary that cannot be tested by readings.
    """
    decision, arena = scenario.decision, scenario.arena
    rows, columns, tile_width_m, tile_height_m, left_m, bottom_m = geometry_of(scenario)
    positive, negative = 0.0, 0.0
    if decision.boundary_of == "tiles" or strategy_used(scenario).knows_error_rates:
        own = error_rates(scenario.sensor)
        assumed = (decision.assumed_false_positive, decision.assumed_false_negative)
        positive, negative = (
            own_rate if value is None else value for value, own_rate in zip(assumed, own, strict=True)
        )
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
def world_of_robot(w: World, i: int) -> World:
    """Return the world as robot ``i`` knows it."""
    return World(
        i, w.robots, w.t_end_s, w.tick_s, w.tick_ms, w.width_m, w.height_m, w.rows, w.columns, w.tile_width_m,
        w.tile_height_m, w.left_m, w.bottom_m, w.decision_boundary, w.boundary, w.credible_threshold,
        w.min_observations, w.gate, w.gate_counts_current, w.revise, w.prior_alpha, w.prior_beta, w.false_positive,
        w.false_negative, w.hold_s, w.beliefs,
    )  # fmt: skip


def empty_swarm(strategy: Strategy, network: Network, scenario: Scenario, runs: int) -> Swarm:
    """Return zeroed rows for the robots of ``runs`` runs."""
    robots = scenario.swarm.robots
    params = zero_rows(robots, strategy.params_type)
    params[:] = strategy.params_row(scenario.strategy.params)
    arrays = arrays_for(strategy, network, runs * robots, sizes_of(scenario))
    failures = zero_rows(runs * robots, FAILURE)
    failures["opposite_from_s"], failures["silent_tick"], failures["works"] = np.inf, NEVER_TICK, 1
    return Swarm(
        zero_rows(runs * robots, AGENT),
        zero_rows(runs * robots, strategy.state_type),
        arrays,
        params,
        failures,
    )


def set_failures(swarm: Swarm, scenario: Scenario, seed: int, runs: NDArray[np.int64]) -> None:
    """Write the faults of these runs' robots into the swarm."""
    if not scenario.faults.kinds:
        return
    numbers: list[int] = runs.tolist()
    opposite, silent = (onset_s(scenario, seed, numbers, kind) for kind in ("opposite", "radio_dead"))
    works = working(scenario, seed, numbers)
    works[~works.any(axis=1)] = True
    tick_ms = scenario.run.control_period_ms
    ticks = [
        NEVER_TICK if np.isinf(time_s) else tick_at(time_s, tick_ms) for time_s in silent.ravel().tolist()
    ]
    swarm.failures["opposite_from_s"], swarm.failures["silent_tick"] = opposite.ravel(), ticks
    swarm.failures["works"] = works.ravel()


def sizes_of(scenario: Scenario) -> dict[str, int]:
    """Return the sizes that a strategy's arrays may refer to."""
    rows, columns = geometry_of(scenario)[:2]
    robots = scenario.swarm.robots
    return {"robots": robots, "rows": int(rows), "columns": int(columns), "tiles": int(rows * columns)}


@inlined
def begin_agent(row: Any) -> None:
    """Reset a robot: undecided, nothing heard."""
    row.decision, row.samples, row.sent, row.received, row.timers = -1, 0, 0, 0, 0
    row.heard, row.ones, row.own_ones = 0, 0, 0
    row.opinion, row.row, row.tick, row.sample_tick, row.due_tick = -1, -1, 0, 0, 0
    row.decided_s, row.first_decided_s, row.belief, row.belief_at_decision = np.nan, np.nan, np.nan, np.nan


@inlined
def begin_draws(seed: int, run: int, i: int) -> Draws:
    """Return the random numbers of ``begin`` for robot ``i``."""
    return Draws(seed, run, i, BEGINNING, FIRST, ALONE, 0, -1.0)


@inlined
def sample_draws(seed: int, run: int, i: int, number: int, first: float) -> Draws:
    """Return the random numbers of ``on_sample``, which soft feedback draws its messages from.

    Args:
        number: index of the sample. first: number 0 if computed already, else -1.
    """
    return Draws(seed, run, i, MESSAGE, number, ALONE, 0, first)


@inlined
def message_draws(seed: int, run: int, i: int, sender: int, number: int) -> Draws:
    """Return the random numbers of ``on_message``, addressed by receiver, sender and message."""
    return Draws(seed, run, i, HEARING, number, sender, 16, -1.0)


@inlined
def timer_draws(seed: int, run: int, i: int, number: int) -> Draws:
    """Return the random numbers of ``on_timer``."""
    return Draws(seed, run, i, TIMER, number, ALONE, 0, -1.0)


@inlined
def steering_draws(seed: int, run: int, i: int, number: int) -> Draws:
    """Return the random numbers of ``steer``."""
    return Draws(seed, run, i, STEERING, number, ALONE, 0, -1.0)


@inlined
def loss_draws(seed: int, run: int, receiver: int, sender: int, number: int) -> Draws:
    """Return the random numbers of ``lost``, addressed by receiver, sender and message."""
    return Draws(seed, run, receiver, LOSS, number, sender, 16, -1.0)


@inlined
def send_draws(seed: int, run: int, sender: int, number: int) -> Draws:
    """Return the random numbers of ``send``, addressed by sender and message."""
    return Draws(seed, run, sender, NETWORK, number, ALONE, 0, -1.0)


@inlined
def is_lost(seed: int, run: int, receiver: int, sender: int, number: int, loss: float) -> bool:
    """Return whether message ``number`` of the sender fails to reach the receiver."""
    return loss > 0.0 and loss_uniform(seed, run, receiver, sender, number) < loss


@inlined
def loss_uniform(seed: int, run: int, receiver: int, sender: int, number: int) -> float:
    """Return the uniform number of a message and a receiver; the message is lost if it is below ``loss``."""
    return uniform(seed, run, receiver, LOSS, number, sender)


def final_columns(swarm: Swarm) -> dict[str, NDArray[Any]]:
    """Return the columns of ``FINALS`` except run and robot, plus ``sent``, (runs * robots,) each.

    For a robot that never decided, the decision is -1, and ``decision_time_s`` and ``belief_at_decision`` are nan;
    alpha and beta are nan if the strategy keeps none.
    """
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
        "belief_below": np.where(decided, agents["belief_at_decision"], agents["belief"]),
        **counts,
        "samples": agents["samples"].astype(np.uint32),
        "sent": agents["sent"].astype(np.uint32),
        "messages_received": agents["received"].astype(np.uint32),
    }


def final_frame(ends: pl.DataFrame, swarm: Swarm) -> pl.DataFrame:
    """Return the final state of each robot as a table, in the order of ``ends``."""
    kinds = {**FINALS, "sent": pl.UInt32}
    columns = final_columns(swarm).items()
    series = [as_column(name, column, kinds[name]) for name, column in columns]
    return pl.DataFrame([ends["run"], ends["robot"], *series])


def as_column(name: str, values: NDArray[Any], kind: Any) -> pl.Series:
    """Return a table column with nan as null.

    It uses none of polars' threads, which a forked process lacks.
    """
    if values.dtype == np.float64 and kind != pl.Float64:
        if np.isnan(values).any():
            return pl.Series(name, [None if np.isnan(value) else int(value) for value in values], dtype=kind)
        values = values.astype(np.int64)
    return pl.Series(name, values, dtype=kind, nan_to_null=values.dtype == np.float64)
