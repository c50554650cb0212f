"""State of a robot beside its strategy's own state, the world as robots know it, and the robots' random numbers.

In arrays over the robots of some runs, robot i of the r-th run is in row r * robots + i; such a row is called ``e`` in
kernels. A robot's "events" are its own samples and timers.
"""

from __future__ import annotations

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
    MESSAGE,
    TIMER,
)
from vibroswarm.core.ticks import tick_at
from vibroswarm.inference.generated_kernels import arrays_for
from vibroswarm.inference.outcomes import as_series
from vibroswarm.networks.base import Network
from vibroswarm.observation.decision_boundary import geometry_of, grid_of, readings_boundary
from vibroswarm.observation.energy_model import claimed_error_rates, claimed_rates
from vibroswarm.scenario.fault_draws import onset_s, working
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.strategies import strategy as strategy_of
from vibroswarm.strategies.base import Strategy, arrays_of
from vibroswarm.strategies.bayes import GATES
from vibroswarm.strategies.world import NO_RATES, Draws, World, beliefs

AGENT = np.dtype(
    [(name, np.int64) for name in ("decision", "samples", "sent", "received", "timers", "heard", "ones", "own_ones")]
    + [(name, np.int64) for name in ("opinion", "row", "tick", "sample_tick", "due_tick")]
    + [(name, np.float64) for name in ("decided_s", "first_decided_s", "belief", "belief_at_decision")]
)  # fmt: skip
"""State of one robot. ``decision``: -1 while undecided. ``opinion``: what its strategy's ``decision`` returned last,
which is no decision yet if the strategy decides by opinions. ``samples``, ``sent``, ``received``, ``timers``: numbers
so far. ``heard``: index of the next unread message of the run. ``ones``, ``own_ones``: number of ones among received
messages, and among its own. ``row``: row of its last sample, counted from the run's first (-1: none). ``tick``,
``sample_tick``, ``due_tick``: ticks of its last event, of its last sample, and at which its timer is due.
``decided_s``, ``first_decided_s``: times of its current and of its first decision. ``belief``, ``belief_at_decision``:
after its last event, and when the current decision was made. Times and beliefs are nan before. Not every kernel updates
all fields."""

FINALS: Final[dict[str, Any]] = {
    "run": pl.UInt32,
    "robot": pl.UInt16,
    "decision": pl.Int8,
    "decision_time_s": pl.Float64,
    "belief_at_decision": pl.Float64,
    "belief_below": pl.Float64,
    "alpha": pl.UInt32,
    "beta": pl.UInt32,
    "estimate": pl.Float64,
    "estimate_spread": pl.Float64,
    "samples": pl.UInt32,
    "messages_received": pl.UInt32,
}
"""The final state of each robot. ``belief_below`` is the belief that the share of ones is below the boundary: at the
moment of decision or, for an undecided robot, at its last sample or timer. alpha, beta (null if the strategy has none),
messages_received and the estimate of the fill ratio, with its standard deviation, are those at the end."""


FAILURE = np.dtype([("opposite_from_s", np.float64), ("silent_tick", np.int64), ("works", np.int64)])
"""Faults of a robot that concern its messages. ``opposite_from_s``: from this time on it sends the opposite (inf:
never). ``silent_tick``: from this tick on its radio is dead (``NEVER_TICK``: never). ``works``: 1 if its opinion must
agree with the others before a swarm that decides by opinions has decided, else 0. It is 1 for the robots without any
fault or, if each robot of the run has a fault, for all."""
NEVER_TICK: Final = 2**62
"""A tick that no run reaches."""


class Swarm(NamedTuple):
    """State of all robots of some runs, (runs * robots,) rows each unless stated."""

    agents: NDArray[np.void]
    """Rows of ``AGENT``."""
    states: NDArray[np.void]
    """Rows of the strategy's ``State``."""
    arrays: Any
    """A tuple of the strategy's arrays, (runs * robots, size) each; 0 if it has none."""
    params: NDArray[np.void]
    """(robots,): rows of the strategy's ``Params``."""
    failures: NDArray[np.void]
    """Rows of ``FAILURE``."""


def strategy_used(scenario: Scenario) -> Strategy:
    """Return the scenario's strategy."""
    return strategy_of(scenario.strategy.name)


def world_of(scenario: Scenario, counts: int) -> World:
    """Return the world as robot 0 knows it (``strategies.world.World``)."""
    decision, arena = scenario.decision, scenario.arena
    rows, columns, tile_width_m, tile_height_m, left_m, bottom_m = geometry_of(scenario)
    # With boundary_of = "readings" robots trust their readings, so the error rates that they assume are 0, unless the
    # strategy needs the rates.
    positive, negative, told = 0.0, 0.0, NO_RATES
    knows_rates = strategy_used(scenario).knows_error_rates
    if knows_rates and max(scenario.sensor.kinds, scenario.sensor.readings) > 2:
        told = claimed_rates(scenario.sensor, grid_of(scenario)).ravel()
    elif decision.boundary_of == "tiles" or knows_rates:
        own = claimed_error_rates(scenario.sensor, grid_of(scenario))
        assumed = (decision.assumed_false_positive, decision.assumed_false_negative)
        # A rate that the scenario does not give is the one that the sensor claims, away from edges.
        positive, negative = (
            own_rate if value is None else value for value, own_rate in zip(assumed, own, strict=True)
        )
    boundary = readings_boundary(scenario)
    return World(
        robot=0,
        robots=scenario.swarm.robots,
        kinds=scenario.sensor.kinds,
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
        rates=told,
    )


@inlined
def world_of_robot(w: World, i: int) -> World:
    """Return ``w`` with another ``robot``; field by field, as compiled named tuples have no ``_replace``."""
    return World(
        i, w.robots, w.kinds, w.t_end_s, w.tick_s, w.tick_ms, w.width_m, w.height_m, w.rows, w.columns, w.tile_width_m,
        w.tile_height_m, w.left_m, w.bottom_m, w.decision_boundary, w.boundary, w.credible_threshold,
        w.min_observations, w.gate, w.gate_counts_current, w.revise, w.prior_alpha, w.prior_beta, w.false_positive,
        w.false_negative, w.hold_s, w.beliefs, w.rates,
    )  # fmt: skip


def empty_swarm(strategy: Strategy, network: Network, scenario: Scenario, runs: int) -> Swarm:
    """Allocate the state of all robots of ``runs`` runs: zeros, with the strategy's parameters and without faults."""
    robots = scenario.swarm.robots
    params = zero_rows(robots, strategy.params_type)
    params[:] = strategy.params_row(scenario.strategy.params)
    arrays = arrays_for(strategy, network, runs * robots, sizes_of(scenario))
    failures = zero_rows(runs * robots, FAILURE)
    # No faults: a robot never sends opposite bits, its radio is never silent, and its opinion counts.
    failures["opposite_from_s"], failures["silent_tick"], failures["works"] = np.inf, NEVER_TICK, 1
    return Swarm(
        agents=zero_rows(runs * robots, AGENT),
        states=zero_rows(runs * robots, strategy.state_type),
        arrays=arrays,
        params=params,
        failures=failures,
    )


ARRAY_BYTES_AT_A_TIME: Final = 2**28
"""Approximate memory of the robots' arrays at a time. It grows with the square of their number where each robot has a
map for each sender."""


def arrays_fit(scenario: Scenario) -> int:
    """Return how many runs have room in ``ARRAY_BYTES_AT_A_TIME`` with the arrays of all their robots, at least 1."""
    declared = arrays_of(strategy_used(scenario).arrays).values()
    sizes = sizes_of(scenario) if declared else {}  # which take longer
    of_robot = sum(array.size(sizes) * np.dtype(array.kind).itemsize for array in declared)
    return max(ARRAY_BYTES_AT_A_TIME // max(scenario.swarm.robots * of_robot, 1), 1)


def set_failures(swarm: Swarm, scenario: Scenario, seed: int, runs: NDArray[np.int64]) -> None:
    """Write the faults of the robots to the rows of ``swarm.failures`` (``FAILURE``)."""
    if not scenario.faults.kinds:
        return
    numbers: list[int] = runs.tolist()
    opinion_counts = working(scenario, seed, numbers)  # True for robots without any fault
    # If each robot of a run has a fault, all opinions count.
    opinion_counts[~opinion_counts.any(axis=1)] = True
    swarm.failures["opposite_from_s"] = onset_s(scenario, seed, numbers, "opposite").ravel()
    # Messages are sent and read at ticks, so the times are converted to ticks.
    swarm.failures["silent_tick"] = [
        NEVER_TICK if np.isinf(time_s) else tick_at(time_s, scenario.run.control_period_ms)
        for time_s in onset_s(scenario, seed, numbers, "radio_dead").ravel().tolist()
    ]
    swarm.failures["works"] = opinion_counts.ravel()


def sizes_of(scenario: Scenario) -> dict[str, int]:
    """Return the numbers of robots, rows, columns and tiles, of kinds of tile and of classes of readings, by name."""
    rows, columns = map(int, geometry_of(scenario)[:2])
    return {
        "robots": scenario.swarm.robots,
        "kinds": scenario.sensor.kinds,
        "readings": scenario.sensor.readings,
        "rows": rows,
        "columns": columns,
        "tiles": rows * columns,
    }


@inlined
def begin_agent(row: Any) -> None:
    """Reset a row of ``AGENT`` to time 0: undecided, no samples, nothing sent or heard."""
    # -1: no decision, no opinion and no row of a sample yet. nan: no time and no belief yet.
    row.decision, row.samples, row.sent, row.received, row.timers = -1, 0, 0, 0, 0
    row.heard, row.ones, row.own_ones = 0, 0, 0
    row.opinion, row.row, row.tick, row.sample_tick, row.due_tick = -1, -1, 0, 0, 0
    row.decided_s, row.first_decided_s, row.belief, row.belief_at_decision = np.nan, np.nan, np.nan, np.nan


@inlined
def begin_draws(seed: int, run: int, i: int) -> Draws:
    """Return the address of the random numbers of the hook ``begin`` of robot ``i``."""
    return Draws(seed, run, i, BEGINNING, FIRST, ALONE, 0, -1.0)


@inlined
def sample_draws(seed: int, run: int, i: int, number: int, first: float) -> Draws:
    """Return the address of the random numbers of ``on_sample``, from which soft feedback draws its messages."""
    # 0: ``shift``; no other robot is part of the address.
    return Draws(seed, run, i, MESSAGE, number, ALONE, 0, first)


@inlined
def message_draws(seed: int, run: int, i: int, sender: int, number: int) -> Draws:
    """Return the address of the random numbers of ``on_message``."""
    # 16: ``shift``. The k-th number is addressed by the word ``sender + (k << 16)``, 16 bits each. -1.0: ``first``,
    # as the first random number has not been computed in advance.
    return Draws(seed, run, i, HEARING, number, sender, 16, -1.0)


@inlined
def timer_draws(seed: int, run: int, i: int, number: int) -> Draws:
    """Return the address of the random numbers of ``on_timer``; ``number`` counts the robot's timers from 0."""
    return Draws(seed, run, i, TIMER, number, ALONE, 0, -1.0)


def final_columns(scenario: Scenario, swarm: Swarm) -> dict[str, NDArray[Any]]:
    """Return the final state of each robot as columns by name, (runs * robots,) each."""
    agents, states = swarm.agents, swarm.states
    # A strategy may return to -1 after a decision; ``decided_s`` and ``belief_at_decision`` are then those of that
    # change.
    decided = agents["decision"] != -1
    alpha, beta = _counts_of(states)
    used = strategy_used(scenario)
    of_share, of_others = posterior_of(scenario, swarm, used)
    estimate = estimate_of(of_share, of_others)
    spread = np.sqrt(estimate * (1.0 - estimate) / (of_share + of_others + 1.0))  # Eq. 17
    if used.has_own_estimate:
        estimate, spread = states["estimate"].copy(), states["estimate_spread"].copy()
    return {
        "decision": agents["decision"].astype(np.int8),
        "decision_time_s": np.where(decided, agents["decided_s"], np.nan),
        # A copy, as all other columns are: ``swarm`` is overwritten by the next replay.
        "belief_at_decision": agents["belief_at_decision"].copy(),
        "belief_below": np.where(decided, agents["belief_at_decision"], agents["belief"]),
        "estimate": estimate,
        "estimate_spread": spread,
        "alpha": alpha,
        "beta": beta,
        "samples": agents["samples"].astype(np.uint32),
        "sent": agents["sent"].astype(np.uint32),
        "messages_received": agents["received"].astype(np.uint32),
    }


def posterior_of(
    scenario: Scenario, swarm: Swarm, used: Strategy
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return alpha and beta of each robot's posterior of the share that its task asks for; nan if it has none."""
    if not used.shares:
        return _counts_of(swarm.states)
    of_kinds = getattr(swarm.arrays, used.shares).astype(np.float64)
    of_kind = of_kinds[:, getattr(scenario.task.params, "kind", 1)]
    return of_kind, of_kinds.sum(axis=1) - of_kind


def _counts_of(states: NDArray[np.void]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    fields = states.dtype.names or ()
    alpha, beta = (
        states[name].astype(np.float64) if name in fields else np.full(states.size, np.nan)
        for name in ("alpha", "beta")
    )
    return alpha, beta


def final_frame(scenario: Scenario, ends: pl.DataFrame, swarm: Swarm) -> pl.DataFrame:
    """Return the final state of each robot as a table: the columns of ``FINALS``, and ``sent``."""
    kinds = {**FINALS, "sent": pl.UInt32}
    columns = final_columns(scenario, swarm).items()
    series = [as_series(name, column, kinds[name]) for name, column in columns]
    return pl.DataFrame([ends["run"], ends["robot"], *series])


def estimate_of(alpha: NDArray[Any], beta: NDArray[Any]) -> NDArray[np.float64]:
    """Return the posterior mean of the fill ratio, element by element; nan where alpha and beta are nan or both 0."""
    total = alpha + beta.astype(np.float64)  # floats: the sum of 32-bit integers could overflow
    # ``where`` leaves nan where the total is 0 or nan.
    estimate: NDArray[np.float64] = np.divide(alpha, total, out=np.full(total.shape, np.nan), where=total > 0)
    return estimate
