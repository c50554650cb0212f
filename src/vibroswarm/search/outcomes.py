"""Outcomes of some runs of one scenario as arrays, from which costs are computed.

``from_tables`` reads the outcomes from the tables of a study. ``outcomes_of`` simulates runs and makes no tables, which
is faster: the readings, messages and decisions of the robots are computed (by a closed loop) while their motion is
simulated, and a run stops as soon as its outcome is final, usually when all robots have decided. Scenarios with the
same settings of motion share one simulated motion.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.ticks import tick_at
from vibroswarm.inference.agents import estimate_of, posterior_of, strategy_used
from vibroswarm.inference.closed_loop import steered_motion
from vibroswarm.inference.deliveries import Timeline, needs_moves, timeline_of
from vibroswarm.inference.outcomes import (
    Array,
    belief_in_truth,
    capped_time_s,
    costs_of,
    fills_and_truth,
    forced_errors,
    numbers,
    right_of,
    run_columns,
    wrong_of,
)
from vibroswarm.inference.replay import advance, classes_and_values, replayer_of
from vibroswarm.motion.motion_tables import Motion
from vibroswarm.motion.source import moved
from vibroswarm.observation.observe import observe, read_samples, reads_energies
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import OF_MOTION, OF_OBSERVATION, floors_of, steers
from vibroswarm.statistics.figures import Swarms

Seen = tuple[NDArray[np.uint8], NDArray[np.float32] | None]
"""Classes and values of samples, see ``replay.classes_and_values``."""
POLL_S: Final = 20.0
"""Interval at which the paper's program checked whether all robots had decided, s; see ``end_s``."""
AGAIN: Final = 1.3
"""What a run costs that is simulated again, with its replay, in runs."""
MANY: Final = 100
"""Number of earlier runs that tell how long the next ones take."""


@dataclass(frozen=True, eq=False)
class Outcomes:
    """Outcomes of some runs of one scenario as arrays; all times in s.

    The program of the paper checked every 20 s whether all robots had decided. It ended a run at the first such check,
    or at T_end, and the cost used the estimates at that time. ``end_s`` is that time here, regardless of the setting
    ``run.stop``: also a run that goes on to T_end has the estimates of ``end_s``. Only ``from_tables`` takes the end of
    the run as it was simulated.
    """

    run: NDArray[np.int64]
    """Run numbers, (runs,)."""
    decision: NDArray[np.int64]
    """Decision 0 or 1 of each robot, -1 if undecided, (runs, robots)."""
    decision_time_s: Array
    """Time of the current decision; nan if undecided, (runs, robots)."""
    estimate: Array
    """Estimate of the fill ratio, or of the number that the task asks for, at the last own sample before ``end_s``,
    (runs, robots): the strategy's own, or the mean of its posterior; nan where it has neither."""
    sent: NDArray[np.int64]
    """Messages that each robot sent up to ``end_s``, (runs, robots)."""
    end_s: Array
    """End of the run for the cost, (runs,)."""
    fill_ratio: Array
    """True fill ratio of the floor inside the arena at ``end_s``, as that is when the estimates were made, (runs,)."""
    truth: Array
    """The right decision by the scenario's task, 0 or 1, (runs,); nan where no decision is right. With the task
    ``fill_ratio`` it is 1 where the fill ratio lies above the boundary. On a floor that changes it is that at the end
    of the run as ``run.stop`` has it, as in tables."""
    tiles: int
    """Number of tiles of the floor."""
    t_end_s: float
    """End of a run that does not stop early."""
    strategy: str = ""
    """Name of the strategy, for messages."""
    costs: Array | None = None
    """What mistakes cost, see ``inference.outcomes.costs_of``."""
    belief_below: Array | float = math.nan
    """Belief of each robot that f is below the boundary, at ``end_s``, (runs, robots)."""

    def __post_init__(self) -> None:
        """Make the arrays read-only: all costs of a search are computed from the same ones."""
        for value in vars(self).values():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False

    @property
    def undecided(self) -> NDArray[np.bool_]:
        """Which robots are undecided, (runs, robots)."""
        return np.asarray(self.decision == -1)

    @property
    def right(self) -> NDArray[np.bool_]:
        """Which robots decided right, (runs, robots); none in a run whose truth is nan."""
        return right_of(self.decision, self.truth)

    @property
    def wrong(self) -> NDArray[np.bool_]:
        """Which robots decided wrong, (runs, robots); none in a run whose truth is nan."""
        return wrong_of(self.decision, self.truth)

    @property
    def mistakes(self) -> Array:
        """Cost of each robot's wrong decision, relative to the dearest mistake; 0 if it is right or undecided."""
        if self.costs is None:
            return self.wrong.astype(np.float64)
        # An undecided robot leans to the truth: it has made no mistake.
        certain = np.ones(self.decision.shape)
        return np.nan_to_num(forced_errors(self.decision, certain, self.truth[:, None], self.costs))

    @property
    def swarms(self) -> Swarms:
        """The runs for figures that are computed from decisions (``statistics.figures``)."""
        runs = run_columns(
            self.decision, self.decision_time_s, self.fill_ratio, self.truth, self.end_s, self.t_end_s
        )
        robots = {
            "decision": self.decision.astype(np.float64),
            "decision_time_s": self.decision_time_s,
            "estimate": self.estimate,
            "belief_in_truth": np.asarray(
                belief_in_truth(np.asarray(self.belief_below), self.truth[:, None])
            ),
        }
        return Swarms.of_arrays(robots, runs, self.t_end_s, [self.costs])

    @property
    def time_s(self) -> Array:
        """min(decision time, T_end) of each robot, (runs, robots); T_end if it is undecided."""
        return capped_time_s(self.decision_time_s, self.t_end_s)


def from_tables(scenario: Scenario, robots: pl.DataFrame, runs: pl.DataFrame, tiles: int) -> Outcomes:
    """Convert the tables of robots and runs of one scenario to outcomes, with estimates at the end as simulated."""
    shape = (runs.height, scenario.swarm.robots)
    names = ("decision_time_s", "estimate", "belief_below")
    time_s, estimate, belief = (numbers(robots[name]).reshape(shape) for name in names)
    return Outcomes(
        run=runs["run"].to_numpy().astype(np.int64),
        decision=robots["decision"].to_numpy().astype(np.int64).reshape(shape),
        decision_time_s=time_s,
        estimate=estimate,
        sent=robots["sent"].to_numpy().astype(np.int64).reshape(shape),
        end_s=runs["end_s"].to_numpy(),
        fill_ratio=runs["fill_ratio"].to_numpy(),
        truth=numbers(runs["truth"]),
        tiles=tiles,
        t_end_s=scenario.run.t_end_s,
        strategy=scenario.strategy.name,
        costs=costs_of(scenario),
        belief_below=belief,
    )


def end_s(last_decision_s: float, t_end_s: float) -> float:
    """Return the end of a run for the cost, s; ``last_decision_s`` is inf if a robot is undecided."""
    if math.isinf(last_decision_s):
        return t_end_s
    return min(math.ceil(last_decision_s / POLL_S) * POLL_S, t_end_s)


def outcomes_of(
    scenarios: Sequence[Scenario], seed: int, runs: Sequence[int], motion: str = "event"
) -> list[Outcomes]:
    """Simulate runs of each scenario; whatever the setting ``run.stop``, a run stops when its outcome is final.

    Args:
        seed: of all runs. runs: numbers of the runs, at least one. motion: name of the motion source.
    """
    groups: dict[tuple[Any, ...], list[int]] = defaultdict(list)  # indices of the scenarios that share motion
    for k, scenario in enumerate(scenarios):
        # A strategy that steers changes the motion of its robots: the index k makes the key unique.
        steered = (k,) if steers(scenario) else ()
        groups[*steered, *(getattr(scenario, section) for section in OF_MOTION)].append(k)
    by_scenario: dict[int, Outcomes] = {}
    for group in groups.values():
        outcomes = _simulated_together([scenarios[k] for k in group], seed, runs, motion)
        by_scenario |= dict(zip(group, outcomes, strict=True))
    return [by_scenario[k] for k in range(len(scenarios))]


@lru_cache(maxsize=16)
def _needed_s(of_motion: Any) -> list[float]:
    """Return up to when motion was needed in the last runs with these settings, s: a list that callers extend."""
    return []


def _simulated_together(
    scenarios: Sequence[Scenario], seed: int, runs: Sequence[int], motion: str
) -> list[Outcomes]:
    """Simulate motion as far as most runs need it, and once more, to T_end, for those that need more.

    A scenario that steers is the only one.
    """
    first, t_end_s = scenarios[0], scenarios[0].run.t_end_s
    courses = [_Course(scenario, seed, runs) for scenario in scenarios]
    moves, is_steered = any(map(needs_moves, scenarios)), steers(first)
    before = _needed_s(tuple(getattr(first, section) for section in OF_MOTION))
    until_s = t_end_s if is_steered else _cheapest_s(before, t_end_s)
    left = np.argsort(runs)  # indices of runs, in the order that tables have
    while left.size:
        some = [runs[r] for r in left.tolist()]
        if is_steered:
            (course,) = courses
            shared = steered_motion(first, seed, some, course.floors, motion, moves, last_s=course.last_s)
        else:
            until = [tick_at(until_s, first.run.control_period_ms)] * left.size
            shared = moved(motion, first, seed, some, moves, until=until)
        timeline, seen = timeline_of(first, shared), dict[Any, Seen]()
        needed_s = np.max([course.take(left, timeline, shared, seen) for course in courses], axis=0)
        before += needed_s.tolist() if left.size == len(runs) else []
        left = left[needed_s > until_s + 1e-9] if until_s < t_end_s else left[:0]
        until_s = t_end_s
    del before[:-MANY]
    return [course.outcomes() for course in courses]


def _cheapest_s(needed_s: list[float], t_end_s: float) -> float:
    """Return up to when runs are best simulated first, s, from what the last runs needed."""
    times_s = np.sort([*needed_s, t_end_s])
    again = 1.0 - np.arange(1, times_s.size + 1) / times_s.size  # share of the runs that need more
    return float(times_s[np.argmin(times_s + AGAIN * t_end_s * again)])


class _Course:
    """The runs of one scenario."""

    def __init__(self, scenario: Scenario, seed: int, runs: Sequence[int]) -> None:
        self.scenario, self.seed, self.runs, self.strategy = scenario, seed, runs, strategy_used(scenario)
        self.may_change = self.strategy.revises and scenario.decision.revise
        self.stops_early, self.t_end_s = scenario.run.stop == "all_decided", scenario.run.t_end_s
        self.floors, shape = floors_of(scenario, seed, runs), (len(runs), scenario.swarm.robots)
        self.decision, self.sent = np.empty(shape, dtype=np.int64), np.empty(shape, dtype=np.int64)
        self.decision_time_s, self.estimate, self.belief = np.empty(shape), np.empty(shape), np.empty(shape)
        self.end_s, self.judged_s = np.empty(len(runs)), np.empty(len(runs))

    def take(
        self, some: NDArray[np.int64], timeline: Timeline, moved: Motion, seen: dict[Any, Seen]
    ) -> Array:
        """Replay runs, by index, write their outcomes, and return up to when their motion is needed, s, (runs,)."""
        scenario, seed = self.scenario, self.seed
        reads = reads_energies(scenario)
        key = (reads, *(getattr(scenario, section) for section in OF_OBSERVATION))
        if key not in seen and reads:
            seen[key] = classes_and_values(observe(scenario, seed, moved.samples, self.floors))
        elif key not in seen:  # without the table
            seen[key] = read_samples(scenario, seed, moved.samples, self.floors).observation, None
        replayer = replayer_of(scenario, seed, timeline)
        agents, shape = replayer.swarm.agents, (some.size, -1)

        def replay(limits_s: Array, is_last: bool = False) -> tuple[NDArray[np.int64], Array]:
            advance(replayer, scenario, seed, timeline, *seen[key], limits_s, is_last=is_last)
            return agents["decision"].reshape(shape).copy(), agents["decided_s"].reshape(shape).copy()

        decision, time_s = replay(np.full(some.size, np.inf))
        last_s = np.where(decision == -1, np.inf, time_s).max(axis=1)
        judged_s = np.full(some.size, self.t_end_s)
        if self.stops_early:
            judged_s = np.minimum(replayer.decided_s + scenario.tick_s, self.t_end_s)
            if self.may_change:  # up to here, and no later
                last_s = replayer.decided_s.copy()
                decision, time_s = replay(judged_s)
        ends_s = np.array([end_s(s, self.t_end_s) for s in last_s.tolist()])
        replay(ends_s)
        self.decision[some], self.decision_time_s[some] = decision, time_s
        if self.strategy.has_own_estimate:
            estimate = np.array(replayer.swarm.states["estimate"])
        else:
            estimate = estimate_of(*posterior_of(scenario, replayer.swarm, self.strategy))
        self.estimate[some] = estimate.reshape(shape)
        self.sent[some] = agents["sent"].reshape(shape)
        replay(ends_s, is_last=True)
        self.belief[some] = agents["belief"].reshape(shape)
        self.end_s[some], self.judged_s[some] = ends_s, judged_s
        is_judged_late = self.stops_early or self.may_change
        known_s: Array = np.maximum(ends_s, judged_s) if is_judged_late else ends_s
        return np.minimum(known_s + scenario.tick_s, self.t_end_s)

    def last_s(self, decided_s: float) -> float:
        """Return up to when a run must be known, s, from when all its robots had decided for the first time."""
        if self.may_change and not self.stops_early:
            return self.t_end_s
        return min(end_s(decided_s, self.t_end_s) + self.scenario.tick_s, self.t_end_s)

    def outcomes(self) -> Outcomes:
        fills, truth = fills_and_truth(self.scenario, self.floors, self.runs, self.end_s)
        if self.scenario.change.is_given:
            _, truth = fills_and_truth(self.scenario, self.floors, self.runs, self.judged_s)
        return Outcomes(
            run=np.array(self.runs, dtype=np.int64),
            decision=self.decision,
            decision_time_s=self.decision_time_s,
            estimate=self.estimate,
            sent=self.sent,
            end_s=self.end_s,
            fill_ratio=fills,
            truth=truth,
            tiles=self.floors[self.runs[0]].tiles.size,
            t_end_s=self.t_end_s,
            strategy=self.scenario.strategy.name,
            costs=costs_of(self.scenario),
            belief_below=self.belief,
        )
