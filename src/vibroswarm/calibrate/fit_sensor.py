"""What robots read, fitted to labelled samples: Gammas by kind of tile, reach of edges, tiles and robots that differ.

The model is that of ``observation.felt``. Of a sample with energy E at distance d of an edge (negative on vibrating
tiles) the likelihood is

    P(d) g_v(E / c_v) / c_v + (1 - P(d)) g_s(E / c_s) / c_s,    P(d) = Phi((reach - d) / blur)

with g of shifted Gammas, and c the factors of the tile felt and of the robot in that session. Gammas, reach and blur are
of maximum likelihood (scipy's L-BFGS-B); factors are means of log E, each sample counting as much as it is likely of its
kind; both in turn, three times. The spreads are what is left of the factors' variance after that of their means (method
of moments). Errors: robots and sessions are drawn anew with replacement, with the factors as found.
"""  # noqa: E501

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import gammaln, ndtr

from vibroswarm.calibrate.measured import Measured
from vibroswarm.draws import Purpose, uniforms

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
"""Density of energies that are of neither kind: one odd reading does not decide."""


@dataclass(frozen=True)
class SensorFit:
    """Values by field (``FIELDS`` and ``SPREADS``) and their draws (draws,), for standard errors."""

    values: dict[str, float]
    draws: dict[str, Floats]


@dataclass(frozen=True)
class _Data:
    energy: Floats
    edge_m: Floats
    vibrating: Floats
    still: Floats
    """Factors of the vibrating and of the still tile in question."""


def fit_sensor(found: Measured, draws: int = DRAWS) -> SensorFit:
    """Fit; at least some 500 samples of each kind are wanted."""
    samples = found.samples
    energy, edge = samples["energy"].to_numpy(), samples["edge_m"].to_numpy()
    on = samples["vibrating"].to_numpy()
    tile, other, run = (samples[name].to_numpy().astype(np.int64) for name in ("tile", "other", "run"))
    # The same floor is the same tiles; another floor has other ones.
    names = {hash(floor): k for k, floor in enumerate(dict.fromkeys(found.floors))}
    base = np.array([names[hash(floor)] for floor in found.floors])[run] * (
        max(f.tiles.size for f in found.floors)
    )
    below, beside = base + tile, np.where(other >= 0, base + other, base + tile)
    tiles = np.unique(np.r_[below, beside], return_inverse=True)[1].reshape(2, -1)
    vib_tile, still_tile = np.where(on, tiles[0], tiles[1]), np.where(on, tiles[1], tiles[0])
    cluster = np.unique(
        np.column_stack([run, samples["robot"].to_numpy().astype(np.int64)]), axis=0, return_inverse=True
    )[1].ravel()
    of_tile, of_robot = np.zeros(int(tiles.max()) + 1), np.zeros(int(cluster.max()) + 1)
    theta = _start(energy, on)
    spreads = (0.0, 0.0)

    def given(tiles: Floats, robots: Floats) -> _Data:
        both = (np.exp(tiles[one] + robots[cluster]) for one in (vib_tile, still_tile))
        return _Data(energy, edge, *both)

    for _ in range(ROUNDS):
        data = _Data(
            energy,
            edge,
            np.exp(of_tile[vib_tile] + of_robot[cluster]),
            np.exp(of_tile[still_tile] + of_robot[cluster]),
        )
        theta = _fit(data, np.ones(energy.size), theta)
        of_tile, of_robot, spreads = _factors(
            theta, data, (vib_tile, still_tile), cluster, (of_tile, of_robot)
        )
    data = _Data(
        energy,
        edge,
        np.exp(of_tile[vib_tile] + of_robot[cluster]),
        np.exp(of_tile[still_tile] + of_robot[cluster]),
    )
    theta = _fit(data, np.ones(energy.size), theta)
    values = _values(theta) | dict(zip(SPREADS, spreads, strict=True))
    kept: dict[str, list[float]] = {name: [] for name in FIELDS}
    clusters = int(cluster.max()) + 1
    for draw in range(draws):
        picked = (uniforms(_SEED, draw, 0, Purpose.BOOTSTRAP, clusters) * clusters).astype(int)
        weight = np.bincount(picked, minlength=clusters)[cluster].astype(float)
        for name, value in _values(_fit(data, weight, theta, quick=True)).items():
            kept[name].append(value)
    spread_draws = _spread_draws(of_tile, of_robot, draws)
    return SensorFit(values, {name: np.array(one) for name, one in kept.items()} | spread_draws)


def fit_plain(energy: Floats, edge_m: Floats, vibrating: NDArray[np.bool_]) -> Floats:
    """The likeliest Gammas, reach and blur (``_start``) where tiles and robots are all alike."""
    even = np.ones(energy.size)
    return _fit(_Data(energy, edge_m, even, even), even, _start(energy, vibrating))


def log_likelihoods(theta: Floats, energy: Floats, edge_m: Floats) -> Floats:
    """Of each sample, where tiles and robots are all alike."""
    even = np.ones(energy.size)
    one, other = _parts(theta, _Data(energy, edge_m, even, even))
    return np.asarray(np.log(one + other + _FLOOR))


def _start(energy: Floats, on: NDArray[np.bool_]) -> Floats:
    """Log shape, log scale, location of either kind by moments, reach (cm), log blur (cm)."""
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
    """Likelihood of each sample as felt on a vibrating and on a still tile."""
    k, s, loc, k2, s2, loc2, reach, blur = theta
    p = ndtr((reach / 100.0 - data.edge_m) / (np.exp(blur) / 100.0))
    one = p * _density(data.energy / data.vibrating, np.exp(k), np.exp(s), loc) / data.vibrating
    other = (1 - p) * _density(data.energy / data.still, np.exp(k2), np.exp(s2), loc2) / data.still
    return one, other


def _fit(data: _Data, weight: Floats, theta: Floats, quick: bool = False) -> Floats:
    def loss(at: Floats) -> float:
        one, other = _parts(at, data)
        return -float(weight @ np.log(one + other + _FLOOR)) / float(weight.sum())

    bounds = [(0.0, 4.0), (-5.0, 2.0), (-2.0, 0.5)] * 2 + [(-3.0, 8.0), (-2.0, 2.0)]
    inside = np.clip(theta, *np.array(bounds).T)
    most = 25 if quick else 200
    found = minimize(loss, inside, method="L-BFGS-B", bounds=bounds, options={"maxiter": most, "ftol": 1e-10})
    return np.asarray(found.x)


def _factors(
    theta: Floats, data: _Data, tiles: tuple[NDArray[np.int64], NDArray[np.int64]], cluster: NDArray[np.int64],
    before: tuple[Floats, Floats],
) -> tuple[Floats, Floats, tuple[float, float]]:  # fmt: skip
    """Logarithms of the factors of tiles and robots, and their spreads."""
    one, other = _parts(theta, data)
    share = one / (one + other + _FLOOR)
    values = _values(theta)
    log_energy = np.log(np.maximum(data.energy, 1e-3))
    rest = []
    for kind in ("vibrating", "still"):
        rest.append(
            log_energy - _mean_log(*(values[f"{kind}_{name}"] for name in ("shape", "scale", "location")))
        )
    weight = np.r_[share, 1 - share]
    left = np.concatenate(rest)
    at_robot = np.r_[cluster, cluster]
    at_tile = np.concatenate(tiles)
    of_tile, of_robot = before
    for _ in range(4):
        of_tile, tile_spread = _effects(left - of_robot[at_robot], weight, at_tile, of_tile.size)
        of_robot, robot_spread = _effects(left - of_tile[at_tile], weight, at_robot, of_robot.size)
    # Mean 1 of the factors: the rest goes into the scale of the Gammas at the next fit.
    return of_tile - of_tile.mean(), of_robot - of_robot.mean(), (tile_spread, robot_spread)


def _effects(rest: Floats, weight: Floats, group: NDArray[np.int64], groups: int) -> tuple[Floats, float]:
    """Means by group, shrunk to their common mean, and the spread between groups without that of their means."""
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
    """E log(G) of a shifted Gamma, by its quantiles; what falls below 1e-3 counts as that."""
    from scipy.special import gammaincinv

    u = (np.arange(400) + 0.5) / 400
    return float(np.log(np.maximum(scale * gammaincinv(shape, u) + location, 1e-3)).mean())


def _spread_draws(of_tile: Floats, of_robot: Floats, draws: int) -> dict[str, Floats]:
    """Spreads of tiles and robots drawn anew with replacement."""
    found: dict[str, Floats] = {}
    for name, values, stream in (("tile_spread", of_tile, 1), ("robot_spread", of_robot, 2)):
        picked = [
            values[(uniforms(_SEED, draw, stream, Purpose.BOOTSTRAP, values.size) * values.size).astype(int)]
            for draw in range(draws)
        ]
        found[name] = np.array([one.std(ddof=1) if one.size > 1 else 0.0 for one in picked])
    return found
