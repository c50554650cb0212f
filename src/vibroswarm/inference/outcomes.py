"""Outcomes of robots and runs: the columns, how each is computed, and the tables and figures made of them.

Unless stated otherwise, arrays about robots have shape (..., runs, robots) and arrays about runs have shape (...,
runs); leading axes are cells (combinations of settings).

| name | definition |
|---|---|
| truth | the right decision by the scenario's task, such as 0 or 1; nan if no decision is right. On a floor that
changes it is that of the floor at the end of the run, and so are right, wrong and the fill ratio |
| right, wrong | robots that decided and whose decision is, or is not, the truth; no robot if the truth is nan |
| consensus | incomplete: a robot is undecided; split: decisions differ; else right, wrong, or truth_undefined (nan) |
| consensus_time_s | time of the last decision of a swarm whose robots all made the same decision, else nan |
| belief_in_truth | belief that f is below the boundary if the truth is 0; one minus that belief if it is 1 |
| estimate | the robot's estimate of f: its own, or alpha / (alpha + beta), the posterior mean; nan if it has none |
| estimate_spread | standard deviation of that estimate, as the robot states it |
| capped time | min(decision time, T_end): an undecided robot, or a swarm without consensus, counts with T_end |
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import ArrayLike, NDArray

from vibroswarm.core.jit import kernel, read_only
from vibroswarm.floors.floor import Floor
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.tasks import Asked, task

Array = NDArray[np.float64]
"""Floats, of any shape."""
Columns = Mapping[str, NDArray[Any]]
"""Columns of a table by name, as arrays."""

CONSENSUS: Final = ("right", "wrong", "split", "incomplete", "truth_undefined")
"""Outcomes of a run. ``truth_undefined``: all robots made the same decision, on a floor on which neither decision is
right, such as one whose fill ratio is the boundary itself."""
RIGHT, WRONG, SPLIT, INCOMPLETE, TRUTH_UNDEFINED = range(len(CONSENSUS))

ROBOTS: Final[dict[str, Any]] = {
    "run": pl.UInt32,
    "robot": pl.UInt16,
    "decision": pl.Int8,
    "decision_time_s": pl.Float64,
    "belief_at_decision": pl.Float64,
    "belief_below": pl.Float64,
    "belief_in_truth": pl.Float64,
    "alpha": pl.UInt32,
    "beta": pl.UInt32,
    "estimate": pl.Float64,
    "estimate_spread": pl.Float64,
    "samples": pl.UInt32,
    "sent": pl.UInt32,
    "messages_received": pl.UInt32,
}
"""Columns of the table of robots. ``belief_below`` is the belief that f is below the boundary, at the moment of
decision or, for a robot that never decided, at its last sample or timer. alpha, beta and messages_received are those
at the end of the run."""

SPENT: Final = {
    "driving_share": "drive_s",
    "turning_share": "turn_s",
    "avoiding_share": "avoid_s",
    "sampling_share": "stop_s",
    "blocked_share": "blocked_s",
}
"""Shares of the time up to a robot's last sample, with the column of the table of motion that they sum. The first four
add up to 1; a robot is blocked if it drives and does not move."""
SHARES: Final[dict[str, Any]] = dict.fromkeys(SPENT, pl.Float64)
"""Columns of the table of robots of a result, after ``ROBOTS``; null without samples."""

RUNS: Final[dict[str, Any]] = {
    "run": pl.UInt32,
    "consensus": pl.Enum(list(CONSENSUS)),
    "consensus_time_s": pl.Float64,
    "fill_ratio": pl.Float64,
    "truth": pl.Int8,
    "right": pl.UInt16,
    "wrong": pl.UInt16,
    "undecided": pl.UInt16,
    "end_s": pl.Float64,
    "stopped_early": pl.Boolean,
}
"""Columns of the table of runs; ``fill_ratio`` is the number that is asked for if the task asks for one; ``truth`` is
null if neither decision is right. ``stopped_early`` marks runs that ended before ``run.t_end_s``, as their motion
statistics are biased."""


HALF: Final = 0.5
"""Belief of a robot that leans to neither answer, and the error expected of it."""


# Floors and truth


class _Question:
    """What a scenario asks about floors, read from it once: its sections are looked up slowly."""

    def __init__(self, scenario: Scenario) -> None:
        asked = scenario.task
        self.task, self.params = task(asked.name), asked.params
        self._asked = Asked(
            scenario.arena.width_m,
            scenario.arena.height_m,
            fill_ratio=math.nan,
            decision_boundary=scenario.decision.decision_boundary,
            kinds=scenario.sensor.kinds,
        )

    def asked(self, floor: Floor, start: Floor) -> Asked:
        """Return what the task may need beside the floor."""
        fill_ratio = floor.fill_ratio_within(self._asked.width_m, self._asked.height_m)
        return self._asked._replace(fill_ratio=fill_ratio, start=start)

    def judged(self, now: Floor, start: Floor) -> tuple[float, float]:
        """Return the number against which estimates are scored, and the right decision, nan for none."""
        asked = self.asked(now, start)
        answer = self.task.answer(now, asked, self.params)
        is_scored = bool(self.task.estimated) or self.task.scored is not None
        number = self.task.number(now, asked, self.params) if is_scored else asked.fill_ratio
        return number, math.nan if answer is None else float(answer)


def truth_on(scenario: Scenario, floor: Floor, *, time_s: float = math.inf) -> int | None:
    """Return the right decision on a floor by the scenario's task, such as 1 or 0, or None if no decision is right."""
    _, truth = _Question(scenario).judged(floor.at(time_s), floor.at(0.0))
    return None if math.isnan(truth) else int(truth)


def truth_over_time(scenario: Scenario, floor: Floor) -> tuple[Array, Array]:
    """Return from when on which decision is right, (spans,) each: times (s), 0 first, and truths, nan for none."""
    if task(scenario.task.name).lacks_truth(scenario.task.params):
        return np.zeros(1), np.full(1, math.nan)
    return truth_of_robot(scenario, floor, ())[:2]


def number_over_time(scenario: Scenario, floor: Floor, end_s: float) -> list[tuple[float, float]]:
    """Return from when on (s), 0 first, estimates are scored against which number, up to the end of a run."""
    question, start, numbers = _Question(scenario), floor.at(0.0), list[tuple[float, float]]()
    for since_s, now in floor.stages():
        if since_s >= end_s:
            break
        number, _ = question.judged(now, start)
        if not numbers or number != numbers[-1][1]:
            numbers.append((since_s, number))
    return numbers


def truth_of_robot(
    scenario: Scenario, floor: Floor, answered_s: Sequence[float]
) -> tuple[Array, Array, NDArray[np.int64]]:
    """Return from when on which decision of a robot is right, if it is asked anew at some times."""
    question, stages = _Question(scenario), list(floor.stages())
    start = now = stages[0][1]
    events: list[tuple[float, Floor | None]] = [*stages, *((time_s, None) for time_s in answered_s)]
    since_s, truth, given = list[float](), list[float](), list[int]()
    for time_s, stage in sorted(events, key=lambda event: (event[0], event[1] is None)):
        if stage is None:
            given.append(len(truth) - 1)
            start = now
        else:
            now = stage
        answer = question.task.answer_of_robot(now, question.asked(now, start), question.params)
        number = math.nan if answer is None else float(answer)
        if not truth or not (number == truth[-1] or (math.isnan(number) and math.isnan(truth[-1]))):
            since_s.append(time_s)
            truth.append(number)
    return np.array(since_s), np.array(truth), np.array(given, dtype=np.int64)


def fills_and_truth(
    scenario: Scenario, floors: Mapping[int, Floor], runs: Sequence[int], end_s: Array | None = None
) -> tuple[Array, Array]:
    """Return fill ratio in the arena (or the number asked for) and truth at the end of each run, (runs,); nan: none."""
    ends = [math.inf] * len(runs) if end_s is None else end_s.tolist()
    # What the truth of each run depends on: the floor object, and the end if the floor changes.
    keys = [
        (id(floors[run]), end if floors[run].is_changing else math.inf)
        for run, end in zip(runs, ends, strict=True)
    ]
    question, known = _Question(scenario), dict[tuple[int, float], tuple[float, float]]()
    for run, key in zip(runs, keys, strict=True):
        if key not in known:
            known[key] = question.judged(floors[run].at(key[1]), floors[run].at(0.0))
    found = np.array([known[key] for key in keys], dtype=np.float64).reshape(-1, 2)
    return found[:, 0].copy(), found[:, 1].copy()


# Columns of robots and of runs


def right_of(decision: NDArray[Any], truth: Array) -> NDArray[np.bool_]:
    """Return which robots decided right, (..., runs, robots); no robot of a run whose truth is nan."""
    return np.asarray(decision == truth[..., None])


def wrong_of(decision: NDArray[Any], truth: Array) -> NDArray[np.bool_]:
    """Return which robots decided wrong, (..., runs, robots); no robot of a run whose truth is nan."""
    truth = truth[..., None]
    return np.asarray((decision != -1) & (decision != truth) & ~np.isnan(truth))


def belief_in_truth(belief: Array, truth: Array) -> Array:
    """Return the belief in the truth; nan where ``belief`` or ``truth`` is nan."""
    return np.where(truth == 0.0, belief, np.where(truth == 1.0, 1.0 - belief, np.nan))


def costs_of(scenario: Scenario) -> Array | None:
    """Return the costs of mistakes, relative to the dearest, (answers, answers): rows are truths, columns decisions."""
    given, asks = scenario.task.costs, scenario.task.entry
    if given is not None:
        costs = np.array(given, dtype=np.float64)
        return np.asarray(costs / costs.max())
    answers = 2 if asks is None else len(asks.answers_of(scenario.sensor.kinds))
    return None if answers == 2 else 1.0 - np.eye(answers)


def forced_errors(
    decision: NDArray[np.integer], belief_in_truth: Array, truth: Array, costs: Array | None = None
) -> Array:
    """Return the forced error of each robot: 0 if it is right, 1 if it is wrong, or the cost of that mistake.

    An undecided robot counts as deciding for the answer that it believes in more; without a belief as guessing (1/2 of
    two answers, 1 - 1/k of k). ``costs``: (..., answers, answers), rows are truths; nan: there is no such answer.
    """
    if costs is not None:
        return _forced_costs(decision, belief_in_truth, truth, costs)
    doubt = np.where(np.isnan(belief_in_truth), HALF, 1.0 - belief_in_truth)
    leaning = np.where(doubt > HALF, 1.0, np.where(doubt < HALF, 0.0, HALF))
    errors = np.where(decision == -1, leaning, decision != truth)
    return np.where(np.isnan(truth), np.nan, errors)


def _forced_costs(decision: NDArray[np.integer], belief_in_truth: Array, truth: Array, costs: Array) -> Array:
    row = np.where(np.isnan(truth), 0, truth).astype(np.intp)
    of_truth = np.take_along_axis(
        np.broadcast_to(costs, (*row.shape, *costs.shape[-2:])), row[..., None, None], -2
    )[..., 0, :]
    answers = (~np.isnan(of_truth)).sum(axis=-1)
    total = np.nansum(of_truth, axis=-1)
    guess, mistake = total / answers, total / np.maximum(answers - 1, 1)
    leaning = np.where(belief_in_truth > HALF, 0.0, np.where(belief_in_truth < HALF, mistake, guess))
    column = np.where(decision == -1, 0, decision).astype(np.intp)
    shape = (*np.broadcast_shapes(row.shape, column.shape), of_truth.shape[-1])
    decided = np.take_along_axis(
        np.broadcast_to(of_truth, shape), np.broadcast_to(column, shape[:-1])[..., None], -1
    )[..., 0]
    return np.where(np.isnan(truth), np.nan, np.where(decision == -1, leaning, decided))


def capped_time_s(time_s: Array, t_end_s: ArrayLike) -> Array:
    """Return min(time, T_end), s, and T_end where the time is nan; the arrays are broadcast against each other."""
    return np.minimum(np.where(np.isnan(time_s), t_end_s, time_s), t_end_s)


def robot_columns(finals: Columns, truth: Array) -> dict[str, NDArray[Any]]:
    """Return the columns ``finals`` with ``belief_in_truth`` and ``sent`` added, (..., runs, robots) each."""
    in_truth = belief_in_truth(finals["belief_below"], truth[..., None])
    return {**finals, "belief_in_truth": in_truth, "sent": finals.get("sent", finals["samples"])}


def run_columns(
    decision: NDArray[Any], time_s: Array, fills: Array, truth: Array, end_s: Array, t_end_s: float
) -> dict[str, NDArray[Any]]:
    """Return the columns of the table of runs except ``run``; consensus is an index into ``CONSENSUS``."""
    undecided = (decision == -1).sum(axis=-1)
    right, wrong = right_of(decision, truth).sum(axis=-1), wrong_of(decision, truth).sum(axis=-1)
    same = (decision == decision[..., :1]).all(axis=-1)  # all robots have the decision of the first one
    of_same = np.where(np.isnan(truth), TRUTH_UNDEFINED, np.where(right > 0, RIGHT, WRONG))
    consensus = (undecided == 0) & same
    return {
        "consensus": np.where(undecided > 0, INCOMPLETE, np.where(same, of_same, SPLIT)).astype(np.uint8),
        "consensus_time_s": np.where(consensus, time_s.max(axis=-1), np.nan),
        "fill_ratio": fills,
        "truth": truth,
        "right": right.astype(np.uint16),
        "wrong": wrong.astype(np.uint16),
        "undecided": undecided.astype(np.uint16),
        "end_s": end_s,
        "stopped_early": end_s < t_end_s - 1e-9,  # 1e-9: for rounding
    }


# Tables


def outcome_tables(
    scenario: Scenario, floors: Mapping[int, Floor], finals: pl.DataFrame, ends: pl.DataFrame
) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Return the tables of robots and of runs."""
    by_run = {name: finals[name].to_numpy().reshape(-1, scenario.swarm.robots) for name in finals.columns}
    end_s = ends["end_s"].to_numpy().reshape(by_run["run"].shape).max(axis=1)
    run = by_run["run"][:, 0].copy()
    fills, truth = fills_and_truth(scenario, floors, run.tolist(), end_s)
    decision, time_s = by_run["decision"], by_run["decision_time_s"]
    of_robots = robot_columns(by_run, truth)
    of_runs = run_columns(decision, time_s, fills, truth, end_s, scenario.run.t_end_s) | {"run": run}
    added = {
        name: as_series(name, of_robots[name].ravel(), ROBOTS[name]) for name in ("belief_in_truth", "sent")
    }
    return (
        pl.DataFrame([added[name] if name in added else finals[name] for name in ROBOTS]),
        pl.DataFrame([as_series(name, of_runs[name], kind) for name, kind in RUNS.items()]),
    )


def with_shares(robots: pl.DataFrame, samples: pl.DataFrame) -> pl.DataFrame:
    """Return the table of robots with the columns ``SHARES``."""
    run, first = np.unique(robots["run"].to_numpy(), return_index=True)
    bounds = np.append(np.searchsorted(samples["run"].to_numpy(), run), samples.height)
    row = np.repeat(first, np.diff(bounds)) + samples["robot"].to_numpy()
    rows, last_s = np.bincount(row, minlength=robots.height), np.full(robots.height, np.nan)
    last_s[row] = samples["time_s"].to_numpy()
    shares = []
    for name, column in SPENT.items():
        total_s, known = np.zeros(robots.height), np.zeros(robots.height)
        add_known(row, read_only(samples[column].to_numpy()), total_s, known)
        mean_s = np.divide(total_s, known, out=np.full(robots.height, np.nan), where=known > 0.0)
        shares.append(as_series(name, mean_s * rows / last_s, SHARES[name]))
    return robots.hstack(shares)


@kernel
def add_known(row: NDArray[np.int64], values: NDArray[np.float32], total: Array, known: Array) -> None:
    """Add the values that are not nan, and their number, to entry ``row`` of ``total`` and ``known``, in order."""
    for k in range(row.size):
        if not math.isnan(values[k]):
            total[row[k]] += values[k]
            known[row[k]] += 1.0


def as_series(name: str, values: NDArray[Any], kind: Any) -> pl.Series:
    """Convert an array to a column of a table, of type ``kind``, with null in place of nan."""
    if isinstance(kind, pl.Enum):
        return pl.Series(name, kind.categories, dtype=kind).gather(values)
    return pl.Series(name, values, nan_to_null=values.dtype == np.float64).cast(kind)


def numbers(column: pl.Series) -> Array:
    """Return a column as an array of floats, with nan in place of null."""
    return column.to_numpy().astype(np.float64)


# Sums over the robots of each run


def sum_by_run(values: Array, first: NDArray[np.intp]) -> Array:
    """Return the sum over the robots of each run, (runs,); empty if there are no runs."""
    sums: Array = np.add.reduceat(values, first) if first.size else np.zeros(0)
    return sums


def mean_by_run(values: Array, first: NDArray[np.intp]) -> Array:
    """Return the mean over those robots of each run whose value is not nan, (runs,); nan if all values are nan."""
    known = ~np.isnan(values)
    with np.errstate(invalid="ignore", divide="ignore"):  # 0 / 0 where all values are nan
        return sum_by_run(np.where(known, values, 0.0), first) / sum_by_run(known.astype(np.float64), first)
