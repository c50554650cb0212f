"""What is inferred from logs: a setting with its range and evidence."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

STOP_S: Final = 1.0
"""Duration of a stop of the study's robots, s; ``infer_strategy`` takes every stop to last so long."""


@dataclass(frozen=True)
class Inferred:
    """One inferred setting."""

    name: str
    """Field of the scenario."""
    value: Any
    """None: undetermined."""
    low: float | None
    """Lower bound of the value; None if there are no bounds."""
    high: float | None
    """Upper bound of the value; None if there are no bounds."""
    evidence: str
    """The evidence in words, or the reason why there is no value."""


def undetermined(name: str, evidence: str) -> Inferred:
    """Return a setting without value and bounds, with the reason in ``evidence``."""
    return Inferred(name, value=None, low=None, high=None, evidence=evidence)
