"""What is inferred from logs: a setting with its range and evidence; and the intervals between samples."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

from vibroswarm.core.arrays import Bools, Floats, Ints

STOP_S: Final = 1.0
"""Duration of a stop of the study's robots, s. ``infer_tau`` uses it only if times spent standing are not logged,
``infer_strategy`` always."""


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


@dataclass(frozen=True)
class Intervals:
    """All samples, with the changes since the previous sample of the same robot; (samples,) each.

    They are ordered by session, robot and time. A change is nan if its column is not logged. At a robot's first row it
    is nan too, except that alpha and beta at sample 0 grow from the prior, and the messages received from 0.
    """

    session: Ints
    """Index of the sample's log."""
    robot: Ints
    """Number of the robot in the log."""
    time_s: Floats
    """Time of the sample's row, s."""
    energy: Floats
    """Energy of the sample."""
    new_alpha: Floats
    """Growth of alpha since the previous sample."""
    new_beta: Floats
    """Growth of beta since the previous sample."""
    new_received: Floats
    """Messages received since the previous sample."""
    whole: Bools
    """Whether no row is missing between this sample and the previous one (before sample 0: none). It is true for all
    samples of a log without the count of messages sent, since lost rows cannot be detected there."""
    spacing_s: Floats
    """Time since the previous sample, s."""
    avoid_s: Floats
    """Time spent avoiding since the previous sample, s."""
    stop_s: Floats
    """Time spent standing since the previous sample, s."""
