"""Outcomes of robots and runs: the columns, how each is computed, and the tables and figures made of them.

All functions take arrays of shape (..., runs, robots) for robots and (..., runs) for runs; leading axes are
cells.

| name | definition |
|---|---|
| truth | the right decision by the scenario's task; nan where neither is |
| right, wrong | robots whose decision is, is not, the truth; none where the truth is nan |
| consensus | incomplete: one is undecided; split: they differ; right, wrong; truth_undefined: the truth is nan |
| consensus_time_s | time of the last decision of a swarm that decided alike, else nan |
| belief_in_truth | belief that f is below the boundary where it is, one minus that where it is above |
| estimate | alpha / (alpha + beta), the posterior mean of f; nan for a robot that keeps no posterior |
| capped time | min(decision time, T_end): an undecided robot, or a swarm without consensus, counts with T_end |
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import ArrayLike, NDArray

from vibroswarm.floors.floor import Floor
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.tasks import Asked, task

Array = NDArray[np.float64]
Columns = Mapping[str, NDArray[Any]]

CONSENSUS: Final = ("right", "wrong", "split", "incomplete", "truth_undefined")
"""Outcome of a run. ``truth_undefined``: all decided alike, on a floor whose fill ratio lies on the boundary itself,
so that neither decision is right."""
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
    "samples": pl.UInt32,
    "sent": pl.UInt32,
    "messages_received": pl.UInt32,
}
"""Columns of the table of robots. ``belief_below`` (the boundary) is at the moment of decision, or at the last sample
of a robot that never decided. alpha, beta and messages_received are at the end."""

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
"""Columns of the table of runs; ``truth`` is null on the boundary. A run that stopped early has biased motion
statistics: it is marked by ``stopped_early``."""


# Floors and truth


def fill_ratios(floors: Mapping[int, Floor], runs: list[int], width_m: float, height_m: float) -> list[float]:
    """Return the fill ratio of each run's floor inside the arena; a floor shared by runs is measured once."""
    known: dict[int, float] = {}
    for run in runs:
        floor = floors[run]
        if id(floor) not in known:
            known[id(floor)] = floor.fill_ratio_within(width_m, height_m)
    return [known[id(floors[run])] for run in runs]


def truth_on(scenario: Scenario, floor: Floor, fill_ratio: float | None = None) -> int | None:
    """Return the right decision on a floor by the scenario's task: 1, 0, or None where neither is.

    Args:
        fill_ratio: fill ratio of the floor inside the arena; None: it is computed.
    Raises:
        CodeError: a user-defined task raised.
    """
    size = scenario.arena.width_m, scenario.arena.height_m
    fill_ratio = floor.fill_ratio_within(*size) if fill_ratio is None else fill_ratio
    question = Asked(*size, fill_ratio, scenario.decision.decision_boundary)
    return task(scenario.task.name).answer(floor, question, scenario.task.params)


def truths(scenario: Scenario, floors: Mapping[int, Floor], runs: list[int], fills: Array) -> Array:
    """Return the truth about the floor of each run, (runs,): 1, 0, or nan where neither decision is right."""
    known: dict[int, float] = {}
    for run, fill in zip(runs, fills, strict=True):
        if id(floors[run]) not in known:
            answer = truth_on(scenario, floors[run], float(fill))
            known[id(floors[run])] = math.nan if answer is None else float(answer)
    return np.array([known[id(floors[run])] for run in runs])


def fills_and_truth(scenario: Scenario, floors: Mapping[int, Floor], runs: list[int]) -> tuple[Array, Array]:
    """Return the fill ratio inside the arena of each run's floor, and the truth about it, (runs,) each."""
    fills = np.array(fill_ratios(floors, runs, scenario.arena.width_m, scenario.arena.height_m))
    return fills, truths(scenario, floors, runs, fills)


# Columns of robots and of runs


def right_of(decision: NDArray[Any], truth: Array) -> NDArray[np.bool_]:
    """Return which robots decided right, (..., runs, robots); none where the truth is nan."""
    return np.asarray(decision == truth[..., None])


def wrong_of(decision: NDArray[Any], truth: Array) -> NDArray[np.bool_]:
    """Return which robots decided wrong, (..., runs, robots); none where the truth is nan."""
    return np.asarray(decision == 1.0 - truth[..., None])


def belief_in_truth(belief: Array, truth: Array) -> Array:
    """Return the belief in the truth, shape as they broadcast; nan where the truth or the belief is nan."""
    return np.where(truth == 0.0, belief, np.where(truth == 1.0, 1.0 - belief, np.nan))


def estimate_of(alpha: NDArray[Any], beta: NDArray[Any]) -> Array:
    """Return the posterior mean of the fill ratio, shape of both; nan where they are nan or both 0."""
    total = alpha + beta.astype(np.float64)
    estimate: Array = np.divide(alpha, total, out=np.full(total.shape, np.nan), where=total > 0)
    return estimate


def capped_time_s(time_s: Array, t_end_s: ArrayLike) -> Array:
    """Return min(time, T_end), s; T_end where the time is nan; shape as they broadcast."""
    return np.minimum(np.where(np.isnan(time_s), t_end_s, time_s), t_end_s)


def robot_columns(finals: Columns, truth: Array) -> dict[str, NDArray[Any]]:
    """Return the columns of the table of robots but run and robot, (..., runs, robots) each.

    Args:
        finals: ``inference.agents.final_columns``, (..., runs, robots) each. Without ``sent``, each robot is taken to
            have sent one message per sample.
        truth: (..., runs).
    """
    in_truth = belief_in_truth(finals["belief_below"], truth[..., None])
    return {**finals, "belief_in_truth": in_truth, "sent": finals.get("sent", finals["samples"])}


def run_columns(
    decision: NDArray[Any], time_s: Array, fills: Array, truth: Array, end_s: Array, t_end_s: float
) -> dict[str, NDArray[Any]]:
    """Return the columns of the table of runs except ``run``; consensus is an index into ``CONSENSUS``.

    Args:
        decision, time_s: (..., runs, robots); -1 and nan where undecided. truth: (..., runs).
        fills, end_s: (runs,). t_end_s: end of a run that does not stop early, s.
    Returns: columns of shape (..., runs); those that depend only on ``fills`` and ``end_s`` have shape (runs,). The
        consensus time is nan unless all robots decided alike.
    """
    undecided = (decision == -1).sum(axis=-1)
    right, wrong = right_of(decision, truth).sum(axis=-1), wrong_of(decision, truth).sum(axis=-1)
    alike = (decision == decision[..., :1]).all(axis=-1)
    of_alike = np.where(np.isnan(truth), TRUTH_UNDEFINED, np.where(right > 0, RIGHT, WRONG))
    together = (undecided == 0) & alike
    return {
        "consensus": np.where(undecided > 0, INCOMPLETE, np.where(alike, of_alike, SPLIT)).astype(np.uint8),
        "consensus_time_s": np.where(together, time_s.max(axis=-1), np.nan),
        "fill_ratio": fills,
        "truth": truth,
        "right": right.astype(np.uint16),
        "wrong": wrong.astype(np.uint16),
        "undecided": undecided.astype(np.uint16),
        "end_s": end_s,
        "stopped_early": end_s < t_end_s - 1e-9,
    }


# Tables


def outcome_tables(
    scenario: Scenario, floors: Mapping[int, Floor], finals: pl.DataFrame, ends: pl.DataFrame
) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Return the tables of robots and of runs.

    Args:
        floors: the floor of each run, by run number.
        finals: final state of each robot (``inference.agents.FINALS``), run by run. ends: ends of the same rows.
    """
    robots = scenario.swarm.robots
    fills, truth = fills_and_truth(scenario, floors, finals["run"].to_list()[::robots])
    end_s = ends["end_s"].to_numpy().reshape(-1, robots).max(axis=1)
    return robot_table(finals, truth), run_table(finals, fills, truth, end_s, scenario.run.t_end_s)


def robot_table(finals: pl.DataFrame, truth: Array) -> pl.DataFrame:
    """Return the table of robots, one row per run and robot, also for robots that never sampled.

    A robot's decision is its last one, and the decision time that of the sample at which it was made.

    Args:
        finals: final state of each robot, run by run. truth: (runs,).
    """
    robots = finals.height // max(truth.size, 1)
    present: list[str] = [name for name in ("belief_below", "samples", "sent") if name in finals.columns]
    by_run = {name: finals[name].to_numpy().reshape(-1, robots) for name in present}
    computed = robot_columns(by_run, truth)
    more = {
        name: as_series(name, computed[name].ravel(), ROBOTS[name]) for name in ("belief_in_truth", "sent")
    }
    return pl.DataFrame([more[name] if name in more else finals[name] for name in ROBOTS])


def run_table(finals: pl.DataFrame, fills: Array, truth: Array, end_s: Array, t_end_s: float) -> pl.DataFrame:
    """Return the table of runs.

    Args:
        finals: final state of each robot, run by run. fills, truth, end_s: (runs,). t_end_s: end of a run, s.
    """
    robots = finals.height // max(truth.size, 1)
    decision, time_s = (
        finals[name].to_numpy().reshape(-1, robots) for name in ("decision", "decision_time_s")
    )
    run = {"run": finals["run"].to_numpy()[::robots].copy()}
    columns = run | run_columns(decision, time_s, fills, truth, end_s, t_end_s)
    return pl.DataFrame([as_series(name, columns[name], kind) for name, kind in RUNS.items()])


def as_series(name: str, values: NDArray[Any], kind: Any) -> pl.Series:
    """Return a column of a table: nan becomes null, an index into the words of an ``Enum`` becomes its word."""
    if isinstance(kind, pl.Enum):
        return pl.Series(name, kind.categories, dtype=kind).gather(values)
    return pl.Series(name, values, nan_to_null=values.dtype == np.float64).cast(kind)


def numbers(column: pl.Series) -> Array:
    """Return a column as floats, nan in place of null."""
    return column.cast(pl.Float64).fill_null(math.nan).to_numpy()


# Figures of each run


def run_figures(robots: Columns, runs: Columns, t_end_s: ArrayLike) -> dict[str, Array]:
    """Return figures of each run, (..., runs) each: those of ``of_swarms``, and means over its robots of decision time
    (T_end if undecided), belief in the truth and estimate; nan where no robot has the value.

    Args:
        robots: columns of the table of robots, (..., runs, robots) each. runs: of runs, (..., runs) each.
        t_end_s: end of a run, s; shape of the leading axes, or one number.
    """
    shape, end_s = robots["decision"].shape, np.asarray(t_end_s, dtype=np.float64)[..., None]
    of_robots = {
        "decision_time_s": capped_time_s(robots["decision_time_s"], end_s[..., None]),
        "belief_in_truth": robots["belief_in_truth"],
        "estimate": estimate_of(robots["alpha"], robots["beta"]),
    }
    first = np.arange(0, math.prod(shape), shape[-1])
    means = {
        name: mean_by_run(values.ravel(), first).reshape(shape[:-1]) for name, values in of_robots.items()
    }
    return of_swarms(runs, shape[-1], end_s) | means


def of_swarms(runs: Columns, robots: ArrayLike, t_end_s: ArrayLike) -> dict[str, Array]:
    """Return the figures of each swarm in ``runs``, (..., runs) each.

    Where the truth is nan, so are the figures that count right or wrong decisions.

    Args:
        runs: columns of the table of runs. robots: number of robots of a run. t_end_s: end of a run, s.
    Returns: truth; consensus_time_s (nan without consensus); right, wrong, undecided (numbers of robots);
        right_share, wrong_share, undecided_share; swarm_right, swarm_wrong (1: all decided so, else 0); swarm_time_s
        (capped consensus time).
    """
    robots = np.asarray(robots, dtype=np.float64)
    truth = runs["truth"].astype(np.float64)
    known = ~np.isnan(truth)
    counts = {name: np.where(known, runs[name], np.nan) for name in ("right", "wrong")}
    counts["undecided"] = runs["undecided"].astype(np.float64)
    swarm = {f"swarm_{CONSENSUS[k]}": np.where(known, runs["consensus"] == k, np.nan) for k in (RIGHT, WRONG)}
    return {
        "truth": truth,
        "consensus_time_s": runs["consensus_time_s"],
        **counts,
        **{f"{name}_share": values / robots for name, values in counts.items()},
        **swarm,
        "swarm_time_s": capped_time_s(runs["consensus_time_s"], t_end_s),
    }


def sum_by_run(values: Array, first: NDArray[np.intp]) -> Array:
    """Return sums over the robots of each run, (runs,), in one fixed order.

    Args:
        values: (robots of all runs,), run by run. first: index of each run's first robot.
    """
    sums: Array = np.add.reduceat(values, first) if first.size else np.zeros(0)
    return sums


def mean_by_run(values: Array, first: NDArray[np.intp]) -> Array:
    """Return the mean over the robots of each run whose value is not nan, (runs,); nan where all are nan.

    Args:
        values, first: as for ``sum_by_run``.
    """
    known = ~np.isnan(values)
    with np.errstate(invalid="ignore", divide="ignore"):
        return sum_by_run(np.where(known, values, 0.0), first) / sum_by_run(known.astype(np.float64), first)
