"""Score every combination of some values on shared motion, as the paper's second stage does for eta and kappa.

A grid is a study: fields of strategy and decision move no robot, so all cells replay one motion and are compared run by
run. The cell with the lowest score is marked, and so is every cell that does not differ significantly from it, since
which of these is lowest is luck. The best cell is scored again on fresh runs.

| name | values in the paper |
|---|---|
| strategy.soft.eta | 750, 1000, ..., 2500 |
| strategy.soft.kappa | 1, 2, 3, 4 |
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.analysis.intervals import Interval
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.core.untrusted_files import parsed_toml, read_text
from vibroswarm.errors import InputError
from vibroswarm.optimize.evaluate import derived_seed
from vibroswarm.optimize.objective import Objective, objectives_from
from vibroswarm.optimize.outcomes import Outcomes, from_tables
from vibroswarm.optimize.spec import KEYS
from vibroswarm.optimize.validation import Scored, Truth, paired_score, scored_of
from vibroswarm.study.factors import flat
from vibroswarm.study.runner import Progress
from vibroswarm.study.spec import Cell, Study, as_toml
from vibroswarm.study.study_result import StudyResult
from vibroswarm.study.study_result import run as run_study

PAPER: Final[dict[str, list[Any]]] = {
    "strategy.soft.eta": [750.0, 1000.0, 1250.0, 1500.0, 1750.0, 2000.0, 2250.0, 2500.0],
    "strategy.soft.kappa": [1.0, 2.0, 3.0, 4.0],
}
"""The paper's grid."""
RUNS: Final = 1000
"""Default runs of each cell; the paper's 100 are too few to distinguish neighbouring cells."""
FRESH: Final = 2000
"""Fresh runs on which the best cell is scored again."""


@dataclass(frozen=True)
class Grid(NotebookView):
    """A study of a grid and its objective."""

    study: Study
    objective: Objective

    @classmethod
    def paper(cls, objective: Objective | None = None, runs: int = RUNS, seed: int = 1) -> Grid:
        """Make the paper's second stage: soft feedback on random floors of fill ratio 0.48, with P*.

        Args:
            objective: by default the paper's cost. runs: of each cell. seed: of all cells.
        """
        base = {"preset": "paper", "strategy": {"name": "soft"}}
        return cls(Study(base, {"grid": PAPER}, runs, seed=seed), objective or Objective())

    @classmethod
    def read(cls, path: str | Path) -> Grid:
        """Read a grid from a search's file ``path``, whose space has lists, or ranges with steps.

        Raises:
            InputError: no space, or one of ranges without steps.
        """
        path = Path(path)
        values = parsed_toml(read_text(path, "a search"), str(path))
        own = {key: values.pop(key) for key in KEYS if key in values}
        space = own.get("space")
        if not isinstance(space, Mapping) or not space:
            raise InputError(
                "a grid needs fields with their values: lists, or ranges with steps", field="space"
            )
        if "grid" in values:
            raise InputError("is the space of this method; put cases into [zip] or [[list]]", field="grid")
        values["grid"] = space
        values.setdefault("runs", RUNS)
        objectives = objectives_from(own.get("objective", {}))
        if len(objectives) > 1:
            raise InputError("a grid has one objective", field="objective")
        return cls(Study.from_values(values, name=str(path), folder=path.parent), objectives[0])

    def to_toml(self) -> str:
        """Write the grid as a self-contained search file; ``read`` returns one with the same cells, runs and seed.

        Raises:
            InputError: its cost is a function, which a file cannot hold, or the study has no grid.
        """
        if self.objective.function is not None:
            raise InputError("a cost that is a function cannot be written to a file", field="objective")
        values = tomllib.loads(self.study.to_toml())
        if "grid" not in values:
            raise InputError("a file of a grid needs fields with their values", field="space")
        cells = self.study.cells
        values["grid"] = {
            name: list(dict.fromkeys(cell.point[name] for cell in cells)) for name in flat(values["grid"])
        }
        # Written as a study's block: there fields keep their order, which is that of the cells.
        text = as_toml(values | {"objective": self.objective.as_values()})
        return re.sub(r"^\[grid\]$", "[space]", text, count=1, flags=re.MULTILINE)


@dataclass(frozen=True)
class Node(NotebookView):
    """A scored cell of a grid."""

    cell: Cell
    scored: Scored
    above_best: Interval
    """Its score minus that of the best cell, paired by run."""
    time_s: float
    belief_in_truth: float | None
    wrong: float
    undecided: float

    @property
    def as_good(self) -> bool:
        """Whether it does not differ significantly from the best cell."""
        return not self.above_best.low > 0


@dataclass(frozen=True)
class Nodes(NotebookView):
    """A grid with the scores of its cells."""

    grid: Grid
    nodes: tuple[Node, ...]

    @property
    def best(self) -> Node:
        """The cell with the lowest score."""
        return min(self.nodes, key=lambda node: (node.scored.score.estimate, node.cell.number))

    @property
    def table(self) -> pl.DataFrame:
        """One row per cell: varied values, the score with its limits, times and shares."""
        rows = []
        for node in self.nodes:
            score, above = node.scored.score, node.above_best
            rows.append({
                "cell": node.cell.number, **node.cell.point, "score": score.estimate, "score_low": score.low,
                "score_high": score.high, "above_best": above.estimate, "above_best_low": above.low,
                "above_best_high": above.high, "as_good_as_best": node.as_good, "decision_time_s": node.time_s,
                "belief_in_truth": node.belief_in_truth, "robots_wrong": node.wrong,
                "robots_undecided": node.undecided, "runs": score.n,
            })  # fmt: skip
        return pl.DataFrame(rows, infer_schema_length=None)

    def as_dict(self, truth: Truth | None = None) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {
            "method": "grid",
            "objective": self.grid.objective.as_values(),
            "best": self.best.cell.point,
            "truth": None if truth is None else truth.as_dict(),
            "as_good_as_best": [node.cell.point for node in self.nodes if node.as_good],
            "cells": self.table.to_dicts(),
        }


def scores_of(grid: Grid, result: StudyResult) -> Nodes:
    """Score the cells of a finished study; estimates of the fill ratio are those at the end of the runs.

    Args:
        grid: the grid. result: of ``grid.study``.
    """
    scored_cells = []
    for cell in result.study.cells:
        robots, outcomes = _outcomes(result, cell)
        scored = _scored(cell.name, cell, grid.objective, outcomes)
        belief = robots["belief_in_truth"].mean()
        figures = (
            float(outcomes.time_s.mean()),
            None if belief is None else float(belief),  # type: ignore[arg-type]
            float(outcomes.wrong.mean()),
            float(outcomes.undecided.mean()),
        )
        scored_cells.append((cell, scored, figures))
    best = scored_cells[int(np.argmin([scored.score.estimate for _, scored, _ in scored_cells]))][1]
    nodes = [
        Node(cell, scored, paired_score(grid.objective, scored, best), *figures)
        for cell, scored, figures in scored_cells
    ]
    return Nodes(grid, tuple(nodes))


def truth_of_grid(
    nodes: Nodes,
    runs: int = FRESH,
    *,
    executor: str | Executor = "threads",
    workers: int | None = None,
    progress: Progress | None = None,
) -> Truth:
    """Score the best cell on fresh runs, since the lowest of many scores is partly luck.

    Args:
        nodes: from ``scores_of``. runs: number of fresh runs.
        executor, workers: see ``study.executors``. progress: called as runs come back.
    Raises:
        InputError: too few runs.
    """
    if runs < 2:
        raise InputError(f"{runs} is too few; at least 2", field="fresh")
    study, best = nodes.grid.study, nodes.best
    again = replace(
        Study.of(best.cell.scenario, runs, derived_seed(study.seed, "fresh runs")), motion=study.motion
    )
    result = run_study(again, executor=executor, workers=workers, progress=progress)
    _, outcomes = _outcomes(result, again.cells[0])
    scored = _scored("winner", best.cell, nodes.grid.objective, outcomes)
    return Truth(best.scored.score.estimate, scored, (), ())


def _outcomes(result: StudyResult, cell: Cell) -> tuple[pl.DataFrame, Outcomes]:
    """Return the table of robots of a cell, and its outcomes."""
    robots, runs = result.tables(cell.number)
    tiles = cell.scenario.floor_for(result.study.seed, 0).tiles.size
    return robots, from_tables(cell.scenario, robots, runs, tiles)


def _scored(name: str, cell: Cell, objective: Objective, outcomes: Outcomes) -> Scored:
    rows = objective.figures(outcomes)[:, None, :]
    return scored_of(name, dict(cell.point), objective, rows, outcomes.run)
