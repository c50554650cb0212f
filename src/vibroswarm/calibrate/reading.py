"""A statistic of recorded sessions beside the same statistic of simulated ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Reading:
    """A statistic of recorded sessions, with mean and standard deviation over simulations of them."""

    name: str
    recorded: float
    """Its value in the recorded sessions."""
    simulated: float
    """Its mean over the simulations."""
    spread: float
    """Its standard deviation over the simulations."""

    @property
    def deviation(self) -> float:
        """Recorded minus simulated value, in units of ``spread``; NaN if all simulations have the same value."""
        return (self.recorded - self.simulated) / self.spread if self.spread > 0 else np.nan


def readings_beside(recorded: dict[str, float], simulated: Sequence[dict[str, float]]) -> tuple[Reading, ...]:
    """Return the statistics of recorded sessions beside those of simulations, by name.

    A statistic is left out if it is unknown in the recordings, or in all simulations but one, as a standard deviation
    needs two values.
    """
    own = {name: np.array([statistics[name] for statistics in simulated]) for name in recorded}
    return tuple(
        Reading(name, value, float(np.nanmean(own[name])), float(np.nanstd(own[name], ddof=1)))
        for name, value in recorded.items()
        if np.isfinite(value) and np.isfinite(own[name]).sum() > 1
    )
