"""The outcomes of runs without their tables: each run is followed as it moves, and no further than need be.

What an evaluation needs is known once all robots have decided. Scenarios that move alike share their motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.followed_events import can_follow, follow_until_decided
from vibroswarm.inference.cost_outcomes import Outcomes, end_s, from_result
from vibroswarm.inference.follow import Follower, may_revise
from vibroswarm.inference.outcomes import fill_ratios, truths
from vibroswarm.motion.contract import source
from vibroswarm.motion.event import EventRun
from vibroswarm.motion.kernel_run import KernelRun
from vibroswarm.motion.neighbours import SMALL_SWARM
from vibroswarm.observation.ground import grounds_of
from vibroswarm.scenario import Scenario
from vibroswarm.simulation import OF_MOTION, floors_of, simulate

PIECE_S: Final = 100.0
"""So far runs move between two looks whether all have decided: a look costs as much as moving for some 20 s."""
LOOK_S: Final = 20.0
"""The same where a look costs next to nothing."""


def outcomes_of(
    scenarios: Sequence[Scenario], seed: int, runs: Sequence[int], motion: str = "event"
) -> list[Outcomes]:
    """The outcomes of these runs of each scenario, whatever its ``run.stop``.

    Args:
        scenarios: one or several. seed, runs, motion: as of ``simulate``.
    Raises:
        InputError: a scenario cannot be simulated.
    """
    alike: dict[tuple[Any, ...], list[int]] = {}
    for k, scenario in enumerate(scenarios):
        alike.setdefault(tuple(getattr(scenario, section) for section in OF_MOTION), []).append(k)
    found: dict[int, Outcomes] = {}
    for group in alike.values():
        came = _followed([scenarios[k] for k in group], seed, runs, motion)
        found |= dict(zip(group, came, strict=True))
    return [found[k] for k in range(len(scenarios))]


def engine_of(scenarios: Sequence[Scenario], motion: str = "event") -> str:
    """Last name of the module whose kernel moves the robots when the outcomes of these scenarios are asked for.

    Args:
        scenarios, motion: as of ``outcomes_of``.
    """
    first, *others = scenarios
    few = first.swarm.robots <= SMALL_SWARM
    if motion == "event" and few and not others and not may_revise(first):
        return "followed_events"
    return motion.replace("-", "_")


def _followed(scenarios: Sequence[Scenario], seed: int, runs: Sequence[int], motion: str) -> list[Outcomes]:
    """The outcomes of these runs of scenarios that move alike."""
    state = source(motion).init(scenarios[0], seed, runs[0], False)
    if not isinstance(state, KernelRun):
        return [from_result(simulate(one, seed, runs, motion=motion, energies=False)) for one in scenarios]
    courses = [_Course(scenario, seed, runs) for scenario in scenarios]
    by_one_kernel = engine_of(scenarios, motion) == "followed_events"
    for r, run in enumerate(runs):
        state.start(seed, run)
        for course in courses:
            course.follower.begin(run, course.grounds[r])
        if by_one_kernel and can_follow(state):
            _follow_alone(state, courses[0], r)
        else:
            _follow_together(state, courses, r)
        for course in courses:
            course.finish(r)
    return [course.outcomes() for course in courses]


def _follow_together(state: KernelRun, courses: Sequence[_Course], r: int) -> None:
    """Move run ``r`` from its start for as long as any course needs it."""

    def take(rows: NDArray[np.void]) -> None:
        for course in courses:
            course.follower.take(rows)

    until_s = min(course.first_s for course in courses)
    while until_s > state.time_s:
        state.go_on(until_s, take)
        until_s = max(course.until_s(r, state.time_s) for course in courses)


def _follow_alone(state: EventRun, course: _Course, r: int) -> None:
    """The same for one course, by one kernel."""
    follow_until_decided(state, course.follower, course.scenario.run.t_end_s, LOOK_S)
    follow_until_decided(state, course.follower, course.until_s(r, state.time_s), LOOK_S, even_then=True)


class _Course:
    """The runs of one scenario while they are followed."""

    def __init__(self, scenario: Scenario, seed: int, runs: Sequence[int]) -> None:
        floors = floors_of(scenario, seed, runs)
        self.scenario, self.follower = scenario, Follower(scenario, seed)
        self.runs, self.grounds = runs, grounds_of(scenario, seed, runs, floors)
        arena = scenario.arena
        self.fills = np.array(fill_ratios(floors, list(runs), arena.width_m, arena.height_m))
        self.tiles = floors[runs[0]].tiles.size
        shape = (len(runs), scenario.swarm.robots)
        self.decision = np.empty(shape, dtype=np.int64)
        self.decision_time_s, self.estimate = np.empty(shape), np.empty(shape)
        self.end_s = np.empty(len(runs))

    @property
    def first_s(self) -> float:
        """Until when no robot can have decided, were none ever kept from sampling; or the first piece."""
        scenario, decision = self.scenario, self.scenario.decision
        between_s = (scenario.sample.sample_interval_ms + scenario.sample.stop_ms) / 1000.0
        counting = 1 if decision.gate == "own" else scenario.swarm.robots
        earliest_s = decision.min_observations * between_s / counting
        return min(max(earliest_s, PIECE_S), scenario.run.t_end_s)

    def until_s(self, r: int, now_s: float) -> float:
        """Until when run ``r`` has to move; no further if that is not later than now."""
        if self.follower.all_decided_s is None or may_revise(self.scenario):
            return min(now_s + PIECE_S, self.scenario.run.t_end_s)
        self.note(r)
        return min(float(self.end_s[r]) + self.scenario.tick_s, self.scenario.run.t_end_s)

    def note(self, r: int) -> None:
        """Put down what the robots have decided in run ``r``, and when it ended."""
        last_s = self.follower.decided(self.decision[r], self.decision_time_s[r])
        self.end_s[r] = end_s(last_s, self.scenario.run.t_end_s)

    def finish(self, r: int) -> None:
        """Put down all that became of run ``r``."""
        self.note(r)
        self.follower.estimates(float(self.end_s[r]), self.estimate[r])

    def outcomes(self) -> Outcomes:
        """Of all runs, once they are finished."""
        return Outcomes(
            run=np.array(self.runs, dtype=np.int64),
            decision=self.decision,
            decision_time_s=self.decision_time_s,
            estimate=self.estimate,
            end_s=self.end_s,
            fill_ratio=self.fills,
            truth=truths(self.scenario, self.fills),
            tiles=self.tiles,
            t_end_s=self.scenario.run.t_end_s,
        )
