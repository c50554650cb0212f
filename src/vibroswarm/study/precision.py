"""Runs until a figure is known well enough: looks at 100, 200, 400, ... runs, corrected for the looks.

The interval of look k is at the level 1 - a_k with a_k = (1 - level) 6 / (pi k)^2. These sum to 1 - level, so that all
intervals together hold at the level, however many looks there are, and the last one is honest although it was the first
that was narrow enough.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from typing import Any, Final

from vibroswarm.errors import InputError, nearest

FIRST_LOOK: Final = 100
MOST: Final = 100_000

TIMES: Final = ("decision_time_s", "consensus_time_s")
SHARES: Final = ("right", "wrong", "undecided", "consensus_right", "consensus_wrong", "belief_in_truth")
FIGURES: Final = (*TIMES, *SHARES)


@dataclass(frozen=True)
class Precision:
    """Half the width of a figure's interval that is wanted.

    Args:
        half_width: relative to the figure for a time, absolute for a share (0.02 is two points of a hundred).
        figure: one of ``FIGURES``. max_runs: no more runs a cell than this. level: of the interval.
    """

    half_width: float
    figure: str = "decision_time_s"
    max_runs: int = MOST
    level: float = 0.95

    def __post_init__(self) -> None:
        if not (isinstance(self.half_width, float) and 0 < self.half_width < 1):
            raise InputError(f"{self.half_width!r} is no precision; such as 2%", field="until")
        if self.figure not in FIGURES:
            raise InputError(
                f"there is no such figure{nearest(str(self.figure), FIGURES)} (there are {', '.join(FIGURES)})",
                field="figure",
            )
        whole = isinstance(self.max_runs, int) and not isinstance(self.max_runs, bool)
        if not whole or self.max_runs < FIRST_LOOK:
            raise InputError(f"{self.max_runs!r} is too few; at least {FIRST_LOOK}", field="max_runs")

    @classmethod
    def from_words(cls, text: Any, figure: Any = None, max_runs: Any = None) -> Precision:
        """From ``"2%"``, and what else is given."""
        share = share_from(text, "until")
        return cls(
            share, "decision_time_s" if figure is None else figure, MOST if max_runs is None else max_runs
        )

    def as_values(self) -> dict[str, Any]:
        """As a study's file has it."""
        per_cent = f"{100 * Decimal(repr(self.half_width)):f}"
        short = per_cent.rstrip("0").rstrip(".") if "." in per_cent else per_cent
        return {"until": f"{short}%", "figure": self.figure, "max_runs": self.max_runs}

    def looks(self) -> Iterator[int]:
        """100, 200, 400, ... and at last ``max_runs``."""
        runs = FIRST_LOOK
        while runs < self.max_runs:
            yield runs
            runs *= 2
        yield self.max_runs

    def level_at(self, look: int) -> float:
        """The level of the interval of look 0, 1, ..."""
        return 1.0 - (1.0 - self.level) * 6.0 / (math.pi * (look + 1)) ** 2

    def reached(self, estimate: float, low: float, high: float) -> bool:
        """Whether the interval is narrow enough; one without a width is not known, and never is."""
        wanted = self.half_width * abs(estimate) if self.figure in TIMES else self.half_width
        return 0.0 < (high - low) / 2.0 <= wanted


def share_from(text: Any, field: str) -> float:
    """The share that ``"2%"`` says.

    Raises:
        InputError: no number with a per cent sign, or not between 0 % and 100 %.
    """
    share = math.nan
    if isinstance(text, str) and text.strip().endswith("%"):
        with suppress(InvalidOperation):  # 21.9 hundredths are 0.219
            share = float(Decimal(text.strip()[:-1]) / 100)
    if not 0 < share < 1:
        raise InputError(f"{text!r} is no share; write it with a per cent sign, such as 2%", field=field)
    return share
