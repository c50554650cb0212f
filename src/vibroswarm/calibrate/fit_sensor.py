"""Fit energies to labelled samples: Gammas by kind of tile, reach of edges, and differences between tiles and robots.

The model is that of ``observation.edge_response``. For a sample with energy E at distance d from an edge (negative on
vibrating tiles) the likelihood is

    P(d) g_v(E / c_v) / c_v + (1 - P(d)) g_s(E / c_s) / c_s,    P(d) = Phi((reach - d) / blur)

with shifted Gamma densities g_v (vibrating) and g_s (still). Every tile and every robot in a session multiplies the
energies by a factor of its own, and c is the product of two factors: c_v of the nearest vibrating tile and the robot,
c_s of the nearest still tile and the robot. One of these tiles is the tile below the robot. P(d) is the probability
that the sample was read as on a vibrating tile.

The fit alternates between two steps, ``ROUNDS`` times. The first finds the Gamma distributions, reach and blur by
maximum likelihood (scipy's L-BFGS-B). The second finds the factors as means of log E over samples, each weighted by the
probability that it was read on this kind of tile. The spreads of tiles and of robots are the standard deviations of
their log factors, without sampling noise (method of moments). Standard errors come from a bootstrap over robots in
sessions, with fixed factors, and the error of their mean; those of the spreads from the chi-square law of a variance
of so many groups.

Inside this module the parameters are one vector theta of 8 values: log shape, log scale and location of the Gamma
distribution for vibrating tiles; the same three for still tiles; reach (cm); log blur (cm).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from scipy.optimize import minimize
from scipy.special import gammaincinv, gammaln, ndtr

from vibroswarm.calibrate.dataset import Dataset
from vibroswarm.calibrate.few_groups import drawn_variances, evenly_drawn
from vibroswarm.core.arrays import Bools, Floats, Ints
from vibroswarm.core.child_python import with_one_blas_thread
from vibroswarm.errors import InputError
from vibroswarm.recordings.threshold import cluster_weights, robot_clusters
from vibroswarm.statistics.intervals import generator

FIELDS: Final = (
    "vibrating_shape", "vibrating_scale", "vibrating_location",
    "still_shape", "still_scale", "still_location", "edge_reach_m", "edge_blur_m",
)  # fmt: skip
"""Fields of the section ``sensor`` that theta gives, in the order of theta."""
SPREADS: Final = ("tile_spread", "robot_spread")
"""Fields of the section ``sensor``: standard deviations of the log factors of tiles and of robots."""
SCALED: Final = ("vibrating_scale", "vibrating_location", "still_scale", "still_location")
"""Fields in the unit of the energies, which a factor of all energies multiplies."""
DIGITS: Final = 5
"""Digits after the point of fitted values in the scenario; of energies in their ``unit_of``."""
DRAWS: Final = 40
"""Bootstrap resamples."""
ROUNDS: Final = 3
"""How often the fit alternates between theta and the factors."""
_SEED: Final = 31
"""Seed of the bootstrap."""
_FLOOR: Final = 1e-6
"""Density added to each sample's likelihood, so that an energy impossible on both kinds of tile does not decide the
fit."""


@dataclass(frozen=True)
class SensorFit:
    """Estimates by field (``FIELDS`` and ``SPREADS``) and their bootstrap draws, (draws,)."""

    values: dict[str, float]
    draws: dict[str, Floats]
    unit: float = 1.0
    """Unit of the energies during the fit (``unit_of``)."""

    def rounded(self, values: Mapping[str, float]) -> dict[str, float]:
        """Return values, by field, with as many digits as a scenario has of them."""
        of_energies = DIGITS - round(math.log10(self.unit))
        return {
            name: round(value, of_energies if name in SCALED else DIGITS) for name, value in values.items()
        }


class _Between(NamedTuple):
    """How far groups (tiles, or robots) are apart, in log E."""

    total: float = 0.0
    """Variance of the groups' means."""
    noise: float = 0.0
    """The part of it that is sampling noise."""
    groups: int = 1

    @property
    def variance(self) -> float:
        """Variance between groups without sampling noise."""
        return max(self.total - self.noise, 0.0)

    def drawn(self, draws: int, purpose: str) -> Floats:
        """Return draws of the spread, (draws,): of a variance of so many groups, less noise (``few_groups``)."""
        freedom = self.groups - 1
        if freedom < 1:
            return np.zeros(draws)
        between = drawn_variances(self.total, freedom, evenly_drawn(draws, _SEED, purpose)) - self.noise
        return np.asarray(
            np.minimum(np.sqrt(np.maximum(between, 0.0)), 2.0)
        )  # the largest that a scenario takes


class _Data(NamedTuple):
    """Samples, (samples,) each."""

    energy: Floats
    edge_m: Floats
    """Signed distance from the edge, m, negative on vibrating tiles."""
    vibrating: Floats
    """Factor c_v: of the nearest vibrating tile, times that of the robot."""
    still: Floats
    """Factor c_s: of the nearest still tile, times that of the robot."""


@with_one_blas_thread
def fit_sensor(found: Dataset, draws: int = DRAWS) -> SensorFit:
    """Fit the Gamma distributions of energies, reach and blur of edges, and the spreads of tiles and robots.

    Some 500 samples on each kind of tile are needed for usable estimates. Positions are corrected for the camera.

    Raises:
        InputError: all samples lie on one kind of tile, or no law within the bounds of the fit describes the energies.
    """
    samples = found.samples
    energies, edge, on = (samples[name].to_numpy() for name in ("energy", "edge_m", "vibrating"))
    unit = unit_of(energies)
    # Numbers of tiles on all grounds. ``other`` is -1 on a floor with one kind of tile. Any tile will do there, so the
    # tile below is used: the distance d is infinite, so P(d) leaves the other kind's term without weight.
    tile, other, ground = (samples[name].to_numpy().astype(np.int64) for name in ("tile", "other", "ground"))
    first_tile = ground * max(floor.tiles.size for floor in found.floors)
    numbers = np.r_[first_tile + tile, first_tile + np.where(other >= 0, other, tile)]
    # 0, 1, 2, ... without gaps, because they index the array of factors.
    below, neighbour = np.unique(numbers, return_inverse=True)[1].reshape(2, -1)
    at_tile = (
        np.where(on, below, neighbour),
        np.where(on, neighbour, below),
    )  # nearest vibrating, nearest still
    cluster = robot_clusters(samples)
    # Logarithms of the factors, all factors 1 at first.
    of_tile, of_robot = np.zeros(int(np.max(at_tile)) + 1), np.zeros(int(cluster.max()) + 1)
    apart = (_Between(), _Between())
    theta = _start(energies / unit, on)
    for k in range(ROUNDS + 1):
        factors = [np.exp(of_tile[number] + of_robot[cluster]) for number in at_tile]
        data = _Data(energies / unit, edge, *factors)
        theta = _fit(data, np.ones(on.size), theta)
        if k < ROUNDS:  # the last theta belongs to the last factors
            of_tile, of_robot, apart = _factors(theta, data, at_tile, cluster, of_tile, of_robot)
    values = _values(theta, unit) | {
        name: math.sqrt(one.variance) for name, one in zip(SPREADS, apart, strict=True)
    }
    for kind, own in (("vibrating", energies[on]), ("still", energies[~on])):
        # Energies that are all alike are beyond the bounds of the fit, which then ends at them.
        shape, scale, location = (values[f"{kind}_{name}"] for name in ("shape", "scale", "location"))
        low, high = scale * gammaincinv(shape, np.array([0.05, 0.95])) + location
        if not low <= np.median(own) <= high:
            raise InputError(
                f"no law can be fitted to those on {kind} tiles; it takes energies that vary",
                field="the energies",
            )
    # A fit to a resample starts from the best theta, which is close to its own optimum, so a quick fit is enough.
    drawn = [
        _values(_fit(data, cluster_weights(_SEED, draw, stream=0, cluster=cluster), theta, quick=True), unit)
        for draw in range(draws)
    ]
    # The mean of the factors is that of these tiles and robots only.
    error = math.sqrt(sum(one.variance / one.groups for one in apart))
    means = np.exp(error * generator(_SEED, "mean factor").standard_normal(draws))
    bootstrap = {
        name: np.array([one[name] for one in drawn]) * (means if name in SCALED else 1.0) for name in FIELDS
    }
    spreads = {name: one.drawn(draws, name) for name, one in zip(SPREADS, apart, strict=True)}
    return SensorFit(values, bootstrap | spreads, unit)


def unit_of(energy: Floats) -> float:
    """Return the power of 10 nearest to the median of energies, the unit for which the bounds of the fit are."""
    median = float(np.median(energy))
    return 10.0 ** round(math.log10(median)) if median > 0.0 else 1.0


def fit_plain(energy: Floats, edge_m: Floats, vibrating: Bools) -> Floats:
    """Return theta of maximum likelihood, (8,), for tiles and robots without differences (all factors 1).

    Raises:
        InputError: all samples lie on one kind of tile.
    """
    ones = np.ones(energy.size)
    return _fit(_Data(energy, edge_m, ones, ones), ones, _start(energy, vibrating))


def log_likelihoods(theta: Floats, energy: Floats, edge_m: Floats) -> Floats:
    """Return the log likelihood of each sample, (samples,), with ``theta`` of ``fit_plain``."""
    ones = np.ones(energy.size)
    return np.log(sum(_parts_of(_Data(energy, edge_m, ones, ones), theta)) + _FLOOR)


def _start(energy: Floats, on: Bools) -> Floats:
    """Return the theta that a fit starts from: of each kind of tile the shape 4, and the standard deviation.

    Raises:
        InputError: there is no sample on one kind of tile.
    """
    theta = []
    for kind in (True, False):
        own = energy[on == kind]
        if not own.size:
            raise InputError(
                f"no sample lies on a {'vibrating' if kind else 'still'} tile; give recordings with both kinds of tile",
                field="REAL",
            )
        theta += [
            np.log(4.0),
            np.log(max(float(own.std()), 1e-3) / 2.0),  # with shape 4, the standard deviation is 2 scales
            # The location should be below the least energy, because the density is 0 up to the location. Half of the
            # least energy, after 0.1 is taken off, leaves some room; it is 0 if the least energy is 0.1 or less.
            max(float(own.min()) - 0.1, 0.0) * 0.5,
        ]
    return np.array([*theta, 0.5, np.log(1.5)])


def _values(theta: Floats, unit: float = 1.0) -> dict[str, float]:
    """Return the parameters by field (``FIELDS``), without logarithms, in metres and for energies in this unit."""
    # Shape, scale and location for vibrating tiles (1) and for still tiles (2).
    log_shape1, log_scale1, loc1, log_shape2, log_scale2, loc2, reach_cm, log_blur_cm = theta
    plain = (
        np.exp(log_shape1), unit * np.exp(log_scale1), unit * loc1,
        np.exp(log_shape2), unit * np.exp(log_scale2), unit * loc2,
        reach_cm / 100.0, np.exp(log_blur_cm) / 100.0,
    )  # fmt: skip
    return {name: float(value) for name, value in zip(FIELDS, plain, strict=True)}


def _density(energy: Floats, shape: float, scale: float, location: float) -> Floats:
    """Return the density of a shifted Gamma distribution at each energy; 0 up to its location."""
    x = np.maximum((energy - location) / scale, 1e-300)  # above 0 for the logarithm
    return np.where(energy > location, np.exp((shape - 1) * np.log(x) - x - gammaln(shape)) / scale, 0.0)


def _parts_of(data: _Data, theta: Floats) -> tuple[Floats, Floats]:
    """Return the two terms of each sample's likelihood, (samples,) each, vibrating tile first."""
    p = ndtr((theta[6] / 100.0 - data.edge_m) / (np.exp(theta[7]) / 100.0))  # P(d)
    vibrating, still = (
        _density(data.energy / factor, np.exp(log_shape), np.exp(log_scale), location) / factor
        for factor, (log_shape, log_scale, location) in (
            (data.vibrating, theta[:3]),
            (data.still, theta[3:6]),
        )
    )
    return p * vibrating, (1 - p) * still


def _fit(data: _Data, weight: Floats, theta: Floats, quick: bool = False) -> Floats:
    """Return the theta of largest weighted likelihood; few iterations if ``quick``, from nearly the best theta."""

    def loss(at: Floats) -> float:
        return -float(weight @ np.log(sum(_parts_of(data, at)) + _FLOOR)) / float(weight.sum())

    # Bounds of theta: log shape, log scale and location of each kind of tile, reach (cm), log blur (cm).
    # All energies may be far from 0, with a law that begins there.
    location = (-2.0, max(float(data.energy.min()), 0.5))
    bounds = [(0.0, 4.0), (-5.0, 2.0), location] * 2 + [(-3.0, 8.0), (-2.0, 2.0)]
    optimum = minimize(
        loss,
        np.clip(theta, *np.array(bounds).T),
        method="L-BFGS-B",
        bounds=bounds,
        options={"maxiter": 25 if quick else 200, "ftol": 1e-10},
    )
    return np.asarray(optimum.x)


def _factors(
    theta: Floats, data: _Data, tiles: tuple[Ints, Ints], cluster: Ints, of_tile: Floats, of_robot: Floats,
) -> tuple[Floats, Floats, tuple[_Between, _Between]]:  # fmt: skip
    """Estimate the log factors of tiles and robots, and how far both are apart, from the present ones.

    Every sample counts twice: as if it was read on its nearest vibrating tile, and as if on its nearest still tile
    (``tiles``). The two are weighted by their probabilities. ``cluster`` is a sample's robot in its session.
    """
    from_vibrating, from_still = _parts_of(data, theta)
    # Probability that a sample was read on a vibrating tile. Without ``_FLOOR`` it would be 0 / 0 for an energy that is
    # impossible on both kinds; such a sample counts as read on the still tile.
    share = from_vibrating / (from_vibrating + from_still + _FLOOR)
    # Log energy minus its mean, if the sample was read on a vibrating tile, and if it was read on a still tile.
    log_energy = np.log(np.maximum(data.energy, 1e-3))
    values = list(_values(theta).values())
    deviation = np.r_[log_energy - _mean_log(*values[:3]), log_energy - _mean_log(*values[3:6])]
    weight, at_robot, at_tile = np.r_[share, 1 - share], np.r_[cluster, cluster], np.concatenate(tiles)
    # Tiles and robots in turn, because the factors of each are estimated with those of the other taken away; after four
    # turns they hardly change.
    for _ in range(4):
        of_tile, tiles_apart = _effects(deviation - of_robot[at_robot], weight, at_tile, of_tile.size)
        of_robot, robots_apart = _effects(deviation - of_tile[at_tile], weight, at_robot, of_robot.size)
    # Centre the log factors so that factors have the mean 1, as in a scenario: the rest goes into the scales of the
    # Gamma distributions at the next fit.
    centred = [
        effects - effects.mean() - apart.variance / 2
        for effects, apart in ((of_tile, tiles_apart), (of_robot, robots_apart))
    ]
    return centred[0], centred[1], (tiles_apart, robots_apart)


def _effects(rest: Floats, weight: Floats, group: Ints, groups: int) -> tuple[Floats, _Between]:
    """Return the effect of each of ``groups`` tiles or robots, (groups,), and how far they are apart.

    An effect is the group's mean minus the mean over groups, multiplied by the share of its variance that is no
    sampling noise. Groups of total weight 5 or less have effect 0. Other arguments: of each sample, (samples,).
    """
    total = np.maximum(np.bincount(group, weight, groups), 1e-9)  # above 0, for groups without samples
    mean = np.bincount(group, weight * rest, groups) / total
    # Variance within each group.
    inside = np.bincount(group, weight * (rest - mean[group]) ** 2, groups) / total
    noise = inside / total  # variance of the group's mean
    counted = total > 5.0
    of_means, count = mean[counted], int(counted.sum())
    apart = (
        _Between(float(of_means.var(ddof=1)), float(noise[counted].mean()), count)
        if count > 1
        else _Between()
    )
    middle = float(of_means.mean()) if count else 0.0
    shrunk = np.where(counted, (mean - middle) * apart.variance / (apart.variance + noise + 1e-12), 0.0)
    return shrunk, apart


def _mean_log(shape: float, scale: float, location: float) -> float:
    """Return the mean of log(max(G, 1e-3)), as in ``_factors``, of a shifted Gamma law, by the midpoint rule."""
    u = (np.arange(400) + 0.5) / 400  # probabilities whose quantiles stand for the distribution
    return float(np.log(np.maximum(scale * gammaincinv(shape, u) + location, 1e-3)).mean())
