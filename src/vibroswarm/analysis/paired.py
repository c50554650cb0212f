"""Compare two cells run by run: they have the same seed, so that run r has the same motion and floor in both.

| figure | symbol | equation |
|---|---|---|
| difference | D | mean over runs of d_r = first_r - second_r |
| interval, p-value | - | sign flips of the d_r, see ``intervals.sign_flip`` |
| p-value of a family | - | Holm: cumulative maximum of (m - i + 1) p_(i), at most 1 (Holm 1979) |
| equivalent | - | the interval lies inside (-margin, margin): two one-sided tests, each at (1 - level) / 2 |

**What pairing does not do.** Common random numbers remove the luck of each run from the comparison, but all comparisons
on one block of seeds share the same luck. An important comparison is therefore repeated on a second block, with fresh
motion and floors, and counts as confirmed only if both intervals exclude 0 on the same side (``confirmed``).

**Motion and floor are two sources of variance.** With a fresh floor for each run the interval over runs covers both.
With one fixed floor it covers motion only and applies to that floor: more runs do not generalise it. With I motions
crossed with J floors, d_ij = D + M_i + F_j + e_ij, the variance of the mean is

    Var(M) / I + Var(F) / J + Var(e) / (I J),

which more motions on few floors cannot reduce below Var(F) / J. So vary floors and motions over runs instead of
crossing few of either.

No significant difference is not equality: that requires an interval inside a margin that was set beforehand.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import ArrayLike

from vibroswarm.analysis.intervals import Interval, check_level, plain, sign_flip
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.errors import InputError, nearest

FIGURES: Final = {
    "decision_time_s": -1,
    "belief_in_truth": 1,
    "right_share": 1,
    "wrong_share": -1,
    "undecided_share": -1,
}
"""Columns of ``cell_summary.run_figures`` that are compared; 1 if higher is better, -1 if lower is."""

DIRECTIONS: Final = FIGURES | {"forced_error": -1, "swarm_right": 1, "swarm_wrong": -1, "swarm_time_s": -1}


@dataclass(frozen=True)
class Paired(NotebookView):
    """One figure in two cells: ``difference`` is first - second, over runs that have the figure in both.

    A win is a run in which the first cell does better. ``p_holm`` is corrected over the family it was compared in.
    """

    figure: str
    first: float
    second: float
    difference: Interval
    wins: int
    ties: int
    losses: int
    pairs: int
    unpaired: int
    """Runs left out: in one cell only, or without the figure in one."""
    p_value: float
    p_holm: float

    def as_row(self) -> dict[str, float | int | str | None]:
        """Return a flat row; None for what is not finite."""
        row: dict[str, Any] = {name: plain(value) for name, value in self.__dict__.items()}
        interval = row.pop("difference")
        row["difference"], row["difference_low"], row["difference_high"] = (plain(v) for v in interval[:3])
        return row | {"level": interval.level}

    def as_dict(self) -> dict[str, Any]:
        """Return nested plain values for JSON."""
        return {name: plain(v) for name, v in self.__dict__.items()} | {
            "difference": self.difference.as_dict()
        }


def compare(
    first: pl.DataFrame,
    second: pl.DataFrame,
    figures: Sequence[str] = tuple(FIGURES),
    level: float = 0.95,
    seed: int = 0,
) -> tuple[Paired, ...]:
    """Compare two cells figure by figure; p-values are Holm-corrected over the figures.

    Args:
        first, second: ``run_figures`` of the two cells, of the same seed: runs of one number are a pair.
        figures: columns of these.
    Raises:
        InputError: no such figure, or no run in both.
    """
    check_level(level)
    for figure in figures:
        if figure not in DIRECTIONS:
            raise InputError(
                f"'{figure}' cannot be compared{nearest(figure, DIRECTIONS)}; "
                f"there are {', '.join(DIRECTIONS)}",
                field="figures",
            )
    both = first.join(second, on="run", how="inner", suffix="_second").sort("run")
    if both.is_empty():
        raise InputError("the two cells have no run in common; give cells of one seed", field="second")
    one_sided = first.height + second.height - 2 * both.height
    compared = [_compare_one(both, figure, one_sided, level, seed) for figure in figures]
    corrected = holm([paired.p_value for paired in compared])
    return tuple(replace(paired, p_holm=p) for paired, p in zip(compared, corrected, strict=True))


def _compare_one(both: pl.DataFrame, figure: str, one_sided: int, level: float, seed: int) -> Paired:
    """Compare one figure over the runs that have it in both cells."""
    values = both.select(first=pl.col(figure), second=pl.col(f"{figure}_second")).drop_nulls()
    a, b = (values[name].cast(pl.Float64).to_numpy() for name in ("first", "second"))
    d = a - b
    d[np.isclose(a, b, rtol=1e-12, atol=1e-12)] = 0.0  # rounding is no difference
    interval, p_value = sign_flip(d, level, seed)
    better = d * DIRECTIONS[figure]
    return Paired(
        figure=figure,
        first=float(a.mean()) if a.size else math.nan,
        second=float(b.mean()) if b.size else math.nan,
        difference=interval,
        wins=int((better > 0).sum()),
        ties=int((better == 0).sum()),
        losses=int((better < 0).sum()),
        pairs=d.size,
        unpaired=one_sided + both.height - d.size,
        p_value=p_value,
        p_holm=p_value,
    )


def holm(p_values: ArrayLike) -> list[float]:
    """Correct p-values over their family by Holm's method, in their order; nan stays nan and does not count."""
    p = np.asarray(p_values, dtype=np.float64).ravel()
    corrected = np.full(p.size, np.nan)
    defined = np.flatnonzero(~np.isnan(p))
    order = defined[np.argsort(p[defined], kind="stable")]
    scaled = p[order] * np.arange(order.size, 0, -1)
    corrected[order] = np.minimum(np.maximum.accumulate(scaled), 1.0)  # Holm 1979
    return [float(value) for value in corrected]


@dataclass(frozen=True)
class Confirmation(NotebookView):
    """A comparison on a first block of seeds and its repetition on a second."""

    first: Paired
    second: Paired
    confirmed: bool
    says: str

    def as_dict(self) -> dict[str, Any]:
        """Return nested plain values for JSON."""
        return {
            "first": self.first.as_dict(),
            "second": self.second.as_dict(),
            "confirmed": self.confirmed,
            "says": self.says,
        }


def confirmed(first: Paired, second: Paired) -> Confirmation:
    """Tell whether a second block of seeds (fresh motion, fresh floors) confirms the first.

    Raises:
        InputError: they compare different figures.
    """
    if first.figure != second.figure:
        raise InputError(
            f"'{second.figure}' does not confirm '{first.figure}'; give one figure", field="second"
        )
    sides = [side(first.difference), side(second.difference)]
    if sides[0] == 0:
        says = "the first block shows no difference"
    elif sides[1] == 0:
        says = "not confirmed: the second block shows no difference"
    elif sides[0] != sides[1]:
        says = "not confirmed: the blocks differ in opposite ways"
    else:
        says = f"confirmed: the first cell is {'higher' if sides[0] > 0 else 'lower'} in both blocks"
    return Confirmation(first, second, sides[0] != 0 and sides[0] == sides[1], says)


def side(interval: Interval) -> int:
    """Return 1 if the interval is above 0, -1 if below, 0 if it contains 0 or has no limits."""
    return int(interval.low > 0) - int(interval.high < 0)


def equivalent(interval: Interval, margin: float) -> bool:
    """Tell whether the difference is smaller than a margin set beforehand: the interval is inside (-margin, margin).

    A 95 % interval gives two one-sided tests at 2.5 % each; for 5 % give a 90 % interval. An interval without width, of
    pairs with equal differences, is not enough, since rarer pairs may not have occurred.

    Raises:
        InputError: a margin that is not above 0.
    """
    if not margin > 0:
        raise InputError(f"{margin!r} is not a margin; give a number above 0", field="margin")
    return bool(-margin < interval.low < interval.high < margin)
