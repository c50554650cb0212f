"""Summarise the runs of cells: their figures with intervals, and comparisons."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.inference.agents import strategy_used
from vibroswarm.inference.outcomes import numbers
from vibroswarm.statistics.decidability import Decidability, decidability
from vibroswarm.statistics.figures import FIGURES, cell_figures, interval
from vibroswarm.statistics.intervals import Interval, columns_of, mean_interval, within
from vibroswarm.statistics.verdict import COUNTED, gate_unreached
from vibroswarm.study.batch import WALK
from vibroswarm.study.cells import Cell
from vibroswarm.study.comparison import Answer, Compared, answers_of, comparison_table, comparisons
from vibroswarm.study.precision import Settled
from vibroswarm.study.runs import Runs

READ: Final = tuple(dict.fromkeys(name for figure in FIGURES for name in figure.read))
"""Columns from which figures are computed."""


@dataclass(frozen=True)
class CellOutcome:
    """The figures of a cell; times in s, lengths in m."""

    cell: Cell
    runs: int
    robots: int
    """Robots in all runs."""
    t_end_s: float
    figures: dict[str, Interval]
    """By name, in the order of ``figures.FIGURES``."""
    walk: dict[str, Any]
    """Means of the columns ``WALK`` over runs, with ``_low`` and ``_high``; None for a value that is not finite."""
    decidable: Decidability
    """Whether the cell can be decided at all."""
    failed: pl.DataFrame
    """Runs that the source of motion gave up: run, time_s, reason; their robots count as undecided."""
    settled: Settled | None = None
    """How far the cell is at its last look; None if no precision is wanted, or before the first look."""
    unreached: str = ""
    """Why no robot was allowed to decide (``statistics.verdict``); empty if one was."""


@dataclass(frozen=True)
class Outcome(NotebookView):
    """The summary of runs."""

    runs: Runs
    """Of the cells that have runs."""
    cells: tuple[CellOutcome, ...]
    """The figures of each cell."""
    comparisons: tuple[Compared, ...]
    """One for each pair of cells and figure; empty if no cells are compared."""
    missing: int = 0
    """Number of runs that are not there; cells without any are in no table."""
    answers: tuple[Answer, ...] = ()
    """An answer for each pair of cells that is compared."""

    @cached_property
    def table(self) -> pl.DataFrame:
        """One row per cell: number, varied values and name, then all figures with their limits."""
        rows = []
        for one in self.cells:
            row: dict[str, Any] = {"runs": one.runs, "failed_runs": one.failed.height, "robots": one.robots}
            row |= {"t_end_s": one.t_end_s, "level": 0.95}
            for name, found in one.figures.items():
                row |= columns_of(name, found)
            rows.append(row | one.walk)
        # A figure that no cell has is a column of numbers too, so that tables of several studies can be joined.
        figures = pl.DataFrame(rows, infer_schema_length=None).with_columns(pl.col(pl.Null).cast(pl.Float64))
        return self.runs.cell_table.drop("scenario_hash", "wanted", "there").hstack(figures)

    @cached_property
    def tables(self) -> dict[str, pl.DataFrame]:
        """All tables that have rows by name: ``summary``, ``reported`` and ``comparisons``."""
        tables = {
            "summary": self.table,
            "reported": self.reported,
            "comparisons": comparison_table(self.comparisons),
        }
        return {name: table for name, table in tables.items() if table.height}

    @cached_property
    def reported(self) -> pl.DataFrame:
        """What the robots of each cell reported at the end of their runs: means over runs, with intervals.

        A row for each cell, report and place of an array; ``error`` is the mean distance from the number asked for.
        """
        cells = {one.cell.number: one.cell for one in self.cells}
        by_run = self.runs.rows("reported").drop_nulls("reported").explode("reported").unnest("reported")
        rows = []
        for (number, report, index), own in by_run.group_by("cell", "name", "index", maintain_order=True):
            cell = cells[int(number)]
            declared = strategy_used(cell.scenario).reported.get(str(report))
            row = {"cell": number, "name": cell.name, "report": report, "index": index}
            row |= {"unit": declared.unit if declared else "", "runs": own["value"].drop_nulls().len()}
            value, error = (mean_interval(own[name].drop_nulls().to_numpy()) for name in ("value", "error"))
            row |= columns_of("value", value[:3])
            row |= columns_of("error", within(error, 0.0, math.inf)[:3])
            rows.append(row)
        floats = ("value", "value_low", "value_high", "error", "error_low", "error_high")
        kinds = {"cell": pl.UInt32, "index": pl.UInt32, **dict.fromkeys(floats, pl.Float64)}
        return pl.DataFrame(rows, schema_overrides=kinds) if rows else pl.DataFrame()


def outcome_of(runs: Runs, reference: str | None = None) -> Outcome:
    """Summarise the runs of cells.

    Args:
        reference: value with which other cells are compared, see ``comparison.pairs_of``.
    Raises:
        InputError: no cell has runs, or the reference is no value that is compared.
    """
    missing = sum(runs.runs_of(cell) - runs.there[cell.number] for cell in runs.cells)
    runs = runs.select([cell for cell in runs.cells if runs.there[cell.number]] or runs.cells)
    cells = [one for block in runs.blocks() for one in _outcomes(runs, block)]
    compared = tuple(comparisons(runs, reference))
    return Outcome(runs, tuple(cells), compared, missing, answers_of(compared))


def _outcomes(runs: Runs, cells: Sequence[Cell]) -> Iterator[CellOutcome]:
    """Summarise cells."""
    sampled = {
        cell.number: (
            _walk(own),
            own.drop_nulls("failed_s").select("run", time_s="failed_s", reason="failed"),
        )
        for cell, own in runs.by_cell(*WALK, "failed_s", "failed", cells=cells)
    }
    for cell, own in runs.by_cell(*READ, cells=cells):
        t_end_s, settled = cell.scenario.run.t_end_s, runs.settled.get(cell.number)
        figures = cell_figures(own, t_end_s)
        if settled is not None and runs.until is not None:  # the level allows for repeated looks
            name = runs.until.figure
            figures[name] = interval(name, own, settled.level, t_end_s)
        unreached = ""
        if (own["undecided"] == own["robots"]).all():
            counted = pl.sum_horizontal(f"robot.{name}" for name in COUNTED[cell.scenario.decision.gate][1])
            most = runs.rows(counted.list.max().alias("most"), cells=[cell])["most"].max()
            unreached = gate_unreached(cell.scenario, most)
        yield CellOutcome(
            cell=cell,
            runs=own.height,
            robots=int(own["robots"].sum()),
            t_end_s=t_end_s,
            figures=figures,
            walk=sampled[cell.number][0],
            decidable=decidability(cell.scenario),
            failed=sampled[cell.number][1],
            settled=settled,
            unreached=unreached,
        )


def _walk(of_runs: pl.DataFrame) -> dict[str, Any]:
    """Return the means of the columns ``WALK`` over the runs that have a value, with ``_low`` and ``_high``."""
    columns: dict[str, Any] = {}
    for name in WALK:
        values = numbers(of_runs[name])
        # It is infinite in a run in which all tiles were sampled equally often.
        known = values[np.isfinite(values)] if name == "effective_samples" else values
        columns |= columns_of(name, mean_interval(known))
    return columns
