"""Compute when the answer could be known: the posterior over tiles from all bits with their positions.

| name | symbol | equation |
|---|---|---|
| tiles in the arena | N | those of which some part lies inside |
| prior of k vibrating tiles | pi_k | each set of k tiles as likely as any other |
| posterior | P(k) | from the likelihood of the model that draws the bits, see below |
| known | - | P(k > x N) >= 1 - alpha, or P(k < x N) >= 1 - alpha |
| claimed error | - | 1 - max(P(k > x N), P(k < x N)) when it is known: at most alpha |

| prior | pi_k |
|---|---|
| ``tiles`` | C(N, k) / 2^N: each tile vibrates or not as a coin falls |
| ``counts`` | 1 / (N + 1): each fill ratio as likely as any other |
| ``mirror`` | 1/2 each for the run's own number of vibrating tiles and its mirror across the boundary, 2xN - k |
| (N + 1,) numbers | as given |

| sensor | posterior |
|---|---|
| a reading depends on the tile below alone | exact: ``tile_posterior`` |
| edges are felt, or tiles or robots differ | by Markov chains over floors and factors, with their Monte Carlo error |

Edges are ``sensor.edge_reach_m`` and ``edge_blur_m``, factors ``tile_spread`` and ``robot_spread``; the chains are
those of ``vibroswarm.posterior``.

**What it bounds.** Nobody who has these bits, their places, the sensor's model and this prior can be surer: a rule that
decides only where its posterior error is at most alpha decides no sooner in any run. A rule that keeps alpha on average
only, some runs worse and some better, may; so may one that knows more, such as the energies or the floor's pattern.

**What error to expect.** Over floors as the prior has them the share wrong is the mean of the claimed errors, which is
at most alpha and somewhat less, since a sample takes the posterior past 1 - alpha and it is looked at from time to time
only. ``wrong`` and ``claimed`` show both. Over other floors the share wrong may be anything: with floors near the
boundary ``tiles`` and above all ``counts`` believe too soon, since few of their floors are as near. Under ``mirror``
floors lie on both sides equally often; those of one side alone may be mistaken more often than those of the other.

``on_both_sides`` puts every second run on a floor with the mirrored fill ratio, to average over the prior ``mirror``.

A cell has floors on one side of the boundary. A test that does not know the side may err more often on one side than on
the other, and its nominal error is that over both. So every second run is observed again on a random floor whose number
of vibrating tiles is mirrored across the boundary; motion is reused, since it does not depend on floors.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
import polars as pl
from numpy.typing import ArrayLike, NDArray

from vibroswarm.analysis.intervals import Interval, mean_interval, plain, wilson, wilson_limits
from vibroswarm.analysis.tile_posterior import Prior, Values, log_prior, log_ratios, mirrored, sides_of
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor, sides_inside
from vibroswarm.posterior.boundary_side import SMALL, needs_chains, sides_until_known
from vibroswarm.result import Result
from vibroswarm.simulation import replay

POINTS: Final = 241
UNSETTLED: Final = 0.05
"""If Markov chains do not converge in a larger share of the runs, no figure is returned."""


@dataclass(frozen=True)
class Known(NotebookView):
    """When the side of the boundary could be known; times in s."""

    prior: str
    alpha: float
    how: Literal["exact", "chains"]
    """How the posterior was computed."""
    runs: pl.DataFrame
    """run, known_s (null: not by the end), decision (-1: none), truth, claimed_error (when known), monte_carlo_error
    (standard error of that), belief_in_truth (at the end; null where chains stop once it is known)."""
    over_time: pl.DataFrame
    """time_s, known, known_low, known_high, wrong (share known and wrong), belief_in_truth (mean; null with chains)."""
    known: Interval
    """Share of runs in which it could be known by the end."""
    wrong: Interval
    """Share wrong among these; its expected value is ``claimed`` if floors follow the prior."""
    claimed: Interval
    """Mean posterior error at the time of knowing: the expected share wrong, at most alpha."""
    time_s: Interval
    """Mean of min(time known, t_end)."""
    monte_carlo_error: float
    """Largest Monte Carlo standard error of a posterior at a decision; 0 if it is exact."""
    unsettled: int
    """Runs in which the Monte Carlo error was too large to compare a posterior with 1 - alpha; not known there."""

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON, including the figures over time but not the runs."""
        curve = [
            {name: plain(value) for name, value in row.items()}
            for row in self.over_time.iter_rows(named=True)
        ]
        intervals = ("known", "wrong", "claimed", "time_s")
        return {
            "prior": self.prior,
            "alpha": self.alpha,
            "how": self.how,
            **{name: getattr(self, name).as_dict() for name in intervals},
            "monte_carlo_error": plain(self.monte_carlo_error),
            "unsettled": self.unsettled,
            "over_time": curve,
        }


def could_be_known(
    result: Result,
    prior: Prior = "tiles",
    alpha: float = 0.05,
    times_s: ArrayLike | None = None,
    energies: bool = False,
    level: float = 0.95,
) -> Known:
    """Compute when the side of the boundary could be known with posterior error alpha, on a grid of times.

    If robots sense across tile edges, or tiles or robots differ, it takes some tenths of a second a run.

    Args:
        result: runs to their end. prior: see the module's head. times_s: increasing; without it 241 from 0 to t_end.
        energies: take the energies that were read (Gamma sensor), not only the bits.
    Raises:
        InputError: an alpha outside (0, 1/2), times that do not increase, a prior of other length than N + 1, energies
            that the result does not hold or whose density is not known or depends on more than the tile below, no tile
            in the arena or one cut by it, runs that stopped early, chains that do not find the posterior.
    """
    if result.runs["stopped_early"].any():
        raise InputError("runs that stopped early lack the samples after; run to t_end", field="result")
    if not 0.0 < alpha < 0.5:
        raise InputError(f"{alpha!r} is not a posterior error; give a share below 0.5", field="alpha")
    t_end_s = result.scenario.run.t_end_s
    times = _times(t_end_s, times_s)
    chains = needs_chains(result.scenario.sensor)
    if chains and energies:
        raise InputError(
            "the posterior from energies is not computed where edges are felt or tiles or robots differ; "
            "leave energies out",
            field="energies",
        )
    find = _by_chains if chains else _exactly
    posteriors = find(result, prior, alpha, times, energies)
    runs = pl.DataFrame([p.row for p in posteriors], schema=_RUNS, orient="row")
    decided = runs.filter((pl.col("decision") != -1) & pl.col("truth").is_not_null())
    wrong = decided.filter(pl.col("decision") != pl.col("truth")).height
    unsettled = sum(not p.settled for p in posteriors)
    if unsettled > UNSETTLED * len(posteriors):
        raise InputError(
            f"the chains that sample the posterior left {unsettled} of {len(posteriors)} runs open "
            f"(Monte Carlo error over {SMALL:g} near 1 - alpha): no figure is given",
            field="result",
        )
    return Known(
        prior=prior if isinstance(prior, str) else "given",
        alpha=alpha,
        how="chains" if chains else "exact",
        runs=runs,
        over_time=_over_time(runs, [p.in_truth for p in posteriors], times, level),
        known=wilson(runs.filter(pl.col("decision") != -1).height, runs.height, level),
        wrong=wilson(wrong, decided.height, level),
        claimed=mean_interval(decided["claimed_error"].to_numpy(), level),
        time_s=mean_interval(runs["known_s"].fill_null(t_end_s).to_numpy(), level),
        monte_carlo_error=float(runs["monte_carlo_error"].fill_null(0.0).max() or 0.0),  # type: ignore[arg-type]
        unsettled=unsettled,
    )


_RUNS: Final[dict[str, Any]] = {
    "run": pl.UInt32,
    "known_s": pl.Float64,
    "decision": pl.Int8,
    "truth": pl.Int8,
    "claimed_error": pl.Float64,
    "monte_carlo_error": pl.Float64,
    "belief_in_truth": pl.Float64,
}


@dataclass(frozen=True)
class _RunPosterior:
    row: tuple[Any, ...]
    in_truth: Values | None
    """Posterior of the truth at each time."""
    settled: bool


def _times(t_end_s: float, times_s: ArrayLike | None) -> Values:
    """Return the given times, checked, or an even grid from 0 to t_end, s."""
    if times_s is None:
        return np.linspace(0.0, t_end_s, POINTS)
    times = np.asarray(times_s, dtype=np.float64).ravel()
    if times.size == 0 or not np.isfinite(times).all() or not (np.diff(times) > 0).all():
        raise InputError("give at least one time, s, and each later than the one before", field="times_s")
    return times


def _of_floor(prior: Prior, floor: Floor, inside: NDArray[np.int64], boundary: float) -> Values:
    """Compute ln pi_k for the floor of a run."""
    if isinstance(prior, str) and prior == "mirror":
        prior = mirrored(int(floor.tiles.ravel()[inside].sum()), inside.size, boundary)
    return log_prior(prior, inside.size)


def _exactly(
    result: Result, prior: Prior, alpha: float, times: Values, energies: bool
) -> list[_RunPosterior]:
    """Compute the posterior of each run exactly (``tile_posterior``)."""
    scenario, ratios = result.scenario, log_ratios(result, energies)
    at, below = result.motion["run"].to_numpy(), result.observations["tile"].to_numpy()
    when, boundary = result.motion["time_s"].to_numpy(), scenario.decision.decision_boundary
    posteriors = []
    for run, truth in result.runs.select("run", "truth").iter_rows():
        part = slice(*(int(k) for k in np.searchsorted(at, [run, run + 1])))
        floor = result.floor(run)
        inside = tiles_inside(floor, scenario.arena.width_m, scenario.arena.height_m)
        sums = _sums_over_time(ratios[part], below[part], when[part], inside, times)
        above, under = sides_of(sums, _of_floor(prior, floor, inside, boundary), boundary)
        row: tuple[Any, ...] = (None, -1, truth, None, None)
        sure = np.flatnonzero(np.maximum(above, under) >= 1.0 - alpha)
        if sure.size:
            k = sure[0]
            row = (times[k], int(above[k] > under[k]), truth, 1.0 - max(above[k], under[k]), 0.0)
        in_truth = None if truth is None else (above if truth == 1 else under)
        end = None if in_truth is None else float(in_truth[-1])
        posteriors.append(_RunPosterior((run, *row, end), in_truth, True))
    return posteriors


def _by_chains(
    result: Result, prior: Prior, alpha: float, times: Values, energies: bool
) -> list[_RunPosterior]:
    """Compute the posterior of each run with Markov chains, until it is known."""
    scenario = result.scenario
    at, boundary = result.motion["run"].to_numpy(), scenario.decision.decision_boundary
    posteriors = []
    for run, truth in result.runs.select("run", "truth").iter_rows():
        low, high = (int(k) for k in np.searchsorted(at, [run, run + 1]))
        floor = result.floor(run)
        inside = tiles_inside(floor, scenario.arena.width_m, scenario.arena.height_m)
        if inside.size < floor.tiles.size:
            raise InputError(
                "tiles beyond the arena may be felt from within; give a floor that ends with the arena",
                field="floor",
            )
        known = sides_until_known(
            scenario, floor, result.motion[low:high], result.observations["observation"][low:high].to_numpy(),
            _of_floor(prior, floor, inside, boundary), alpha, times, result.seed or 0, run,
        )  # fmt: skip
        row: tuple[Any, ...] = (None, -1, truth, None, None)
        if known.time_s is not None:
            look = known.look
            row = (known.time_s, int(look.above > look.under), truth, 1.0 - look.larger, look.error)
        posteriors.append(_RunPosterior((run, *row, None), None, known.settled))
    return posteriors


def tiles_inside(floor: Floor, width_m: float, height_m: float) -> NDArray[np.int64]:
    """Find the tiles in the arena, of this width and height in m; returns their indices, (tiles,).

    Raises:
        InputError: no tile lies in the arena, or those that do have unequal parts inside: the truth counts the area
            of vibrating tiles, the posterior whole tiles.
    """
    sides = sides_inside(floor.geometry, width_m, height_m)
    if sides is None:
        return np.arange(floor.tiles.size)
    across, up = (np.where(side > 1e-9, side, 0.0) for side in sides)
    area = np.outer(up, across).ravel()
    inside = np.flatnonzero(area > 0.0)
    if inside.size == 0:
        raise InputError("no tile lies in the arena; nothing can be known", field="floor")
    if not np.allclose(area[inside], area[inside[0]], rtol=1e-6):
        raise InputError(
            "the arena cuts some of the tiles: what is true of the floor goes by area, and the posterior by whole "
            "tiles; give a floor that ends with the arena",
            field="floor",
        )
    return inside


def _sums_over_time(
    ratios: Values,
    tile: NDArray[np.int32],
    when: Values,
    inside: NDArray[np.int64],
    times: Values,
) -> Values:
    """Compute ln L_t from the samples until each time, (times, N); samples off the tiles ``inside`` do not count."""
    column = np.searchsorted(inside, tile)
    on = (tile >= 0) & (column < inside.size)
    on[on] = inside[column[on]] == tile[on]
    step = np.searchsorted(times, when)  # counts from the first time that is not before the sample
    on &= step < times.size
    flat = np.bincount(step[on] * inside.size + column[on], ratios[on], times.size * inside.size)
    return np.asarray(np.cumsum(flat.reshape(times.size, inside.size), axis=0))


def _over_time(
    runs: pl.DataFrame, in_truth: list[Values | None], times: Values, level: float
) -> pl.DataFrame:
    """Tabulate the shares of runs known and wrong, and the mean belief in the truth, at each time."""
    at = runs["known_s"].fill_null(np.inf).to_numpy()
    wrong = (runs["decision"] != runs["truth"]).fill_null(False).to_numpy() & np.isfinite(at)
    number = max(runs.height, 1)
    known = np.searchsorted(np.sort(at), times, side="right")
    low, high = wilson_limits(known, runs.height, level)
    beliefs = [beliefs_of_run for beliefs_of_run in in_truth if beliefs_of_run is not None]
    return pl.DataFrame(
        {
            "time_s": times,
            "known": known / number,
            "known_low": low,
            "known_high": high,
            "wrong": np.searchsorted(np.sort(at[wrong]), times, side="right") / number,
            "belief_in_truth": np.mean(beliefs, axis=0) if beliefs else np.full(times.size, math.nan),
        }
    ).fill_nan(None)


def on_both_sides(result: Result) -> Result:
    """Keep the even-numbered runs, and put the odd-numbered ones on floors with the mirrored fill ratio.

    Args:
        result: runs to their end, with floors drawn at random for each run.
    Raises:
        InputError: floors are not drawn for each run, the arena cuts them, or they lie on the boundary.
    """
    scenario = result.scenario
    if not scenario.floor.drawn_by_run:
        raise InputError(
            "only floors that are drawn for each run have a mirrored fill ratio", field="floor.source"
        )
    if result.runs["truth"].null_count():
        raise InputError("the fill ratio lies on the boundary; it has no mirror", field="floor.source")
    floor = result.floor(int(result.runs["run"][0]))
    tiles = floor.tiles.size
    if tiles_inside(floor, scenario.arena.width_m, scenario.arena.height_m).size < tiles:
        raise InputError("the arena cuts the floor; give one that ends with the arena", field="floor")
    vibrating = int(floor.tiles.sum())
    weights = mirrored(vibrating, tiles, scenario.decision.decision_boundary)
    weights[vibrating] = 0.0
    fill = int(weights.argmax()) / tiles
    other = replay(result, scenario.with_values({"floor.source": f"random:{fill!r}"}))
    tables = {
        name: _alternating(getattr(result, name), getattr(other, name))
        for name in ("observations", "inference", "robots", "runs", "floors")
    }
    return Result(
        scenario=scenario, seed=result.seed, motion=result.motion, ends=result.ends, segments=result.segments,
        source=result.source, versions=result.versions, **tables,
    )  # fmt: skip


def _alternating(even: pl.DataFrame, odd: pl.DataFrame) -> pl.DataFrame:
    """Join the even-numbered runs of one table with the odd-numbered runs of another, sorted by run."""
    is_even = pl.col("run") % 2 == 0
    return pl.concat([even.filter(is_even), odd.filter(~is_even)]).sort("run", maintain_order=True)
