"""Judge answers by the truth at their time, on floors that change.

| name | definition |
|---|---|
| swarm's answer | the answer on which all robots agreed last; none before they first agree |
| right at the decision | share of the robots whose last answer was right when it was given |
| share of the time | mean over robots: of the time in which an answer is right, the share in which theirs was |
| delay | from a change of the truth until the swarm's answer is the new truth, at most to the next change or to the \
end of the run; mean over the changes of the run |
| false changes | how often an hour the swarm's answer, which was right, became one that was not, at the same truth |

A robot's answer is its decision or, in strategies that decide by opinions, its opinion, from the sample at which it
came to it. Robots with faults do not count, unless all robots of the run have faults. Undecided robots are not right.
The delay is that of the present run: no model is fitted, and a swarm that never answers anew counts with all its time.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.displayed import html_view
from vibroswarm.floors.floor import Floor
from vibroswarm.inference.outcomes import truth_over_time
from vibroswarm.result import Result
from vibroswarm.scenario.fault_draws import working
from vibroswarm.scenario.scenario import Scenario

Array = NDArray[np.float64]

JUDGED: Final = ("right_at_decision", "right_time_share", "answer_delay_s", "false_changes_per_h")
"""Columns with a number for each run; null where a run does not have it."""
ANSWERS: Final[dict[str, Any]] = {"run": pl.UInt32, **dict.fromkeys(JUDGED, pl.Float64)}
"""Columns of the table, one row for each run."""


class Answer(NamedTuple):
    """An answer, and since when it is given."""

    since_s: float
    answer: int
    """Index into the answers of the task; -1: none."""

    def _repr_html_(self) -> str:
        return html_view(self)


class Course(NamedTuple):
    """The answers of a run's robots that count, and the truth, over time."""

    robots: list[list[Answer]]
    """The answers of each robot, in the order of time."""
    swarm: list[Answer]
    """The swarm's answers, each different from the one before it."""
    truth_s: Array
    """Times from which the truth is ``truth``, 0 first."""
    truth: Array
    """The right answer; nan: none."""
    end_s: float
    """End of the run."""


def course_of(
    scenario: Scenario,
    floor: Floor,
    robot: NDArray[Any],
    time_s: Array,
    decision: NDArray[Any],
    counts: NDArray[np.bool_],
    end_s: float,
) -> Course:
    """Return the answers of a run over time.

    Args:
        robot, time_s, decision: (samples,), of the run, in the order of time; -1: undecided. counts: (robots,).
    """
    robots: list[list[Answer]] = [[] for _ in counts]
    order = np.argsort(robot, kind="stable")
    before = np.full(robot.size, -1)
    before[order[1:]] = np.where(robot[order[1:]] == robot[order[:-1]], decision[order[:-1]], -1)
    now, swarm = np.full(counts.size, -1), list[Answer]()
    for k in np.flatnonzero((decision != before) & counts[robot]).tolist():
        i, answer = int(robot[k]), int(decision[k])
        robots[i].append(Answer(float(time_s[k]), answer))
        now[i] = answer
        agreed = answer != -1 and (now[counts] == answer).all()
        if agreed and (not swarm or swarm[-1].answer != answer):
            swarm.append(Answer(float(time_s[k]), answer))
    truth_s, truth = truth_over_time(scenario, floor)
    within = truth_s < end_s
    return Course(
        [one for one, of in zip(robots, counts.tolist(), strict=True) if of],
        swarm,
        truth_s[within],
        truth[within],
        end_s,
    )


def judged(course: Course) -> dict[str, float]:
    """Return the numbers of the module's table for one run, by name; nan where the run does not have one."""
    return {
        "right_at_decision": float(np.mean([_right_when_given(course, one) for one in course.robots])),
        "right_time_share": _right_time_share(course),
        "answer_delay_s": _delay_s(course),
        "false_changes_per_h": _false_changes(course) * 3600.0 / course.end_s,
    }


def _truth_at(course: Course, time_s: float) -> float:
    return float(course.truth[np.searchsorted(course.truth_s, time_s, side="right") - 1])


def _right_when_given(course: Course, answers: list[Answer]) -> bool:
    return bool(answers) and answers[-1].answer == _truth_at(course, answers[-1].since_s)


def _right_time_share(course: Course) -> float:
    """Return the share of the time with a truth in which answers were right, as a mean over robots."""
    until_s = [*course.truth_s[1:].tolist(), course.end_s]
    spans = [
        (since, until, truth)
        for since, until, truth in zip(course.truth_s.tolist(), until_s, course.truth.tolist(), strict=True)
        if not math.isnan(truth)
    ]
    known_s = sum(until - since for since, until, _ in spans)
    if known_s == 0.0:
        return math.nan
    right_s = 0.0
    for answers in course.robots:
        ends_s = [*(answer.since_s for answer in answers[1:]), course.end_s]
        for answer, end_s in zip(answers, ends_s, strict=True):
            for since, until, truth in spans:
                if answer.answer == truth:
                    right_s += max(min(until, end_s) - max(since, answer.since_s), 0.0)
    return float(right_s / known_s / len(course.robots))


def _delay_s(course: Course) -> float:
    """Return the mean delay of the swarm's new answer over changes to another truth; nan without such a change."""
    delays = []
    until_s = [*course.truth_s[1:].tolist(), course.end_s]
    for since_s, end_s, truth in list(
        zip(course.truth_s.tolist(), until_s, course.truth.tolist(), strict=True)
    )[1:]:
        if not math.isnan(truth):
            delays.append(_since(course.swarm, truth, since_s, end_s) - since_s)
    return float(np.mean(delays)) if delays else math.nan


def _since(swarm: list[Answer], truth: float, since_s: float, end_s: float) -> float:
    """Return the first time from ``since_s`` on at which the swarm's answer is ``truth``; at most ``end_s``."""
    before = [one for one in swarm if one.since_s <= since_s]
    if before and before[-1].answer == truth:
        return since_s
    for one in swarm:
        if since_s < one.since_s < end_s and one.answer == truth:
            return one.since_s
    return end_s


def _false_changes(course: Course) -> int:
    """Return how often the swarm left a right answer without a change of the truth."""
    pairs = zip(course.swarm[:-1], course.swarm[1:], strict=True)
    return sum(
        _truth_at(course, after.since_s) == before.answer != after.answer
        and not math.isnan(_truth_at(course, after.since_s))
        for before, after in pairs
    )


def answers_table(
    scenario: Scenario,
    seed: int | None,
    floors: Mapping[int, Floor],
    samples: Mapping[str, NDArray[Any]],
    end_s: Array,
) -> pl.DataFrame:
    """Return the table ``ANSWERS`` of runs.

    Args:
        seed: of the runs; None for recordings, whose robots all count. floors: by number of the run.
        samples: columns run, robot, time_s and decision of all samples, run by run in the order of time. end_s:
            (runs,), end of each run, in the order of ``floors``.
    """
    runs = list(floors)
    counts = np.ones((len(runs), scenario.swarm.robots), dtype=np.bool_)
    if scenario.faults.kinds and seed is not None:
        counts = working(scenario, seed, runs)
        counts[~counts.any(axis=1)] = True
    rows = []
    for r, run in enumerate(runs):
        low, high = np.searchsorted(samples["run"], [run, run + 1]).tolist()
        robot, time_s, decision = (samples[name][low:high] for name in ("robot", "time_s", "decision"))
        course = course_of(scenario, floors[run], robot, time_s, decision, counts[r], float(end_s[r]))
        rows.append({"run": run, **judged(course)})
    return pl.DataFrame(rows, schema=ANSWERS).fill_nan(None)


def answers_in(result: Result) -> pl.DataFrame:
    """Return the table ``ANSWERS`` of a result; runs with decisions that are not logged are left out."""
    known = result.inference.group_by("run").agg(pl.col("decision").null_count() == 0)
    runs = [run for run, is_known in known.sort("run").iter_rows() if is_known]
    samples = result.inference.join(result.motion, on=["run", "robot", "sample"], maintain_order="left")
    columns = {name: samples[name].to_numpy() for name in ("run", "robot", "time_s", "decision")}
    ends = result.runs.filter(pl.col("run").is_in(runs)).sort("run")["end_s"].to_numpy()
    floors = {run: result.floor(run) for run in runs}
    return answers_table(result.scenario, result.seed, floors, columns, ends)


def swarm_answers(result: Result, run: int) -> list[Answer]:
    """Return the swarm's answers in a run, and since when it gave each; empty if it never agreed."""
    rows = result.motion.filter(pl.col("run") == run)
    decision = result.inference.filter(pl.col("run") == run)["decision"].to_numpy()
    counts = np.ones(result.scenario.swarm.robots, dtype=np.bool_)
    if result.scenario.faults.kinds and result.seed is not None:
        working_ones = working(result.scenario, result.seed, [run])[0]
        counts = working_ones if working_ones.any() else counts
    end_s = float(result.runs.filter(pl.col("run") == run)["end_s"][0])
    columns = (rows["robot"].to_numpy(), rows["time_s"].to_numpy(), decision)
    return course_of(result.scenario, result.floor(run), *columns, counts, end_s).swarm
