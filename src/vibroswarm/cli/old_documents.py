"""Printing and saving of results that have a document and no report yet."""

from __future__ import annotations

import json
import sys
from typing import TYPE_CHECKING, Any

from vibroswarm.cli import terminal
from vibroswarm.core.folders import PICTURES, REPORT

if TYPE_CHECKING:
    from vibroswarm.show.document import Document


def document_of(result: Any) -> Document:
    """Return the document of a result."""
    from vibroswarm import documents

    return documents.document_of(result)


def show(document: Document, as_json: bool) -> None:
    """Print a document."""
    if as_json:
        from vibroswarm.show.data import document_data

        print(json.dumps(document_data(document), indent=2, allow_nan=False))
        return
    from vibroswarm.show.terminal import print_document

    print_document(document, sys.stdout, terminal.width(), wide=False)
    sys.stdout.flush()


def save(document: Document, output: Any, page: str) -> None:
    """Write the page of a document, unless there is another, and pictures."""
    from vibroswarm.documents.saved import save as save_document
    from vibroswarm.show.document import without_pictures
    from vibroswarm.show.figures import write_figures

    shown = without_pictures(document) if getattr(output, "no_pictures", False) else document
    save_document(shown, output.out, "", page=page if page == REPORT else None)
    if getattr(output, "pictures", False):
        write_figures(output.out / PICTURES, document, "column")
