"""Judge answers by the truth at their time, on floors that change.

| name | definition |
|---|---|
| swarm's answer | the answer on which all robots agreed last; before they first agree the one that the task presumes \
(``tasks.base``), if any |
| right at the decision | share of the robots whose last answer was right when it was given |
| share of the time | mean over robots: of the time in which an answer is right, the share in which theirs was |
| delay | from a change of the truth until the swarm's answer is the new truth, at most to the next change or to the \
end of the run; mean over the changes of the run, without those at which it was the swarm's answer already |
| false changes | how often an hour the swarm's answer, which was right, became one that was not, at the same truth |
| error of the time | distance of the time of a change that robots report (``changed_s``) from the true one; mean over \
right answers after a change |

Where each robot is asked anew after its answer 1 (``tasks.base``), the truth is its own, and so are delay and false
changes, as means over changes and over robots: from the change until its answer becomes 1, and how often it does so
where nothing has changed since its last. Right at the decision is then its last answer 1, if it has given one.

A robot's answer is its decision or, in strategies that decide by opinions, its opinion, from the sample at which it
came to it. Robots with faults do not count, unless all robots of the run have faults. Undecided robots are not right.
The delay is that of the present run: no model is fitted, and a swarm that never answers anew counts with all its time.

Also on what swarms agreed, and whether agreements lasted, on floors on which no answer is right too:

| name | definition |
|---|---|
| agreed on 0, 1 | share of all runs in which every robot made this decision |
| split, incomplete | share of runs in which decisions differ, or a robot is undecided |
| agreement lasted | share of the runs with an agreement in which opinions still agreed at the end of the run |

On a floor whose fill ratio equals the boundary, or for a task without a right answer, these shares are the outcome:
does a swarm break the tie, on which side, and does it stay there?

Decisions of most strategies are final, or are those at the end of the run. In strategies that decide by opinions
(``Strategy.decides``) the swarm has decided when its opinions have agreed for ``decision.hold_s``, but opinions may
change after that. Opinions of robots with faults do not count, unless all robots of the run have faults.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.floors.floor import Floor
from vibroswarm.inference.outcomes import Array, truth_of_robot, truth_over_time
from vibroswarm.result import Result
from vibroswarm.scenario.fault_draws import working
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.tasks import task

if TYPE_CHECKING:
    from vibroswarm.inference.agents import Swarm  # a type alone: no kernels are loaded


AGREEMENTS: Final[dict[str, Any]] = {"run": pl.UInt32, "holds": pl.Boolean}
"""Columns of the table of agreements, one row for each run in which all robots decided alike: whether their opinions
still agree with it at the end of the run."""


def may_change(scenario: Scenario) -> bool:
    """Return whether opinions may change after the swarm has decided.

    A run that stops when all have decided ends with the agreement, so that nothing is known of what comes after it.
    """
    return scenario.strategy.entry.decides == "opinion" and scenario.run.stop == "t_end"


def agreements_of(swarm: Swarm, runs: range) -> pl.DataFrame:
    """Return the table of agreements of a strategy that decides by opinions.

    Args:
        swarm: state of all robots at the end of the runs. runs: their numbers.
    """
    shape = (len(runs), -1)
    decision, opinion = (swarm.agents[name].reshape(shape) for name in ("decision", "opinion"))
    works = swarm.failures["works"].reshape(shape) == 1
    agreed = (decision != -1).all(axis=1) & (decision == decision[:, :1]).all(axis=1)
    holds = ((opinion == decision) | ~works).all(axis=1)
    numbers = np.arange(runs.start, runs.stop)
    return pl.DataFrame({"run": numbers[agreed], "holds": holds[agreed]}, schema=AGREEMENTS)


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

    since_s: Array
    """Times from which the truth is ``answer``, 0 first."""
    answer: Array
    """The right answer; nan: none."""
    given: NDArray[np.int64]
    """Index of the span in which each of its answers was given."""

    def spans(self, end_s: float) -> list[tuple[float, float, float]]:
        """Return start, end and right answer of each span."""
        since_s = self.since_s.tolist()
        return list(zip(since_s, [*since_s[1:], end_s], self.answer.tolist(), strict=True))


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
        robot, time_s, decision: (samples,), of the run, in the order of time; -1: undecided. counts: (robots,).
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
    truth_s, truth = truth_over_time(scenario, floor)
    truth_s, truth = truth_s[truth_s < end_s], truth[truth_s < end_s]
    of_swarm = Truth(truth_s, truth, _spans_at(truth_s, swarm))
    answers = [one for one, of in zip(robots, counts.tolist(), strict=True) if of]
    asked = task(scenario.task.name)
    is_own = asked.is_asked_anew(scenario.task.params)
    if is_own:
        truths = [_own_truth(scenario, floor, one, end_s) for one in answers]
    else:
        truths = [Truth(truth_s, truth, _spans_at(truth_s, one)) for one in answers]
    return Course(answers, swarm, asked.presumed, of_swarm, end_s, truths, is_own)


def _own_truth(scenario: Scenario, floor: Floor, answers: list[Answer], end_s: float) -> Truth:
    """Return what is right for a robot that is asked anew after each answer 1."""
    asked_anew_s = [one.since_s for one in answers if one.answer == 1]
    since_s, truth, ended = truth_of_robot(scenario, floor, asked_anew_s)
    given = _spans_at(since_s, answers)
    given[[one.answer == 1 for one in answers]] = ended  # before it was asked anew
    within = since_s < end_s
    return Truth(since_s[within], truth[within], given)


def _spans_at(since_s: Array, answers: list[Answer]) -> NDArray[np.int64]:
    return np.searchsorted(since_s, [one.since_s for one in answers], side="right") - 1


def judged(course: Course) -> dict[str, float]:
    """Return the numbers of the module's table for one run, by name; nan where the run does not have one."""
    if all(np.isnan(truth.answer).all() for truth in course.truths):  # no answer was ever right
        return dict.fromkeys(JUDGED, math.nan)
    return {
        "right_at_decision": _right_when_given(course),
        "right_time_share": _right_time_share(course),
        "answer_delay_s": _own_delay_s(course) if course.is_own else _delay_s(course),
        "false_changes_per_h": (_own_false_changes if course.is_own else _false_changes)(course)
        * 3600.0
        / course.end_s,
        "change_time_error_s": _time_error_s(course),
    }


def _right_when_given(course: Course) -> float:
    right = []
    for answers, truth in zip(course.robots, course.truths, strict=True):
        changes = [k for k, one in enumerate(answers) if course.is_own and one.answer == 1]
        last = changes[-1] if changes else len(answers) - 1
        right.append(bool(answers) and answers[last].answer == truth.answer[truth.given[last]])
    return float(np.mean(right))


def _right_time_share(course: Course) -> float:
    """Return the share of the time with a truth in which answers were right, as a mean over robots."""
    right_s = known_s = 0.0
    for answers, own in zip(course.robots, course.truths, strict=True):
        spans = [span for span in own.spans(course.end_s) if not math.isnan(span[2])]
        known_s = sum(until - since for since, until, _ in spans)  # the same for all
        ends_s = [*(answer.since_s for answer in answers[1:]), course.end_s]
        for answer, end_s in zip(answers, ends_s, strict=False):  # a robot may give no answer
            for since, until, truth in spans:
                if answer.answer == truth:
                    right_s += max(min(until, end_s) - max(since, answer.since_s), 0.0)
    return float(right_s / known_s / len(course.robots)) if known_s else math.nan


def _delay_s(course: Course) -> float:
    """Return the mean delay of the swarm's new answer over changes to another truth; nan without one to notice."""
    delays = []
    for since_s, end_s, truth in course.truth.spans(course.end_s)[1:]:
        before = [course.presumed, *(one.answer for one in course.swarm if one.since_s < since_s)]
        if not math.isnan(truth) and before[-1] != truth:
            again = (one.since_s for one in course.swarm if one.answer == truth and one.since_s >= since_s)
            delays.append(min(next(again, end_s), end_s) - since_s)
    return float(np.mean(delays)) if delays else math.nan


def _false_changes(course: Course) -> int:
    """Return how often the swarm left a right answer without a change of the truth."""
    answers = [one.answer for one in course.swarm]
    truths = course.truth.answer[course.truth.given].tolist()  # when each answer was given
    changes = zip([course.presumed, *answers], answers, truths, strict=False)
    return sum(truth == before != after for before, after, truth in changes)


def _own_delay_s(course: Course) -> float:
    """Return how long robots' answers were not yet 1 after a change, as a mean over changes; nan without one."""
    spans = [span for truth in course.truths for span in truth.spans(course.end_s)]
    delays = [until - since for since, until, truth in spans if truth == 1]
    return float(np.mean(delays)) if delays else math.nan


def _own_false_changes(course: Course) -> float:
    """Return how often a robot's answer became 1 although nothing had changed, as a mean over robots."""
    false: int = sum(
        answer.answer == 1 and truth.answer[k] == 0
        for answers, truth in zip(course.robots, course.truths, strict=True)
        for answer, k in zip(answers, truth.given.tolist(), strict=True)
    )
    return false / len(course.robots)


def _time_error_s(course: Course) -> float:
    """Return the mean distance of reported times of changes from true ones; nan where no right answer has one."""
    errors = [
        abs(answer.changed_s - float(truth.since_s[k]))
        for answers, truth in zip(course.robots, course.truths, strict=True)
        for answer, k in zip(answers, truth.given.tolist(), strict=True)
        if k > 0 and answer.changed_s is not None and answer.answer == truth.answer[k]
        if answer.answer == 1 or not course.is_own
    ]
    return float(np.mean(errors)) if errors else math.nan


def _counting(scenario: Scenario, seed: int | None, runs: list[int]) -> NDArray[np.bool_]:
    """Return which robots count, (runs, robots): those without faults, or all of a run in which all have some."""
    counts = np.ones((len(runs), scenario.swarm.robots), dtype=np.bool_)
    if scenario.faults.kinds and seed is not None:
        counts = working(scenario, seed, runs)
        counts[~counts.any(axis=1)] = True
    return counts


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
        samples: columns run, robot, time_s and decision of all samples, run by run in the order of time, and
            changed_s if robots report it. end_s: (runs,), end of each run, in the order of ``floors``.
    """
    runs = list(floors)
    counts, rows = _counting(scenario, seed, runs), []
    for r, run in enumerate(runs):
        low, high = np.searchsorted(samples["run"], [run, run + 1]).tolist()
        robot, time_s, decision = (samples[name][low:high] for name in ("robot", "time_s", "decision"))
        changed_s = samples["changed_s"][low:high] if "changed_s" in samples else None
        course = course_of(
            scenario, floors[run], robot, time_s, decision, counts[r], float(end_s[r]), changed_s
        )
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
