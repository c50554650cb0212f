"""Import libraries of the package's extras, which need not be installed."""

from __future__ import annotations

import importlib
from typing import Any

from vibroswarm.errors import InputError


def needed(library: str, extra: str, what: str) -> Any:
    """Import a library of an extra of this package."""
    try:
        return importlib.import_module(library)
    except ImportError:
        raise InputError(f"needs {library}: pip install 'vibroswarm[{extra}]'", field=what) from None
