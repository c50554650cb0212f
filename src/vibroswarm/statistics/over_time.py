"""Judge answers by the truth at their time, on floors that change; and what robots reported over time.

| name | definition |
|---|---|
| swarm's answer | the answer on which all robots agreed last; before that the one that the task presumes, if any |
| right at the decision | share of the robots whose last answer was right when it was given |
| share of the time | mean over robots: of the time in which an answer is right, the share in which theirs was |
| delay | from a change of the truth until the swarm's answer is the new truth, at most to the next change or to the \
end of the run; mean over the changes of the run, without those at which it was the swarm's answer already |
| false changes | how often an hour the swarm's answer, which was right, became one that was not, at the same truth |
| error of the time | distance of the time of a change that robots report (``changed_s``) from the true one; mean over \
right answers after a change |
| agreement lasted | share of the runs with an agreement in which opinions still agreed at the end of the run |

Where each robot is asked anew after its answer 1 (``tasks.base``), the truth is its own, and so are delay and false
changes, as means over changes and over robots: from the change until its answer becomes 1, and how often it does so
where nothing has changed since its last. Right at the decision is then its last answer 1, if it has given one.

An answer is a decision or, in strategies that decide by opinions (``Strategy.decides``), an opinion. Robots with faults
do not count, unless all of the run have faults. Undecided robots are not right.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any, Final, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.floors.floor import Floor
from vibroswarm.inference.agents import Swarm, strategy_used
from vibroswarm.inference.outcomes import Array, number_over_time, truth_of_robot, truth_over_time
from vibroswarm.result import Result
from vibroswarm.scenario.fault_draws import working
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.strategies.base import arrays_of
from vibroswarm.tasks import task


def may_change(scenario: Scenario) -> bool:
    """Return whether opinions may change after the swarm has decided, in runs that go on."""
    return scenario.strategy.entry.decides == "opinion" and scenario.run.stop == "t_end"


def agreement_held(swarm: Swarm, runs: int) -> Array:
    """Return whether opinions still agree at the end with what all robots decided, (runs,); nan if they did not."""
    decision, opinion = (swarm.agents[name].reshape(runs, -1) for name in ("decision", "opinion"))
    works = swarm.failures["works"].reshape(runs, -1) == 1
    agreed = (decision != -1).all(axis=1) & (decision == decision[:, :1]).all(axis=1)
    return np.where(agreed, ((opinion == decision) | ~works).all(axis=1), math.nan)


JUDGED: Final = (
    "right_at_decision",
    "right_time_share",
    "answer_delay_s",
    "false_changes_per_h",
    "change_time_error_s",
)
"""Columns with a number for each run; null where a run does not have it."""
ANSWERS: Final[dict[str, Any]] = {"run": pl.UInt32, **dict.fromkeys(JUDGED, pl.Float64)}
"""Columns of the table, one row for each run."""


class Answer(NamedTuple):
    """An answer, and since when it is given."""

    since_s: float
    answer: int
    """Index into the answers of the task; -1: none."""
    changed_s: float | None = None
    """When the floor changed, as the robot reports it; None: it does not."""


class Truth(NamedTuple):
    """What is right for a robot or a swarm over time, and what was when it gave its answers."""

    spans: list[tuple[float, float, float]]
    """Start and end (s) of each span, and the right answer; nan: none."""
    given: list[int]
    """Index of the span in which each of its answers was given."""


class Course(NamedTuple):
    """The answers of a run's robots that count, and the truth, over time."""

    robots: list[list[Answer]]
    """The answers of each robot, in the order of time."""
    swarm: list[Answer]
    """The swarm's answers, each different from the one before it."""
    presumed: int | None
    """The answer that the swarm stands for before its first."""
    truth: Truth
    """What is right for the swarm."""
    end_s: float
    """End of the run."""
    truths: list[Truth]
    """What is right for each robot."""
    is_own: bool
    """Whether that depends on its own answers."""


def course_of(
    scenario: Scenario,
    floor: Floor,
    robot: NDArray[Any],
    time_s: Array,
    decision: NDArray[Any],
    counts: NDArray[np.bool_],
    end_s: float,
    changed_s: Array | None = None,
) -> Course:
    """Return the answers of a run over time.

    Args:
        robot, time_s, decision: (samples,), in the order of time; -1: undecided. counts: which robots do, (robots,).
        changed_s: (samples,), when the floor changed, as robots report it, nan: it has not; None: they do not.
    """
    robots: list[list[Answer]] = [[] for _ in counts]
    order = np.argsort(robot, kind="stable")
    before = np.full(robot.size, -1)
    before[order[1:]] = np.where(robot[order[1:]] == robot[order[:-1]], decision[order[:-1]], -1)
    now, swarm = np.full(counts.size, -1), list[Answer]()
    for k in np.flatnonzero((decision != before) & counts[robot]).tolist():
        i, answer = int(robot[k]), int(decision[k])
        reported = None if changed_s is None or math.isnan(changed_s[k]) else float(changed_s[k])
        robots[i].append(Answer(float(time_s[k]), answer, reported))
        now[i] = answer
        agreed = answer != -1 and (now[counts] == answer).all()
        if agreed and (not swarm or swarm[-1].answer != answer):
            swarm.append(Answer(float(time_s[k]), answer))
    answers = [one for one, of in zip(robots, counts.tolist(), strict=True) if of]
    asked, common = task(scenario.task.name), truth_over_time(scenario, floor)
    is_own = asked.is_asked_anew(scenario.task.params)
    truths = []
    for own in answers:
        truth = _truth(*common, own, end_s)
        if is_own:
            anew = [k for k, one in enumerate(own) if one.answer == 1]
            since_s, right, ended = truth_of_robot(scenario, floor, [own[k].since_s for k in anew])
            truth = _truth(since_s, right, own, end_s)
            for k, span in zip(anew, ended.tolist(), strict=True):
                truth.given[k] = span  # before it was asked anew
        truths.append(truth)
    return Course(answers, swarm, asked.presumed, _truth(*common, swarm, end_s), end_s, truths, is_own)


def _truth(since_s: Array, truth: Array, answers: list[Answer], end_s: float) -> Truth:
    within = since_s < end_s
    starts_s, right = since_s[within].tolist(), truth[within].tolist()
    given = np.searchsorted(starts_s, [one.since_s for one in answers], side="right") - 1
    return Truth(list(zip(starts_s, [*starts_s[1:], end_s], right, strict=True)), given.tolist())


def judged(course: Course) -> dict[str, float]:
    """Return the numbers of the module's table for one run, by name; nan where the run does not have one."""
    if all(math.isnan(right) for truth in course.truths for *_, right in truth.spans):  # none was ever right
        return dict.fromkeys(JUDGED, math.nan)
    given = [
        (answer, k, *own.spans[k])
        for answers, own in zip(course.robots, course.truths, strict=True)
        for answer, k in zip(answers, own.given, strict=True)
    ]
    if course.is_own:
        delays_s = [until - since for own in course.truths for since, until, truth in own.spans if truth == 1]
        false = sum(one.answer == 1 and truth == 0 for one, *_, truth in given) / len(course.robots)
    else:
        delays_s, false = _delays_and_false_changes(course)
    errors_s = [
        abs(one.changed_s - since)
        for one, k, since, _, truth in given
        if k > 0 and one.changed_s is not None and one.answer == truth
        if one.answer == 1 or not course.is_own
    ]
    return {
        "right_at_decision": _right_when_given(course),
        "right_time_share": _right_time_share(course),
        "answer_delay_s": float(np.mean(delays_s)) if delays_s else math.nan,
        "false_changes_per_h": false * 3600.0 / course.end_s,
        "change_time_error_s": float(np.mean(errors_s)) if errors_s else math.nan,
    }


def _right_when_given(course: Course) -> float:
    right = []
    for answers, truth in zip(course.robots, course.truths, strict=True):
        changes = [k for k, one in enumerate(answers) if course.is_own and one.answer == 1]
        last = changes[-1] if changes else len(answers) - 1
        right.append(bool(answers) and answers[last].answer == truth.spans[truth.given[last]][2])
    return float(np.mean(right))


def _right_time_share(course: Course) -> float:
    """Return the share of the time with a truth in which answers were right, as a mean over robots."""
    right_s = known_s = 0.0
    for answers, own in zip(course.robots, course.truths, strict=True):
        spans = [span for span in own.spans if not math.isnan(span[2])]
        known_s = sum(until - since for since, until, _ in spans)  # the same for all
        ends_s = [*(answer.since_s for answer in answers[1:]), course.end_s]
        for answer, end_s in zip(answers, ends_s, strict=False):  # a robot may give no answer
            for since, until, truth in spans:
                if answer.answer == truth:
                    right_s += max(min(until, end_s) - max(since, answer.since_s), 0.0)
    return float(right_s / known_s / len(course.robots)) if known_s else math.nan


def _delays_and_false_changes(course: Course) -> tuple[list[float], int]:
    """Return delays of the swarm's new answer after changes, and how often it left a right answer without one."""
    delays_s = []
    for since_s, end_s, truth in course.truth.spans[1:]:
        before = [course.presumed, *(one.answer for one in course.swarm if one.since_s < since_s)]
        if not math.isnan(truth) and before[-1] != truth:
            again = (one.since_s for one in course.swarm if one.answer == truth and one.since_s >= since_s)
            delays_s.append(min(next(again, end_s), end_s) - since_s)
    answers = [one.answer for one in course.swarm]
    truths = [course.truth.spans[k][2] for k in course.truth.given]
    changes = zip([course.presumed, *answers], answers, truths, strict=False)
    return delays_s, sum(truth == before != after for before, after, truth in changes)


def answers_table(
    scenario: Scenario,
    seed: int | None,
    floors: Mapping[int, Floor],
    samples: Mapping[str, NDArray[Any]],
    end_s: Array,
) -> pl.DataFrame:
    """Return the table ``ANSWERS`` of runs.

    Args:
        seed: None for recordings, whose robots all count. floors, end_s: of each run.
        samples: run, robot, time_s, decision and, if robots report it, changed_s, run by run in the order of time.
    """
    counts = np.ones((len(floors), scenario.swarm.robots), dtype=np.bool_)
    if scenario.faults.kinds and seed is not None:
        counts = working(scenario, seed, list(floors))
        counts[~counts.any(axis=1)] = True
    rows = []
    for (run, floor), of_run, end in zip(floors.items(), counts, end_s.tolist(), strict=True):
        own = slice(*np.searchsorted(samples["run"], [run, run + 1]))
        robot, time_s, decision = (samples[name][own] for name in ("robot", "time_s", "decision"))
        changed_s = samples["changed_s"][own] if "changed_s" in samples else None
        course = course_of(scenario, floor, robot, time_s, decision, of_run, end, changed_s)
        rows.append({"run": run, **judged(course)})
    return pl.DataFrame(rows, schema=ANSWERS).fill_nan(None)


def answers_in(result: Result) -> pl.DataFrame:
    """Return the table ``ANSWERS`` of a result; runs with decisions that are not logged are left out."""
    unknown = result.inference.filter(pl.col("decision").is_null())["run"].unique()
    runs = sorted(set(result.runs["run"]) - set(unknown))
    samples = result.inference.join(result.motion, on=["run", "robot", "sample"], maintain_order="left")
    if result.reports is not None:
        told = result.reports.filter(pl.col("name") == "changed_s").drop("name", "index")
        samples = samples.join(told, on=["run", "robot", "sample"], how="left", maintain_order="left")
        samples = samples.rename({"value": "changed_s"}) if told.height else samples
    read: list[str] = ["run", "robot", "time_s", "decision", "changed_s"]
    columns = {name: samples[name].to_numpy() for name in read if name in samples.columns}
    ends = result.runs.filter(pl.col("run").is_in(runs)).sort("run")["end_s"].to_numpy()
    floors = {run: result.floor(run) for run in runs}
    return answers_table(result.scenario, result.seed, floors, columns, ends)


def reports_over_time(result: Result, run: int = 0) -> pl.DataFrame:
    """Return what robots reported over time, not null; places of an array have names such as ``trust 3``."""
    columns = ("name", "robot", "time_s", "value")
    if result.reports is None:
        return pl.DataFrame(
            schema=dict(zip(columns, (pl.String, pl.UInt16, pl.Float64, pl.Float64), strict=True))
        )
    strategy = strategy_used(result.scenario)
    once = [name for name in arrays_of(strategy.arrays) if name not in (strategy.state_type.names or ())]
    told = result.reports.filter(
        pl.col("run") == run, pl.col("value").is_not_null(), ~pl.col("name").is_in(once)
    )
    places = pl.format("{} {}", "name", "index")
    is_array = pl.col("index").max().over("name") > 0
    told = told.with_columns(pl.when(is_array).then(places).otherwise("name").alias("name"))
    times = result.motion.select("run", "robot", "sample", "time_s")
    return told.join(times, on=["run", "robot", "sample"], maintain_order="left").select(columns)


def report_headings(result: Result, names: Iterable[str]) -> dict[str, str]:
    """Return names and units in words, by names as in ``reports_over_time``."""
    reported = strategy_used(result.scenario).reported
    parts = {name: name.partition(" ") for name in names}
    return {
        name: report_heading(field, place, reported[field].unit if field in reported else "")
        for name, (field, _, place) in parts.items()
    }


def report_heading(name: str, place: int | str = "", unit: str = "") -> str:
    """Return a report and its unit in words, such as "trust 3 (m)"; ``place`` is that of a value in an array."""
    words = name.removesuffix(f"_{unit}").replace("_", " ")
    return " ".join(filter(None, (words, str(place), f"({unit})" if unit else "")))


def estimates_of(result: Result) -> list[str]:
    """Return the names of the reports that estimate the number that the task asks for."""
    reported = strategy_used(result.scenario).reported.values()
    return ["estimate", *(one.name for one in reported if one.estimates)]


def true_number_over_time(result: Result, run: int) -> list[tuple[float, float]]:
    """Return from when on (s), 0 first, the number that such reports estimate is which."""
    floor, (row,) = result.floor(run), result.runs.filter(run=run).to_dicts()
    if not floor.is_changing:
        return [(0.0, row["fill_ratio"])]
    return number_over_time(result.scenario, floor, row["end_s"])
