"""Score the cells of a study under a cost, mark those that tie with the best, and score the best on fresh runs.

Cells that share motion are compared run by run. Every cell that does not differ significantly from the one with the
lowest score is in the best group, since the runs do not show which of them is best; all differences hold together
(``statistics.best_group``). The best cell is scored again on fresh runs, which played no part in choosing it.

The costs use the robots' estimates at the end of each run as it was simulated. A search uses those soon after the last
decision, or at T_end if a robot is undecided (``outcomes.end_s``).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import polars as pl

from vibroswarm.inference.outcomes import Array
from vibroswarm.search.evaluate import derived_seed
from vibroswarm.search.objective import Objective, Rows, drawn_scores
from vibroswarm.search.outcomes import from_tables
from vibroswarm.statistics.best_group import LEVEL, best_group
from vibroswarm.statistics.intervals import Interval, columns_of
from vibroswarm.study.cells import Cell
from vibroswarm.study.run import run
from vibroswarm.study.runs import Runs


@dataclass(frozen=True)
class CellScores:
    """Scores of cells, see the head of this module."""

    objective: Objective
    table: pl.DataFrame
    """A row for each cell: number, varied fields, name; score and above_best with limits; best_group, runs."""
    best: Cell
    """The cell with the lowest score."""
    fresh: Interval | None = None
    """Its score on fresh runs; None: it was not determined."""


def scores_of(runs: Runs, objective: Objective) -> CellScores:
    """Score the cells of a finished study.

    Raises:
        InputError: runs are missing, or the cost is not defined on them.
    """
    runs.check_complete()
    rows = np.concatenate([_figures(runs, cell, objective) for cell in runs.cells], axis=1)
    cells, scored = (
        range(len(runs.cells)),
        [objective.interval(rows[:, k : k + 1]) for k in range(rows.shape[1])],
    )

    def scores(some: Rows) -> list[float]:
        return [objective.score(some[:, k : k + 1]) for k in cells]

    draws: Array = np.vstack([scores(rows), drawn_scores(scores, rows)]).T
    group = best_group(draws, len(rows))
    columns: list[dict[str, Any]] = []
    for score, (above, low, high), tie in zip(
        scored, group.difference.tolist(), group.member.tolist(), strict=True
    ):
        above_best = Interval(above, low, high, LEVEL, len(rows), "max-t")
        columns.append(
            {
                **columns_of("score", score),
                **columns_of("above_best", above_best),
                "best_group": tie,
                "runs": score.n,
            }
        )
    table = runs.cell_table.drop("scenario_hash", "wanted", "there")
    return CellScores(objective, table.hstack(pl.DataFrame(columns)), runs.cells[group.best])


def with_fresh_runs(scores: CellScores, runs: Runs, **how: Any) -> CellScores:
    """Score the best cell on as many fresh runs, since the lowest of many scores is partly luck.

    Args:
        how: further arguments of ``study.run.run``, such as workers.
    """
    fresh = run(
        [scores.best], runs.runs, derived_seed(runs.seed, "fresh runs"), motion=runs.motion, folder=runs.folder, **how
    )  # fmt: skip
    return replace(scores, fresh=scores.objective.interval(_figures(fresh, scores.best, scores.objective)))


def _figures(runs: Runs, cell: Cell, objective: Objective) -> Rows:
    """Return the figures of the runs of a cell, (runs, 1 case, columns)."""
    tiles = cell.scenario.floor_for(runs.seed, 0).tiles.size  # the same in all runs
    return objective.figures(from_tables(cell.scenario, *runs.tables(cell), tiles))[:, None, :]
