"""Two cells compared run by run: the same seeds in both, so that run r has the same motion and floor in each.

| figure | symbol | equation |
|---|---|---|
| difference | D | mean over runs of d_r = first_r - second_r |
| interval, p-value | - | sign flips of the d_r, see ``intervals.sign_flip`` |
| p-value of a family | - | Holm: the largest so far of (m - i + 1) p_(i), at most 1 (Holm 1979) |
| equivalent | - | the interval lies inside (-margin, margin): two one-sided tests, each at (1 - level) / 2 |

**What pairing does not do.** Common random numbers take the luck of each run out of the comparison, and bring the
same luck into every comparison made on the same block of seeds: a lucky block flatters one cell in all of them. A
headline comparison is therefore made again on a second block, of fresh motion and fresh floors, and counts as
confirmed only if both intervals exclude 0 on the same side (``confirmed``).

**Motion and floor are two sources of luck.** With a fresh floor for each run the interval over runs holds both. With
one fixed floor it holds motion only, and speaks for that floor: more runs make it narrow, not general. With I motions
crossed with J floors, d_ij = D + M_i + F_j + e_ij, the variance of the mean is

    Var(M) / I + Var(F) / J + Var(e) / (I J),

which more motions on few floors cannot bring below Var(F) / J. So vary floors (and motions) over runs, rather than
crossing few of either.

"Not told apart" is never "equal": only an interval inside a margin that was set beforehand says that.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import ArrayLike

from vibroswarm.analysis.intervals import Interval, check_level, plain, sign_flip
from vibroswarm.errors import InputError, nearest

FIGURES: Final = {
    "decision_time_s": -1,
    "belief_in_truth": 1,
    "right_share": 1,
    "wrong_share": -1,
    "undecided_share": -1,
}
"""Columns of ``per_run.run_figures`` that are compared, and which way is better."""

DIRECTIONS: Final = FIGURES | {"swarm_right": 1, "swarm_wrong": -1, "swarm_time_s": -1}


@dataclass(frozen=True)
class Paired:
    """One figure in two cells: ``difference`` is first less second, over runs that have the figure in both.

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
        """Flat, None for what is not finite."""
        row: dict[str, Any] = {name: plain(value) for name, value in self.__dict__.items()}
        interval = row.pop("difference")
        row["difference"], row["difference_low"], row["difference_high"] = (plain(v) for v in interval[:3])
        return row | {"level": interval.level}

    def as_dict(self) -> dict[str, Any]:
        """Nested plain values for JSON."""
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
    """Two cells compared figure by figure; Holm-corrected over the figures.

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
    return tuple(_with_p(paired, p) for paired, p in zip(compared, corrected, strict=True))


def _compare_one(both: pl.DataFrame, figure: str, one_sided: int, level: float, seed: int) -> Paired:
    here = both.select(first=pl.col(figure), second=pl.col(f"{figure}_second")).drop_nulls()
    a, b = (here[name].cast(pl.Float64).to_numpy() for name in ("first", "second"))
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


def _with_p(paired: Paired, p_holm: float) -> Paired:
    return Paired(**{**paired.__dict__, "p_holm": p_holm})


def holm(p_values: ArrayLike) -> list[float]:
    """p-values corrected over their family, in their order; those that are not defined count for nothing."""
    p = np.asarray(p_values, dtype=np.float64).ravel()
    corrected = np.full(p.size, np.nan)
    there = np.flatnonzero(~np.isnan(p))
    order = there[np.argsort(p[there], kind="stable")]
    scaled = p[order] * np.arange(order.size, 0, -1)
    corrected[order] = np.minimum(np.maximum.accumulate(scaled), 1.0)
    return [float(value) for value in corrected]


@dataclass(frozen=True)
class Confirmation:
    """A comparison made on a first block of seeds and again on a second."""

    first: Paired
    second: Paired
    confirmed: bool
    says: str

    def as_dict(self) -> dict[str, Any]:
        """Nested plain values for JSON."""
        return {
            "first": self.first.as_dict(),
            "second": self.second.as_dict(),
            "confirmed": self.confirmed,
            "says": self.says,
        }


def confirmed(first: Paired, second: Paired) -> Confirmation:
    """Whether a second block of seeds (fresh motion, fresh floors) bears out the first.

    Raises:
        InputError: the two are of different figures.
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
    """1 where the interval lies above 0, -1 below, 0 where it holds 0 or there is none."""
    return int(interval.low > 0) - int(interval.high < 0)


def equivalent(interval: Interval, margin: float) -> bool:
    """Whether the difference is smaller than a margin set beforehand: the interval lies inside (-margin, margin).

    A 95 % interval gives two one-sided tests at 2.5 % each; for 5 % give a 90 % interval. An interval without width, of
    pairs that all differ alike, is not enough: it says nothing of rarer pairs that were not seen.

    Raises:
        InputError: a margin that is not above 0.
    """
    if not margin > 0:
        raise InputError(f"{margin!r} is no margin; give a number above 0", field="margin")
    return bool(-margin < interval.low < interval.high < margin)
