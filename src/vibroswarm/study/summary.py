"""Summarise a study: figures of its cells with intervals, comparisons, and warnings."""

from __future__ import annotations

import io
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import polars as pl

from vibroswarm.analysis.cell_summary import CellSummary, summary
from vibroswarm.analysis.decidability import Decidability, decidability
from vibroswarm.analysis.forced_error import forced_error_by_run
from vibroswarm.analysis.intervals import Interval, mean_interval
from vibroswarm.core.atomic_io import write_files
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.core.tables import csv_bytes
from vibroswarm.inference.outcomes import numbers
from vibroswarm.study.answers import Answer, answers_of, question
from vibroswarm.study.batch_table import failed_words
from vibroswarm.study.cell_comparison import Compared, at_equal_error, comparison_table, comparisons
from vibroswarm.study.precision import Settled, figure_of
from vibroswarm.study.spec import Cell
from vibroswarm.study.study_result import StudyResult

WALK: Final = ("avoid_per_sample_s", "distance_m", "spacing_s", "ones", "effective_samples")
"""Figures of a run's walk that the store saves."""


@dataclass(frozen=True)
class CellOutcome(NotebookView):
    """The figures of a cell; times in s, lengths in m."""

    cell: Cell
    summary: CellSummary
    walk: dict[str, Any]
    """Means over runs, with ``_low`` and ``_high``."""
    decidable: Decidability
    forced_error: Interval
    """Mean over runs of ``analysis.forced_error``: robots wrong, or undecided and leaning to the wrong side."""
    failed: pl.DataFrame
    """Runs that the source of motion gave up, ``batch_table.FAILED_RUNS``; their robots count as undecided."""
    settled: Settled | None = None
    """After how many runs the cell reached the precision, and at which level its figure is reported."""

    def as_row(self) -> dict[str, Any]:
        """Return a flat row for a table; None for what is not finite."""
        ends = zip(("", "_low", "_high"), self.forced_error[:3], strict=True)
        error = {f"forced_error{end}": value if math.isfinite(value) else None for end, value in ends}
        return {**self.summary.as_row(), **error, **self.walk}


@dataclass(frozen=True)
class Outcome(NotebookView):
    """The summary of a study."""

    result: StudyResult
    replicate: StudyResult | None
    cells: tuple[CellOutcome, ...]
    comparisons: tuple[Compared, ...]
    without_runs: tuple[Cell, ...] = ()
    """Cells without runs; they are in no table."""
    answers: tuple[Answer, ...] = ()
    """One for each pair of cells that is compared."""

    def __repr__(self) -> str:
        return f"Outcome({len(self.cells)} cells, {len(self.answers)} comparisons, of {self.result!r})"

    @cached_property
    def table(self) -> pl.DataFrame:
        """One row per cell: its varied values, then all figures with their limits."""
        varied = self.result.cells.drop("scenario_hash", "group", "wanted", "there")
        figures = pl.DataFrame([cell.as_row() for cell in self.cells], infer_schema_length=None)
        if self.has_failed_runs:
            counts = pl.Series("failed_runs", [cell.failed.height for cell in self.cells], dtype=pl.Int64)
            figures = figures.insert_column(figures.columns.index("runs") + 1, counts)
        return varied.hstack(figures)

    @property
    def has_failed_runs(self) -> bool:
        """Whether the source of motion gave up a run; only then is there a column ``failed_runs``."""
        return any(cell.failed.height > 0 for cell in self.cells)

    @cached_property
    def question(self) -> str:
        """What was asked: what is compared, in which setting, in how many runs."""
        return question(self.result, self.comparisons)

    @property
    def warnings(self) -> list[str]:
        """Facts that may invalidate the figures, such as failed or missing runs."""
        warnings = list(dict.fromkeys(
            f"{_floor_words(c)}: {c.decidable.says}" for c in self.cells if c.decidable.is_warning
        ))  # fmt: skip
        store = self.result.store
        cells = self.result.cells
        warnings += [failed_words(c.cell, c.failed, c.summary.runs) for c in self.cells if c.failed.height]
        if store.failures:
            warnings.append(_failed_words(self.result))
        if self.replicate is not None and self.replicate.store.failures:
            warnings.append(f"on other seeds, {_failed_words(self.replicate)}")
        if self.without_runs:
            names = ", ".join(cell.name for cell in self.without_runs)
            warnings.append(f"there are no runs of {names}.")
        lost = int((cells["wanted"] - cells["there"]).sum())
        if lost and not store.failures:
            warnings.append(
                f"{lost:,} of {int(cells['wanted'].sum()):,} runs are missing; run the same command again."
            )
        warnings += [f"a damaged shard was left out: {words}" for words in store.damaged]
        if len(store.made_by) > 1:
            warnings.append(
                "runs were made by different versions of the software; they may not be repeatable as a whole."
            )
        until = self.result.study.until
        short = [c for c in self.cells if c.settled is not None and not c.settled.reached]
        if until is not None and short:
            warnings.append(
                f"in {len(short)} of {len(self.cells)} cells {until.figure} is not known to "
                f"{100 * until.half_width:g} % after {until.max_runs:,} runs, the most that were allowed."
            )
        return warnings

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        study = self.result.study
        return {
            "study_hash": study.hash,
            "name": study.name,
            "seed": study.seed,
            "cells": [
                {
                    "cell": row.cell.number,
                    "name": row.cell.name,
                    "varied": row.cell.point,
                    "scenario_hash": row.cell.scenario.hash,
                    **row.summary.as_dict(),
                    **({"failed_runs": row.failed.height} if self.has_failed_runs else {}),
                    "forced_error": row.forced_error.as_dict(),
                    "walk": row.walk,
                    "decidability": row.decidable.as_dict(),
                    "settled": None if row.settled is None else row.settled._asdict(),
                }
                for row in self.cells
            ],
            "comparisons": [row.as_row() for row in self.comparisons],
            "answers": [
                {"sentence": answer.sentence, "at_equal_error": answer.at_equal_error}
                for answer in self.answers
            ],
            "equal_error": [answer.as_row() for answer in self.answers if answer.matched is not None],
            "second_block_seed": None if self.replicate is None else self.replicate.study.seed,
            "warnings": self.warnings,
            "versions": self.result.store.made_by,
        }


def outcome_of(
    result: StudyResult,
    replicate: StudyResult | None = None,
    reference: str | None = None,
    progress: Callable[[float], None] | None = None,
    *,
    compare: bool = True,
) -> Outcome:
    """Summarise a study, with one cell at a time in memory.

    Args:
        replicate: the second block of seeds, see ``cell_comparison``. reference: with what others are compared, as of
            ``cell_comparison.pairs_of``. progress: called with the share of replays at equal error that are done.
        compare: whether cells are compared; without, only their figures are computed.
    Raises:
        InputError: the reference is no value that is compared.
    """
    cells = []
    result, without_runs = _with_runs(result)
    replicate = None if replicate is None or not replicate.cells["there"].sum() else _with_runs(replicate)[0]
    for number in result.selected:
        cell = result.study.cells[number]
        robots, runs = result.tables(number)
        settled = result.settled(number)
        figures = _at_the_level(summary(robots, runs, cell.scenario.run.t_end_s), result, number, settled)
        error = mean_interval(numbers(forced_error_by_run(robots, runs)["forced_error"]))
        failed, decidable = result.failed_runs(number), decidability(cell.scenario)
        cells.append(CellOutcome(cell, figures, _walk(runs), decidable, error, failed, settled))
    compared = tuple(comparisons(result, replicate, reference)) if compare else ()
    answers = answers_of(compared, at_equal_error(result, compared, progress))
    return Outcome(result, replicate, tuple(cells), compared, without_runs, answers)


def _with_runs(result: StudyResult) -> tuple[StudyResult, tuple[Cell, ...]]:
    """Separate the cells with runs from those without; if no cell has runs, none is separated."""
    stored = dict(result.cells.select("cell", "there").iter_rows())
    if all(stored.values()) or not any(stored.values()):
        return result, ()
    with_runs = tuple(number for number in result.selected if stored[number])
    without = tuple(result.cell(number) for number in stored if not stored[number])
    return replace(result, selected=with_runs), without


def _failed_words(result: StudyResult) -> str:
    """Write how many runs of which cells failed, with the first cause."""
    failures, groups = result.store.failures, {group.number: group for group in result.plan.groups}
    names = dict.fromkeys(cell.name for failure in failures for cell in groups[failure["group"]].cells)
    runs = sum(failure["last"] - failure["first"] for failure in failures)
    return (
        f"{runs:,} runs of {', '.join(names)} failed and are in no figure, so that figures of the others may be biased "
        f"({failures[0]['why']})."
    )


_SETTLED: Final = {
    "right": "robots_right",
    "wrong": "robots_wrong",
    "undecided": "robots_undecided",
    "consensus_right": "swarm_right",
    "consensus_wrong": "swarm_wrong",
}
"""Figures whose names in a summary differ from those of a precision."""


def _at_the_level(
    figures: CellSummary, result: StudyResult, cell: int, settled: Settled | None
) -> CellSummary:
    """Replace the interval of the study's precision figure by that of its last look, corrected for repeated looks.

    Without a precision, or before the cell is settled, the figures are returned as they are.
    """
    until = result.study.until
    if settled is None or until is None:
        return figures
    t_end_s = result.study.cells[cell].scenario.run.t_end_s
    interval = figure_of(result.rows(cell), until.figure, t_end_s, settled.level)
    changed: dict[str, Any] = {_SETTLED.get(until.figure, until.figure): interval}
    return replace(figures, **changed)


def _walk(runs: pl.DataFrame) -> dict[str, Any]:
    """Average the sampling figures over the runs that have them, with limits; None for what is not finite."""
    columns: dict[str, Any] = {}
    for name in WALK:
        values = runs[name].drop_nulls().to_numpy()
        values = values[[math.isfinite(value) for value in values]] if name == "effective_samples" else values
        interval = mean_interval(values)
        for end, value in zip(("", "_low", "_high"), interval[:3], strict=True):
            columns[f"{name}{end}"] = value if math.isfinite(value) else None
    return columns


def _floor_words(one: CellOutcome) -> str:
    floor = one.cell.scenario.floor
    return f"floor {floor.source}, threshold {one.cell.scenario.sensor.rms_threshold:g}"


def write_outcome(outcome: Outcome, folder: Path) -> None:
    """Write ``summary``, ``comparisons`` and ``equal_error`` as CSV and Parquet into a study's folder."""
    tables = {"summary": outcome.table}
    if outcome.comparisons:
        tables["comparisons"] = comparison_table(outcome.comparisons)
    if matched := [answer.as_row() for answer in outcome.answers if answer.matched is not None]:
        tables["equal_error"] = pl.DataFrame(matched, infer_schema_length=None)
    for name, table in tables.items():
        write_table(table, folder / name)


def write_table(table: pl.DataFrame, path: Path) -> None:
    """Write a table as CSV and Parquet; ``path`` is without a suffix.

    Raises:
        RunError: the disk is full or failed.
    """
    buffer = io.BytesIO()
    table.write_parquet(buffer)
    contents = {f"{path.name}.csv": csv_bytes(table), f"{path.name}.parquet": buffer.getvalue()}
    write_files(path.parent, contents)
