"""What ``StudyResult`` offers an interactive session: comparison, picture, report, and tables of pandas and xarray.

The functions here do the work of the methods of ``StudyResult``. Pandas and xarray are optional dependencies.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Final

import polars as pl

from vibroswarm.core.atomic_io import OURS, whole_folder
from vibroswarm.core.displayed import document_of
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.errors import InputError, check_choice
from vibroswarm.plots.picture import Picture
from vibroswarm.show.document import Document
from vibroswarm.show.figures import write_figures
from vibroswarm.show.page import write_page
from vibroswarm.study.answers import Answer
from vibroswarm.study.baselines import references_of
from vibroswarm.study.cell_comparison import comparison_table, second_block
from vibroswarm.study.summary import Outcome, outcome_of, write_outcome

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from vibroswarm.study.study_result import StudyResult


REPORT: Final = "report.html"
"""Name of the page."""
PICTURES: Final = "pictures"
"""Name of the folder of pictures, beside the page."""


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
        if not self.outcome.comparisons:
            return pl.DataFrame()
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
    replicate = second_block(result) if confirm else None
    outcome = outcome_of(result, replicate=replicate, reference=reference, equal_error=equal_error)
    return Comparison(outcome)


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
    outcome = outcome_of(result, equal_error=equal_error)
    outcome = replace(outcome, references=tuple(references_of(result)))
    write_outcome(outcome, folder)
    document = document_of(outcome)
    write_page(folder / REPORT, document)
    write_figures(folder / PICTURES, document, "column")
    return ReportFile(folder / REPORT)


def pandas_of(frame: pl.DataFrame) -> pd.DataFrame:
    """Convert a table to pandas.

    Raises:
        InputError: pandas or pyarrow is not installed.
    """
    # Both are imported only to check that they are installed: the ``to_pandas`` of polars needs them.
    try:
        import pandas  # noqa: F401
        import pyarrow  # noqa: F401
    except ImportError as error:
        raise _missing(error, "to_pandas") from None
    return frame.to_pandas()


def dataset_of(result: StudyResult, table: str) -> xr.Dataset:
    """Convert a table of a study to an xarray Dataset, see ``StudyResult.to_xarray``.

    Its dimensions are the varied fields; then ``run`` for the tables ``runs``, ``robots`` and ``samples``; then
    ``robot`` for the last two of them; then ``sample`` for the table ``samples``. Without varied fields, the table
    ``cells`` has the dimension ``index``. Values are missing where the table has no row, for instance if no cell has a
    combination of varied values.

    Args:
        table: name of the table, see ``StudyResult.to_pandas``.
    Raises:
        InputError: several cells have the same varied values, so that their rows have the same place in the dimensions;
            xarray is not installed; or ``StudyResult.to_pandas`` raises it.
    """
    try:
        import xarray
    except ImportError as error:
        raise _missing(error, "to_xarray") from None
    # The index of the data frame, which xarray turns into the dimensions.
    of_table = {"runs": ["run"], "robots": ["run", "robot"], "samples": ["run", "robot", "sample"]}
    index = [*result.study.varied, *of_table.get(table, [])]
    frame = result.to_pandas(table).drop(columns="cell")  # a cell is given by its varied values
    for name in frame.select_dtypes("category"):  # xarray has no categories
        frame[name] = frame[name].astype(str)
    indexed = frame.set_index(index) if index else frame
    if not indexed.index.is_unique:
        raise InputError("several cells have the same varied values", field="to_xarray")
    return xarray.Dataset.from_dataframe(indexed)


def _missing(error: ImportError, field: str) -> InputError:
    """Return the error for an optional package that is not installed; it says how to install it."""
    return InputError(f"needs {error.name}: pip install 'vibroswarm[frames]'", field=field)
