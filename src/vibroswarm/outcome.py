"""What became of each robot and of each run, summed up from what replay says of the robots."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.floors.floor import Floor
from vibroswarm.result import CONSENSUS, ROBOTS, RUNS
from vibroswarm.scenario import Scenario

RIGHT, WRONG, SPLIT, INCOMPLETE, AGREED = range(len(CONSENSUS))


def truth_of(fill_ratio: float, boundary: float) -> int | None:
    """1 where the fill ratio lies above the boundary, 0 below, None on it."""
    if abs(fill_ratio - boundary) < 1e-12:
        return None
    return 1 if fill_ratio > boundary else 0


def outcome_tables(
    scenario: Scenario, floors: Mapping[int, Floor], finals: pl.DataFrame, ends: pl.DataFrame
) -> tuple[pl.DataFrame, pl.DataFrame]:
    """The tables of robots and of runs.

    Args:
        floors: of each run. finals: what became of each robot (``inference.minds.FINALS``), run by run. ends: of
            the same rows.
    """
    robots = scenario.swarm.robots
    runs = finals["run"].to_numpy()[::robots]
    fills, truth = fills_and_truth(scenario, floors, runs.tolist())
    end_s = ends["end_s"].to_numpy().reshape(-1, robots).max(axis=1)
    return robot_table(finals, truth), run_table(finals, fills, truth, end_s, scenario.run.t_end_s)


def fills_and_truth(
    scenario: Scenario, floors: Mapping[int, Floor], runs: list[int]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The fill ratio inside the arena of each run's floor, and what is true of it: 0, 1, or nan on the boundary."""
    fills = fill_ratios(floors, runs, scenario.arena.width_m, scenario.arena.height_m)
    boundary = scenario.decision.decision_boundary
    truth = {fill: truth_of(fill, boundary) for fill in set(fills)}
    return np.array(fills), np.array([truth[fill] for fill in fills], dtype=np.float64)  # None: nan


def fill_ratios(floors: Mapping[int, Floor], runs: list[int], width_m: float, height_m: float) -> list[float]:
    """The fill ratio inside the arena of each run's floor; floors that several runs share are taken once."""
    known: dict[int, float] = {}
    for run in runs:
        floor = floors[run]
        if id(floor) not in known:
            known[id(floor)] = floor.fill_ratio_within(width_m, height_m)
    return [known[id(floors[run])] for run in runs]


def robot_table(finals: pl.DataFrame, truth: NDArray[np.float64]) -> pl.DataFrame:
    """The table of robots, one row a run and robot, also for robots that never sampled.

    A robot's decision is its last, and its time that of the sample at which it came to stand.

    Args:
        finals: what became of each robot, run by run. truth: (runs,), 0 or 1, nan on the boundary.
    """
    robots = finals.height // max(truth.size, 1)
    in_truth = belief_in_truth(finals["belief"].to_numpy(), np.repeat(truth, robots))
    more = {
        "belief_in_truth": pl.Series("belief_in_truth", in_truth, nan_to_null=True),
        "sent": finals["samples"].alias("sent"),
    }
    return pl.DataFrame([more[name] if name in more else finals[name] for name in ROBOTS])


def belief_in_truth(belief: NDArray[np.float64], truth: NDArray[np.float64]) -> NDArray[np.float64]:
    """The share of a belief that is in what is so, shape as they broadcast; nan on the boundary."""
    return np.where(truth == 0.0, belief, np.where(truth == 1.0, 1.0 - belief, np.nan))


def run_table(
    finals: pl.DataFrame,
    fills: NDArray[np.float64],
    truth: NDArray[np.float64],
    end_s: NDArray[np.float64],
    t_end_s: float,
) -> pl.DataFrame:
    """The table of runs: consensus right, wrong, split or incomplete, and when.

    Args:
        finals: what became of each robot, run by run. fills, truth, end_s: (runs,).
    """
    robots = finals.height // max(truth.size, 1)
    decision, time_s = (
        finals[name].to_numpy().reshape(-1, robots) for name in ("decision", "decision_time_s")
    )
    columns: dict[str, NDArray[Any]] = {
        "run": finals["run"].to_numpy()[::robots].copy(),
        "fill_ratio": fills,
        "truth": truth,
        **consensus_columns(decision, time_s, truth),
        **end_columns(end_s, t_end_s),
    }
    return pl.DataFrame([as_series(name, columns[name], kind) for name, kind in RUNS.items()])


def consensus_columns(
    decision: NDArray[np.int8], time_s: NDArray[np.float64], truth: NDArray[np.float64]
) -> dict[str, NDArray[Any]]:
    """What became of the swarms: columns of the table of runs, (..., runs) each; consensus by place in ``CONSENSUS``.

    Args:
        decision, time_s: (..., runs, robots). truth: (..., runs), 0 or 1, nan on the boundary.
    """
    robots, unknown = decision.shape[-1], np.isnan(truth)
    undecided = (decision == -1).sum(axis=-1)
    right = (decision == truth[..., None]).sum(axis=-1)
    wrong = np.where(unknown, 0, robots - undecided - right)
    alike = (decision == decision[..., :1]).all(axis=-1)
    of_alike = np.where(unknown, AGREED, np.where(right > 0, RIGHT, WRONG))
    together = (undecided == 0) & alike
    return {
        "consensus": np.where(undecided > 0, INCOMPLETE, np.where(alike, of_alike, SPLIT)).astype(np.uint8),
        "consensus_time_s": np.where(together, time_s.max(axis=-1), np.nan),
        "right": right.astype(np.uint16),
        "wrong": wrong.astype(np.uint16),
        "undecided": undecided.astype(np.uint16),
    }


def end_columns(end_s: NDArray[np.float64], t_end_s: float) -> dict[str, NDArray[Any]]:
    """Until when the runs went, and whether that is before their end: columns of the table of runs, (runs,) each."""
    return {"end_s": end_s, "stopped_early": end_s < t_end_s - 1e-9}


def as_series(name: str, values: NDArray[Any], kind: Any) -> pl.Series:
    """A column of a table: what is not a number is null, places in an ``Enum`` become its words."""
    if isinstance(kind, pl.Enum):
        return pl.Series(name, kind.categories, dtype=kind).gather(values)
    return pl.Series(name, values, nan_to_null=values.dtype == np.float64).cast(kind)
