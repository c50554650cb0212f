"""What became of each robot and of each run, summed up from what replay says of the robots."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.floors.floor import Floor
from vibroswarm.result import CONSENSUS, ROBOTS, RUNS
from vibroswarm.scenario import Scenario

RIGHT, WRONG, SPLIT, INCOMPLETE, AGREED = CONSENSUS


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
    fills = np.array(fill_ratios(floors, runs.tolist(), scenario.arena.width_m, scenario.arena.height_m))
    boundary = scenario.decision.decision_boundary
    truth = np.array([truth_of(fill, boundary) for fill in fills.tolist()], dtype=np.float64)  # None: nan
    end_s = ends["end_s"].to_numpy().reshape(-1, robots).max(axis=1)
    return robot_table(finals, truth), run_table(finals, fills, truth, end_s, scenario.run.t_end_s)


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
    belief, true = finals["belief"].to_numpy(), np.repeat(truth, robots)
    in_truth = np.where(true == 0.0, belief, np.where(true == 1.0, 1.0 - belief, np.nan))
    more = {
        "belief_in_truth": pl.Series("belief_in_truth", in_truth, nan_to_null=True),
        "sent": finals["samples"].alias("sent"),
    }
    return pl.DataFrame([more[name] if name in more else finals[name] for name in ROBOTS])


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
    decision = finals["decision"].to_numpy().reshape(-1, robots)
    undecided = (decision == -1).sum(axis=1)
    right = (decision == truth[:, None]).sum(axis=1)
    wrong = np.where(np.isnan(truth), 0, robots - undecided - right)
    alike = (decision == decision[:, :1]).all(axis=1)
    of_alike = np.where(np.isnan(truth), AGREED, np.where(right > 0, RIGHT, WRONG))
    consensus = np.where(undecided > 0, INCOMPLETE, np.where(alike, of_alike, SPLIT))
    last_s = finals["decision_time_s"].to_numpy().reshape(-1, robots).max(axis=1)
    together = (undecided == 0) & alike
    return pl.DataFrame(
        [
            pl.Series("run", finals["run"].to_numpy()[::robots].copy()),
            pl.Series("consensus", consensus.tolist(), dtype=RUNS["consensus"]),
            pl.Series("consensus_time_s", np.where(together, last_s, np.nan), nan_to_null=True),
            pl.Series("fill_ratio", fills),
            pl.Series("truth", truth, nan_to_null=True).cast(pl.Int8),
            pl.Series("right", right.astype(np.uint16)),
            pl.Series("wrong", wrong.astype(np.uint16)),
            pl.Series("undecided", undecided.astype(np.uint16)),
            pl.Series("end_s", end_s),
            pl.Series("stopped_early", end_s < t_end_s - 1e-9),
        ]
    )
