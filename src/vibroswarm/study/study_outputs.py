"""What ``Study`` and ``StudyResult`` offer an interactive session: running, summary, comparison, picture, report.

The functions here do the work of their methods (``core.notebook_view.study_verbs``).
"""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import polars as pl

from vibroswarm.core.atomic_io import OURS, whole_folder
from vibroswarm.core.folders import PICTURES, REPORT
from vibroswarm.core.notebook_view import NotebookView, document_of
from vibroswarm.core.numbers import count
from vibroswarm.core.progress_line import ProgressLine, is_watched
from vibroswarm.errors import InputError, check_choice, check_keywords
from vibroswarm.plots.picture import Picture
from vibroswarm.show.document import Document
from vibroswarm.show.figures import write_figures
from vibroswarm.study.answers import Answer
from vibroswarm.study.cell_comparison import comparison_table
from vibroswarm.study.evaluation import outcome_after, write_report
from vibroswarm.study.run import run
from vibroswarm.study.runner import Progress, StudyProgress
from vibroswarm.study.spec import Study
from vibroswarm.study.study_result import StudyResult
from vibroswarm.study.summary import Outcome, outcome_of


def run_with_bar(
    study: Study, folder: str | Path | None, progress: Progress | bool, how: Mapping[str, Any]
) -> StudyResult:
    """Run a study as ``Study.run`` does.

    Args:
        progress: called with the progress; True shows a bar if the output is a terminal or a notebook, False none.
        how: the other keyword arguments of ``run``.
    Raises:
        InputError: ``how`` has a name that is no argument of ``run``. Besides, the errors of ``run``.
    """
    check_keywords(how, "run", [name for name in inspect.signature(run).parameters if name != "study"])
    if not isinstance(progress, bool):
        return run(study, folder, progress=progress, **how)
    if not (progress and is_watched()):
        return run(study, folder, **how)
    line = ProgressLine("simulating")
    try:
        return run(study, folder, progress=lambda now: line.show(now.done, now.wanted, _failed(now)), **how)
    finally:
        line.end()


def _failed(now: StudyProgress) -> str:
    return f"{count(now.failed, 'batch', 'batches')} failed" if now.failed else ""


@dataclass(frozen=True, eq=False)
class Comparison(NotebookView):
    """The pairwise comparisons of a study's cells; its text is one sentence per pair."""

    outcome: Outcome

    @property
    def answers(self) -> tuple[Answer, ...]:
        """An answer for each pair of cells, with effects and their intervals."""
        return self.outcome.answers

    @property
    def sentences(self) -> list[str]:
        """Sentences about each pair of cells, also at equal error if computed, and then the warnings.

        If no cells are compared, there is a sentence about each cell instead.
        """
        document = self._document
        return [*document.answer, *(f"Warning: {words}" for words in document.warnings)]

    @property
    def table(self) -> pl.DataFrame:
        """One row per pair and figure: means, difference with interval, corrected p-value.

        If no cells are compared, the table has no rows and no columns.
        """
        return comparison_table(self.outcome.comparisons)

    @cached_property
    def _document(self) -> Document:
        document: Document = document_of(self)
        return document

    def __repr__(self) -> str:
        return "\n".join([*self._document.knew, self._document.title, *self.sentences])


@dataclass(frozen=True)
class ReportFile(NotebookView):
    """A report that was written."""

    path: Path
    """The page, which opens in a browser."""

    def __repr__(self) -> str:
        return f"ReportFile({str(self.path)!r})"


def compared(
    result: StudyResult, reference: str | None, confirm: bool, equal_error: bool = False
) -> Comparison:
    """Compare the selected cells pairwise.

    Args:
        reference: a value of one of the compared fields, with which the field's other values are compared. None: every
            two strategies are compared; of any other field, each value with the first one. ``cell_comparison.pairs_of``
            has the rules in full.
        confirm: whether the study is first repeated on another seed, to confirm the differences.
        equal_error: whether strategies are also compared at equal error.
    """
    return Comparison(outcome_after(result, reference=reference, confirm=confirm, equal_error=equal_error))


def plotted(result: StudyResult, name: str, style: str) -> Picture:
    """Draw one of the figures of the study's document by its name.

    Raises:
        InputError: there is no such style, or the study has no such figure; the message lists those that it has.
    """
    figures = document_of(outcome_of(result, compare=False)).figures
    if name not in figures:  # only the figures of comparisons need the comparisons, which take longer
        figures = document_of(outcome_of(result)).figures
    check_choice(name, "name", figures)
    drawn: Picture = figures[name].draw(style)
    return drawn


def reported(result: StudyResult, folder: Path | None, replace: bool) -> ReportFile:
    """Write tables, pictures and report into ``folder``, or into the study's own folder if it is None.

    Args:
        folder: new, or one with a report only; the study's own folder counts as None.
        replace: whether a folder with a report is replaced, with everything in it. In the study's own folder, an
            earlier report is always overwritten, and other files stay.
    Raises:
        InputError: ``folder`` exists and may not be replaced, or cannot be written.
        RunError: the disk is full or failed.
    """
    if folder is None or folder.resolve() == result.store.folder.resolve():
        return _write(result, result.store.folder)
    # ``whole_folder`` would replace any folder of ours, also one with the runs of another study.
    results = [name for name in OURS if (folder / name).exists()]
    if results:
        raise InputError(
            f"holds results ('{results[0]}'), which a report does not replace; give another folder",
            field=str(folder),
        )
    with whole_folder(folder, replace=replace, marker=REPORT) as part:
        _write(result, part)
    return ReportFile(folder / REPORT)


def _write(result: StudyResult, folder: Path) -> ReportFile:
    """Write tables, pictures and report into an existing folder; pictures are as wide as a journal's column."""
    # The report keeps the comparison at equal error that the study's folder has.
    equal_error = (result.store.folder / "equal_error.csv").is_file()
    document = write_report(outcome_of(result, equal_error=equal_error), folder)
    write_figures(folder / PICTURES, document, "column")
    return ReportFile(folder / REPORT)
