"""Show a public object in a session: a short text on one line, and HTML in a notebook."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from vibroswarm.core.short_text import short_text


def html_view(value: object) -> str:
    """Return what a notebook shows of a public object; everything from scenarios and files is escaped."""
    # Views draw pictures and pages, which are layers above most of these classes; so they are found by name.
    return str(import_module("vibroswarm.notebook.views").html_of(value))


class NotebookView:
    """Base of public classes: a short ``repr``, and a view as HTML."""

    __slots__ = ()

    def __init_subclass__(cls, **settings: Any) -> None:
        """Keep a dataclass from writing a ``__repr__`` with all its tables: it writes none where there is one."""
        super().__init_subclass__(**settings)
        if "__repr__" not in vars(cls):
            cls.__repr__ = cls.__repr__  # type: ignore[method-assign]

    def __repr__(self) -> str:
        return short_text(self)

    def _repr_html_(self) -> str:
        """Return what a notebook shows."""
        return html_view(self)
