"""What users do with a study and its result: methods of ``Study`` and ``StudyResult`` call functions that stand above.

The package's root adds where those functions are (``study_outputs``), so that nothing here imports upwards.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol


class Verbs(Protocol):
    """The functions of ``study_outputs`` that do the work of methods."""

    run_with_bar: Callable[..., Any]
    summarised: Callable[..., Any]
    compared: Callable[..., Any]
    plotted: Callable[..., Any]
    reported: Callable[..., Any]


providers: list[Callable[[], Any]] = []
"""One function, which the package's root adds; it returns an object with all ``Verbs``."""


def verbs() -> Verbs:
    """Return the functions; their module is imported when this is called for the first time."""
    (provide,) = providers
    found: Verbs = provide()
    return found
