"""Simulate outcomes without tables: each run is inferred while it moves, and stops when its outcome is final.

An evaluation needs a run only until all robots have decided. Scenarios that move alike share their motion.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from vibroswarm.core.ticks import reached
from vibroswarm.inference.closed_loop import ClosedLoop, advance_loops
from vibroswarm.inference.motion_feedback import steer_on, steerable
from vibroswarm.inference.outcome_arrays import Outcomes, end_s
from vibroswarm.inference.outcomes import fill_ratios, truths
from vibroswarm.motion.kernel_run import KernelRun
from vibroswarm.motion.source import MotionState, source
from vibroswarm.observation.observe import sensed_floors
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import OF_MOTION, floors_of, steers

__all__ = ["Outcomes", "outcomes_of"]

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

        Not before the earliest end of recent runs that took longer than this one so far. If the end is equally likely
        at any time and ``m`` away on average, checking every ``sqrt(2 m MARGIN_S)`` minimises the cost of checks and
        of unneeded motion.
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
