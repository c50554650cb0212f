"""Run until a figure is precise enough: looks at 100, 200, 400, ... runs, corrected for repeated looks.

The interval of look k has the level 1 - a_k with a_k = (1 - level) 6 / (pi k)^2 (1). The a_k sum to 1 - level, so all
intervals hold together at the level, whatever the number of looks; the last one is valid although it was chosen for
being the first that is narrow enough. A group of cells is settled once the figure is precise enough in all of them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
import polars as pl

from vibroswarm.core.notebook_view import NotebookView, html_view
from vibroswarm.errors import InputError, check_choice, whole_number_of

if TYPE_CHECKING:
    from vibroswarm.analysis.intervals import Interval
    from vibroswarm.study.plan import Group
    from vibroswarm.study.store import Store

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


class Settled(NamedTuple):
    """A group that needs no more runs, or has reached the limit."""

    look: int
    runs: int
    level: float
    """Level of the interval at that look, which is the one to report."""
    reached: bool

    def _repr_html_(self) -> str:
        return html_view(self)


def settled(store: Store, group: Group, precision: Precision) -> Settled | None:
    """Find the look at which a group is precise enough in all cells; None if it needs runs that do not exist yet.

    It depends only on the first runs, so that a study that was interrupted, or extended by others, stops at the same
    look as an uninterrupted one.
    """
    available, look, runs = store.runs(group.number), 0, 0
    for look, runs in enumerate(precision.looks()):
        if runs > available:
            return None
        if _is_precise(store, group, precision, look, runs):
            return Settled(look, runs, precision.level_at(look), True)
    return Settled(look, runs, precision.level_at(look), False)


def _is_precise(store: Store, group: Group, precision: Precision, look: int, runs: int) -> bool:
    """Return whether the interval is narrow enough in each cell of the group."""
    rows, level = store.scan(group.number, runs), precision.level_at(look)
    assert rows is not None
    # Equal cells have equal rows: the first of each is enough.
    for cell in (equal_cells[0] for observed in group.observed for equal_cells in observed):
        interval = figure_of(
            rows.filter(pl.col("cell") == cell.number), precision.figure, cell.scenario.run.t_end_s, level
        )
        if not precision.reached(interval.estimate, interval.low, interval.high):
            return False
    return True


def figure_of(rows: pl.LazyFrame, figure: str, t_end_s: float, level: float) -> Interval:
    """Compute a figure of one cell with its interval; the run is the unit.

    Args:
        rows: as in the store. figure: one of ``FIGURES``.
    """
    from vibroswarm.analysis.intervals import mean_interval, wilson

    if figure.startswith("consensus_") and figure != "consensus_time_s":
        outcome = figure.removeprefix("consensus_")
        of_runs = (
            rows.filter(pl.col("robot") == 0).select(hit=pl.col("consensus") == outcome).collect()["hit"]
        )
        return wilson(int(of_runs.sum()), of_runs.len(), level)
    of_robot = {
        "decision_time_s": pl.col("decision_time_s").fill_null(t_end_s),
        "consensus_time_s": pl.col("consensus_time_s").fill_null(t_end_s),
        "belief_in_truth": pl.col("belief_in_truth"),
        "right": pl.col("decision") == pl.col("truth"),
        "wrong": (pl.col("decision") != pl.col("truth")) & (pl.col("decision") != -1),
        "undecided": pl.col("decision") == -1,
    }[figure]
    values = rows.select("run", "robot", value=of_robot.cast(pl.Float64)).sort("run", "robot").collect()
    robots = values["robot"].n_unique()
    # Summed robot by robot, so that the last bit does not depend on how runs are divided into shards.
    table = values["value"].to_numpy().reshape(-1, max(robots, 1))
    known = np.isfinite(table)
    count, total = known.sum(axis=1), np.where(known, table, 0.0).sum(axis=1)
    return mean_interval(total[count > 0] / count[count > 0], level)


def runs_that_count(store: Store, group: Group, precision: Precision) -> int:
    """Return the number of runs at which a group was settled; if it is not, that of the last complete look.

    Before the first look is complete, all runs from 0 to the first gap count.
    """
    stop, done = settled(store, group, precision), store.runs(group.number)
    return stop.runs if stop else max((runs for runs in precision.looks() if runs <= done), default=done)
