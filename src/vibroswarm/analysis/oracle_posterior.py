"""Compute when the answer could be known: the posterior of the floor from all bits of a run with their true places.

A bit is the 0 or 1 that a sample reads. x is the decision boundary. What is said of the sides of the boundary holds of
the kinds of tile too, where there are several and the task is ``majority``: of which of them is the most common.

| name | symbol | equation |
|---|---|---|
| tiles in the arena | N | number of tiles with some part inside the arena |
| prior of k vibrating tiles | pi_k | as in the next table; each set of k tiles has the same probability |
| posterior | P(k) | from the likelihood of the model that draws the bits |
| known | - | P(k > x N) >= 1 - alpha (decision 1), or P(k < x N) >= 1 - alpha (decision 0) |
| claimed error | - | 1 - max(P(k > x N), P(k < x N)) at the time when it is known: at most alpha |
| known, of kinds | - | P(kind j has more tiles than any other) >= 1 - alpha (decision j) |

| prior | pi_k |
|---|---|
| ``tiles`` | C(N, k) / 2^N: each tile vibrates with probability 1/2 |
| ``counts`` | 1 / (N + 1): all fill ratios have the same probability |
| ``mirror`` | 1/2 each for the run's own number k of vibrating tiles and its mirror across the boundary, 2xN - k |
| (N + 1,) numbers | as given |

| prior, of kinds | numbers k of tiles of each kind |
|---|---|
| ``tiles`` | each tile is of each kind with the same probability |
| ``counts`` | all numbers have the same probability |
| ``mirror`` | the run's own numbers, in any order: each kind has each of them once |

The posterior is exact (``tile_posterior``), which requires that a reading depends only on the tile below it. A sensor
that feels across tile edges (``sensor.edge_reach_m``, ``edge_blur_m``), or tiles or robots that differ
(``tile_spread``, ``robot_spread``), are refused.

**What it bounds.** With these bits, their places, the sensor's model and this prior, no observer can be surer. A rule
that decides only when its posterior error is at most alpha decides no sooner in any run, but for the steps of the times
at which the posterior is computed. Two kinds of rule may decide sooner: a rule whose error is alpha only on average
over runs, and a rule with more knowledge, such as the energies or the floor's pattern.

**What error to expect.** If floors follow the prior, the expected share of wrong decisions is the mean claimed error.
That is somewhat below alpha, since the posterior jumps past 1 - alpha, and is computed at certain times only. ``wrong``
and ``claimed`` show the two. If floors do not follow the prior, the share wrong may have any value. With floors near
the boundary, ``tiles`` and even more ``counts`` decide too soon, since they give such floors little weight. Under
``mirror`` the error holds as a mean over both sides of the boundary; on one side alone it may be larger.

The floors of one cell all lie on one side of the boundary. To average over the prior ``mirror``, ``on_both_sides``
observes every second run again on a random floor with the mirrored number of vibrating tiles; of kinds, runs in turn
on floors with the numbers in each order. The motion is reused, since it does not depend on floors.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import ArrayLike, NDArray

from vibroswarm.analysis.intervals import (
    Interval,
    mean_interval,
    plain,
    time_interval,
    wilson,
    wilson_limits,
    within,
)
from vibroswarm.analysis.tile_posterior import (
    Prior,
    Values,
    log_prior,
    log_ratios,
    mirrored,
    most_common_of,
    orders_of,
    permuted,
    sides_of,
)
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor, refuse_changes, sides_inside
from vibroswarm.result import Result
from vibroswarm.simulation import replay

POINTS: Final = 241
"""Number of times in the default grid from 0 to t_end."""


@dataclass(frozen=True)
class Known:
    """When the side of the boundary, or the most common kind, could be known; times in s.

    The module's docstring explains the terms.
    """

    prior: str
    """Name of the prior; "given" for a prior of N + 1 weights."""
    alpha: float
    """Posterior error at which a side counts as known."""
    runs: pl.DataFrame
    """One row per run: run, known_s (null: not by the end), decision (-1: not known), truth, claimed_error (when
    known), belief_in_truth (posterior of the true side at the end)."""
    over_time: pl.DataFrame
    """One row per time: time_s, known (share of runs known by then), known_low, known_high, wrong (share of runs known
    and wrong), belief_in_truth (mean posterior of the true side)."""
    known: Interval
    """Share of runs in which the side of the boundary could be known by the end."""
    wrong: Interval
    """Share of the runs with a known side in which this side is wrong; runs without a truth are left out. Its expected
    value is ``claimed`` if floors follow the prior."""
    claimed: Interval
    """Mean posterior error at the time of knowing, over the same runs as ``wrong``: the expected share wrong, at most
    alpha."""
    time_s: Interval
    """Mean of min(time known, t_end)."""

    def as_dict(self) -> dict[str, Any]:
        """Return the fields for JSON, with the figures over time but without the table of runs."""
        curve = [
            {name: plain(value) for name, value in row.items()}
            for row in self.over_time.iter_rows(named=True)
        ]
        intervals = ("known", "wrong", "claimed", "time_s")
        return {
            "prior": self.prior,
            "alpha": self.alpha,
            **{name: getattr(self, name).as_dict() for name in intervals},
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
    """Compute for each run the first of the times ``times_s`` at which the side of the boundary is known.

    The side is known if the posterior of one side is at least 1 - ``alpha``.

    Args:
        result: runs to t_end. prior: "tiles", "counts", "mirror" or N + 1 weights. alpha: posterior error, below 1/2.
        times_s: at which the posterior is computed, increasing, s; by default ``POINTS`` from 0 to t_end.
        energies: compute the posterior from the energies that were read (Gamma sensor), not from the bits.
        level: confidence level of the limits.
    Raises:
        InputError: runs that stopped early; an alpha outside (0, 1/2); a level outside (0, 1); times that do not
            increase; an unknown prior, or one of other length than N + 1; readings that depend on more than the tile
            below; energies that the result does not hold, or whose densities are not known; no tile in the arena, or
            tiles that its border cuts; several kinds of tile, and another task than ``majority``.
    """
    if _has_kinds(result) and result.scenario.task.name != "majority":
        raise InputError(
            "of several kinds of tile it is computed which is the most common; choose the task majority",
            field="task.name",
        )
    if result.scenario.floor.has_surface:
        raise InputError("the posterior is that of tiles that vibrate or not", field="floor.source")
    if result.runs["stopped_early"].any():
        raise InputError(
            "runs that stopped early lack the samples after they stopped; run to t_end", field="result"
        )
    if not 0.0 < alpha < 0.5:
        raise InputError(
            f"{alpha!r} is not a posterior error; give a share above 0 and below 0.5", field="alpha"
        )
    t_end_s = result.scenario.run.t_end_s
    times = _times(t_end_s, times_s)
    runs, in_truth = _exactly(result, prior, alpha, times, energies)
    # A side can be right or wrong only in a run with a truth.
    decided = runs.filter((pl.col("decision") != -1) & pl.col("truth").is_not_null())
    wrong = decided.filter(pl.col("decision") != pl.col("truth")).height
    return Known(
        prior=prior if isinstance(prior, str) else "given",
        alpha=alpha,
        runs=runs,
        over_time=_over_time(runs, in_truth, times, level),
        known=wilson(runs.filter(pl.col("decision") != -1).height, runs.height, level),
        wrong=wilson(wrong, decided.height, level),
        claimed=within(mean_interval(decided["claimed_error"].to_numpy(), level), 0.0, alpha),
        time_s=time_interval(runs["known_s"].fill_null(t_end_s).to_numpy(), t_end_s, level),
    )


_RUNS: Final[dict[str, Any]] = {
    "run": pl.UInt32,
    "known_s": pl.Float64,
    "decision": pl.Int8,
    "truth": pl.Int8,
    "claimed_error": pl.Float64,
    "belief_in_truth": pl.Float64,
}
"""Columns of ``Known.runs``."""


def _times(t_end_s: float, times_s: ArrayLike | None) -> Values:
    """Return the given times after checking them, or by default ``POINTS`` evenly spaced from 0 to t_end, s."""
    if times_s is None:
        return np.linspace(0.0, t_end_s, POINTS)
    times = np.asarray(times_s, dtype=np.float64).ravel()
    if times.size == 0 or not np.isfinite(times).all() or not (np.diff(times) > 0).all():
        raise InputError(
            "give at least one finite time, s, and each later than the one before", field="times_s"
        )
    return times


def _has_kinds(result: Result) -> bool:
    """Return whether there are more than two kinds of tile, or classes."""
    return max(result.scenario.sensor.kinds, result.scenario.sensor.readings) > 2


def _beliefs_of_run(
    result: Result, prior: Prior, floor: Floor, inside: NDArray[np.int64], sums: Values
) -> Values:
    """Compute the posterior of each answer at each time, (answers, times); ties and the boundary are no answer.

    Args:
        prior: only "mirror" depends on the run's floor. floor: the run's floor. inside: indices of the N tiles in the
            arena. sums: log likelihood ratios of these by each time.
    """
    tiles = floor.tiles.ravel()[inside]
    if _has_kinds(result):
        kinds = result.scenario.sensor.kinds
        if isinstance(prior, str) and prior == "mirror":
            prior = permuted(np.bincount(tiles, minlength=kinds))
        return most_common_of(sums, log_prior(prior, inside.size, kinds))
    boundary = result.scenario.decision.decision_boundary
    if isinstance(prior, str) and prior == "mirror":
        prior = mirrored(int(tiles.sum()), inside.size, boundary)
    above, under = sides_of(sums, log_prior(prior, inside.size), boundary)
    return np.stack([under, above])


def _exactly(
    result: Result, prior: Prior, alpha: float, times: Values, energies: bool
) -> tuple[pl.DataFrame, list[Values]]:
    """Compute the posterior of each run exactly, at all times, from the likelihood ratios of its tiles.

    Args:
        prior: "tiles", "counts", "mirror" or N + 1 weights. alpha: posterior error at which a side counts as known.
        times: at which the posterior is computed, increasing, s. energies: read energies instead of bits.
    Returns: the table ``Known.runs``; and the posterior of the true side at each time of each run with a truth.
    """
    scenario, ratios = result.scenario, log_ratios(result, energies)
    run_of_sample, tile = result.motion["run"].to_numpy(), result.observations["tile"].to_numpy()
    taken_s = result.motion["time_s"].to_numpy()
    rows, in_truth = [], list[Values]()
    for run, truth in result.runs.select("run", "truth").iter_rows():
        # Samples are sorted by run: those of this run have the indices from ``low`` to ``high`` - 1.
        low, high = np.searchsorted(run_of_sample, [run, run + 1])
        part = slice(int(low), int(high))
        floor = result.floor(run)
        refuse_changes(floor)
        inside = tiles_inside(floor, scenario.arena.width_m, scenario.arena.height_m)
        sums = _sums_over_time(ratios[part], tile[part], taken_s[part], inside, times)
        beliefs = _beliefs_of_run(result, prior, floor, inside, sums)
        row: dict[str, Any] = {"run": run, "truth": truth, "decision": -1}
        if truth is not None:
            in_truth.append(beliefs[truth])
            row["belief_in_truth"] = float(beliefs[truth, -1])
        sure = np.flatnonzero(beliefs.max(axis=0) >= 1.0 - alpha)
        if sure.size:
            k = sure[0]  # the first time at which an answer is known
            row["known_s"], row["decision"] = times[k], int(beliefs[:, k].argmax())
            row["claimed_error"] = 1.0 - beliefs[:, k].max()
        rows.append(row)
    return pl.DataFrame(rows, schema=_RUNS), in_truth


def tiles_inside(floor: Floor, width_m: float, height_m: float) -> NDArray[np.int64]:
    """Find the tiles with some part inside an arena of this width and height (m).

    Returns: their indices, increasing, (tiles,).
    Raises:
        InputError: no tile lies in the arena, or tiles have parts of different area inside. The truth goes by the area
            of vibrating tiles and the posterior by their number, which agree only if all areas are equal.
    """
    sides = sides_inside(floor.geometry, width_m, height_m)
    if sides is None:  # no tile is cut or outside
        return np.arange(floor.tiles.size)
    # Widths of the columns and heights of the rows inside the arena; at most 1e-9 m is rounding and counts as 0.
    across, up = (np.where(side > 1e-9, side, 0.0) for side in sides)
    area = np.outer(up, across).ravel()
    inside = np.flatnonzero(area > 0.0)
    if inside.size == 0:
        raise InputError("no tile lies in the arena; nothing can be known", field="floor")
    if not np.allclose(area[inside], area[inside[0]], rtol=1e-6):
        raise InputError(
            "the arena's border cuts some of the tiles: the true answer goes by area, the posterior by whole tiles; "
            "give a floor that ends with the arena",
            field="floor",
        )
    return inside


def _sums_over_time(
    ratios: Values,
    tile: NDArray[np.int32],
    taken_s: Values,
    inside: NDArray[np.int64],
    times: Values,
) -> Values:
    """Compute ln L_t, the log likelihood ratio of each tile from the samples taken by each time.

    Args:
        ratios: log likelihood ratio of each sample, (samples,), or (samples, kinds - 1). tile: index of its tile, -1
            off all tiles. taken_s: its time; (samples,) each. inside: increasing indices of the N tiles that count;
            samples elsewhere do not. times: increasing, s.
    Returns: ln L_t, (times, N), or ln L_tj, (times, N, kinds - 1).
    """
    if ratios.ndim == 2:
        of_kinds = [_sums_over_time(of_kind, tile, taken_s, inside, times) for of_kind in ratios.T]
        return np.stack(of_kinds, axis=-1)
    # ``column``: column of the result for the tile of each sample. ``on``: whether this tile is one of ``inside``; if
    # not, ``column`` has no meaning.
    column = np.searchsorted(inside, tile)
    on = (tile >= 0) & (column < inside.size)
    on[on] = inside[column[on]] == tile[on]
    # A sample counts from the first of ``times`` that is not before it; never if there is none.
    step = np.searchsorted(times, taken_s)
    on &= step < times.size
    # Sums by step and tile, then running sums over steps.
    flat = np.bincount(step[on] * inside.size + column[on], ratios[on], times.size * inside.size)
    return np.asarray(np.cumsum(flat.reshape(times.size, inside.size), axis=0))


def _over_time(runs: pl.DataFrame, in_truth: list[Values], times: Values, level: float) -> pl.DataFrame:
    """Compute the table ``Known.over_time``.

    Args:
        runs: the table ``Known.runs``. in_truth: posterior of the true side at each time, (times,), of each run with a
            truth. times: times of the rows, s. level: confidence level of the limits.
    """
    known_s = runs["known_s"].fill_null(np.inf).to_numpy()
    wrong = (runs["decision"] != runs["truth"]).fill_null(False).to_numpy() & np.isfinite(known_s)
    number = max(runs.height, 1)  # without runs the shares are 0 / 1
    known = np.searchsorted(np.sort(known_s), times, side="right")
    low, high = wilson_limits(known, runs.height, level)
    return pl.DataFrame(
        {
            "time_s": times,
            "known": known / number,
            "known_low": low,
            "known_high": high,
            "wrong": np.searchsorted(np.sort(known_s[wrong]), times, side="right") / number,
            "belief_in_truth": np.mean(in_truth, axis=0) if in_truth else np.full(times.size, math.nan),
        }
    ).fill_nan(None)


def on_both_sides(result: Result) -> Result:
    """Return a result whose runs are in turn as they are, and on floors of the other sides that the prior knows.

    With two kinds, even-numbered runs are as they are and odd-numbered runs on mirrored floors.

    A mirrored floor is a random floor whose fill ratio lies at the same distance on the other side of the boundary. An
    odd-numbered run keeps its motion, and is observed and decided again on such a floor. With several kinds the floors
    have the numbers of tiles in each order. The scenario stays as it is: the floors are in the table of floors.

    Args:
        result: at least one run. The runs must be ones that ``simulation.replay`` accepts: simulated to t_end, with a
            strategy that does not steer.
    Raises:
        InputError: floors are not drawn for each run, the arena's border cuts them or leaves tiles outside, their fill
            ratio is the boundary, or the runs cannot be replayed.
    """
    scenario = result.scenario
    if scenario.floor.has_surface:
        raise InputError("no floor of values or patches mirrors another", field="floor.source")
    if not scenario.floor.drawn_by_run:
        raise InputError(
            "only floors that are drawn for each run can be mirrored; give a random floor such as random:0.55",
            field="floor.source",
        )
    if result.runs["truth"].null_count():
        raise InputError(
            "the fill ratio is the boundary, which has no mirror; give another", field="floor.source"
        )
    # The floor of the first run; the floors of all runs have the same number of vibrating tiles.
    floor = result.floor(int(result.runs["run"][0]))
    if tiles_inside(floor, scenario.arena.width_m, scenario.arena.height_m).size < floor.tiles.size:
        raise InputError(
            "the arena's border cuts the floor; give one that ends with the arena", field="floor"
        )
    sources = (
        _sources_of_kinds(floor, scenario.sensor.kinds) if _has_kinds(result) else [_mirror(result, floor)]
    )
    others = [replay(result, scenario.with_values({"floor.source": source})) for source in sources]
    tables: dict[str, Any] = {
        name: _in_turn([getattr(one, name) for one in (result, *others)])
        for name in ("observations", "inference", "robots", "runs", "floors")
    }
    return replace(result, **tables)  # the other tables do not depend on floors


def _mirror(result: Result, floor: Floor) -> str:
    """Return the source of random floors with the mirrored number of vibrating tiles."""
    vibrating, tiles = int(floor.tiles.sum()), floor.tiles.size
    # ``mirrored`` gives weights of 1 to two numbers of tiles: the floor's own number and its mirror. With the weight of
    # the floor's own number set to 0, the mirror is the only one left.
    weights = mirrored(vibrating, tiles, result.scenario.decision.decision_boundary)
    weights[vibrating] = 0.0
    # ``!r`` writes the share with all digits, so that it gives exactly this number of tiles.
    return f"random:{int(weights.argmax()) / tiles!r}"


def _sources_of_kinds(floor: Floor, kinds: int) -> list[str]:
    """Return the sources of random floors with the numbers of tiles of each kind in the other orders."""
    orders = orders_of(np.bincount(floor.tiles.ravel(), minlength=kinds))
    return ["random:" + ",".join(repr(number / floor.tiles.size) for number in order) for order in orders[1:]]


def _in_turn(tables: list[pl.DataFrame]) -> pl.DataFrame:
    """Join the runs of some tables, sorted by run: each run of one of them, in turn."""
    turn = pl.col("run") % len(tables)
    taken = [table.filter(turn == number) for number, table in enumerate(tables)]
    return pl.concat(taken).sort("run", maintain_order=True)
