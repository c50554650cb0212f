"""Summarise a study: the figures of its cells with intervals, and comparisons.

A run failed if its source of motion gave it up; its robots count as undecided (``batch_table``). A batch failed if its
simulation raised an error; its runs are not stored and are in no figure (``store``).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.analysis.cell_summary import CellSummary, summaries_of
from vibroswarm.analysis.decidability import Decidability, decidability
from vibroswarm.analysis.figures import columns_of, figures_table, interval
from vibroswarm.analysis.intervals import columns_of as interval_columns
from vibroswarm.analysis.intervals import mean_interval, within
from vibroswarm.analysis.robot_knowledge import COUNTED, counted, gate_unreached
from vibroswarm.core.atomic_io import write_files
from vibroswarm.core.folders import about_file
from vibroswarm.core.numbers import count
from vibroswarm.core.tables import csv_bytes, parquet_bytes
from vibroswarm.errors import RunError, warn_once
from vibroswarm.inference.agents import strategy_used
from vibroswarm.inference.outcomes import Array, numbers
from vibroswarm.study.batch_table import WALK
from vibroswarm.study.cell_comparison import (
    KEPT,
    Answer,
    Compared,
    answers_of,
    compared_columns,
    comparison_table,
    comparisons,
)
from vibroswarm.study.precision import Precision
from vibroswarm.study.settled import Settled
from vibroswarm.study.spec import Cell
from vibroswarm.study.study_result import StudyResult

OF_SOME: Final = ("reported", "comparisons")
"""Tables that only some summaries have."""


@dataclass(frozen=True)
class CellOutcome:
    """The figures of a cell; times in s, lengths in m."""

    cell: Cell
    summary: CellSummary
    walk: dict[str, Any]
    """Means of the columns ``WALK`` over runs, with ``_low`` and ``_high``; None for a value that is not finite."""
    decidable: Decidability
    """Whether the cell can be decided at all."""
    failed: pl.DataFrame
    """Runs that the source of motion gave up (``StudyResult.failed_runs``); their robots count as undecided."""
    settled: Settled | None = None
    """After how many runs the cell's group needed no more, and at which level the figure with the wanted precision is
    reported; None if the study has no precision, or the group needs more runs."""
    unreached: str = ""
    """Why no robot was allowed to decide (``analysis.robot_knowledge``); empty if one was."""

    def as_row(self) -> dict[str, Any]:
        """Return a flat row of all figures with ``_low`` and ``_high``, for a table; None for what is not finite."""
        return {**self.summary.as_row(), **self.walk}


@dataclass(frozen=True)
class Outcome:
    """The summary of a study."""

    result: StudyResult
    """The study, for the selected cells that have runs."""
    cells: tuple[CellOutcome, ...]
    """The figures of each cell."""
    comparisons: tuple[Compared, ...]
    """One for each pair of cells and figure; empty if no cells are compared."""
    without_runs: tuple[Cell, ...] = ()
    """Cells of which no run is stored; they are in no table."""
    answers: tuple[Answer, ...] = ()
    """An answer for each pair of cells that is compared."""

    @cached_property
    def table(self) -> pl.DataFrame:
        """One row per cell: number, varied values and name, then all figures with their limits.

        If the source of motion gave up a run of any cell, the column ``failed_runs`` follows the column ``runs``.
        """
        varied = self.result.cells.drop("scenario_hash", "group", "wanted", "there")
        figures = pl.DataFrame([cell.as_row() for cell in self.cells], infer_schema_length=None)
        if self.has_failed_runs:
            counts = pl.Series("failed_runs", [cell.failed.height for cell in self.cells], dtype=pl.Int64)
            figures = figures.insert_column(figures.columns.index("runs") + 1, counts)
        # A figure that no cell has is a column of numbers too, so that tables of several studies can be joined.
        figures = figures.with_columns(pl.col(pl.Null).cast(pl.Float64))
        # Both tables have a row for each selected cell, in the same order.
        return varied.hstack(figures)

    @cached_property
    def tables(self) -> dict[str, pl.DataFrame]:
        """All tables by name.

        These are ``summary``; ``reported``, if robots report something; and ``comparisons``, if cells are compared.
        """
        tables = {
            "summary": self.table,
            "reported": self.reported,
            "comparisons": comparison_table(self.comparisons),
        }
        return {name: table for name, table in tables.items() if table.height}

    @cached_property
    def reported(self) -> pl.DataFrame:
        """What the robots of each cell reported at the end of their runs: means over runs, with intervals.

        There is a row for each cell, report and place of an array: cell, name, report, index, unit, runs, and ``value``
        and ``error`` with ``_low`` and ``_high``. ``error`` is the mean distance from the number that is asked for,
        of reports that estimate it. A run in which no robot has a value is left out. There are no rows if robots report
        nothing but their estimates, which are figures of their own.
        """
        cells = {one.cell.number: one.cell for one in self.cells}
        by_run = self.result.reported(*cells)
        rows = []
        for (number, report, index), own in by_run.group_by("cell", "name", "index", maintain_order=True):
            cell = cells[int(number)]
            declared = strategy_used(cell.scenario).reported.get(str(report))
            row = {"cell": number, "name": cell.name, "report": report, "index": index}
            row |= {"unit": declared.unit if declared else "", "runs": own["value"].drop_nulls().len()}
            value, error = (mean_interval(own[name].drop_nulls().to_numpy()) for name in ("value", "error"))
            row |= interval_columns("value", value[:3])
            row |= interval_columns("error", within(error, 0.0, math.inf)[:3])
            rows.append(row)
        floats = ("value", "value_low", "value_high", "error", "error_low", "error_high")
        kinds = {"cell": pl.UInt32, "index": pl.UInt32, **dict.fromkeys(floats, pl.Float64)}
        return pl.DataFrame(rows, schema_overrides=kinds) if rows else pl.DataFrame()

    @property
    def has_failed_runs(self) -> bool:
        """Whether the source of motion gave up a run; only then is there a column ``failed_runs``."""
        return any(cell.failed.height > 0 for cell in self.cells)


def outcome_of(
    result: StudyResult,
    reference: str | None = None,
    *,
    compare: bool = True,
) -> Outcome:
    """Summarise the selected cells of a study, with the rows of one cell, or of few small ones, at a time in memory.

    Args:
        reference: value with which other cells are compared, see ``cell_comparison.pairs_of``.
        compare: whether cells are compared; if not, only their figures are computed.
    Raises:
        InputError: no selected cell has runs, or the reference is no value that is compared.
    """
    result, without_runs = _with_runs(result)
    known: dict[int, pl.DataFrame] = {}
    all_failed = result.failed_runs()
    failed = all_failed.partition_by("cell", as_dict=True)
    found: dict[int, CellOutcome] = {}
    for together in result.cells_together():
        for one, by_run in _outcomes(result, together, lambda cell: failed.get((cell,), all_failed.clear())):
            found[one.cell.number] = one
            if len(result.selected) <= KEPT:
                known[one.cell.number] = compared_columns(by_run)
    compared = tuple(comparisons(result, reference, known)) if compare else ()
    return Outcome(
        result=result,
        cells=tuple(found[number] for number in result.selected),
        comparisons=compared,
        without_runs=without_runs,
        answers=answers_of(compared),
    )


def _outcomes(
    result: StudyResult, cells: Sequence[Cell], failed: Callable[[int], pl.DataFrame]
) -> Iterator[tuple[CellOutcome, pl.DataFrame]]:
    """Summarise cells that share motion; yield the outcome of each, and the figures of its runs.

    Args:
        failed: returns the failed runs of a cell.
    """
    keys = ("cell", "run", "truth", "consensus")
    parts = (
        (
            _narrowed(figures_table(swarms, runs.select(keys))),
            runs.select(*WALK),
            rows.group_by("cell").agg([counted(gate).alias(gate) for gate in COUNTED]),
        )
        for swarms, rows, runs in result.parts(cells)
    )
    table, walked, most = (pl.concat(part, how="vertical_relaxed") for part in zip(*parts, strict=True))
    most_of = most.group_by("cell").max().rows_by_key("cell", named=True, unique=True)
    walk = {name: numbers(walked[name]) for name in WALK}
    _, sizes = np.unique(table["cell"].to_numpy(), return_counts=True)
    summaries = summaries_of(table, sizes.tolist(), [cell.scenario.run.t_end_s for cell in cells])
    settled, end = result.settled(cells[0].number), 0
    for cell, summary, size in zip(cells, summaries, sizes.tolist(), strict=True):
        first, end = end, end + size
        figures = table[first:end]
        outcome = CellOutcome(
            cell=cell,
            summary=_with_corrected_interval(summary, figures, result.study.until, settled),
            walk=_walk({name: values[first:end] for name, values in walk.items()}),
            decidable=decidability(cell.scenario),
            failed=failed(cell.number),
            settled=settled,
            unreached=gate_unreached(cell.scenario, most_of[cell.number][cell.scenario.decision.gate]),
        )
        yield outcome, figures


def _narrowed(figures: pl.DataFrame) -> pl.DataFrame:
    """Return figures by run, those that are small whole numbers or null, as most are, in a byte each."""
    columns = []
    for column in figures.drop("cell", "run", "consensus"):
        narrow = column.cast(pl.Int8, strict=False)
        is_exact = narrow.null_count() == column.null_count() and (narrow == column).all()
        columns.append(narrow if is_exact else column)
    return figures.with_columns(columns)


def _with_runs(result: StudyResult) -> tuple[StudyResult, tuple[Cell, ...]]:
    """Return the result for the cells with stored runs only, and the cells without stored runs.

    If no cell has runs, the result is returned unchanged, with no cells besides: reading its tables then raises the
    error that it holds no runs yet.
    """
    # Number of stored runs, by the number of the cell.
    stored = dict(result.cells.select("cell", "there").iter_rows())
    if all(stored.values()) or not any(stored.values()):
        return result, ()
    with_runs = tuple(number for number in result.selected if stored[number])
    without = tuple(result.cell(number) for number in stored if not stored[number])
    return replace(result, selected=with_runs), without


def _with_corrected_interval(
    summary: CellSummary, figures: pl.DataFrame, until: Precision | None, settled: Settled | None
) -> CellSummary:
    """Correct the interval of the figure with the wanted precision for repeated looks (``precision``)."""
    if settled is None or until is None:
        return summary
    corrected = interval(until.figure, columns_of(figures), settled.level, t_end_s=summary.t_end_s)
    return replace(summary, figures={**summary.figures, until.figure: corrected})


def _walk(of_runs: Mapping[str, Array]) -> dict[str, Any]:
    """Return the means of the columns ``WALK`` over the runs that have a value, with ``_low`` and ``_high``.

    Args:
        of_runs: these columns of a cell, (runs,) each; nan where a run has no value.
    Returns: values by name of the column; None in place of a value that is not finite.
    """
    columns: dict[str, Any] = {}
    for name, values in of_runs.items():
        # effective_samples is infinite in a run in which all tiles were sampled equally often.
        known = values[np.isfinite(values)] if name == "effective_samples" else values
        columns |= interval_columns(name, mean_interval(known))
    return columns


def write_outcome(outcome: Outcome, folder: Path) -> None:
    """Write the tables of a summary as CSV and Parquet into a study's folder; remove earlier ones that it has not.

    Raises:
        InputError: a file cannot be created. RunError: the disk is full or failed, or a file cannot be removed.
    """
    for name, table in outcome.tables.items():
        write_table(table, folder / name)
    others = [name for name in OF_SOME if name not in outcome.tables]
    for path in (folder / f"{name}.{suffix}" for name in others for suffix in ("csv", "parquet")):
        remove_file(path)


def remove_file(path: Path) -> None:
    """Remove a file, if it is there.

    Raises:
        RunError: it cannot be removed.
    """
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise RunError(f"could not remove '{path}': {error.strerror or error}") from error


MOST_CSV_ROWS: Final = 2**20 - 1
"""Most rows of a table that is written as CSV: what a spreadsheet can hold below the names of columns."""


def write_table(table: pl.DataFrame, path: Path) -> dict[str, Any]:
    """Write a table as CSV and Parquet; ``path`` is without a suffix. One too long for spreadsheets is no CSV.

    Returns: what a manifest says of the Parquet file, by its name.
    Raises:
        InputError: a file cannot be created. RunError: the disk is full or failed.
    """
    data = parquet_bytes(table)
    files = {f"{path.name}.parquet": data}
    if table.height <= MOST_CSV_ROWS:
        files = {f"{path.name}.csv": csv_bytes(table), **files}
    else:
        path.with_name(f"{path.name}.csv").unlink(missing_ok=True)  # of an earlier result
        warn_once(f"table '{path.name}' has {count(table.height, 'row')}, and is saved as Parquet only")
    write_files(path.parent, files)
    return {f"{path.name}.parquet": about_file(data)}
