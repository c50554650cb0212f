"""The cells of the reproduction: each a scenario run many times; all that move alike share their motion.

Cells of all items are gathered first and run as one study, which keeps what is done: a second run goes on with it.
"""

from __future__ import annotations

import hashlib
import json
import math
import shlex
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.analysis.intervals import mean_interval
from vibroswarm.analysis.per_run import capped_time_s, run_figures
from vibroswarm.analysis.swarm import summary
from vibroswarm.floors.source import is_random
from vibroswarm.paper.columns import COLUMNS
from vibroswarm.presets import preset
from vibroswarm.result import ROBOTS
from vibroswarm.scenario import Scenario
from vibroswarm.study.compare import second_seed
from vibroswarm.study.result import StudyResult, run
from vibroswarm.study.runner import Told
from vibroswarm.study.spec import Study
from vibroswarm.study.varied import LABEL

WALKED: Final = ("avoid_per_sample_s", "distance_m", "spacing_s", "ones", "effective_samples")
SHOWN: Final = ("robots_right", "robots_wrong", "robots_undecided", "swarm_right", "swarm_wrong")
FIRST_RUNS: Final = 10
"""Runs of a cell whose robots an archive holds one by one."""
ROWS_AT_A_TIME: Final = 400_000
Tell = Callable[[float], None]


@dataclass(frozen=True)
class Cell:
    """One scenario and how it is run.

    Args:
        block: 0: the seed of the reproduction; 1: its second block of seeds. motion: the engine.
        runs: fewer than the others, if wanted.
    """

    column: str
    scenario: Scenario
    block: int = 0
    motion: str = "event"
    runs: int | None = None

    @cached_property
    def key(self) -> str:
        """Equal for cells that give the same numbers."""
        return f"{self.scenario.hash}-{self.block}-{self.motion}-{self.runs or 'all'}"

    def seed(self, seed: int) -> int:
        """The seed of its runs."""
        return second_seed(seed) if self.block else seed

    def command(self, runs: int, seed: int) -> str:
        """The command that gives this cell alone."""
        how = [f"--runs {min(self.runs or runs, runs)}", f"--seed {self.seed(seed)}"]
        how += [f"--motion {self.motion}"] if self.motion != "event" else []
        return " ".join(["vibroswarm evaluate", *options_of(self.column, self.scenario), *how])


def options_of(column: str, scenario: Scenario) -> list[str]:
    """The options by which ``evaluate`` makes this scenario from the preset of a column."""
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
    """Fields in which a scenario differs from another, by dotted name."""
    found: dict[str, Any] = {}
    there = base.model_dump(exclude_none=True)
    for section, values in scenario.model_dump(exclude_none=True).items():
        for name, value in values.items():
            if value != there[section].get(name):
                found[f"{section}.{name}"] = list(value) if isinstance(value, tuple) else value
    return found


@dataclass(frozen=True)
class CellCame:
    """What came of one cell."""

    row: dict[str, Any]
    """Summed up, see ``summed_up``."""
    figures: pl.DataFrame
    """One row a run: ``analysis.per_run``, how the robots sampled, and the swarm's mean estimate of the fill ratio."""
    digest: str
    """Of the table of robots, all runs, bit by bit."""
    first: pl.DataFrame
    """The table of robots of the first runs."""


@dataclass(frozen=True)
class Came:
    """What came of all cells."""

    seed: int
    runs: int
    cells: dict[str, CellCame]

    def __getitem__(self, cell: Cell) -> CellCame:
        return self.cells[cell.key]

    def values(self, cell: Cell, name: str) -> np.ndarray[Any, Any]:
        """One figure of each run, (runs,); not a number where a run has none."""
        column = self[cell].figures[name].cast(pl.Float64)
        found: np.ndarray[Any, Any] = column.fill_null(math.nan).to_numpy()
        return found

    def row(self, cell: Cell) -> dict[str, Any]:
        """The cell summed up, with the command that gives it alone."""
        about = {"command": cell.command(self.runs, self.seed), "scenario": cell.scenario.hash}
        return self[cell].row | about


def summed_up(cell: Cell, robots: pl.DataFrame, runs: pl.DataFrame) -> CellCame:
    """A cell in the two forms, from its tables of robots and runs.

    The paper's: means of time and belief, with the standard deviation over robots over the root of the runs as
    bar. As they should be: intervals over runs, and what became of the robots and of the swarms.
    """
    t_end_s = cell.scenario.run.t_end_s
    figures = run_figures(robots, runs, t_end_s).hstack(runs.sort("run").select(WALKED))
    estimates = robots.select("run", estimate=pl.col("alpha") / (pl.col("alpha") + pl.col("beta")))
    figures = figures.hstack(estimates.group_by("run", maintain_order=True).mean().select("estimate"))
    found = summary(robots, runs, t_end_s).as_row()
    row: dict[str, Any] = {"runs": runs.height}
    for name in ("decision_time_s", "belief_in_truth"):
        row |= {f"{name}{end}": found[f"{name}{end}"] for end in ("", "_low", "_high")}
    row["decision_time_s_bar"] = float(capped_time_s(robots, t_end_s).std()) / math.sqrt(runs.height)
    belief = robots["belief_in_truth"].drop_nulls().to_numpy()
    row["belief_in_truth_bar"] = float(belief.std()) / math.sqrt(runs.height) if belief.size else None
    for name in SHOWN:
        row |= {f"{name}{end}": found[f"{name}{end}"] for end in ("", "_low", "_high")}
    for name in WALKED[:2]:
        ends = mean_interval(figures[name].drop_nulls().to_numpy())[:3]
        row |= {
            f"{name}{end}": v if math.isfinite(v) else None
            for end, v in zip(("", "_low", "_high"), ends, strict=True)
        }
    return CellCame(row, figures, robots_digest(robots), robots.filter(pl.col("run") < FIRST_RUNS))


def robots_digest(robots: pl.DataFrame) -> str:
    """SHA-256 of the values of a table of robots, bit by bit; a missing value counts as one."""
    found = hashlib.sha256()
    missing, filled = robots.select(pl.all().is_null()), robots.select(pl.all().fill_null(0))
    for name in robots.columns:
        kind = "<f8" if robots.schema[name].is_float() else "<i8"
        found.update(name.encode() + b"\0" + missing[name].to_numpy().tobytes())
        found.update(filled[name].to_numpy().astype(kind).tobytes())
    return found.hexdigest()


def run_cells(
    cells: Iterable[Cell], runs: int, seed: int, folder: Path, workers: int | None, tell: Tell
) -> Came:
    """Run what is missing of the cells, and give what came; kept in ``folder``."""
    groups: dict[tuple[int, str, int], dict[str, Cell]] = {}
    for cell in cells:
        how = (cell.seed(seed), cell.motion, min(cell.runs or runs, runs))
        groups.setdefault(how, {}).setdefault(cell.key, cell)
    came: dict[str, CellCame] = {}
    weights = [_weight(list(group.values()), how) for how, group in groups.items()]
    before = 0.0
    for (how, group), weight in zip(groups.items(), weights, strict=True):
        study = study_of(group, how)

        def told(now: Told, before: float = before, weight: float = weight) -> None:
            tell((before + weight * now.done / max(now.wanted, 1)) / sum(weights))

        result = run(study, folder / study.hash, workers=workers, tell=told)
        came |= _read(result, list(group.values()), how[2], workers)
        before += weight
        tell(before / sum(weights))
    return Came(seed, runs, came)


def _read(result: StudyResult, cells: list[Cell], runs: int, workers: int | None) -> dict[str, CellCame]:
    """Sum up all cells of a study, some at a time: reading them one by one would read all of them each time."""
    found: dict[str, CellCame] = {}
    for group in result.plan.groups:
        numbers = [cell.number for cell in group.cells]
        step = max(ROWS_AT_A_TIME // (runs * group.first.swarm.robots), 1)
        for first in range(0, len(numbers), step):
            some = numbers[first : first + step]
            parts = result.rows(*some).collect().partition_by("cell", as_dict=True)
            with ThreadPoolExecutor(workers) as pool:
                came = pool.map(_sum_up, [cells[number] for number in some], [parts[(n,)] for n in some])
                found |= {cells[number].key: one for number, one in zip(some, came, strict=True)}
    return found


def _sum_up(cell: Cell, rows: pl.DataFrame) -> CellCame:
    of_run = [name for name in rows.columns if name not in ROBOTS and name != "cell"]
    runs = rows.filter(pl.col("robot") == 0).select("run", *of_run)
    return summed_up(cell, rows.select(list(ROBOTS)), runs)


def _weight(cells: list[Cell], how: tuple[int, str, int]) -> float:
    """Roughly how long a group takes."""
    return (5.0 if how[1] == "fixed-step" else 1.0) * how[2] * (3 + len(cells) / 30)


def study_of(group: Mapping[str, Cell], how: tuple[int, str, int]) -> Study:
    """A study whose cells are these, in order."""
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
    """16 hexadecimal digits of a text."""
    return hashlib.sha256(text.encode()).hexdigest()[:16]
