"""Who lays results out, as documents and as HTML: the layer above says so, so that nothing here imports it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

Kind = TypeVar("Kind", bound=type)

writers: list[Callable[[object], str]] = []
"""One function, which the package's root adds."""


def html_view(value: object) -> str:
    """Return the HTML that a notebook shows for a public object; texts from scenarios and files are escaped."""
    (write,) = writers
    return write(value)


def viewed(kind: Kind) -> Kind:
    """Give a named tuple the view of ``NotebookView``, which cannot be its base."""
    kind._repr_html_ = html_view  # type: ignore[attr-defined]
    return kind


makers: list[Callable[[object], Any]] = []
"""One function, which the package's root adds."""


def document_of(value: object) -> Any:
    """Return the document of a result (``vibroswarm.show.document.Document``)."""
    (make,) = makers
    return make(value)
