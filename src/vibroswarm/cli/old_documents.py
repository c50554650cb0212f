"""Printing and saving of results that have a document and no report yet."""

from __future__ import annotations

import json
import sys
from typing import Any

from vibroswarm.cli import terminal


def report_of(result: Any, **options: Any) -> Any:
    """Return the report of a result, or its document."""
    from vibroswarm import documents
    from vibroswarm.report.report import report

    if is_old(result):
        return result
    try:
        return report(result, **options)
    except (ModuleNotFoundError, TypeError):
        return documents.document_of(result)


def is_old(report: Any) -> bool:
    """Return whether a report is a document."""
    from vibroswarm.show.document import Document

    return isinstance(report, Document)


def show(document: Any, as_json: bool) -> None:
    """Print a document."""
    if as_json:
        from vibroswarm.show.data import document_data

        print(json.dumps(document_data(document), indent=2, allow_nan=False))
        return
    from vibroswarm.show.terminal import print_document

    print_document(document, sys.stdout, terminal.width(), wide=False)
    sys.stdout.flush()


def save(document: Any, output: Any, page: str) -> None:
    """Write the page of a document, unless there is another, and pictures."""
    from vibroswarm.core.folders import PICTURES, REPORT
    from vibroswarm.documents.saved import save as save_document
    from vibroswarm.show.document import without_pictures
    from vibroswarm.show.figures import write_figures

    shown = without_pictures(document) if getattr(output, "no_pictures", False) else document
    save_document(shown, output.out, "", page=page if page == REPORT else None)
    if getattr(output, "pictures", False):
        write_figures(output.out / PICTURES, document, "column")
