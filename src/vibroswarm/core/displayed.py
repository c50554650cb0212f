"""Who writes the HTML that a notebook shows for an object: the layer above says so, so that nothing here imports it."""

from __future__ import annotations

from collections.abc import Callable

writers: list[Callable[[object], str]] = []
"""One function, which the package's root adds."""


def html_view(value: object) -> str:
    """Return the HTML that a notebook shows for a public object; texts from scenarios and files are escaped."""
    (write,) = writers
    return write(value)
