"""When could it be known? The exact posterior over tiles from all samples with their places: a bound.

| name | symbol | equation |
|---|---|---|
| tiles in the arena | N | those of which some part lies inside; all count alike, whatever their area inside |
| likelihood ratio of tile t | L_t | product over its samples of P(reading, vibrating) / P(reading, still) |
| weight of k vibrating tiles | e_k | sum over all sets of k tiles of the product of their L_t |
| prior of k vibrating tiles | pi_k | each set of k tiles as likely as any other |
| posterior | P(k) | pi_k e_k / C(N, k), over its sum |
| known | - | P(k > x N) >= 1 - alpha, or P(k < x N) >= 1 - alpha |

| prior | pi_k |
|---|---|
| ``tiles`` | C(N, k) / 2^N: each tile vibrates or not as a coin falls |
| ``counts`` | 1 / (N + 1): each fill ratio as likely as any other |
| ``mirror`` | 1/2 each for the run's own number of vibrating tiles and its mirror across the boundary, 2xN - k |
| (N + 1,) numbers | as given |

Who knows the places, the sensor's errors and this prior can know no more from these samples: no rule on them stops
sooner with a posterior error of alpha. Only this is called a bound, and always with its prior. Where floors are not as
the prior has them it is off its alpha, and ``wrong`` shows by how much: with floors near the boundary ``tiles`` and
above all ``counts`` believe too soon, since few of their floors are as near; ``mirror`` is fair to such a study.

e_k comes from the Poisson-binomial recursion with p_t = L_t / (1 + L_t), since prod (1 - p_t + p_t z) is
sum e_k z^k over prod (1 + L_t).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import polars as pl
from numpy.typing import ArrayLike, NDArray
from scipy.special import expit, gammaln, logsumexp

from vibroswarm.analysis.intervals import Interval, mean_interval, plain, wilson, wilson_limits
from vibroswarm.errors import InputError
from vibroswarm.fields import Sensor
from vibroswarm.floors.floor import Floor
from vibroswarm.observation.reading import error_rates
from vibroswarm.result import Result

PriorName = Literal["tiles", "counts", "mirror"]
Prior = PriorName | ArrayLike
Values = NDArray[np.float64]

POINTS = 121
_BLOCK = 4_000_000
_SMALL = 1e-290
"""Sums below this may lack what fell below the smallest number: they are made again in logarithms."""


@dataclass(frozen=True)
class Known:
    """When it could be known which side of the boundary the floor is on; times in s."""

    prior: str
    alpha: float
    runs: pl.DataFrame
    """run, known_s (null: not by the end), decision (-1: none), truth, belief_in_truth (at the end)."""
    over_time: pl.DataFrame
    """time_s, known, known_low, known_high, wrong (share known and wrong), belief_in_truth (mean)."""
    known: Interval
    """Share of runs in which it could be known by the end."""
    wrong: Interval
    """Share wrong among these: about alpha or less where floors are as the prior has them."""
    time_s: Interval
    """Mean of min(time known, t_end)."""

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON, the figures over time included, the runs not."""
        curve = [
            {name: plain(value) for name, value in row.items()}
            for row in self.over_time.iter_rows(named=True)
        ]
        return {
            "prior": self.prior,
            "alpha": self.alpha,
            "known": self.known.as_dict(),
            "wrong": self.wrong.as_dict(),
            "time_s": self.time_s.as_dict(),
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
    """When the side of the boundary could be known with posterior error alpha: to the next time of a grid.

    Args:
        result: runs to their end. prior: see the module's head. times_s: increasing; without it 121 from 0 to t_end.
        energies: take the energies that were read (Gamma sensor), not only the bits.
    Raises:
        InputError: an alpha outside (0, 1/2), a prior of other length than N + 1, energies that the result does
            not hold or whose density is not known, no tile in the arena, runs that stopped early.
    """
    if result.runs["stopped_early"].any():
        raise InputError("runs that stopped early lack the samples after; run to t_end", field="result")
    if not 0.0 < alpha < 0.5:
        raise InputError(f"{alpha!r} is no posterior error; give a share below 0.5", field="alpha")
    scenario, t_end_s = result.scenario, result.scenario.run.t_end_s
    times = np.linspace(0.0, t_end_s, POINTS) if times_s is None else np.asarray(times_s, np.float64).ravel()
    ratios = log_ratios(result, energies)
    at, below = result.motion["run"].to_numpy(), result.observations["tile"].to_numpy()
    when, boundary = result.motion["time_s"].to_numpy(), scenario.decision.decision_boundary
    rows, sides = [], []
    for run, truth in result.runs.select("run", "truth").iter_rows():
        part = slice(*(int(k) for k in np.searchsorted(at, [run, run + 1])))
        floor = result.floor(run)
        inside = tiles_inside(floor, scenario.arena.width_m, scenario.arena.height_m)
        sums = _sums_over_time(ratios[part], below[part], when[part], inside, times)
        of_floor: Prior = prior
        if isinstance(prior, str) and prior == "mirror":
            of_floor = mirrored(int(floor.tiles.ravel()[inside].sum()), inside.size, boundary)
        above, under = sides_of(sums, log_prior(of_floor, inside.size), boundary)
        sides.append((above, under))
        rows.append((run, *_first_known(above, under, alpha, times), truth, _in_truth(above, under, truth)))
    schema = {"run": pl.UInt32, "known_s": pl.Float64, "decision": pl.Int8, "truth": pl.Int8}
    runs = pl.DataFrame(rows, schema=schema | {"belief_in_truth": pl.Float64}, orient="row")
    decided = runs.filter((pl.col("decision") != -1) & pl.col("truth").is_not_null())
    wrong = decided.filter(pl.col("decision") != pl.col("truth")).height
    return Known(
        prior=prior if isinstance(prior, str) else "given",
        alpha=alpha,
        runs=runs,
        over_time=_over_time(runs, sides, times, level),
        known=wilson(runs.filter(pl.col("decision") != -1).height, runs.height, level),
        wrong=wilson(wrong, decided.height, level),
        time_s=mean_interval(runs["known_s"].fill_null(t_end_s).to_numpy(), level),
    )


def log_ratios(result: Result, energies: bool = False) -> Values:
    """ln P(reading, vibrating) / P(reading, still) of each sample, shape (samples,)."""
    sensor = result.scenario.sensor
    if energies:
        return _log_density_ratio(result.observations["energy"], sensor)
    a, b = error_rates(sensor)
    with np.errstate(divide="ignore"):
        of_one, of_zero = np.log([1.0 - b, a]), np.log([b, 1.0 - a])
    # A reading that only one kind of tile gives settles it: as good as certain, and still a number.
    of_bit = np.array([np.clip(of_zero[0], -700, 0) - np.clip(of_zero[1], -700, 0)])
    of_bit = np.append(of_bit, np.clip(of_one[0], -700, 0) - np.clip(of_one[1], -700, 0))
    return np.asarray(of_bit[result.observations["observation"].to_numpy()])


def _log_density_ratio(energy: pl.Series, sensor: Sensor) -> Values:
    from scipy import stats

    if sensor.model != "gamma":
        raise InputError(
            "drawn from measured ones they have no density; leave energies out", field="energies"
        )
    if energy.null_count():
        raise InputError(
            "this result holds none; simulate with energies, or leave them out", field="energies"
        )
    read = energy.cast(pl.Float64).to_numpy()
    densities = [
        stats.gamma.logpdf(read, shape, loc=location, scale=scale)
        for shape, scale, location in (
            (sensor.vibrating_shape, sensor.vibrating_scale, sensor.vibrating_location),
            (sensor.still_shape, sensor.still_scale, sensor.still_location),
        )
    ]
    return np.asarray(np.clip(densities[0], -700, None) - np.clip(densities[1], -700, None))


def tiles_inside(floor: Floor, width_m: float, height_m: float) -> NDArray[np.int64]:
    """Indices of the tiles of which some part lies in the arena, of this width and height in m; shape (tiles,).

    Raises:
        InputError: none does.
    """
    rows, columns, tile_width, tile_height, left, bottom = floor.geometry
    x, y = left + tile_width * np.arange(columns), bottom + tile_height * np.arange(rows)[::-1]
    across = (x < width_m - 1e-9) & (x + tile_width > 1e-9)
    up = (y < height_m - 1e-9) & (y + tile_height > 1e-9)
    inside = np.flatnonzero(up[:, None] & across)
    if inside.size == 0:
        raise InputError("no tile lies in the arena; nothing can be known", field="floor")
    return inside


def _sums_over_time(
    ratios: Values,
    tile: NDArray[np.int32],
    when: Values,
    inside: NDArray[np.int64],
    times: Values,
) -> Values:
    """ln L_t at each time, shape (times, N)."""
    column = np.searchsorted(inside, tile)
    on = (tile >= 0) & (column < inside.size)
    on[on] = inside[column[on]] == tile[on]
    step = np.searchsorted(times, when)  # counts from the first time that is not before the sample
    on &= step < times.size
    flat = np.bincount(step[on] * inside.size + column[on], ratios[on], times.size * inside.size)
    return np.asarray(np.cumsum(flat.reshape(times.size, inside.size), axis=0))


def log_prior(prior: Prior, tiles: int) -> Values:
    """ln pi_k, shape (tiles + 1,).

    Raises:
        InputError: a prior of another name, or weights that are negative, all 0, or not tiles + 1.
    """
    if isinstance(prior, str):
        if prior == "tiles":
            return np.asarray(_log_choose(tiles) - tiles * math.log(2.0))
        if prior == "counts":
            return np.full(tiles + 1, -math.log(tiles + 1.0))
        raise InputError(
            f"'{prior}' is no prior; tiles, counts, mirror or {tiles + 1} numbers", field="prior"
        )
    weights = np.asarray(prior, dtype=np.float64).ravel()
    if weights.size != tiles + 1 or not (weights >= 0).all() or not 0 < weights.sum() < np.inf:
        raise InputError(
            f"give a weight of at least 0 for each number of vibrating tiles from 0 to {tiles}", field="prior"
        )
    with np.errstate(divide="ignore"):
        return np.asarray(np.log(weights / weights.sum()), dtype=np.float64)


def mirrored(vibrating: int, tiles: int, boundary: float) -> Values:
    """Weights of a number of vibrating tiles and of its mirror across the boundary, shape (tiles + 1,)."""
    weights = np.zeros(tiles + 1)
    weights[[vibrating, min(max(round(2 * boundary * tiles - vibrating), 0), tiles)]] = 1.0
    return weights


def _log_choose(n: int) -> Values:
    k = np.arange(n + 1)
    return np.asarray(gammaln(n + 1.0) - gammaln(k + 1.0) - gammaln(n - k + 1.0), dtype=np.float64)


def count_weights(log_likelihood_ratios: Values) -> Values:
    """e_k up to a constant of each row: (rows, N) ln L_t to (N + 1, rows), by the recursion over tiles."""
    vibrates, still = expit(log_likelihood_ratios.T), expit(-log_likelihood_ratios.T)
    weights = np.zeros((vibrates.shape[0] + 1, vibrates.shape[1]))
    weights[0] = 1.0
    for t in range(vibrates.shape[0]):
        weights[1 : t + 2] = weights[1 : t + 2] * still[t] + weights[: t + 1] * vibrates[t]
        weights[0] *= still[t]
    return weights


def log_count_weights(log_likelihood_ratios: Values) -> Values:
    """The logarithm of ``count_weights``, where that lies below the smallest number; ten times slower."""
    vibrates, still = (
        -np.logaddexp(0.0, -log_likelihood_ratios.T),
        -np.logaddexp(0.0, log_likelihood_ratios.T),
    )
    weights = np.full((vibrates.shape[0] + 1, vibrates.shape[1]), -np.inf)
    weights[0] = 0.0
    for t in range(vibrates.shape[0]):
        weights[1 : t + 2] = np.logaddexp(weights[1 : t + 2] + still[t], weights[: t + 1] + vibrates[t])
        weights[0] += still[t]
    return weights


def posterior_of_counts(log_likelihood_ratios: Values, log_of_prior: Values) -> Values:
    """P(k) for each row of ln L_t: (rows, N) to (rows, N + 1)."""
    rows, tiles = log_likelihood_ratios.shape
    of_set = log_of_prior - _log_choose(tiles)
    of_set -= of_set.max()
    at_once = max(1, _BLOCK // (tiles + 1))
    parts = [np.empty((0, tiles + 1))]
    for first in range(0, rows, at_once):
        ratios = log_likelihood_ratios[first : first + at_once]
        joint = count_weights(ratios) * np.exp(of_set)[:, None]
        total = joint.sum(axis=0)
        small = total < _SMALL
        joint /= np.where(small, 1.0, total)
        if small.any():
            logs = log_count_weights(ratios[small]) + of_set[:, None]
            joint[:, small] = np.exp(logs - logsumexp(logs, axis=0))
        parts.append(joint.T)
    return np.concatenate(parts)


def sides_of(log_likelihood_ratios: Values, log_of_prior: Values, boundary: float) -> tuple[Values, Values]:
    """P(k > x N) and P(k < x N) for each row; what is left lies on the boundary."""
    tiles = log_likelihood_ratios.shape[1]
    k = np.arange(tiles + 1)
    posterior = posterior_of_counts(log_likelihood_ratios, log_of_prior)
    above, below = k > boundary * tiles + 1e-9, k < boundary * tiles - 1e-9
    return posterior[:, above].sum(axis=1), posterior[:, below].sum(axis=1)


def _first_known(above: Values, under: Values, alpha: float, times: Values) -> tuple[float | None, int]:
    sure = np.flatnonzero(np.maximum(above, under) >= 1.0 - alpha)
    if not sure.size:
        return None, -1
    return float(times[sure[0]]), int(above[sure[0]] > under[sure[0]])


def _in_truth(above: Values, under: Values, truth: int | None) -> float | None:
    return None if truth is None or not above.size else float((above if truth == 1 else under)[-1])


def _over_time(
    runs: pl.DataFrame, sides: list[tuple[Values, Values]], times: Values, level: float
) -> pl.DataFrame:
    at = runs["known_s"].fill_null(np.inf).to_numpy()
    wrong = (runs["decision"] != runs["truth"]).fill_null(False).to_numpy() & np.isfinite(at)
    number = max(runs.height, 1)
    known = np.searchsorted(np.sort(at), times, side="right")
    low, high = wilson_limits(known, runs.height, level)
    truths = runs["truth"].to_list()
    beliefs = [
        above if truth == 1 else under
        for (above, under), truth in zip(sides, truths, strict=True)
        if truth is not None
    ]
    return pl.DataFrame(
        {
            "time_s": times,
            "known": known / number,
            "known_low": low,
            "known_high": high,
            "wrong": np.searchsorted(np.sort(at[wrong]), times, side="right") / number,
            "belief_in_truth": np.mean(beliefs, axis=0) if beliefs else np.full(times.size, np.nan),
        }
    ).fill_nan(None)
