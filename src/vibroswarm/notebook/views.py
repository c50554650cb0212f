"""Notebook views of calibrations, and of everything else its document."""

from __future__ import annotations

from typing import Final

from vibroswarm.documents.notebook import html_of as document_html

LAZY: Final = ("calibrate",)
"""Packages whose views are in ``lazy_views``."""


def html_of(value: object) -> str:
    """Return the view of an object as HTML: that of its class or nearest base class, or else its document."""
    # All base classes are tried, as the class may be defined outside of this package. The final dots keep a longer name
    # with the same beginning from matching. ``lazy_views`` imports this module, so it is imported only here.
    lazy = tuple(f"vibroswarm.{package}." for package in LAZY)
    if any(f"{kind.__module__}.".startswith(lazy) for kind in type(value).__mro__):
        from vibroswarm.notebook.lazy_views import lazy_view_of

        if (view := lazy_view_of(value)) is not None:
            return view(value)
    return document_html(value)
