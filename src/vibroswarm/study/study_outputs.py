"""What a study's result gives to a session: a comparison in sentences, a picture, a report, and tables of other kinds.

Pandas and xarray, to which tables are converted, are optional.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import polars as pl

from vibroswarm.core.atomic_io import whole_folder
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.errors import InputError, check_choice
from vibroswarm.plots.picture import Picture
from vibroswarm.study.answers import Answer, cell_sentences
from vibroswarm.study.baselines import references_of
from vibroswarm.study.cell_comparison import comparison_table, second_block
from vibroswarm.study.pictures import pictures_of
from vibroswarm.study.study_report import REPORT, write_pictures_and_report
from vibroswarm.study.summary import Outcome, outcome_of, write_outcome

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from vibroswarm.study.study_result import StudyResult


@dataclass(frozen=True, eq=False)
class Comparison(NotebookView):
    """The pairwise comparisons of a study's cells; its text is one sentence per pair."""

    outcome: Outcome

    @property
    def answers(self) -> tuple[Answer, ...]:
        """One for each pair of cells, with effects and their intervals."""
        return self.outcome.answers

    @property
    def sentences(self) -> list[str]:
        """Sentences on each pair, also at equal error if computed; on each cell if none are compared; then warnings."""
        lines = [line for one in self.answers for line in (one.sentence, one.at_equal_error) if line]
        lines = lines or cell_sentences(self.outcome.cells)
        return lines + [f"Warning: {words}" for words in self.outcome.warnings]

    @property
    def table(self) -> pl.DataFrame:
        """One row per pair and figure: means, difference with interval, corrected p-value; empty without pairs."""
        if not self.outcome.comparisons:
            return pl.DataFrame()
        return comparison_table(self.outcome.comparisons)

    def __repr__(self) -> str:
        return "\n".join([self.outcome.question, *self.sentences])


@dataclass(frozen=True)
class ReportFile(NotebookView):
    """A report that was written."""

    path: Path
    """Of the page, which opens in a browser."""

    def __repr__(self) -> str:
        return f"ReportFile({str(self.path)!r})"


def compared(result: StudyResult, reference: str | None, confirm: bool) -> Comparison:
    """Compare cells, after repeating the study on other seeds if ``confirm``."""
    return Comparison(outcome_of(result, second_block(result) if confirm else None, reference))


def plotted(result: StudyResult, name: str, style: str) -> Picture:
    """Draw the picture of that name of ``pictures_of``.

    Raises:
        InputError: the study has no such picture; the message lists those that it has.
    """
    named = {picture.name: picture for picture in pictures_of(outcome_of(result, compare=False))}
    if name not in named:  # comparisons replay runs, which takes longer
        named = {picture.name: picture for picture in pictures_of(outcome_of(result))}
    check_choice(name, "name", named)
    return named[name].draw(style=style)


def reported(result: StudyResult, folder: Path | None, replace: bool) -> ReportFile:
    """Write tables, pictures and report into ``folder``, or into the study's own.

    Raises:
        InputError: the folder exists and may not be replaced, or cannot be written.
    """
    if folder is None:
        return _write(result, result.store.folder)
    with whole_folder(folder, replace=replace, marker=REPORT) as part:
        _write(result, part)
    return ReportFile(folder / REPORT)


def _write(result: StudyResult, folder: Path) -> ReportFile:
    outcome = outcome_of(result)
    write_outcome(outcome, folder)
    write_pictures_and_report(outcome, references_of(result), folder, "column")
    return ReportFile(folder / REPORT)


def pandas_of(frame: pl.DataFrame) -> pd.DataFrame:
    """Convert a table to pandas.

    Raises:
        InputError: pandas or pyarrow is not installed.
    """
    try:
        import pandas  # noqa: F401
        import pyarrow  # noqa: F401
    except ImportError as error:
        raise _missing(error, "to_pandas") from None
    return frame.to_pandas()


def dataset_of(result: StudyResult, table: str) -> xr.Dataset:
    """Convert a table of a study to an xarray Dataset, see ``StudyResult.to_xarray``.

    Raises:
        InputError: the cells form no grid of the varied fields, or xarray is not installed.
    """
    try:
        import xarray
    except ImportError as error:
        raise _missing(error, "to_xarray") from None
    index = [
        *result.study.varied,
        *(["run"] if table in ("runs", "robots") else []),
        *(["robot"] if table == "robots" else []),
    ]
    frame = result.to_pandas(table).drop(columns="cell")
    for name in frame.select_dtypes("category"):
        frame[name] = frame[name].astype(str)
    indexed = frame.set_index(index) if index else frame
    if not indexed.index.is_unique:
        raise InputError("several cells have the same varied values", field="to_xarray")
    return xarray.Dataset.from_dataframe(indexed)


def _missing(error: ImportError, field: str) -> InputError:
    """Return the error that names the package that is missing, and the extra that has it."""
    return InputError(f"needs {error.name}: pip install 'vibroswarm[frames]'", field=field)
