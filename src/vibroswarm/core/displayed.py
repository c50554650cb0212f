"""Who lays results out, as documents and as HTML: the layer above says so, so that nothing here imports it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

writers: list[Callable[[object], str]] = []
"""One function, which the package's root adds."""


def html_view(value: object) -> str:
    """Return the HTML that a notebook shows for a public object; texts from scenarios and files are escaped."""
    (write,) = writers
    return write(value)


makers: list[Callable[[object], Any]] = []
"""One function, which the package's root adds."""


def document_of(value: object) -> Any:
    """Return the document of a result (``vibroswarm.show.document.Document``)."""
    (make,) = makers
    return make(value)
