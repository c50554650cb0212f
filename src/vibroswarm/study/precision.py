"""Run until a figure is precise enough: looks at 100, 200, 400, ... runs, corrected for repeated looks.

The interval of look k has the level 1 - a_k with a_k = (1 - level) 6 / (pi k)^2 (1). The a_k sum to 1 - level, so all
intervals hold together at the level, whatever the number of looks; the last one is valid although it was chosen for
being the first that is narrow enough.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from typing import Any, Final

from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.errors import InputError, check_choice, whole_number_of

FIRST_LOOK: Final = 100
MOST: Final = 100_000

TIMES: Final = ("decision_time_s", "consensus_time_s")
SHARES: Final = ("right", "wrong", "undecided", "consensus_right", "consensus_wrong", "belief_in_truth")
FIGURES: Final = (*TIMES, *SHARES)


@dataclass(frozen=True)
class Precision(NotebookView):
    """The wanted half-width of a figure's interval.

    Args:
        half_width: relative to the figure for a time, absolute for a share (0.02 is two percentage points).
        figure: one of ``FIGURES``. max_runs: most runs of a cell. level: of the interval.
    """

    half_width: float
    figure: str = "decision_time_s"
    max_runs: int = MOST
    level: float = 0.95

    def __post_init__(self) -> None:
        if not (isinstance(self.half_width, float) and 0 < self.half_width < 1):
            raise InputError(
                f"{self.half_width!r} is not a precision; give a percentage such as 2%", field="until"
            )
        check_choice(self.figure, "figure", FIGURES)
        whole_number_of(self.max_runs, "max_runs", FIRST_LOOK, 10**9)

    @classmethod
    def from_words(cls, text: Any, figure: Any = None, max_runs: Any = None) -> Precision:
        """Parse ``"2%"``, with an optional figure and limit of runs."""
        share = share_from(text, "until")
        return cls(
            share, "decision_time_s" if figure is None else figure, MOST if max_runs is None else max_runs
        )

    def as_values(self) -> dict[str, Any]:
        """Return the entries of a study's file."""
        per_cent = f"{100 * Decimal(repr(self.half_width)):f}"
        short = per_cent.rstrip("0").rstrip(".") if "." in per_cent else per_cent
        return {"until": f"{short}%", "figure": self.figure, "max_runs": self.max_runs}

    def looks(self) -> Iterator[int]:
        """Yield 100, 200, 400, ... and finally ``max_runs``."""
        runs = FIRST_LOOK
        while runs < self.max_runs:
            yield runs
            runs *= 2
        yield self.max_runs

    def level_at(self, look: int) -> float:
        """Return the level of the interval at look 0, 1, ..., equation (1) with k = look + 1."""
        return 1.0 - (1.0 - self.level) * 6.0 / (math.pi * (look + 1)) ** 2

    def reached(self, estimate: float, low: float, high: float) -> bool:
        """Tell whether the interval is narrow enough; one of width 0 never is, since it comes from too few data."""
        target = self.half_width * abs(estimate) if self.figure in TIMES else self.half_width
        return 0.0 < (high - low) / 2.0 <= target


def share_from(text: Any, field: str) -> float:
    """Parse a share such as ``"2%"``.

    Raises:
        InputError: it is no number with a percent sign, or not between 0 % and 100 %.
    """
    share = math.nan
    if isinstance(text, str) and text.strip().endswith("%"):
        with suppress(InvalidOperation):  # 21.9 hundredths are 0.219
            share = float(Decimal(text.strip()[:-1]) / 100)
    if not 0 < share < 1:
        raise InputError(f"{text!r} is not a percentage; give one such as 2%", field=field)
    return share
