"""Run until a figure is precise enough: its interval is computed ("a look") after 100, 200, 400, ... runs.

Looking repeatedly is corrected for. The interval of look k = 1, 2, ... has the level 1 - a_k with
a_k = (1 - level) 6 / (pi k)^2 (1). The a_k sum to 1 - level, so all intervals together hold at the level, whatever the
number of looks. So the last interval is valid, although it was chosen because it was the first that is narrow enough.
A group of cells needs no more runs ("is settled") once the figure is precise enough in each of its cells, or once it
has the most runs that are allowed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from decimal import Decimal
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
import polars as pl

from vibroswarm.core.displayed import html_view
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.errors import InputError, check_choice, share_from, shown, whole_number_of

if TYPE_CHECKING:
    from vibroswarm.analysis.intervals import Interval
    from vibroswarm.study.plan import Group
    from vibroswarm.study.store import Store

FIRST_LOOK: Final = 100
"""Number of runs at the first look; it doubles from look to look."""
MOST: Final = 100_000
"""Most runs of a cell unless the study says otherwise."""
LEVEL: Final = 0.95
"""Level of confidence unless the study says otherwise."""

TIMES: Final = ("decision_time_s", "consensus_time_s")
"""Figures that are times: their half-width is relative."""
SHARES: Final = ("right", "wrong", "undecided", "consensus_right", "consensus_wrong", "belief_in_truth")
"""Figures that are shares or probabilities: their half-width is absolute."""
FIGURES: Final = (*TIMES, *SHARES)
"""Figures for which a precision can be wanted."""


@dataclass(frozen=True)
class Precision(NotebookView):
    """The wanted half-width of a figure's interval, and the most runs that may be made for it.

    Args:
        half_width: between 0 and 1, as a float; relative to the figure for a time, absolute for a share (0.02 is two
            percentage points).
        figure: one of ``FIGURES``. max_runs: most runs of a cell. level: of all intervals together, between 0 and 1.
    Raises:
        InputError: one of them is wrong; the message says what would be right.
    """

    half_width: float
    figure: str = "decision_time_s"
    max_runs: int = MOST
    level: float = LEVEL

    def __post_init__(self) -> None:
        if not (isinstance(self.half_width, float) and 0 < self.half_width < 1):
            raise InputError(
                f"{self.half_width!r} is not a precision; give a percentage such as 2%", field="until"
            )
        check_choice(self.figure, "figure", FIGURES)
        most = whole_number_of(self.max_runs, "max_runs", low=FIRST_LOOK, high=10**9)
        object.__setattr__(self, "max_runs", most)
        if not (isinstance(self.level, float) and 0 < self.level < 1):
            raise InputError(
                f"{shown(self.level)} is not a level of confidence; give a share such as {LEVEL}",
                field="level",
            )
        # A float of NumPy becomes one of Python, since ``as_values`` cannot parse the ``repr`` of the former.
        for name in ("half_width", "level"):
            object.__setattr__(self, name, float(getattr(self, name)))

    @classmethod
    def from_words(cls, text: Any, figure: Any = None, max_runs: Any = None, level: Any = None) -> Precision:
        """Make a precision from its half-width as text (``"2%"``).

        Args:
            figure, max_runs, level: as in ``Precision``; None: the default.
        """
        share = share_from(text, "until")
        return cls(
            half_width=share,
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

    def reached(self, estimate: float, low: float, high: float) -> bool:
        """Return whether [low, high] is narrow enough; an interval of width 0 is not, as it comes from too few data.

        Limits that are infinite or nan, as those of a figure with one value or none, are not narrow enough either.
        """
        target = self.half_width * abs(estimate) if self.figure in TIMES else self.half_width
        return 0.0 < (high - low) / 2.0 <= target


class Settled(NamedTuple):
    """A group that needs no more runs: it is precise enough, or has reached the limit of runs."""

    look: int
    """The look at which it was settled, counted from 0."""
    runs: int
    """Number of runs at that look."""
    level: float
    """Level of the interval at that look, which is the one to report."""
    reached: bool
    """Whether it is precise enough."""

    def _repr_html_(self) -> str:
        return html_view(self)


def settled(store: Store, group: Group, precision: Precision) -> Settled | None:
    """Find the first look at which a group is precise enough in all cells, or else the last look that is allowed.

    The result depends only on the runs up to that look, so a study that was interrupted, or extended, stops at the
    same look as an uninterrupted one.

    Returns: None if the group needs runs that are not stored yet.
    """
    available = store.runs(group.number)
    look = runs = 0  # set by the loop, which has at least one look
    for look, runs in enumerate(precision.looks()):
        if runs > available:
            return None
        if _is_precise(store, group, precision, look, runs):
            return Settled(look, runs, level=precision.level_at(look), reached=True)
    # No look was precise enough: ``look`` and ``runs`` are those of the last one.
    return Settled(look, runs, level=precision.level_at(look), reached=False)


def _is_precise(store: Store, group: Group, precision: Precision, look: int, runs: int) -> bool:
    """Return whether the figure's interval from the first ``runs`` runs is narrow enough in each cell of the group.

    Args:
        look: number of the look, counted from 0, which sets the level of the interval.
    """
    rows, level = store.scan(group.number, runs), precision.level_at(look)
    assert rows is not None  # all ``runs`` runs are stored
    # Cells with equal scenarios have equal rows, so one cell of each scenario is enough.
    for cell in (equal_cells[0] for entry in group.observed for equal_cells in entry):
        rows_of_cell = rows.filter(pl.col("cell") == cell.number)
        interval = figure_of(rows_of_cell, precision.figure, cell.scenario.run.t_end_s, level)
        if not precision.reached(interval.estimate, interval.low, interval.high):
            return False
    return True


def figure_of(rows: pl.LazyFrame, figure: str, t_end_s: float, level: float) -> Interval:
    """Compute a figure of one cell with its interval over runs.

    A share of runs (``consensus_right``, ``consensus_wrong``) has a Wilson interval. For any other figure, the values
    of a run's robots are averaged, and the interval is that of the mean over runs. The value of ``consensus_time_s`` is
    the same for all robots of a run. Figures about right and wrong leave out the runs without a truth, in which they
    are undefined, as in ``analysis.cell_summary``.

    Args:
        rows: the cell's rows of the store, one for each run and robot. figure: one of ``FIGURES``.
        t_end_s: end of the runs, s. It stands for the missing time of a robot that never decided, or of a run without
            consensus.
        level: of the interval.
    """
    from vibroswarm.analysis.intervals import mean_interval, wilson

    if figure.startswith("consensus_") and figure != "consensus_time_s":
        outcome = figure.removeprefix("consensus_")
        # Columns of the run are repeated for each robot: robot 0 stands for the run.
        runs_with_truth = rows.filter(pl.col("robot") == 0, pl.col("truth").is_not_null())
        of_runs = runs_with_truth.select(hit=pl.col("consensus") == outcome).collect()["hit"]
        return wilson(int(of_runs.sum()), of_runs.len(), level)
    decided_wrong = (pl.col("decision") != pl.col("truth")) & (pl.col("decision") != -1)
    of_robot = {
        "decision_time_s": pl.col("decision_time_s").fill_null(t_end_s),
        "consensus_time_s": pl.col("consensus_time_s").fill_null(t_end_s),
        "belief_in_truth": pl.col("belief_in_truth"),
        "right": pl.col("decision") == pl.col("truth"),
        # Without the condition, an undecided robot would count as not wrong in a run without a truth: null & False is
        # False in polars.
        "wrong": pl.when(pl.col("truth").is_not_null()).then(decided_wrong),
        "undecided": pl.col("decision") == -1,
    }[figure]
    values = rows.select("run", "robot", value=of_robot.cast(pl.Float64)).sort("run", "robot").collect()
    robots = values["robot"].n_unique()
    # (runs, robots); nan where null. The rows are sorted, so that the last bit of a sum over robots does not depend on
    # how runs are divided into shards. ``max``: without any run, the empty table still needs a width.
    table = values["value"].to_numpy().reshape(-1, max(robots, 1))
    known = np.isfinite(table)
    count, total = known.sum(axis=1), np.where(known, table, 0.0).sum(axis=1)
    has_values = count > 0  # runs of which no robot has the figure are left out
    return mean_interval(total[has_values] / count[has_values], level)


def runs_that_count(store: Store, group: Group, precision: Precision) -> int:
    """Return from how many runs the figures of a group are computed: the first ones, up to a look.

    If the group is settled, the number is that of the look at which it was settled. Otherwise it is that of the last
    look whose runs are all stored. If the first look has missing runs, all runs before the first missing one count.
    """
    done_with, stored = settled(store, group, precision), store.runs(group.number)
    if done_with is not None:
        return done_with.runs
    return max((runs for runs in precision.looks() if runs <= stored), default=stored)
