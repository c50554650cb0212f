"""Fit energies to labelled samples: Gammas by kind of tile, reach of edges, and differences between tiles and robots.

The model is that of ``observation.edge_response``. For a sample with energy E at distance d from an edge (negative on
vibrating tiles) the likelihood is

    P(d) g_v(E / c_v) / c_v + (1 - P(d)) g_s(E / c_s) / c_s,    P(d) = Phi((reach - d) / blur)

with shifted Gamma densities g, and c the product of the factors of the tile and of the robot in that session. Gammas,
reach and blur are found by maximum likelihood (scipy's L-BFGS-B); factors are means of log E, each sample weighted by
the probability of its kind; both alternate three times. The spreads are what remains of the factors' variance
after that
of their means (method of moments). Errors: bootstrap over robots in sessions, with the factors held.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import gammaln, ndtr

from vibroswarm.calibrate.dataset import Dataset
from vibroswarm.recordings.threshold import cluster_weights, resample, robot_clusters

Floats = NDArray[np.float64]
FIELDS: Final = (
    "vibrating_shape", "vibrating_scale", "vibrating_location",
    "still_shape", "still_scale", "still_location", "edge_reach_m", "edge_blur_m",
)  # fmt: skip
SPREADS: Final = ("tile_spread", "robot_spread")
DRAWS: Final = 40
ROUNDS: Final = 3
_SEED: Final = 31
_FLOOR: Final = 1e-6
"""Density added for energies of neither kind, so that one outlier does not decide."""


@dataclass(frozen=True)
class SensorFit:
    """Estimates by field (``FIELDS`` and ``SPREADS``) and their bootstrap draws, (draws,)."""

    values: dict[str, float]
    draws: dict[str, Floats]


@dataclass(frozen=True)
class _Data:
    energy: Floats
    edge_m: Floats
    vibrating: Floats
    still: Floats
    """Factors of the vibrating and of the still tile at each sample."""


def fit_sensor(found: Dataset, draws: int = DRAWS) -> SensorFit:
    """Fit the sensor; needs at least some 500 samples of each kind."""
    samples = found.samples
    energy, edge = samples["energy"].to_numpy(), samples["edge_m"].to_numpy()
    on = samples["vibrating"].to_numpy()
    tile, other, run = (samples[name].to_numpy().astype(np.int64) for name in ("tile", "other", "run"))
    # Sessions on the same floor share tile factors; tiles of different floors are numbered apart.
    names = {hash(floor): k for k, floor in enumerate(dict.fromkeys(found.floors))}
    base = np.array([names[hash(floor)] for floor in found.floors])[run] * (
        max(f.tiles.size for f in found.floors)
    )
    below, neighbour = base + tile, np.where(other >= 0, base + other, base + tile)
    tiles = np.unique(np.r_[below, neighbour], return_inverse=True)[1].reshape(2, -1)
    vib_tile, still_tile = np.where(on, tiles[0], tiles[1]), np.where(on, tiles[1], tiles[0])
    cluster = robot_clusters(samples)
    of_tile, of_robot = np.zeros(int(tiles.max()) + 1), np.zeros(int(cluster.max()) + 1)
    theta = _start(energy, on)
    spreads = (0.0, 0.0)

    def with_factors() -> _Data:
        return _Data(
            energy,
            edge,
            *(np.exp(of_tile[tile_of] + of_robot[cluster]) for tile_of in (vib_tile, still_tile)),
        )

    for _ in range(ROUNDS):
        data = with_factors()
        theta = _fit(data, np.ones(energy.size), theta)
        of_tile, of_robot, spreads = _factors(
            theta, data, (vib_tile, still_tile), cluster, (of_tile, of_robot)
        )
    data = with_factors()
    theta = _fit(data, np.ones(energy.size), theta)
    values = _values(theta) | dict(zip(SPREADS, spreads, strict=True))
    bootstrap: dict[str, list[float]] = {name: [] for name in FIELDS}
    for draw in range(draws):
        weight = cluster_weights(_SEED, draw, 0, cluster)
        for name, value in _values(_fit(data, weight, theta, quick=True)).items():
            bootstrap[name].append(value)
    spread_draws = _spread_draws(of_tile, of_robot, draws)
    return SensorFit(
        values, {name: np.array(draws_of) for name, draws_of in bootstrap.items()} | spread_draws
    )


def fit_plain(energy: Floats, edge_m: Floats, vibrating: NDArray[np.bool_]) -> Floats:
    """Return the maximum-likelihood Gammas, reach and blur (``_start``) if all tiles and robots are alike."""
    even = np.ones(energy.size)
    return _fit(_Data(energy, edge_m, even, even), even, _start(energy, vibrating))


def log_likelihoods(theta: Floats, energy: Floats, edge_m: Floats) -> Floats:
    """Return the log likelihood of each sample if all tiles and robots are alike."""
    even = np.ones(energy.size)
    from_vibrating, from_still = _parts(theta, _Data(energy, edge_m, even, even))
    return np.asarray(np.log(from_vibrating + from_still + _FLOOR))


def _start(energy: Floats, on: NDArray[np.bool_]) -> Floats:
    """Return start values of a fit: log shape, log scale, location of either kind; then reach (cm), log blur (cm)."""
    theta = []
    for kind in (True, False):
        own = energy[on == kind]
        theta += [
            np.log(4.0),
            np.log(max(float(own.std()), 1e-3) / 2.0),
            max(float(own.min()) - 0.1, 0.0) * 0.5,
        ]
    return np.array([*theta, 0.5, np.log(1.5)])


def _values(theta: Floats) -> dict[str, float]:
    k, s, loc, k2, s2, loc2, reach, blur = theta
    plain = (np.exp(k), np.exp(s), loc, np.exp(k2), np.exp(s2), loc2, reach / 100.0, np.exp(blur) / 100.0)
    return {name: float(value) for name, value in zip(FIELDS, plain, strict=True)}


def _density(energy: Floats, shape: float, scale: float, location: float) -> Floats:
    x = np.maximum((energy - location) / scale, 1e-300)
    inside = energy > location
    return np.where(inside, np.exp((shape - 1) * np.log(x) - x - gammaln(shape)) / scale, 0.0)


def _parts(theta: Floats, data: _Data) -> tuple[Floats, Floats]:
    """Return the two terms of each sample's likelihood: read on a vibrating tile, and read on a still one."""
    k, s, loc, k2, s2, loc2, reach, blur = theta
    p = ndtr((reach / 100.0 - data.edge_m) / (np.exp(blur) / 100.0))
    from_vibrating = p * _density(data.energy / data.vibrating, np.exp(k), np.exp(s), loc) / data.vibrating
    from_still = (1 - p) * _density(data.energy / data.still, np.exp(k2), np.exp(s2), loc2) / data.still
    return from_vibrating, from_still


def _fit(data: _Data, weight: Floats, theta: Floats, quick: bool = False) -> Floats:
    """Maximise the weighted likelihood from start values ``theta``."""

    def loss(at: Floats) -> float:
        from_vibrating, from_still = _parts(at, data)
        return -float(weight @ np.log(from_vibrating + from_still + _FLOOR)) / float(weight.sum())

    bounds = [(0.0, 4.0), (-5.0, 2.0), (-2.0, 0.5)] * 2 + [(-3.0, 8.0), (-2.0, 2.0)]
    inside = np.clip(theta, *np.array(bounds).T)
    most = 25 if quick else 200
    optimum = minimize(
        loss, inside, method="L-BFGS-B", bounds=bounds, options={"maxiter": most, "ftol": 1e-10}
    )
    return np.asarray(optimum.x)


def _factors(
    theta: Floats, data: _Data, tiles: tuple[NDArray[np.int64], NDArray[np.int64]], cluster: NDArray[np.int64],
    before: tuple[Floats, Floats],
) -> tuple[Floats, Floats, tuple[float, float]]:  # fmt: skip
    """Return the logarithms of the factors of tiles and robots, and their spreads."""
    from_vibrating, from_still = _parts(theta, data)
    share = from_vibrating / (from_vibrating + from_still + _FLOOR)
    values = _values(theta)
    log_energy = np.log(np.maximum(data.energy, 1e-3))
    rest = [
        log_energy - _mean_log(*(values[f"{kind}_{name}"] for name in ("shape", "scale", "location")))
        for kind in ("vibrating", "still")
    ]
    weight = np.r_[share, 1 - share]
    left = np.concatenate(rest)
    at_robot = np.r_[cluster, cluster]
    at_tile = np.concatenate(tiles)
    of_tile, of_robot = before
    for _ in range(4):
        of_tile, tile_spread = _effects(left - of_robot[at_robot], weight, at_tile, of_tile.size)
        of_robot, robot_spread = _effects(left - of_tile[at_tile], weight, at_robot, of_robot.size)
    # Centre the log factors: their mean goes into the scale of the Gammas at the next fit.
    return of_tile - of_tile.mean(), of_robot - of_robot.mean(), (tile_spread, robot_spread)


def _effects(rest: Floats, weight: Floats, group: NDArray[np.int64], groups: int) -> tuple[Floats, float]:
    """Return the deviation of each group from the common mean, shrunk by its noise, and the sd between groups.

    The standard deviation is that without sampling noise. Groups with hardly any weight have deviation 0.

    Args:
        rest, weight, group: of each sample: value, weight, and number of its group from 0. groups: how many there are.
    """
    total = np.maximum(np.bincount(group, weight, groups), 1e-9)
    mean = np.bincount(group, weight * rest, groups) / total
    inside = np.bincount(group, weight * (rest - mean[group]) ** 2, groups) / total
    noise = inside / total
    counted = total > 5.0
    between = (
        max(float(mean[counted].var(ddof=1)) - float(noise[counted].mean()), 0.0)
        if counted.sum() > 1
        else 0.0
    )
    middle = float(mean[counted].mean()) if counted.any() else 0.0
    shrunk = np.where(counted, (mean - middle) * between / (between + noise + 1e-12), 0.0)
    return shrunk, float(np.sqrt(between))


def _mean_log(shape: float, scale: float, location: float) -> float:
    """Return the mean of log(G), G of a shifted Gamma distribution and at least 1e-3, from 400 quantiles."""
    from scipy.special import gammaincinv

    u = (np.arange(400) + 0.5) / 400
    return float(np.log(np.maximum(scale * gammaincinv(shape, u) + location, 1e-3)).mean())


def _spread_draws(of_tile: Floats, of_robot: Floats, draws: int) -> dict[str, Floats]:
    """Return the bootstrap draws of the spreads of tiles and robots."""
    spreads: dict[str, Floats] = {}
    for name, values, stream in (("tile_spread", of_tile, 1), ("robot_spread", of_robot, 2)):
        picked = [values[resample(_SEED, draw, stream, values.size)] for draw in range(draws)]
        spreads[name] = np.array([factors.std(ddof=1) if factors.size > 1 else 0.0 for factors in picked])
    return spreads
