"""What the layers above offer to classes below them: their view as HTML in a notebook.

The package's root adds the functions (``above``), so that nothing here imports upwards.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

above: dict[str, Callable[..., Any]] = {}
"""The functions, by name."""


class NotebookView:
    """Base of what a notebook shows as HTML; texts from scenarios and files are escaped."""

    __slots__ = ()

    def _repr_html_(self) -> str:
        return str(above["html"](self))
