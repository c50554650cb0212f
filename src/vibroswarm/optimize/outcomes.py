"""Outcomes of some runs of one scenario as arrays, from which costs are computed: of tables, or simulated without them.

Simulated so, each run is inferred while it moves, and stops when its outcome is final: an evaluation needs a run only
until all robots have decided. Scenarios that move alike share their motion.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.core.ticks import reached
from vibroswarm.errors import InputError
from vibroswarm.inference.closed_loop import ClosedLoop, advance_loops
from vibroswarm.inference.motion_feedback import steer_on, steerable
from vibroswarm.inference.outcomes import (
    Array,
    capped_time_s,
    estimate_of,
    fill_ratios,
    numbers,
    right_of,
    truths,
    wrong_of,
)
from vibroswarm.motion.kernel_run import KernelRun
from vibroswarm.motion.source import MotionState, source
from vibroswarm.observation.observe import sensed_floors
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import OF_MOTION, floors_of, steers

POLL_S: Final = 20.0
"""Interval at which the study's search checked whether all robots had decided."""


@dataclass(frozen=True, eq=False)
class Outcomes(NotebookView):
    """Outcomes of some runs of one scenario as arrays; times in s, ``t_end_s`` is the end of the runs.

    The study's search ended a run when all had decided, which it checked every 20 s, or at T_end, and took the
    estimate then. A run that goes on to T_end has the same decisions, so ``end_s`` is that moment, regardless of
    ``run.stop``.
    """

    run: NDArray[np.int64]
    """(runs,): run numbers."""
    decision: NDArray[np.int64]
    """0, 1; -1 undecided, (runs, robots)."""
    decision_time_s: Array
    """Time of the current decision; nan if undecided, (runs, robots)."""
    estimate: Array
    """Posterior mean of the fill ratio at the last own sample before ``end_s``, (runs, robots); nan where the strategy
    keeps none."""
    end_s: Array
    """End of the run for the cost, (runs,)."""
    fill_ratio: Array
    """(runs,)."""
    truth: Array
    """1 where the fill ratio lies above the boundary, 0 below, nan on it, (runs,)."""
    tiles: int
    """Number of tiles of the floor."""
    t_end_s: float
    """End of a run that does not stop early."""
    strategy: str = ""
    """Name of the strategy, for messages."""

    @property
    def robots(self) -> int:
        """Number of robots of a run."""
        return int(self.decision.shape[1])

    @property
    def undecided(self) -> NDArray[np.bool_]:
        """(runs, robots)."""
        return np.asarray(self.decision == -1)

    @property
    def right(self) -> NDArray[np.bool_]:
        """(runs, robots); none where the truth is nan."""
        return right_of(self.decision, self.truth)

    @property
    def wrong(self) -> NDArray[np.bool_]:
        """(runs, robots); none where the truth is nan."""
        return wrong_of(self.decision, self.truth)

    @property
    def time_s(self) -> Array:
        """min(decision time, T_end): an undecided robot counts with T_end, (runs, robots)."""
        return capped_time_s(self.decision_time_s, self.t_end_s)


def from_tables(scenario: Scenario, robots: pl.DataFrame, runs: pl.DataFrame, tiles: int) -> Outcomes:
    """Return the outcomes of the tables of robots and runs; the estimates are those at the end of the runs."""
    if robots.height != runs.height * scenario.swarm.robots:
        raise InputError("the tables of robots and of runs are not of the same runs", field="runs")
    shape = (runs.height, scenario.swarm.robots)
    time_s, alpha, beta = (
        numbers(robots[name]).reshape(shape) for name in ("decision_time_s", "alpha", "beta")
    )
    return Outcomes(
        run=runs["run"].to_numpy().astype(np.int64),
        decision=robots["decision"].to_numpy().astype(np.int64).reshape(shape),
        decision_time_s=time_s,
        estimate=estimate_of(alpha, beta),
        end_s=runs["end_s"].to_numpy(),
        fill_ratio=runs["fill_ratio"].to_numpy(),
        truth=numbers(runs["truth"]),
        tiles=tiles,
        t_end_s=scenario.run.t_end_s,
        strategy=scenario.strategy.name,
    )


def end_s(last_decision_s: float, t_end_s: float) -> float:
    """Return the end of a run for the cost: the next check after its last decision (inf: none), at most T_end, s."""
    if math.isinf(last_decision_s):
        return t_end_s
    return min(math.ceil(last_decision_s / POLL_S) * POLL_S, t_end_s)


PIECE_S: Final = 100.0
"""Time between checks whether all have decided, while the typical duration is unknown."""
MARGIN_S: Final = 30.0
"""A check costs as much as this time of motion."""


def outcomes_of(
    scenarios: Sequence[Scenario], seed: int, runs: Sequence[int], motion: str = "event"
) -> list[Outcomes]:
    """Simulate the outcomes of runs of each scenario, whatever its ``run.stop``.

    Args:
        scenarios: one or several. seed, runs, motion: as of ``simulate``.
    Raises:
        InputError: a scenario cannot be simulated.
    """
    alike: dict[tuple[Any, ...], list[int]] = {}
    for k, scenario in enumerate(scenarios):
        moving = (k,) if steers(scenario) else ()  # each by itself
        alike.setdefault((*moving, *(getattr(scenario, section) for section in OF_MOTION)), []).append(k)
    by_scenario: dict[int, Outcomes] = {}
    for group in alike.values():
        outcomes = _followed([scenarios[k] for k in group], seed, runs, motion)
        by_scenario |= dict(zip(group, outcomes, strict=True))
    return [by_scenario[k] for k in range(len(scenarios))]


def _followed(scenarios: Sequence[Scenario], seed: int, runs: Sequence[int], motion: str) -> list[Outcomes]:
    """Simulate the outcomes of runs of scenarios that move alike."""
    courses = [_ScenarioRuns(scenario, seed, runs) for scenario in scenarios]
    loops = [course.loop for course in courses]
    state: MotionState | None = None
    for r, run in enumerate(runs):
        if isinstance(state, KernelRun):
            state.start(seed, run)
        else:
            state = source(motion).init(
                scenarios[0], seed, run, False, any(loop.needs_moves for loop in loops)
            )
        for course in courses:
            course.loop.begin(run, course.grounds[r])

        until_s = max(course.until_s(0.0) for course in courses)
        while not reached(state.time_s, until_s, loops[0].tick_ms):
            if loops[0].steers:
                steer_on(steerable(state, motion), loops[0], until_s)
            else:
                advance_loops(state, loops, until_s)
            until_s = max(course.until_s(state.time_s) for course in courses)
        for course in courses:
            course.finish(r)
    for loop in loops:
        _keep(loop)
    return [course.outcomes() for course in courses]


_kept = threading.local()
MANY: Final = 30
"""Number of recent runs from which the duration of the next one is estimated."""
KEPT: Final = 4
"""Closed loops that a thread caches, since a search simulates each scenario a few runs at a time."""


def _loop_of(scenario: Scenario, seed: int) -> ClosedLoop:
    """Return the closed loop of this scenario, cached for each thread."""
    loops: list[ClosedLoop] = vars(_kept).setdefault("loops", [])
    cached = next((loop for loop in loops if loop.scenario is scenario and loop.seed == seed), None)
    if cached is None:
        return ClosedLoop(scenario, seed)
    loops.remove(cached)  # while it is used, since the same scenario may be requested twice at once
    return cached


def _keep(loop: ClosedLoop) -> None:
    """Return a loop to the cache."""
    loops: list[ClosedLoop] = vars(_kept).setdefault("loops", [])
    del loops[: len(loops) + 1 - KEPT]
    loops.append(loop)


class _ScenarioRuns:
    """The runs of one scenario while they are simulated."""

    def __init__(self, scenario: Scenario, seed: int, runs: Sequence[int]) -> None:
        floors = floors_of(scenario, seed, runs)
        self.scenario, self.loop = scenario, _loop_of(scenario, seed)
        self.runs, self.grounds = runs, sensed_floors(scenario, seed, runs, floors)
        arena = scenario.arena
        self.fills = np.array(fill_ratios(floors, list(runs), arena.width_m, arena.height_m))
        self.truth = truths(scenario, floors, list(runs), self.fills)
        self.tiles = floors[runs[0]].tiles.size
        shape = (len(runs), scenario.swarm.robots)
        self.decision = np.empty(shape, dtype=np.int64)
        self.decision_time_s, self.estimate = np.empty(shape), np.empty(shape)
        self.end_s = np.empty(len(runs))
        self.ends_s = self.loop.ends_s[-MANY:]

    def until_s(self, now_s: float) -> float:
        """Return the time up to which the run must move; not later than now if it may stop."""
        t_end_s = self.scenario.run.t_end_s
        if now_s > 0.0 and not self.loop.may_change:
            decided_s = self.loop.all_decided_s
            if decided_s is not None:
                return min(end_s(decided_s, t_end_s) + self.scenario.tick_s, t_end_s)
        return min(self.next_look_s(now_s), t_end_s)

    def next_look_s(self, now_s: float) -> float:
        """Choose the time of the next check; no result depends on it.

        It is not before the earliest end of the recent runs that took longer than this one so far; without such runs it
        is ``PIECE_S`` from now. If the end is equally likely at any time and ``m`` away on average, checking every
        ``sqrt(2 m MARGIN_S)`` minimises the cost of checks and of unneeded motion.
        """
        tick_s = self.scenario.tick_s
        after_s = now_s + tick_s
        longer = [t_s for t_s in self.ends_s if t_s > after_s]
        if not longer:
            return now_s + PIECE_S
        remaining_s = sum(longer) / len(longer) - now_s
        step_s = math.sqrt(2.0 * MARGIN_S * remaining_s)
        return max(end_s(min(longer), np.inf) + tick_s, now_s + step_s)

    def finish(self, r: int) -> None:
        """Record the outcome of run ``r``."""
        loop, decided_s = self.loop, self.loop.all_decided_s
        self.end_s[r] = end_s(np.inf if decided_s is None else decided_s, self.scenario.run.t_end_s)
        self.decision[r], self.decision_time_s[r] = loop.decision, loop.decision_time_s
        loop.rewind_to(float(self.end_s[r]))
        self.estimate[r] = loop.estimate
        self.ends_s.append(float(self.end_s[r]))
        self.loop.ends_s.append(float(self.end_s[r]))

    def outcomes(self) -> Outcomes:
        """Return the outcomes of all runs, once they are finished."""
        return Outcomes(
            run=np.array(self.runs, dtype=np.int64),
            decision=self.decision,
            decision_time_s=self.decision_time_s,
            estimate=self.estimate,
            end_s=self.end_s,
            fill_ratio=self.fills,
            truth=self.truth,
            tiles=self.tiles,
            t_end_s=self.scenario.run.t_end_s,
            strategy=self.scenario.strategy.name,
        )
