"""Outcomes of some runs of one scenario as arrays, from which costs are computed.

``from_tables`` reads the outcomes from the tables of a study. ``outcomes_of`` simulates runs and makes no tables, which
is faster: the readings, messages and decisions of the robots are computed (by a closed loop) while their motion is
simulated, and a run stops as soon as its outcome is final, usually when all robots have decided. Scenarios with the
same settings of motion share one simulated motion.
"""

from __future__ import annotations

import math
import threading
from bisect import bisect_right, insort
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.analysis.figures import Swarms
from vibroswarm.core.ticks import reached
from vibroswarm.errors import InputError
from vibroswarm.inference.agents import arrays_fit
from vibroswarm.inference.closed_loop import ClosedLoop, advance_loops
from vibroswarm.inference.motion_feedback import steer_on, steerable
from vibroswarm.inference.outcomes import (
    Array,
    capped_time_s,
    costs_of,
    fills_and_truth,
    forced_errors,
    numbers,
    right_of,
    run_columns,
    wrong_of,
)
from vibroswarm.motion.kernel_run import KernelRun
from vibroswarm.motion.source import MotionState, source
from vibroswarm.observation.observe import sensed_floors
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import OF_MOTION, floors_of, steers

POLL_S: Final = 20.0
"""Interval at which the paper's program checked whether all robots had decided, s; see ``end_s``."""


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

    def __post_init__(self) -> None:
        """Make the arrays read-only: all costs of a search are computed from the same ones."""
        for value in vars(self).values():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False

    @property
    def robots(self) -> int:
        """Number of robots of a run."""
        return int(self.decision.shape[1])

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
        """The runs for figures that are computed from decisions (``analysis.figures``)."""
        runs = run_columns(
            self.decision, self.decision_time_s, self.fill_ratio, self.truth, self.end_s, self.t_end_s
        )
        robots = {
            "decision": self.decision.astype(np.float64),
            "decision_time_s": self.decision_time_s,
            "estimate": self.estimate,
        }
        return Swarms.of_arrays(robots, runs, self.t_end_s)

    @property
    def time_s(self) -> Array:
        """min(decision time, T_end) of each robot, (runs, robots); T_end if it is undecided."""
        return capped_time_s(self.decision_time_s, self.t_end_s)


def from_tables(scenario: Scenario, robots: pl.DataFrame, runs: pl.DataFrame, tiles: int) -> Outcomes:
    """Convert the tables of robots and runs of one scenario to outcomes.

    ``Outcomes.end_s`` is the end of each run as it was simulated, and the estimates are those at that time.

    Args:
        scenario: the one whose runs the tables hold. tiles: number of tiles of its floor.
        robots: the table of robots, one row per run and robot, sorted by run, then robot.
        runs: the table of runs, one row per run, in the same order of runs.
    Raises:
        InputError: the numbers of rows do not fit together.
    """
    if robots.height != runs.height * scenario.swarm.robots:
        raise InputError(
            f"{robots.height} rows of robots do not fit {runs.height} runs of {scenario.swarm.robots} robots",
            field="runs",
        )
    shape = (runs.height, scenario.swarm.robots)
    time_s, estimate = (numbers(robots[name]).reshape(shape) for name in ("decision_time_s", "estimate"))
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
    )


def end_s(last_decision_s: float, t_end_s: float) -> float:
    """Return the end of a run for the cost, s: the first multiple of ``POLL_S`` at or after the last decision.

    The end is T_end if that comes earlier, or if a robot is undecided. The paper's program checked every ``POLL_S``
    whether all robots had decided, and ended the run at such a check.

    Args:
        last_decision_s: when the last robot decided; inf if a robot is undecided. t_end_s: the latest end of a run.
    """
    if math.isinf(last_decision_s):
        return t_end_s
    return min(math.ceil(last_decision_s / POLL_S) * POLL_S, t_end_s)


PIECE_S: Final = 100.0
"""Simulated time between checks whether all robots have decided, while the typical duration is unknown."""
MARGIN_S: Final = 30.0
"""A check takes as long to compute as this simulated time of motion."""


def outcomes_of(
    scenarios: Sequence[Scenario], seed: int, runs: Sequence[int], motion: str = "event"
) -> list[Outcomes]:
    """Simulate runs of each scenario and return their outcomes, in the order of the scenarios.

    Whatever the setting ``run.stop``, a run stops when its outcome is final.

    Args:
        scenarios: one or several. seed: of all runs. runs: numbers of the runs, at least one.
        motion: name of the motion source.
    Raises:
        InputError: a scenario cannot be simulated.
    """
    groups: dict[tuple[Any, ...], list[int]] = {}  # indices of the scenarios that share motion
    for k, scenario in enumerate(scenarios):
        # A strategy that steers changes the motion of its robots, so that no other scenario shares it. The index k
        # makes the key unique.
        steered = (k,) if steers(scenario) else ()
        motion_key = (*steered, *(getattr(scenario, section) for section in OF_MOTION))
        groups.setdefault(motion_key, []).append(k)
    by_scenario: dict[int, Outcomes] = {}
    for group in groups.values():
        at_a_time = min(arrays_fit(scenarios[k]) for k in group)
        for low in range(0, len(group), at_a_time):
            some = group[low : low + at_a_time]
            outcomes = _simulated_together([scenarios[k] for k in some], seed, runs, motion)
            by_scenario |= dict(zip(some, outcomes, strict=True))
    return [by_scenario[k] for k in range(len(scenarios))]


def _simulated_together(
    scenarios: Sequence[Scenario], seed: int, runs: Sequence[int], motion: str
) -> list[Outcomes]:
    """Simulate the motion of each run once, and from it the outcomes of all these scenarios, which share motion.

    The arguments and the result are those of ``outcomes_of``. A scenario that steers is the only one.
    """
    courses = [_ScenarioRuns(scenario, seed, runs) for scenario in scenarios]
    loops = [course.loop for course in courses]
    state: MotionState | None = None
    for r, run in enumerate(runs):
        if isinstance(state, KernelRun):
            state.start(seed, run)  # reuses the memory of the run before
        else:
            # The motion source makes further tables only on request: segments of motion are never needed here.
            needs_segments, needs_moves = False, any(loop.needs_moves for loop in loops)
            # Any of the scenarios will do, since they have the same settings of motion.
            state = source(motion).init(scenarios[0], seed, run, needs_segments, needs_moves)
        for course in courses:
            course.loop.begin(run, course.grounds[r])

        # The motion is simulated up to the latest time that a scenario needs. ``finish`` then rewinds the loop of each
        # other scenario to the end of its run.
        if len(loops) == 1 and loops[0].can_follow(state):
            loops[0].follow(state, POLL_S)
        until_s = max(course.until_s(state.time_s) for course in courses)
        # A run of a single tick is at its end from the start, and is replayed all the same.
        while loops[0].is_new or not reached(state.time_s, until_s, loops[0].tick_ms):
            if loops[0].steers:  # then it is the only one
                steer_on(steerable(state, motion), loops[0], until_s)
            else:
                advance_loops(state, loops, until_s)
            until_s = max(course.until_s(state.time_s) for course in courses)
        for course in courses:
            course.finish(r)
    for loop in loops:
        _put_back(loop)
    return [course.outcomes() for course in courses]


_cache = threading.local()
"""``loops`` is this thread's list of closed loops that are not in use, the last used at the end."""
MANY: Final = 30
"""Number of runs of earlier calls from which, with those of this call, the end of the next run is estimated."""
KEPT: Final = 4
"""Most closed loops that a thread caches, since a search simulates each scenario a few runs at a time."""


def _take_loop(scenario: Scenario, seed: int) -> ClosedLoop:
    """Take the closed loop of this scenario and seed out of the thread's cache, or make one if there is none.

    The caller puts the loop back with ``_put_back`` after use. A loop in use must not be in the cache: a list of
    scenarios may hold the same scenario twice, and each entry needs a loop of its own. Scenarios are compared by
    identity, which suffices: ``evaluate`` caches them, so that the pieces of a candidate have the same objects.
    """
    loops: list[ClosedLoop] = vars(_cache).setdefault("loops", [])
    cached = next((loop for loop in loops if loop.scenario is scenario and loop.seed == seed), None)
    if cached is None:
        return ClosedLoop(scenario, seed)
    loops.remove(cached)
    return cached


def _put_back(loop: ClosedLoop) -> None:
    """Put a closed loop into the thread's cache; drop the loop that was not used for longest if there are too many."""
    loops: list[ClosedLoop] = vars(_cache).setdefault("loops", [])
    loops.append(loop)
    del loops[: -min(KEPT, arrays_fit(loop.scenario))]  # the last ones remain


class _ScenarioRuns:
    """The runs of one scenario while they are simulated, one after the other."""

    def __init__(self, scenario: Scenario, seed: int, runs: Sequence[int]) -> None:
        """Make the floors of the runs and empty arrays of outcomes, and take the scenario's closed loop.

        The caller puts the loop back with ``_put_back`` at the end.
        """
        floors = floors_of(scenario, seed, runs)
        self.scenario, self.loop = scenario, _take_loop(scenario, seed)
        self.tick_s, self.t_end_s = scenario.tick_s, scenario.run.t_end_s
        self.stops_early, self.may_change = scenario.run.stop == "all_decided", self.loop.may_change
        self.runs = runs
        self.grounds = sensed_floors(scenario, seed, runs, floors)
        """The floor and the sensors of each run, in the order of ``runs``."""
        self.floors = floors
        self.tiles = floors[runs[0]].tiles.size
        shape = (len(runs), scenario.swarm.robots)
        self.decision, self.sent = np.empty(shape, dtype=np.int64), np.empty(shape, dtype=np.int64)
        self.decision_time_s, self.estimate = np.empty(shape), np.empty(shape)
        self.end_s, self.judged_s = np.empty(len(runs)), np.full(len(runs), self.t_end_s)
        self.ends_s = sorted(self.loop.ends_s[-MANY:])
        """Ends of up to ``MANY`` runs of earlier calls and of the runs so far, s, rising; ``next_check_s`` estimates
        from them when a run ends."""

    def until_s(self, now_s: float) -> float:
        """Return the time up to which the motion must be simulated before the next check, s.

        ``now_s`` is the time up to which it has been simulated. The result is at most ``now_s`` once the outcome of the
        run is final: all robots have decided, their decisions cannot change or the run ends with them, and the motion
        has reached the end of the run. At the start (``now_s`` 0) the decisions of the closed loop are not read:
        ``ClosedLoop.begin`` leaves those of the run before, until the first replay of the new run.
        """
        if now_s > 0.0:
            decided_s = self.final_s
            if decided_s is not None:
                # one tick more, so that the samples taken at the very end are included
                return min(end_s(decided_s, self.t_end_s) + self.tick_s, self.t_end_s)
        return min(self.next_check_s(now_s), self.t_end_s)

    @property
    def final_s(self) -> float | None:
        """Time of the last decision that counts, s; None while decisions are missing or may change."""
        if not self.may_change:
            return self.loop.all_decided_s
        return self.loop.first_all_decided_s if self.stops_early else None

    def next_check_s(self, now_s: float) -> float:
        """Choose when to check next whether all robots have decided, s; no result depends on the choice.

        Frequent checks cost time, and rare checks simulate motion after the end of the run. The remaining time m of
        this run is estimated by the mean of recent runs that ended more than a tick after ``now_s``. If the end is
        equally likely at any time, checking every sqrt(2 m ``MARGIN_S``) minimises the sum of both costs. But the next
        check is not before the earliest end of these recent runs. If there are none, the next check is ``PIECE_S`` from
        now.
        """
        longer = self.ends_s[bisect_right(self.ends_s, now_s + self.tick_s) :]
        if not longer:
            return now_s + PIECE_S
        remaining_s = sum(longer) / len(longer) - now_s
        step_s = math.sqrt(2.0 * MARGIN_S * remaining_s)
        # ``math.inf``: the caller limits the time to T_end
        return max(end_s(longer[0], t_end_s=math.inf) + self.tick_s, now_s + step_s)

    def finish(self, r: int) -> None:
        """Store the outcome of the run that the closed loop has just simulated, at index ``r`` of the arrays."""
        loop, first_s = self.loop, self.loop.first_all_decided_s if self.stops_early else None
        decided_s = first_s if self.may_change and first_s is not None else loop.all_decided_s
        self.end_s[r] = end_s(np.inf if decided_s is None else decided_s, self.t_end_s)
        # Read before the rewind. A decision by opinions has the time since which the opinions agree, but is only made
        # when they have agreed for ``decision.hold_s``, possibly after ``end_s``: the rewind would undo it.
        self.decision[r], self.decision_time_s[r] = loop.decision, loop.decision_time_s
        loop.rewind_to(float(self.end_s[r]))  # the motion may have been simulated beyond the end of the run
        self.estimate[r], self.sent[r] = loop.estimate, loop.replayer.swarm.agents["sent"]
        if first_s is not None:
            self.judged_s[r] = min(first_s + self.tick_s, self.t_end_s)
            if self.may_change:  # up to here, and no later
                loop.rewind_to(float(self.judged_s[r]))
                self.decision[r], self.decision_time_s[r] = loop.decision, loop.decision_time_s
        insort(self.ends_s, float(self.end_s[r]))
        self.loop.ends_s.append(float(self.end_s[r]))  # for later calls that take this loop out of the cache

    def outcomes(self) -> Outcomes:
        """Return the outcomes of all runs, once they are finished."""
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
            tiles=self.tiles,
            t_end_s=self.scenario.run.t_end_s,
            strategy=self.scenario.strategy.name,
            costs=costs_of(self.scenario),
        )
