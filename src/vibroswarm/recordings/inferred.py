"""What is inferred from logs: a setting with its range and evidence; and the intervals between samples."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

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

    session: NDArray[np.int64]
    """Index of the sample's log."""
    robot: NDArray[np.int64]
    """Number of the robot in the log."""
    time_s: NDArray[np.float64]
    """Time of the sample's row, s."""
    energy: NDArray[np.float64]
    """Energy of the sample."""
    new_alpha: NDArray[np.float64]
    """Growth of alpha since the previous sample."""
    new_beta: NDArray[np.float64]
    """Growth of beta since the previous sample."""
    new_received: NDArray[np.float64]
    """Messages received since the previous sample."""
    whole: NDArray[np.bool_]
    """Whether no row is missing between this sample and the previous one (before sample 0: none). It is true for all
    samples of a log without the count of messages sent, since lost rows cannot be detected there."""
    spacing_s: NDArray[np.float64]
    """Time since the previous sample, s."""
    avoid_s: NDArray[np.float64]
    """Time spent avoiding since the previous sample, s."""
    stop_s: NDArray[np.float64]
    """Time spent standing since the previous sample, s."""
