"""Run until a figure is precise enough: its interval is computed ("a look") after 100, 200, 400, ... runs.

Looking repeatedly is corrected for. The interval of look k = 1, 2, ... has the level 1 - a_k with
a_k = (1 - level) 6 / (pi k)^2 (1). The a_k sum to 1 - level, so all intervals together hold at the level. Runs of a
mean must also be so many that what happened in none of them cannot move it by more than the precision.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

from vibroswarm.errors import InputError, check_choice, share_from, whole_number_of
from vibroswarm.statistics import figures
from vibroswarm.statistics.intervals import Interval, wilson_limits

FIRST_LOOK: Final = 100
"""Number of runs at the first look; it doubles from look to look."""
MOST: Final = 100_000
"""Most runs of a cell unless the study says otherwise."""
LEVEL: Final = 0.95
"""Level of all intervals of a cell together."""
FIGURES: Final = tuple(
    figure.name
    for figure in figures.FIGURES
    if figure.kind != "median" and figure.by_run not in figures.FOLLOWED
)
"""Figures for which a precision can be wanted."""


class Settled(NamedTuple):
    """How far cells that share motion are at their last look."""

    runs: int
    """Number of runs at that look."""
    level: float
    """Level of the interval at that look, which is the one to report."""
    reached: bool
    """Whether the figure is precise enough in each cell."""


@dataclass(frozen=True)
class Precision:
    """The wanted half-width of a figure's interval, and the most runs that may be made for it.

    Args:
        half_width: between 0 and 1; relative to the figure for a time and a number of messages, else absolute.
        figure: one of ``FIGURES``. max_runs: most runs of a cell.
    """

    half_width: float
    figure: str = "decision_time_s"
    max_runs: int = MOST

    def __post_init__(self) -> None:
        if not 0 < self.half_width < 1:
            raise InputError(
                f"{self.half_width!r} is no share above 0 and below 1, such as 0.02", field="until"
            )
        check_choice(self.figure, "figure", FIGURES)
        whole_number_of(self.max_runs, "max_runs", low=FIRST_LOOK, high=10**9)

    @classmethod
    def of(cls, until: Any, **others: Any) -> Precision:
        """Make a precision from its half-width as text (``"2%"``); others that are None have their default."""
        return cls(
            share_from(until, "until"), **{name: one for name, one in others.items() if one is not None}
        )

    def as_values(self) -> dict[str, Any]:
        """Return the precision as entries of a study's file."""
        return {
            "until": f"{100 * self.half_width:.12g}%",
            "figure": self.figure,
            "max_runs": self.max_runs,
        }

    def looks(self) -> Iterator[int]:
        """Yield the number of runs at each look: 100, 200, 400, ... and finally ``max_runs``."""
        runs = FIRST_LOOK
        while runs < self.max_runs:
            yield runs
            runs *= 2
        yield self.max_runs

    def level_at(self, look: int) -> float:
        """Return the level of the interval at a look, which is counted from 0 here: equation (1) with k = look + 1."""
        return 1.0 - (1.0 - LEVEL) * 6.0 / (math.pi * (look + 1)) ** 2

    def reached(self, found: Interval, t_end_s: float) -> bool:
        """Return whether an interval is narrow enough; one of width 0 is not, as it comes from too few data.

        Nor is that of a mean if values that did not occur, up to ``t_end_s`` (s) away, could move it further.
        """
        figure, width = figures.BY_NAME[self.figure], found.high - found.low
        is_relative = figure.unit == "s" or self.figure == "sent"
        target = self.half_width * abs(found.estimate) if is_relative else self.half_width
        apart = t_end_s if figure.unit == "s" else figure.most_apart  # nan: not known
        unseen = apart * float(wilson_limits(0, found.n, found.level)[1]) if figure.kind == "mean" else 0.0
        return 0.0 < width / 2.0 <= target and not unseen > target
