"""Run the cells of the reproduction: each is one scenario run many times; cells with the same motion share it.

The cells of all items run as one study, which saves what is done: a second call continues it.
"""

from __future__ import annotations

import hashlib
import json
import math
import shlex
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.analysis.cell_summary import interval
from vibroswarm.analysis.intervals import Interval, mean_interval, plain
from vibroswarm.floors.source import is_random
from vibroswarm.inference.outcomes import ROBOTS, Columns, as_series, capped_time_s, run_figures
from vibroswarm.paper.columns import COLUMNS
from vibroswarm.scenario.scenario import Scenario, field_names, preset, value_of
from vibroswarm.study.batch_table import arrays_of
from vibroswarm.study.cell_comparison import second_seed
from vibroswarm.study.executors import processors
from vibroswarm.study.factors import LABEL
from vibroswarm.study.runner import StudyProgress
from vibroswarm.study.spec import Study
from vibroswarm.study.study_result import StudyResult, run

FIRST_RUNS: Final = 10
"""Runs of each cell whose robots an archive lists one by one."""
ROWS_AT_A_TIME: Final = 400_000
Progress = Callable[[float], None]
Figures = Mapping[str, NDArray[np.float64]]

WALKED: Final = ("avoid_per_sample_s", "distance_m", "spacing_s", "ones", "effective_samples")
OF_RUN: Final = ("truth", "consensus", "consensus_time_s", "right", "wrong", "undecided", *WALKED)
READ: Final = ("cell", *ROBOTS, *OF_RUN)
"""Columns of a study's rows that are summarised."""


@dataclass(frozen=True)
class Cell:
    """One scenario and how it is run.

    Args:
        column: preset of the reproduction. block: 0, the seed of the reproduction; 1, its second block of seeds.
        motion: engine. runs: at most so many runs; None, as many as the other cells.
    """

    column: str
    scenario: Scenario
    block: int = 0
    motion: str = "event"
    runs: int | None = None

    @cached_property
    def key(self) -> str:
        """Identifier that is equal for cells with equal results."""
        return f"{self.scenario.hash}-{self.block}-{self.motion}-{self.runs or 'all'}"

    def seed(self, seed: int) -> int:
        """Return the seed of its runs."""
        return second_seed(seed) if self.block else seed

    def command(self, runs: int, seed: int) -> str:
        """Return the command that runs this cell alone."""
        options = [f"--runs {min(self.runs or runs, runs)}", f"--seed {self.seed(seed)}"]
        options += [f"--motion {self.motion}"] if self.motion != "event" else []
        return " ".join(["vibroswarm evaluate", *options_of(self.column, self.scenario), *options])


def options_of(column: str, scenario: Scenario) -> list[str]:
    """Return options with which ``evaluate`` makes this scenario from the preset of a column."""
    values = differences(scenario, preset(column))
    words = [f"--preset {column}"]
    source = values.pop("floor.source", None)
    if source is not None and values.get("floor.tiles") is None:
        words.append(f"--floor {shlex.quote(str(source))}")
    elif source is not None:
        words.append(f"--set floor.source={shlex.quote(json.dumps(source))}")
    if "strategy.name" in values:
        words.append(f"--strategy {values.pop('strategy.name')}")
    if "swarm.robots" in values:
        words.append(f"--robots {values.pop('swarm.robots')}")
    return words + [f"--set {shlex.quote(f'{name}={json.dumps(value)}')}" for name, value in values.items()]


def differences(scenario: Scenario, base: Scenario) -> dict[str, Any]:
    """Return the fields in which a scenario differs from a base, by dotted name."""
    changed: dict[str, Any] = {}
    for name in field_names():
        value = value_of(scenario, name)
        if value is not None and value != value_of(base, name):
            changed[name] = list(value) if isinstance(value, tuple) else value
    return changed


@dataclass(frozen=True)
class CellResult:
    """Results of one cell."""

    row: dict[str, Any]
    """Summary, see ``row_of``."""
    figures: Figures
    """Figures of each run, (runs,) each: ``outcomes.run_figures`` and ``WALKED``."""
    digest: str
    """SHA-256 of the table of robots of all runs."""
    first: pl.DataFrame
    """Table of robots of the first runs."""


@dataclass(frozen=True)
class CellResults:
    """Results of all cells."""

    seed: int
    runs: int
    cells: dict[str, CellResult]

    def __getitem__(self, cell: Cell) -> CellResult:
        return self.cells[cell.key]

    def values(self, cell: Cell, name: str) -> NDArray[np.float64]:
        """Return a figure of each run of a cell, (runs,); nan where a run has none."""
        return self[cell].figures[name]

    def row(self, cell: Cell) -> dict[str, Any]:
        """Return the summary of a cell, with the command that runs it alone."""
        origin = {"command": cell.command(self.runs, self.seed), "scenario": cell.scenario.hash}
        return self[cell].row | origin


def run_cells(
    cells: Iterable[Cell], runs: int, seed: int, folder: Path, workers: int | None, progress: Progress
) -> CellResults:
    """Run the cells that are missing in ``folder`` and return the results of all."""
    groups: dict[tuple[int, str, int], dict[str, Cell]] = {}
    for cell in cells:
        group_key = (cell.seed(seed), cell.motion, min(cell.runs or runs, runs))
        groups.setdefault(group_key, {}).setdefault(cell.key, cell)
    read: list[Future[dict[str, CellResult]]] = []
    weights = [_weight(list(group.values()), group_key) for group_key, group in groups.items()]
    before = 0.0
    with ThreadPoolExecutor(1) as reader:  # cells of a study are summarised while the next study runs
        for (group_key, group), weight in zip(groups.items(), weights, strict=True):
            study = study_of(group, group_key)

            def report_progress(now: StudyProgress, before: float = before, weight: float = weight) -> None:
                progress((before + weight * now.done / max(now.wanted, 1)) / sum(weights))

            result = run(study, folder / study.hash, workers=workers, progress=report_progress)
            read.append(reader.submit(_read, result, list(group.values()), group_key[2], workers))
            if workers == 1:
                wait(read)
            before += weight
            progress(before / sum(weights))
        results = {key: cell_result for future in read for key, cell_result in future.result().items()}
    return CellResults(seed, runs, results)


def _read(result: StudyResult, cells: list[Cell], runs: int, workers: int | None) -> dict[str, CellResult]:
    """Summarise all cells of a study in blocks: each read scans the whole study, so cells are not read one by one."""
    by_key: dict[str, CellResult] = {}
    with ThreadPoolExecutor(workers or processors()) as pool:
        for group in result.plan.groups:
            numbers, robots = [cell.number for cell in group.cells], group.first.swarm.robots
            step = max(ROWS_AT_A_TIME // (runs * robots), 1)
            for first in range(0, len(numbers), step):
                some = numbers[first : first + step]
                rows = result.unsorted_rows(*some).select(READ).collect()
                block = [cells[number] for number in some]
                results = summarise(block, rows, some, runs, robots, pool.map)
                by_key |= {cell.key: cell_result for cell, cell_result in zip(block, results, strict=True)}
    return by_key


def summarise(
    cells: Sequence[Cell],
    rows: pl.DataFrame,
    numbers: Sequence[int],
    runs: int,
    robots: int,
    map_: Callable[..., Iterable[CellResult]] = map,
) -> list[CellResult]:
    """Summarise cells whose swarms have the same size.

    Args:
        rows: of a study, the columns ``READ``. numbers: of the cells there, ascending. runs: of each cell.
        map_: function that maps over the cells, such as that of a pool.
    """
    of_robots, of_runs = arrays_of(rows.select(READ), numbers, runs, robots)
    t_end_s = np.array([cell.scenario.run.t_end_s for cell in cells])
    figures = run_figures(of_robots, of_runs, t_end_s) | {name: of_runs[name] for name in WALKED}

    def cell_result(k: int) -> CellResult:
        own_columns = {name: column[k] for name, column in of_robots.items()}
        own_figures = {name: column[k].copy() for name, column in figures.items()}
        first_runs = {name: column[:FIRST_RUNS].ravel() for name, column in own_columns.items()}
        table = pl.DataFrame([as_series(name, first_runs[name], kind) for name, kind in ROBOTS.items()])
        row = row_of(own_columns, own_figures, float(t_end_s[k]))
        return CellResult(row, own_figures, digest_of(own_columns), table)

    return list(map_(cell_result, range(len(cells))))


def row_of(robots: Columns, figures: Figures, t_end_s: float) -> dict[str, Any]:
    """Return the summary of one cell in two forms.

    As in the paper: means of time and belief, with the standard deviation over robots divided by the square root
    of the
    number of runs as error bar. Correctly: intervals over runs, and the shares of robots and swarms by outcome.

    Args:
        robots: table of robots, (runs, robots) each. figures: (runs,) each.
    """
    runs, count = robots["decision"].shape
    figures = {**figures, "robots": np.full(runs, count)}
    row: dict[str, Any] = {"runs": runs}
    for name in ("decision_time_s", "belief_in_truth"):
        row |= _with_limits(name, interval(name, figures))
    row["decision_time_s_bar"] = float(capped_time_s(robots["decision_time_s"], t_end_s).std()) / math.sqrt(
        runs
    )
    belief = robots["belief_in_truth"].ravel()
    belief = belief[~np.isnan(belief)]
    row["belief_in_truth_bar"] = float(belief.std()) / math.sqrt(runs) if belief.size else None
    for name in ("robots_right", "robots_wrong", "robots_undecided", "swarm_right", "swarm_wrong"):
        row |= _with_limits(name, interval(name, figures))
    for name in WALKED[:2]:
        row |= _with_limits(name, mean_interval(figures[name]))
    return row


def _with_limits(name: str, found: Interval) -> dict[str, Any]:
    return {f"{name}{end}": plain(value) for end, value in zip(("", "_low", "_high"), found[:3], strict=True)}


def digest_of(robots: Columns) -> str:
    """Return the SHA-256 of a table of robots, (runs, robots) each; a missing value counts as a value."""
    digest = hashlib.sha256()
    for name, kind in ROBOTS.items():
        values = robots[name]
        missing = np.isnan(values) if values.dtype.kind == "f" else np.zeros(values.shape, dtype=np.bool_)
        digest.update(name.encode() + b"\0" + missing.tobytes())
        filled = np.where(missing, 0, values).astype("<f8" if kind.is_float() else "<i8")
        digest.update(filled.tobytes())
    return digest.hexdigest()


def _weight(cells: list[Cell], how: tuple[int, str, int]) -> float:
    """Return the rough cost of a group of cells, relative to other groups.

    Args:
        how: seed, motion engine and number of runs of its cells.
    """
    return (5.0 if how[1] == "fixed-step" else 1.0) * how[2] * (3 + len(cells) / 30)


def study_of(group: Mapping[str, Cell], how: tuple[int, str, int]) -> Study:
    """Return the study with these cells, in order."""
    seed, motion, runs = how
    base = preset(COLUMNS[0])
    points = [{LABEL: key, **differences(cell.scenario, base)} for key, cell in group.items()]
    floors = {
        cell.scenario.floor.source: cell.scenario.floor.tiles
        for cell in group.values()
        if cell.scenario.floor.tiles is not None and not is_random(cell.scenario.floor.source)
    }
    return Study(
        base, {"list": points}, runs, seed=seed, motion=motion, floors=floors, name="The paper's cells"
    )


def digest(text: str) -> str:
    """Return the first 16 hexadecimal digits of the SHA-256 of a text."""
    return hashlib.sha256(text.encode()).hexdigest()[:16]
