"""Show a public object as HTML in a notebook."""

from __future__ import annotations

from importlib import import_module


class NotebookView:
    """Base of public classes that a notebook shows as HTML."""

    __slots__ = ()

    def _repr_html_(self) -> str:
        """Return what a notebook shows; everything from scenarios and files is escaped."""
        # Views draw pictures and pages, which are layers above most of these classes; so they are found by name.
        return str(import_module("vibroswarm.notebook.views").html_of(self))
