"""Summarise a study: the figures of its cells with intervals, and comparisons.

A run failed if its source of motion gave it up; its robots count as undecided (``batch_table``). A batch failed if its
simulation raised an error; its runs are not stored and are in no figure (``store``).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Container
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import polars as pl

from vibroswarm.analysis.cell_summary import CellSummary, summary_of, time_within_runs
from vibroswarm.analysis.decidability import Decidability, decidability
from vibroswarm.analysis.intervals import columns_of, mean_interval, within
from vibroswarm.analysis.robot_knowledge import counted, gate_unreached
from vibroswarm.core.atomic_io import write_files
from vibroswarm.core.folders import about_file
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.core.numbers import count
from vibroswarm.core.tables import csv_bytes, parquet_bytes
from vibroswarm.errors import RunError, warn_once
from vibroswarm.inference.agents import strategy_used
from vibroswarm.inference.outcomes import costs_of
from vibroswarm.study.baselines import References
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
from vibroswarm.study.equal_error import at_equal_error, why_not_at_equal_error
from vibroswarm.study.settled import Settled, figure_of
from vibroswarm.study.spec import Cell
from vibroswarm.study.study_result import StudyResult

OF_SOME: Final = ("reported", "comparisons", "equal_error", "references")
"""Tables that only some summaries have."""


@dataclass(frozen=True)
class CellOutcome(NotebookView):
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
class Outcome(NotebookView):
    """The summary of a study."""

    result: StudyResult
    """The study, for the selected cells that have runs."""
    replicate: StudyResult | None
    """Its second block of runs, from another seed; None if there is none, or if none of its runs is stored."""
    cells: tuple[CellOutcome, ...]
    """The figures of each cell."""
    comparisons: tuple[Compared, ...]
    """One for each pair of cells and figure; empty if no cells are compared."""
    without_runs: tuple[Cell, ...] = ()
    """Cells of which no run is stored; they are in no table."""
    answers: tuple[Answer, ...] = ()
    """An answer for each pair of cells that is compared."""
    failed_replicate: StudyResult | None = None
    """The second block, if all its batches failed, so that none of its runs is stored; else None."""
    references: tuple[References, ...] = ()
    """How soon could have been decided from the same samples, of ``baselines.references_of``; empty: not computed."""
    unmatched: str = ""
    """What was requested and is not compared at equal error, and why; empty if nothing."""

    def __repr__(self) -> str:
        return f"Outcome({len(self.cells)} cells, {len(self.answers)} comparisons, of {self.result!r})"

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

        These are ``summary``; ``reported``, if robots report something; ``comparisons``, if cells are compared;
        ``equal_error``, if they are compared at equal error; and ``references``, if these are computed.
        """
        matched = [answer.as_row() for answer in self.answers if answer.matched is not None]
        tables = {
            "summary": self.table,
            "reported": self.reported,
            "comparisons": comparison_table(self.comparisons),
            "equal_error": pl.DataFrame(matched, infer_schema_length=None),
            "references": pl.DataFrame([one.as_row() for one in self.references], infer_schema_length=None),
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
            row |= columns_of("value", value[:3]) | columns_of("error", within(error, 0.0, math.inf)[:3])
            rows.append(row)
        numbers = ("value", "value_low", "value_high", "error", "error_low", "error_high")
        kinds = {"cell": pl.UInt32, "index": pl.UInt32, **dict.fromkeys(numbers, pl.Float64)}
        return pl.DataFrame(rows, schema_overrides=kinds) if rows else pl.DataFrame()

    @property
    def has_failed_runs(self) -> bool:
        """Whether the source of motion gave up a run; only then is there a column ``failed_runs``."""
        return any(cell.failed.height > 0 for cell in self.cells)


def outcome_of(
    result: StudyResult,
    replicate: StudyResult | None = None,
    reference: str | None = None,
    progress: Callable[[float], None] = lambda share: None,
    *,
    compare: bool = True,
    equal_error: bool = False,
) -> Outcome:
    """Summarise the selected cells of a study, with the rows of one cell at a time in memory.

    Args:
        replicate: the second block of runs, from another seed, see ``cell_comparison``; None if there is none.
        reference: value with which other cells are compared, see ``cell_comparison.pairs_of``.
        progress: called with the share of cells, 0 to 1, that have been replayed for the comparison at equal error.
        compare: whether cells are compared; if not, only their figures are computed.
        equal_error: whether strategies are also compared at equal error, which replays up to 1000 runs of each cell
            with many settings and may take longer than the study itself.
    Raises:
        InputError: no selected cell has runs, or the reference is no value that is compared.
    """
    cells = []
    result, without_runs = _with_runs(result)
    failed_replicate: StudyResult | None = None
    if replicate is not None:
        # A second block of which no run is stored, since all its batches failed, compares nothing; it gives a warning.
        has_runs = replicate.cells["there"].sum() > 0
        # Only cells with runs are compared. Cells without runs in the second block get no warning: they are not listed
        # in ``Outcome.without_runs``.
        replicate_with_runs, _ = _with_runs(replicate)
        replicate, failed_replicate = (replicate_with_runs, None) if has_runs else (None, replicate)
    known: dict[int, pl.DataFrame] = {}
    all_failed = result.failed_runs()
    for number in result.selected:
        one, by_run = _cell_outcome(result, number, all_failed.filter(pl.col("cell") == number))
        cells.append(one)
        if len(result.selected) <= KEPT:
            known[number] = by_run
    compared = tuple(comparisons(result, replicate, reference, known)) if compare else ()
    matched = at_equal_error(result, compared, progress) if equal_error else {}
    return Outcome(
        result=result,
        replicate=replicate,
        cells=tuple(cells),
        comparisons=compared,
        without_runs=without_runs,
        answers=answers_of(compared, matched),
        failed_replicate=failed_replicate,
        unmatched=why_not_at_equal_error(result, compared, matched) if equal_error else "",
    )


def _cell_outcome(result: StudyResult, number: int, failed: pl.DataFrame) -> tuple[CellOutcome, pl.DataFrame]:
    """Summarise a cell; return its figures, and the columns of its runs with which it is compared.

    Args:
        number: of the cell. failed: its failed runs.
    """
    cell = result.study.cells[number]
    t_end_s, settled = cell.scenario.run.t_end_s, result.settled(number)
    parts = (
        (
            _narrowed(figures.with_columns(time_within_runs(robots, t_end_s))),
            runs.select(*WALK),
            robots.select(most=counted(cell.scenario)),
        )
        for figures, robots, runs in result.parts(number)
    )
    table, walked, most = (pl.concat(part, how="vertical_relaxed") for part in zip(*parts, strict=True))
    summary = summary_of(table, t_end_s)
    outcome = CellOutcome(
        cell=cell,
        summary=_with_corrected_interval(summary, result, number, settled),
        walk=_walk(walked),
        decidable=decidability(cell.scenario),
        failed=failed,
        settled=settled,
        unreached=gate_unreached(cell.scenario, most["most"].max()),
    )
    return outcome, compared_columns(table)


def _narrowed(figures: pl.DataFrame) -> pl.DataFrame:
    """Return figures by run, those that are small whole numbers or null, as most are, in a byte each."""
    columns = []
    for column in figures.drop("run", "consensus"):
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
    figures: CellSummary, result: StudyResult, cell: int, settled: Settled | None
) -> CellSummary:
    """Correct the interval of the figure with the wanted precision for repeated looks (``precision``)."""
    until = result.study.until
    if settled is None or until is None:
        return figures
    scenario = result.study.cells[cell].scenario
    rows, costs = result.rows(cell), costs_of(scenario)
    interval = figure_of(rows, until.figure, scenario.run.t_end_s, settled.level, costs)
    return replace(figures, figures={**figures.figures, until.figure: interval})


def _walk(runs: pl.DataFrame) -> dict[str, Any]:
    """Return the means of the columns ``WALK`` over the runs that have a value, with ``_low`` and ``_high``.

    Args:
        runs: table of runs of a cell with these columns.
    Returns: values by name of the column; None in place of a value that is not finite.
    """
    columns: dict[str, Any] = {}
    for name in WALK:
        values = runs[name].drop_nulls().to_numpy()
        if name == "effective_samples":  # infinite in a run in which all tiles were sampled equally often
            values = values[[math.isfinite(value) for value in values]]
        columns |= columns_of(name, mean_interval(values))
    return columns


def write_outcome(outcome: Outcome, folder: Path, kept: Container[str] = ()) -> None:
    """Write the tables of a summary as CSV and Parquet into a study's folder; remove earlier ones that it has not.

    Args:
        kept: tables that are not removed.
    Raises:
        InputError: a file cannot be created. RunError: the disk is full or failed, or a file cannot be removed.
    """
    for name, table in outcome.tables.items():
        write_table(table, folder / name)
    others = [name for name in OF_SOME if name not in outcome.tables and name not in kept]
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
