"""The document of each kind of result: one function a kind, which terminal, page, notebook and JSON show.

Documents of several objects, such as floors side by side or a search with its scores on fresh runs, of plain tables and
lists, and of files and folders are not in ``DOCUMENTS``; commands call their functions.
"""

from __future__ import annotations

from importlib import import_module
from typing import Final

from vibroswarm.show.document import Document

DOCUMENTS: Final = {
    "vibroswarm.paper.reproduce.Reproduction": "reproduction:reproduction_document",
    "vibroswarm.search.sensitivity.Sensitivity": "search:sensitivity_document",
}
"""Module and function, by module and name of the class. Packages of results take long to import, so that each module is
imported when a document is asked for."""


def document_of(value: object) -> Document:
    """Return the document of a result, which has one, by the function of its class or nearest base class."""
    if isinstance(value, Document):
        return value
    names = [f"{kind.__module__}.{kind.__qualname__}" for kind in type(value).__mro__]
    module, _, function = next(DOCUMENTS[name] for name in names if name in DOCUMENTS).partition(":")
    document: Document = getattr(import_module(f"{__name__}.{module}"), function)(value)
    return document
