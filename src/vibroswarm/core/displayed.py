"""What layers above do with objects of those below: lay results out, and work that methods of studies offer.

The package's root adds the functions, so that nothing here imports upwards.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

Kind = TypeVar("Kind", bound=type)

above: dict[str, Callable[..., Any]] = {}
"""The functions, by name."""


def html_view(value: object) -> str:
    """Return the HTML that a notebook shows for a public object; texts from scenarios and files are escaped."""
    return str(above["html"](value))


def viewed(kind: Kind) -> Kind:
    """Give a named tuple the view of ``NotebookView``, which cannot be its base."""
    kind._repr_html_ = html_view  # type: ignore[attr-defined]
    return kind


def document_of(value: object) -> Any:
    """Return the document of a result (``vibroswarm.show.document.Document``)."""
    return above["document"](value)


def study_verbs() -> Any:
    """Return ``vibroswarm.study.study_outputs``, the functions behind methods of ``Study`` and ``StudyResult``."""
    return above["study verbs"]()
