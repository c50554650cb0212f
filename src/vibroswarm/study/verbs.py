"""What users do with a study and its result: methods of ``Study`` and ``StudyResult`` call functions that stand above.

The package's root adds where those functions are (``study_outputs``), so that nothing here imports upwards.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

providers: list[Callable[[], Any]] = []
"""One function, which the package's root adds; it returns the module ``study_outputs``."""


def verbs() -> Any:
    """Return the module of the functions; it is imported when this is called for the first time."""
    (provide,) = providers
    return provide()
