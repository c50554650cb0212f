"""Score every combination of some values on shared motion, as the paper's second stage does for eta and kappa.

A grid is a study with one cell for each combination of the values. Fields of strategy and decision do not change how
robots move, so all cells replay one motion and are compared run by run. The cell with the lowest score is the best.
Every cell that does not differ significantly from the best one is marked, since the runs do not show which of them is
best. The differences hold together (``analysis.best_group``): the lowest of many equal cells is always far
below some of them. The best cell is scored again on fresh runs, that is runs that played no part in choosing it.

| name | values in the paper |
|---|---|
| strategy.soft.eta | 750, 1000, ..., 2500 |
| strategy.soft.kappa | 1, 2, 3, 4 |
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import reduce
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.analysis.best_group import LEVEL, best_group
from vibroswarm.analysis.intervals import Interval, columns_of
from vibroswarm.core.untrusted_files import parsed_toml, read_text
from vibroswarm.errors import InputError, whole_number_of
from vibroswarm.optimize.evaluate import derived_seed
from vibroswarm.optimize.objective import Objective, Rows, drawn_scores, objectives_from
from vibroswarm.optimize.outcomes import Outcomes, from_tables
from vibroswarm.optimize.spec import KEYS
from vibroswarm.optimize.validation import Scored, Truth, scored_of
from vibroswarm.study.factors import flat
from vibroswarm.study.run import run as run_study
from vibroswarm.study.runner import Progress
from vibroswarm.study.spec import Cell, Study, as_toml
from vibroswarm.study.study_result import StudyResult

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
class Grid:
    """A study of a grid and its objective."""

    study: Study
    objective: Objective

    @classmethod
    def paper(cls, objective: Objective | None = None, runs: int = RUNS, seed: int = 1) -> Grid:
        """Make the grid of the paper's second stage: soft feedback on random floors of fill ratio 0.48.

        The fields that it does not vary are those of preset `paper`, which has the paper's optimised parameters, P*.

        Args:
            objective: what is minimised, by default mean + sd of the cost of the paper's program.
            runs: of each cell. seed: of the runs, the same in all cells.
        """
        base = {"preset": "paper", "strategy": {"name": "soft"}}  # the preset has these floors and P*
        return cls(Study(base, vary={"grid": PAPER}, runs=runs, seed=seed), objective or Objective())

    @classmethod
    def read(cls, path: str | Path) -> Grid:
        """Read a grid from the file ``path`` of a search, whose block ``space`` gives the values of each field.

        Each field must have a list of values, or a range with steps. The number of runs per cell is ``RUNS`` if the
        file does not give it.

        Raises:
            InputError: the file has no space, a range without steps, several objectives, or another wrong entry.
        """
        path = Path(path)
        values = parsed_toml(read_text(path, "a search"), str(path))
        # A search file is a study file with some further keys. These are taken out, and the space becomes the study's
        # block "grid". The keys "search", "pso" and "start" are not read: a grid has no method.
        search_values = {key: values.pop(key) for key in KEYS if key in values}
        space = search_values.get("space")
        if not isinstance(space, Mapping) or not space:
            raise InputError(
                "a grid needs fields with their values: lists, or ranges with steps", field="space"
            )
        if "grid" in values:
            raise InputError(
                "the block 'grid' is made of the space here; put cases into [zip] or [[list]]", field="grid"
            )
        values["grid"] = space
        if "until" not in values:
            values.setdefault("runs", RUNS)
        objectives = objectives_from(search_values.get("objective", {}))
        if len(objectives) > 1:
            raise InputError("a grid has one objective", field="objective")
        return cls(Study.from_values(values, name=str(path), folder=path.parent), objectives[0])

    def to_toml(self) -> str:
        """Write the grid as a self-contained search file, from which ``read`` makes the same cells, runs and seed.

        Raises:
            InputError: its cost is a function, which a file cannot hold, or its study varies no fields in a grid.
        """
        if self.objective.function is not None:
            raise InputError(
                "a cost that is a function cannot be written to a file; search without a folder",
                field="objective",
            )
        values = tomllib.loads(self.study.to_toml())
        if "grid" not in values:
            raise InputError("a file of a grid needs fields with their values", field="space")
        cells = self.study.cells
        # Ranges are replaced by their values: the distinct values of the cells, in the order of the cells.
        values["grid"] = {
            name: list(dict.fromkeys(cell.point[name] for cell in cells)) for name in flat(values["grid"])
        }
        # The order of the fields determines that of the cells. ``as_toml`` preserves it only in a study's block "grid",
        # so that the space is written under this heading, which is then renamed.
        text = as_toml(values | {"objective": self.objective.as_values()})
        return re.sub(r"^\[grid\]$", "[space]", text, count=1, flags=re.MULTILINE)


@dataclass(frozen=True)
class Node:
    """A scored cell of a grid."""

    cell: Cell
    scored: Scored
    above_best: Interval
    """Score of this cell minus that of the best cell, paired by run; limits of all cells hold together."""
    time_s: float
    """Mean decision time over robots and runs, s; an undecided robot counts with T_end."""
    belief_in_truth: float | None
    """Mean belief of the robots in the true answer; None if the strategy has no beliefs."""
    wrong: float
    """Share of wrong robots among all."""
    undecided: float
    """Share of undecided robots among all."""

    @property
    def as_good(self) -> bool:
        """Whether the score of this cell is not significantly higher than that of the best cell; true of the best.

        It is also true if the cells have fewer than ``best_group.FEWEST`` runs: the interval then has no limits.
        """
        return not self.above_best.low > 0


@dataclass(frozen=True)
class Nodes:
    """A grid with the scores of its cells."""

    grid: Grid
    """The study and its objective."""
    nodes: tuple[Node, ...]
    """The scored cells, in the order of the study's cells."""

    @property
    def best(self) -> Node:
        """The cell with the lowest score, the first of equals."""
        return min(self.nodes, key=lambda node: node.above_best.estimate)

    @property
    def table(self) -> pl.DataFrame:
        """One row per cell: its values, its score and its distance above the best score (with limits), other figures.

        The limits of a score are those of a 95 % interval, those above the best hold together with 95 %; ``runs`` is
        the number of runs behind the score.
        """
        rows = []
        for node in self.nodes:
            score, above = node.scored.score, node.above_best
            rows.append({
                "cell": node.cell.number, **node.cell.point, **columns_of("score", score),
                **columns_of("above_best", above), "as_good_as_best": node.as_good, "decision_time_s": node.time_s,
                "belief_in_truth": node.belief_in_truth, "robots_wrong": node.wrong,
                "robots_undecided": node.undecided, "runs": score.n,
            })  # fmt: skip
        return pl.DataFrame(rows, infer_schema_length=None)


def scores_of(grid: Grid, result: StudyResult) -> Nodes:
    """Score the cells of a finished study.

    The costs use the robots' estimates of the fill ratio at the end of each run as it was simulated. In a search they
    use those soon after the last decision, or at T_end if a robot is undecided (``outcomes.end_s``).

    Args:
        grid: the grid, with the objective. result: the result of ``grid.study``.
    Returns:
        The scored cells. Each is also compared, run by run, with the cell of the lowest score.
    Raises:
        InputError: a cell has no runs, or no run is in all cells.
    """
    scored_cells = []
    for cell in result.study.cells:
        robots, outcomes = _outcomes(result, cell)
        scored = _scored(cell.name, cell, grid.objective, outcomes)
        belief = robots["belief_in_truth"].mean()  # None if the strategy has no beliefs
        figures = (
            float(outcomes.time_s.mean()),
            None if belief is None else float(belief),  # type: ignore[arg-type]
            float(outcomes.wrong.mean()),
            float(outcomes.undecided.mean()),
        )
        scored_cells.append((cell, scored, figures))
    above_best = _above_best(grid.objective, [scored for _, scored, _ in scored_cells])
    nodes = [
        Node(
            cell=cell,
            scored=scored,
            above_best=above,
            time_s=time_s,
            belief_in_truth=mean_belief,
            wrong=wrong,
            undecided=undecided,
        )
        for (cell, scored, (time_s, mean_belief, wrong, undecided)), above in zip(
            scored_cells, above_best, strict=True
        )
    ]
    return Nodes(grid, tuple(nodes))


def _above_best(objective: Objective, cells: Sequence[Scored]) -> list[Interval]:
    """Compare the score of each cell with the lowest, over the runs that all have; see ``analysis.best_group``."""
    common = reduce(np.intersect1d, [cell.runs for cell in cells])
    if not common.size:
        raise InputError(
            "no run is in all cells; run the study again for those that are missing", field="grid"
        )
    rows = np.concatenate([cell.rows[np.isin(cell.runs, common)] for cell in cells], axis=1)

    def scores(some: Rows) -> list[float]:
        return [objective.score(some[:, k : k + 1]) for k in range(len(cells))]

    group = best_group(np.vstack([scores(rows), drawn_scores(scores, rows)]).T, common.size)
    return [
        Interval(above, low, high, LEVEL, common.size, "max-t")
        for above, low, high in group.difference.tolist()
    ]


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
        nodes: the scored cells. runs: number of fresh runs.
        executor, workers: see ``study.executors``. progress: called as runs finish.
    Returns:
        The score on the runs by which the cell was chosen (believed), and its score on the fresh runs. No other cells
        are compared with it.
    Raises:
        InputError: fewer than 2 runs.
    """
    runs = whole_number_of(runs, "fresh", 2, 10**9)
    study, best = nodes.grid.study, nodes.best
    fresh_seed = derived_seed(study.seed, "fresh runs")  # runs that differ from those of the grid
    # The motion source is the only setting outside the scenario, apart from the seed, on which the runs depend.
    fresh_study = replace(Study.of(best.cell.scenario, runs, fresh_seed), motion=study.motion)
    result = run_study(fresh_study, executor=executor, workers=workers, progress=progress)
    _, outcomes = _outcomes(result, fresh_study.cells[0])
    scored = _scored("winner", best.cell, nodes.grid.objective, outcomes)
    return Truth(believed=best.scored.score.estimate, winner=scored, others=(), against=())


def _outcomes(result: StudyResult, cell: Cell) -> tuple[pl.DataFrame, Outcomes]:
    """Return the table of robots of a cell (one row per run and robot), and the outcomes of its runs."""
    robots, runs = result.tables(cell.number)
    # The floors of all runs have the same number of tiles.
    tiles = cell.scenario.floor_for(result.study.seed, 0).tiles.size
    return robots, from_tables(cell.scenario, robots, runs, tiles)


def _scored(name: str, cell: Cell, objective: Objective, outcomes: Outcomes) -> Scored:
    """Score the runs of a cell under the name ``name``."""
    rows = objective.figures(outcomes)[:, None, :]  # (runs, 1 case, columns)
    return scored_of(name, dict(cell.point), objective, rows, outcomes.run)
