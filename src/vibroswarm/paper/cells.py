"""Run the cells of the reproduction: a cell is one scenario that is run many times.

Cells of all items that have the same number of runs are one study. A study simulates motion only once
for cells that share it. It also saves finished work, so that a second call continues it.
"""

from __future__ import annotations

import json
import math
import shlex
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.child_python import processors
from vibroswarm.inference.outcomes import Columns, capped_time_s, numbers
from vibroswarm.scenario.scenario import Scenario, differences, preset
from vibroswarm.statistics.figures import interval
from vibroswarm.statistics.intervals import columns_of, mean_interval
from vibroswarm.study.cells import Cell as StudyCell
from vibroswarm.study.run import StudyProgress, run
from vibroswarm.study.runs import OF_RUN, Runs

T = TypeVar("T")
R = TypeVar("R")

Figures = Mapping[str, NDArray[np.float64]]
"""Figures of each run of a cell, by name, (runs,) each."""


@dataclass(frozen=True)
class Cell:
    """One scenario and how often it is run.

    Args:
        column: preset of the reproduction that the scenario belongs to.
        runs: upper limit of the number of runs; None: the number of the reproduction.
    """

    column: str
    scenario: Scenario
    runs: int | None = None

    @cached_property
    def key(self) -> str:
        """Identifier: in a reproduction, cells with equal keys have equal results. The column is not part of it."""
        return f"{self.scenario.hash}-{self.runs or 'all'}"

    def command(self, runs: int, seed: int) -> str:
        """Return the command line that runs this cell alone.

        Args:
            runs, seed: number of runs and seed of the whole reproduction.
        """
        options = [f"--runs {min(self.runs or runs, runs)}", f"--seed {seed}"]
        return " ".join(["vibroswarm evaluate", *options_of(self.column, self.scenario), *options])


def options_of(column: str, scenario: Scenario) -> list[str]:
    """Return the command-line options with which ``evaluate`` makes this scenario from the preset of a column.

    Floor, strategy and number of robots have options of their own; other fields are set by name.
    """
    values = differences(scenario, preset(column))
    words = [f"--preset {column}"]
    source = values.pop("floor.source", None)
    # ``--floor`` takes the name of a pattern or of a random floor. A floor with tiles of its own has its name in the
    # field ``floor.source`` and its tiles in ``floor.tiles``; both are set with ``--set``.
    if source is not None and values.get("floor.tiles") is None:
        words.append(f"--floor {shlex.quote(str(source))}")
    elif source is not None:
        words.append(f"--set floor.source={shlex.quote(json.dumps(source))}")
    if "strategy.name" in values:
        words.append(f"--strategy {values.pop('strategy.name')}")
    if "swarm.robots" in values:
        words.append(f"--robots {values.pop('swarm.robots')}")
    return words + [f"--set {shlex.quote(f'{name}={json.dumps(value)}')}" for name, value in values.items()]


@dataclass(frozen=True)
class CellResult:
    """Results of one cell."""

    row: dict[str, Any]
    """Summary of the cell's figures with their limits, by name, see ``row_of``."""
    figures: Figures
    """Figures of each run, (runs,) each: ``statistics.figures`` and ``WALK``."""


@dataclass(frozen=True)
class CellResults:
    """Results of all cells."""

    seed: int
    """Seed of the reproduction."""
    runs: int
    """Number of runs of each cell of the reproduction; a cell may have fewer."""
    cells: dict[str, CellResult]
    """By ``Cell.key``."""

    def __getitem__(self, cell: Cell) -> CellResult:
        return self.cells[cell.key]

    def row(self, cell: Cell) -> dict[str, Any]:
        """Return the summary of a cell, with the hash of its scenario and the command that runs it alone."""
        origin = {"command": cell.command(self.runs, self.seed), "scenario": cell.scenario.hash}
        return self[cell].row | origin


def run_cells(
    cells: Iterable[Cell],
    runs: int,
    seed: int,
    folder: Path,
    workers: int | None,
    progress: Callable[[float], None],
) -> CellResults:
    """Run the cells whose results are missing in ``folder``, and return the results of all cells.

    Cells with the same number of runs are one study.

    Args:
        cells: cells to run; cells with equal keys are run once.
        runs, seed: number of runs of each cell (fewer if ``Cell.runs`` is smaller), and seed of the reproduction.
        folder: of all runs. workers: number of threads; None: one for each processor.
        progress: called with the share of the work that is done, 0 to 1.
    """
    groups: dict[int, dict[str, Cell]] = {}  # cells by key, by number of runs
    for cell in cells:
        groups.setdefault(min(cell.runs or runs, runs), {}).setdefault(cell.key, cell)
    summaries: list[Future[dict[str, CellResult]]] = []
    weights = [_weight(group, own_runs) for own_runs, group in groups.items()]
    before = 0.0  # sum of the weights of the studies that are done
    with ThreadPoolExecutor(1) as reader:  # cells of a study are summarised while the next study runs
        for (own_runs, group), weight in zip(groups.items(), weights, strict=True):
            own = [StudyCell(k, {}, cell.scenario, key) for k, (key, cell) in enumerate(group.items())]

            # The default values keep this study's ``before`` and ``weight``.
            def report_progress(now: StudyProgress, before: float = before, weight: float = weight) -> None:
                progress((before + weight * now.share) / sum(weights))

            result = run(own, own_runs, seed, folder=folder, workers=workers, progress=report_progress)
            summaries.append(reader.submit(_summaries, result, list(group.values())))
            if workers == 1:  # only one thread may compute at a time
                wait(summaries)
            before += weight
            progress(before / sum(weights))
        results = {key: cell_result for future in summaries for key, cell_result in future.result().items()}
    return CellResults(seed, runs, results)


def on_threads(function: Callable[[T], R], items: Iterable[T], workers: int | None) -> list[R]:
    """Return what a function gives for each item, computed on threads; ``workers``: None is one for each processor."""
    with ThreadPoolExecutor(workers or processors()) as pool:
        return list(pool.map(function, items))


def _summaries(result: Runs, cells: list[Cell]) -> dict[str, CellResult]:
    """Summarise all cells of a study; return the results by the cells' keys.

    Args:
        cells: the cells; the index is the cell's number in the study.
    """
    result.check_complete()
    results = {}
    for block, rows in result.blocks(OF_RUN, "robot.decision_time_s", "robot.belief_in_truth"):
        for one, own in zip(block, rows.partition_by("cell", maintain_order=True), strict=True):
            results[cells[one.number].key] = _summary(own, one.scenario.run.t_end_s)
    return results


def _summary(rows: pl.DataFrame, t_end_s: float) -> CellResult:
    """Summarise a cell from its runs."""
    robots = {
        name: numbers(rows[f"robot.{name}"].explode()).reshape(rows.height, -1)
        for name in ("decision_time_s", "belief_in_truth")
    }
    figures = {column.name: numbers(column) for column in rows if column.dtype.is_numeric()}
    return CellResult(row_of(robots, figures, t_end_s), figures)


def row_of(robots: Columns, figures: Figures, t_end_s: float) -> dict[str, Any]:
    """Return the summary of one cell: its figures by name, in the paper's form and in the proper form.

    The paper's form has the means of time and belief, each with an error bar (NAME_bar): the standard deviation over
    robots divided by the square root of the number of runs. The proper form has intervals over runs (NAME_low,
    NAME_high), also for the shares of robots and of swarms by outcome, and for two figures of how robots walked.

    Args:
        robots: columns of the table of robots, (runs, robots) each. figures: figures of each run, (runs,) each.
        t_end_s: end of a run, which is the decision time of an undecided robot.
    """
    runs = robots["decision_time_s"].shape[0]
    row: dict[str, Any] = {"runs": runs}
    for name in ("decision_time_s", "belief_in_truth"):
        row |= columns_of(name, interval(name, figures, t_end_s=t_end_s))
    time_s = capped_time_s(robots["decision_time_s"], t_end_s)
    row["decision_time_s_bar"] = float(time_s.std()) / math.sqrt(runs)
    belief = robots["belief_in_truth"].ravel()
    belief = belief[~np.isnan(belief)]  # nan, for example, on floors where neither decision is right
    row["belief_in_truth_bar"] = float(belief.std()) / math.sqrt(runs) if belief.size else None
    for name in ("robots_right", "robots_wrong", "robots_undecided", "swarm_right", "swarm_wrong"):
        row |= columns_of(name, interval(name, figures, t_end_s=t_end_s))
    for name in ("avoid_per_sample_s", "distance_m"):  # avoidance per sample, and distance between samples
        row |= columns_of(name, mean_interval(figures[name]))
    return row


def _weight(cells: Mapping[str, Cell], runs: int) -> float:
    """Return the rough cost of a group of cells, relative to other groups, for the progress bar.

    Motion is shared by many cells, so the cost grows slowly with their number: motion counts as 3, and 30 cells count
    as 1.

    Args:
        cells: the cells of the group. runs: number of runs of these cells.
    """
    return runs * (3 + len(cells) / 30)
