"""What ``vibroswarm evaluate`` does: run a study or a part of it, summarise, write.

``evaluate`` does all of it in one call; ``words.study_of`` makes the study from the words of the command. Methods of
``Study`` and ``StudyResult`` for an interactive session (running with a bar, summary, comparison, picture, report) call
the functions at the end (``core.notebook_view.study_verbs``).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import polars as pl

from vibroswarm.core.atomic_io import OURS, whole_folder
from vibroswarm.core.folders import PICTURES, REPORT
from vibroswarm.core.notebook_view import NotebookView, document_of
from vibroswarm.core.stages import SILENT, Stages
from vibroswarm.errors import InputError, RunError, check_choice
from vibroswarm.plots.picture import Picture
from vibroswarm.show.data import document_data
from vibroswarm.show.document import Document
from vibroswarm.show.figures import remove_figures, write_figures
from vibroswarm.show.page import write_page
from vibroswarm.show.page_origin import is_made_from, origin
from vibroswarm.study.cell_comparison import Answer, comparison_table, pairs_of
from vibroswarm.study.run import run
from vibroswarm.study.runner import Job, Progress, failures_in_words
from vibroswarm.study.spec import Study
from vibroswarm.study.study_result import StudyResult
from vibroswarm.study.summary import Outcome, outcome_of, remove_file, write_outcome


def evaluate(
    study: Study,
    folder: Path | None = None,
    *,
    reference: str | None = None,
    stages: Stages = SILENT,
    **how: Any,
) -> Outcome:
    """Run a study and summarise it; in a folder, write its tables and its page.

    Args:
        folder: where the study is saved, and continued; None: a temporary one.
        reference: as of ``outcome_after``. stages: told what is done.
        how: further arguments of ``study.run.run``, such as workers.
    Raises:
        InputError: the study, the folder or the reference is wrong, or no run finished. RunError: runs failed; what is
            finished is saved and written.
    """
    pairs_of(study, reference)  # refuses an unknown reference before anything runs
    with stages.runs("simulating") as progress:
        result = run(study, folder, progress=progress, allow_failures=True, **how)
    if not result.cells["there"].sum():
        raise_failures(result, kept=folder is not None)
    outcome = outcome_after(result, folder, reference=reference)
    if folder is not None and not has_report(outcome, folder):
        remove_figures(folder / PICTURES)
        write_report(outcome, folder, stages)
    raise_failures(result, kept=folder is not None)
    return outcome


def outcome_after(
    result: StudyResult, folder: Path | None = None, *, reference: str | None = None
) -> Outcome:
    """Summarise a finished study; in a folder, write its tables.

    A page of an older outcome is removed from the folder.

    Args:
        reference: see ``cell_comparison.pairs_of``.
    """
    outcome = outcome_of(result, reference)
    if folder is not None:
        if not has_report(outcome, folder):
            remove_file(folder / REPORT)
        write_outcome(outcome, folder)
    return outcome


def has_report(outcome: Outcome, folder: Path) -> bool:
    """Return whether the page of a study in a folder is that of this outcome already, whole, and of this program."""
    page = folder / REPORT
    return page.is_file() and is_made_from(page, _made_from(outcome))


def write_report(outcome: Outcome, folder: Path, stages: Stages = SILENT) -> Document:
    """Write the page of a study, and return its document."""
    document: Document = document_of(outcome)
    with stages.share("drawing") as progress:
        write_page(folder / REPORT, document, progress, _made_from(outcome))
    return document


def _made_from(outcome: Outcome) -> str:
    """Return what the page of a study is made from: its tables and its stored runs."""
    shards = sorted(outcome.result.store.shards, key=lambda shard: shard.name)
    stored = [[shard.name, dict(shard.made_by)] for shard in shards]
    return origin({"document": document_data(document_of(outcome)), "runs": stored})


def raise_failures(result: StudyResult, *, kept: bool) -> None:
    """Raise ``RunError`` if runs of a study failed; ``kept``: whether the study's folder stays."""
    if result.store.failures:
        raise RunError(failures_in_words(result.store, kept=kept))


def check_part(study: Study, shard: str | None, batch: str | None, folder: Path | None) -> Job | None:
    """Return the job of a shard, such as "3/16"; None without one.

    Raises:
        InputError: it is not of this form, or does not go together with the study, a batch or results that are not
            saved: a part of a study is of use only if it is joined with the others.
    """
    job = None if shard is None else Job.from_words(shard)
    if job is not None and study.until is not None:
        raise InputError(
            "needs a fixed number of runs, not --until: shards run independently", field="--shard"
        )
    if job is not None and batch is not None:
        raise InputError("cannot be used with --shard", field="--batch")
    if (job or batch) and folder is None:
        raise InputError("needs --out DIR", field="--shard" if job else "--batch")
    return job


def run_with_bar(
    study: Study, folder: str | Path | None, progress: Progress | bool, how: Mapping[str, Any]
) -> StudyResult:
    """Run a study as ``Study.run`` does.

    Args:
        progress: called with the progress; True shows a bar if the output is a terminal or a notebook, False none.
        how: the other keyword arguments of ``run``.
    Raises:
        The errors of ``run``.
    """
    if not isinstance(progress, bool):
        return run(study, folder, progress=progress, **how)
    from rich.console import Console
    from rich.progress import Progress as Bars

    console = Console(stderr=True)
    is_watched = console.is_terminal or console.is_jupyter
    with Bars(console=console, disable=not (progress and is_watched)) as bars:
        task = bars.add_task("simulating")
        return run(
            study,
            folder,
            progress=lambda now: bars.update(task, total=now.wanted, completed=now.done),
            **how,
        )


@dataclass(frozen=True, eq=False)
class Comparison:
    """The pairwise comparisons of a study's cells; its text is one sentence per pair."""

    outcome: Outcome

    @property
    def answers(self) -> tuple[Answer, ...]:
        """An answer for each pair of cells, with effects and their intervals."""
        return self.outcome.answers

    @property
    def sentences(self) -> list[str]:
        """Sentences about each pair of cells, and then the warnings.

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
    _kept: object = field(default=None, repr=False, compare=False)
    """The temporary folder of a study that is not saved: a notebook shows the page after the result is gone."""

    def __repr__(self) -> str:
        return f"ReportFile({str(self.path)!r})"


def compared(result: StudyResult, reference: str | None) -> Comparison:
    """Compare the selected cells pairwise.

    Args:
        reference: a value of one of the compared fields, with which the field's other values are compared. None: every
            two strategies are compared; of any other field, each value with the first one. ``cell_comparison.pairs_of``
            has the rules in full.
    """
    return Comparison(outcome_after(result, reference=reference))


def plotted(result: StudyResult, name: str, style: str) -> Picture:
    """Draw one of the figures of the study's document by its name.

    Raises:
        InputError: there is no such style, or the study has no such figure; the message lists those that it has.
    """
    figures = document_of(outcome_of(result, compare=False)).figures
    if (
        isinstance(name, str) and name not in figures
    ):  # only the figures of comparisons need the comparisons, which take longer
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
    if folder is None or folder.resolve() == result.store.root.resolve():
        return _write(result, result.store.root)
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
    outcome = outcome_of(result)
    write_outcome(outcome, folder)
    document = write_report(outcome, folder)
    write_figures(folder / PICTURES, document, "column")
    return ReportFile(folder / REPORT, result._kept)
