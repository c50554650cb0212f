"""The document of a study in a folder, from the runs that are there."""

from __future__ import annotations

from typing import Final

from vibroswarm.core.folders import has_manifest
from vibroswarm.documents.study import study_document
from vibroswarm.errors import InputError
from vibroswarm.show.document import Document
from vibroswarm.study.cell_comparison import SECOND
from vibroswarm.study.store import Store
from vibroswarm.study.study_result import StudyResult
from vibroswarm.study.summary import outcome_of

OF_CODE: Final = ("strategy.name", "network.name", "task.name")
"""Fields of a scenario that may name the user's own code."""


def results_of(store: Store) -> Document | None:
    """Return what the finished runs of a study say; None if no run is finished.

    If the folder holds a repetition of the study on other seeds (``SECOND``), the document states which comparisons are
    confirmed by it.
    """
    every_cell = tuple(cell.number for cell in store.study.cells)
    result = StudyResult(store.study, store, selected=every_cell)
    if not result.cells["there"].sum():
        return None
    second = store.folder / SECOND
    repetition = StudyResult.open(second) if has_manifest(second) else None
    # The table is there if strategies were compared at equal error when the study was run.
    equal_error = (store.folder / "equal_error.csv").is_file()
    return study_document(outcome_of(result, repetition, equal_error=equal_error))


def results_or_need(store: Store) -> tuple[Document | None, str]:
    """Return the results of a study (``results_of``) and an empty text; or None and the user's code that they need.

    Results may need a strategy, network or task of the user. Without ``--trust``, ``show`` does not run such code; then
    the results are None, and the text states which code is needed. If no run of the study is finished, the results are
    None and the text is empty.
    """
    try:
        return results_of(store), ""
    except InputError as error:
        if error.field not in OF_CODE:
            raise
        return None, str(error)
