"""Import libraries of the package's extras, which need not be installed."""

from __future__ import annotations

import importlib
import importlib.util
from typing import Any, Final

from vibroswarm.errors import InputError

NAMES: Final = {"sklearn": "scikit-learn"}
"""Names of libraries whose modules are named otherwise."""


def needed(library: str, extra: str, what: str) -> Any:
    """Import a library of an extra of this package.

    Args:
        library: its module. extra: extra of this package that installs it. what: field or option that needs it.
    Raises:
        InputError: it is not installed; the message names ``what``.
    """
    try:
        return importlib.import_module(library)
    except ImportError:
        raise InputError(f"needs {_words(library)}: pip install 'vibroswarm[{extra}]'", field=what) from None


def lacking(library: str, extra: str) -> str | None:
    """Return a sentence that a library of an extra is not installed; None if it is."""
    if importlib.util.find_spec(library) is not None:
        return None
    return f"It needs {_words(library)}: pip install 'vibroswarm[{extra}]'."


def _words(library: str) -> str:
    package = library.partition(".")[0]
    return NAMES.get(package, package)
