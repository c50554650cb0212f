"""Train boosted trees to tell real from simulated undisturbed intervals, by turn and distance alone.

Two splits of two sessions: other robots (train on all but one, test on it, each in turn), and the same robots (train on
all minutes but every fifth, test on these, in turn). The second sees each robot's own veer and speed, and is the harder
test for a simulator. Real sessions of the same robots differ too: how well they are told from each other is the figure
to hold it against. Reported is the balanced accuracy; 0.5 is chance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.calibrate.boosting import boosted_accuracy
from vibroswarm.calibrate.undisturbed import undisturbed

Floats = NDArray[np.float64]
FEATURES: Final = ("turn_rad", "distance_m")
MINUTE_S: Final = 60.0
FOLDS: Final = 5
LEAST: Final = 200
"""Fewest undisturbed intervals of a session."""


@dataclass(frozen=True)
class Told:
    """Balanced accuracies of pairs of sessions, by split."""

    same_robots: tuple[float, ...]
    other_robots: tuple[float, ...]

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {"same_robots": list(self.same_robots), "other_robots": list(self.other_robots)}


@dataclass(frozen=True)
class IntervalAccuracy:
    """How well undisturbed intervals are told apart: real from simulated, and real sessions from each other.

    ``by_feature``: real from simulated with the same robots, by one feature alone; mean over pairs.
    """

    simulated: Told
    real: Told
    by_feature: dict[str, float]

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {
            "simulated": self.simulated.as_dict(),
            "real": self.real.as_dict(),
            "by_feature": self.by_feature,
        }


def interval_accuracy(
    real: Sequence[pl.DataFrame], simulated: Sequence[pl.DataFrame]
) -> IntervalAccuracy | None:
    """Train and test on all pairs of sessions; None if one has fewer than ``LEAST`` undisturbed intervals.

    Args:
        real, simulated: sessions (``features.sessions_of``).
    """
    a, b = ([undisturbed(session) for session in sessions] for sessions in (real, simulated))
    if min(session.height for session in (*a, *b)) < LEAST:
        return None
    across = [(one, other) for one in a for other in b]
    return IntervalAccuracy(
        simulated=_told(across),
        real=_told(list(combinations(a, 2))),
        by_feature={
            name: float(np.mean([same_robots(one, other, (name,)) for one, other in across]))
            for name in FEATURES
        },
    )


def _told(pairs: Sequence[tuple[pl.DataFrame, pl.DataFrame]]) -> Told:
    return Told(
        tuple(same_robots(one, other) for one, other in pairs),
        tuple(other_robots(one, other) for one, other in pairs),
    )


def same_robots(one: pl.DataFrame, other: pl.DataFrame, features: Sequence[str] = FEATURES) -> float:
    """Return the accuracy on minutes not trained on, of the same robots; two sessions of ``undisturbed``."""
    rows = [session.select(features).to_numpy() for session in (one, other)]
    folds = [(session["time_s"] // MINUTE_S).to_numpy() % FOLDS for session in (one, other)]
    shares = []
    for fold in range(FOLDS):
        train, test = (
            tuple(own[(of == fold) == held] for own, of in zip(rows, folds, strict=True))
            for held in (False, True)
        )
        if min(map(len, (*train, *test))):
            shares.append(boosted_accuracy((train[0], train[1]), (test[0], test[1])))
    return float(np.mean(shares)) if shares else np.nan


def other_robots(one: pl.DataFrame, other: pl.DataFrame) -> float:
    """Return the accuracy on robots not trained on; two sessions of ``undisturbed``."""
    shares = []
    for robot in sorted(set(one["robot"]) & set(other["robot"])):
        held = pl.col("robot") == robot
        train = [session.filter(~held).select(FEATURES).to_numpy() for session in (one, other)]
        test = [session.filter(held).select(FEATURES).to_numpy() for session in (one, other)]
        if min(map(len, (*train, *test))):
            shares.append(boosted_accuracy((train[0], train[1]), (test[0], test[1])))
    return float(np.mean(shares)) if shares else np.nan
