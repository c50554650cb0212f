"""Run until a figure is precise enough: its interval is computed ("a look") after 100, 200, 400, ... runs.

Looking repeatedly is corrected for. The interval of look k = 1, 2, ... has the level 1 - a_k with
a_k = (1 - level) 6 / (pi k)^2 (1). The a_k sum to 1 - level, so all intervals together hold at the level, whatever the
number of looks. So the last interval is valid, although it was chosen because it was the first that is narrow enough.
Runs that are nearly alike have a narrow interval, whatever rarely happens. So the runs of a mean must also be so many
that the upper limit of what happened in none of them, times how far runs can be apart, if this is known, is within the
precision.
A group of cells needs no more runs ("is settled") once the figure is precise enough in each of its cells, or once it
has the most runs that are allowed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from decimal import Decimal
from typing import Any, Final

from vibroswarm.analysis import figures
from vibroswarm.analysis.intervals import Interval, check_level, wilson_limits
from vibroswarm.errors import InputError, check_choice, keep_plain, share_from, whole_number_of

FIRST_LOOK: Final = 100
"""Number of runs at the first look; it doubles from look to look."""
MOST: Final = 100_000
"""Most runs of a cell unless the study says otherwise."""
LEVEL: Final = 0.95
"""Level of confidence unless the study says otherwise."""

FIGURES: Final = tuple(
    figure.name
    for figure in figures.FIGURES
    if figure.kind != "median" and figure.by_run not in figures.FOLLOWED
)
"""Figures for which a precision can be wanted."""
RENAMED: Final = {
    "right": "robots_right",
    "wrong": "robots_wrong",
    "undecided": "robots_undecided",
    "consensus_right": "swarm_right",
    "consensus_wrong": "swarm_wrong",
}
"""Names that figures had in earlier versions."""


@dataclass(frozen=True)
class Precision:
    """The wanted half-width of a figure's interval, and the most runs that may be made for it.

    Args:
        half_width: between 0 and 1, as a float; relative to the figure for a time and a number of messages, absolute
            for the others (0.02 of a share is two percentage points).
        figure: one of ``FIGURES``. max_runs: most runs of a cell. level: of all intervals together, between 0 and 1.
    Raises:
        InputError: one of them is wrong; the message says what would be right.
    """

    half_width: float
    figure: str = "decision_time_s"
    max_runs: int = MOST
    level: float = LEVEL

    def __post_init__(self) -> None:
        keep_plain(self)
        if not (isinstance(self.half_width, float) and 0 < self.half_width < 1):
            raise InputError(
                f"{self.half_width!r} is wrong; give a share above 0 and below 1, such as 0.02",
                field="half_width",
            )
        if self.figure in RENAMED:
            raise InputError(f"'{self.figure}' is called '{RENAMED[self.figure]}' now", field="figure")
        check_choice(self.figure, "figure", FIGURES)
        whole_number_of(self.max_runs, "max_runs", low=FIRST_LOOK, high=10**9)
        check_level(self.level)

    @classmethod
    def from_words(cls, text: Any, figure: Any = None, max_runs: Any = None, level: Any = None) -> Precision:
        """Make a precision from its half-width as text (``"2%"``).

        Args:
            figure, max_runs, level: as in ``Precision``; None: the default.
        """
        return cls(
            half_width=share_from(text, "until"),
            figure="decision_time_s" if figure is None else figure,
            max_runs=MOST if max_runs is None else max_runs,
            level=LEVEL if level is None else level,
        )

    def as_values(self) -> dict[str, Any]:
        """Return the precision as entries of a study's file: ``{"until": "2%", "figure": ..., "max_runs": ...}``.

        ``level`` is among them if it is not the default.
        """
        # The decimal is made from the float's shortest text, so that 0.07 is 7 % and not 7.000000000000001 %.
        per_cent = f"{100 * Decimal(repr(self.half_width)):f}"
        short = per_cent.rstrip("0").rstrip(".") if "." in per_cent else per_cent
        level = {} if self.level == LEVEL else {"level": self.level}
        return {"until": f"{short}%", "figure": self.figure, "max_runs": self.max_runs, **level}

    def looks(self) -> Iterator[int]:
        """Yield the number of runs at each look: 100, 200, 400, ... and finally ``max_runs``."""
        runs = FIRST_LOOK
        while runs < self.max_runs:
            yield runs
            runs *= 2
        yield self.max_runs

    def level_at(self, look: int) -> float:
        """Return the level of the interval at a look, which is counted from 0 here: equation (1) with k = look + 1."""
        return 1.0 - (1.0 - self.level) * 6.0 / (math.pi * (look + 1)) ** 2

    def reached(self, found: Interval, t_end_s: float) -> bool:
        """Return whether an interval is narrow enough; one of width 0 is not, as it comes from too few data.

        Limits that are infinite or nan, as those of a figure with one value or none, are not narrow enough either. Nor
        are those of a mean that values which did not occur may move further: of 100 runs that end within 50 s of each
        other, none may be one of the 1 % in which robots stay undecided.

        Args:
            found: interval of the figure, over runs. t_end_s: end of the runs, s.
        """
        figure, width = figures.BY_NAME[self.figure], found.high - found.low
        is_relative = figure.unit == "s" or self.figure == "sent"
        target = self.half_width * abs(found.estimate) if is_relative else self.half_width
        apart = t_end_s if figure.unit == "s" else figure.most_apart  # nan: not known
        unseen = apart * float(wilson_limits(0, found.n, found.level)[1]) if figure.kind == "mean" else 0.0
        return 0.0 < width / 2.0 <= target and not unseen > target
