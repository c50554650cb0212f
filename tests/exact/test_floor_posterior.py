"""The posterior of a floor where edges are felt and tiles and robots differ: against the model, enumeration, chance."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import Any

import numpy as np
import polars as pl
import pytest
from scipy import stats

from vibroswarm.analysis.tile_posterior import log_prior, log_ratios, mirrored, sides_of
from vibroswarm.floors.floor import Floor
from vibroswarm.observation.edge_response import response_of
from vibroswarm.observation.observe import observe
from vibroswarm.posterior.boundary_side import Chains, _estimate, chain_target
from vibroswarm.posterior.likelihood import Evidence, bit_likelihood, evidence_of
from vibroswarm.posterior.markov_chain import Target
from vibroswarm.result import Result
from vibroswarm.scenario.fields import Sensor
from vibroswarm.scenario.scenario import preset
from vibroswarm.simulation import simulate

SIDE_M = 0.1
PLAIN = dict.fromkeys(
    ("sensor.edge_reach_m", "sensor.edge_blur_m", "sensor.tile_spread", "sensor.robot_spread")
)
"""Without these a reading depends on the tile below alone: the product form, which the tests hold to fail."""


def sensor(**values: Any) -> Sensor:
    return preset("calibrated").with_values(PLAIN).sensor.model_copy(update=values)


EDGES = {"edge_reach_m": 0.015, "edge_blur_m": 0.02}


def floor_of(tiles: Any) -> Floor:
    return Floor(np.asarray(tiles, dtype=np.uint8), SIDE_M, SIDE_M)


def chance_of_one(
    s: Sensor, tiles: np.ndarray, x: float, y: float, tile_factors: np.ndarray, robot_factor: float
) -> float:
    """P(1), worked out anew: distances to rectangles, scipy's distributions; tile factors as the tiles lie."""
    rows, columns = tiles.shape
    inside = 0 <= x < columns * SIDE_M and 0 <= y < rows * SIDE_M
    below = (rows - 1 - math.floor(y / SIDE_M), math.floor(x / SIDE_M)) if inside else None
    kind = int(tiles[below]) if below else 0
    others = []
    for (i, j), other in np.ndenumerate(tiles):
        dx = max(j * SIDE_M - x, x - (j + 1) * SIDE_M, 0.0)
        dy = max((rows - 1 - i) * SIDE_M - y, y - (rows - i) * SIDE_M, 0.0)
        if other != kind:
            others.append((math.hypot(dx, dy), (i, j)))

    def reads_one(of: int, factor: float) -> float:
        shape, scale, location = (
            (s.vibrating_shape, s.vibrating_scale, s.vibrating_location)
            if of
            else (s.still_shape, s.still_scale, s.still_location)
        )
        return float(stats.gamma.sf(s.rms_threshold / factor, shape, loc=location, scale=scale))

    own = (tile_factors[below] if below else 1.0) * robot_factor
    reach, blur = s.edge_reach_m, s.edge_blur_m
    if not others or reach is None or blur is None:
        return reads_one(kind, own)
    distance, nearest = min(others)
    past = reach + distance if kind else reach - distance
    vibrates = stats.norm.cdf(past / blur)
    theirs = tile_factors[nearest] * robot_factor
    of_kind = {kind: own, 1 - kind: theirs}
    return float(vibrates * reads_one(1, of_kind[1]) + (1 - vibrates) * reads_one(0, of_kind[0]))


def places(random: np.random.Generator, tiles: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    rows, columns = tiles.shape
    return random.uniform(0, columns * SIDE_M, count), random.uniform(0, rows * SIDE_M, count)


def of_evidence(
    evidence: Evidence, s: int, tiles: np.ndarray, tile_factors: np.ndarray, robot_factors: np.ndarray
) -> float:
    log_tile = np.append(np.log(tile_factors).ravel(), 0.0)
    return bit_likelihood(evidence, s, tiles.ravel().astype(np.uint8), log_tile, np.log(robot_factors))


def test_the_likelihood_is_that_of_the_model_worked_out_anew() -> None:
    random = np.random.default_rng(1)
    s = sensor(**EDGES, tile_spread=0.3, robot_spread=0.2)
    worst = 0.0
    for _ in range(15):
        tiles = random.integers(0, 2, (3, 2))
        x, y = places(random, tiles, 12)
        x[0] = -0.004  # off all tiles
        robot, bit = random.integers(0, 2, 12), random.integers(0, 2, 12).astype(np.uint8)
        factors = np.exp(random.normal(0, 0.3, (3, 2)))
        of_robot = np.exp(random.normal(0, 0.2, 2))
        evidence = evidence_of(s, floor_of(tiles), 2, robot, x, y, bit)
        for k in range(12):
            one = chance_of_one(s, tiles, x[k], y[k], factors, of_robot[robot[k]])
            found = of_evidence(evidence, k, tiles, factors, of_robot)
            worst = max(worst, abs(found - (one if bit[k] else 1 - one)))
    assert worst < 2e-6


def test_the_model_draws_bits_as_the_likelihood_says() -> None:
    """At 30 places, of two robots: shares of ones by chi-squared; a likelihood without edges fails."""
    scenario = preset("calibrated").with_values(
        {"floor.rows": 2, "floor.columns": 2, "floor.source": "random:0.5", "swarm.robots": 2}
    )
    floor = Floor(np.array([[1, 0], [0, 1]], dtype=np.uint8), 0.5, 0.5)
    random, each, count = np.random.default_rng(2), 2000, 30
    x, y = 0.5 + random.uniform(-0.05, 0.05, count), random.uniform(0.0, 1.0, count)
    robot = random.integers(0, 2, count)
    samples = pl.DataFrame(
        {
            "run": np.zeros(count * each, np.uint32),
            "robot": np.repeat(robot, each).astype(np.uint16),
            "sample": np.arange(count * each, dtype=np.uint32),
            "time_s": np.arange(count * each, dtype=np.float64),
            "x_m": np.repeat(x, each),
            "y_m": np.repeat(y, each),
        }
    )
    bits = observe(scenario, 3, samples, {0: floor}, energies=False)["observation"].to_numpy()
    ones = bits.reshape(count, each).sum(axis=1)
    factors = response_of(scenario, 3, np.array([0]), [4]).factors.reshape(2, 5)
    of_robot, of_tile = factors[:, 0], (factors[0] / factors[0, 0])[1:]

    def p_value(values: Sensor) -> float:
        evidence = evidence_of(values, floor, 2, robot, x, y, np.ones(count, np.uint8))
        share = np.array([of_evidence(evidence, k, floor.tiles, of_tile, of_robot) for k in range(count)])
        z = (ones - each * share) / np.sqrt(each * share * (1 - share))
        return float(stats.chi2.sf(z @ z, count))

    assert p_value(scenario.sensor) > 0.005
    assert p_value(scenario.with_values(PLAIN).sensor) < 1e-6


def log_likelihoods(
    s: Sensor,
    shape: tuple[int, int],
    data: tuple[np.ndarray, ...],
    tile_factors: np.ndarray,
    robot_factors: np.ndarray,
) -> dict[tuple[int, ...], float]:
    """ln P(bits) of every floor of this shape."""
    robot, x, y, bit = data
    found = {}
    for floor in itertools.product([0, 1], repeat=shape[0] * shape[1]):
        tiles = np.array(floor).reshape(shape)
        one = np.array(
            [
                chance_of_one(s, tiles, x[k], y[k], tile_factors.reshape(shape), robot_factors[robot[k]])
                for k in range(bit.size)
            ]
        )
        found[floor] = float(np.log(np.where(bit == 1, one, 1 - one)).sum())
    return found


def above_by_enumeration(
    weights: np.ndarray, log_likelihood: dict[tuple[int, ...], float], x: float
) -> float:
    tiles = weights.size - 1
    above = total = 0.0
    for floor, log in log_likelihood.items():
        k = sum(floor)
        joint = weights[k] / math.comb(tiles, k) * math.exp(log)
        total += joint
        above += joint * (k > x * tiles)
    return above / total


def drawn_data(
    s: Sensor, tiles: np.ndarray, count: int, seed: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Bits of a floor of which all factors are 1, of two robots."""
    random = np.random.default_rng(seed)
    x, y = places(random, tiles, count)
    ones = [chance_of_one(s, tiles, x[k], y[k], np.ones(tiles.shape), 1.0) for k in range(count)]
    return random.integers(0, 2, count), x, y, (random.random(count) < ones).astype(np.uint8)


def by_chains(
    s: Sensor, shape: tuple[int, int], data: tuple[np.ndarray, ...], target: Target, sweeps: int = 4000
) -> tuple[float, float]:
    """P(above) and its standard error."""
    robot, x, y, bit = data
    evidence = evidence_of(s, floor_of(np.zeros(shape)), 2, robot, x, y, bit)
    chains = Chains(evidence, target, 2, 5, 0)
    chains.sweep(bit.size, 200)
    look = _estimate(np.array([chains.sweep(bit.size, sweeps // 20) for _ in range(20)]))
    return look.above, look.error


FLOORS = ([[1, 0], [0, 1], [1, 0]], [[1, 1], [1, 1], [0, 0]], [[0, 0], [1, 0], [0, 0]])


@pytest.mark.parametrize("tiles", FLOORS)
@pytest.mark.parametrize("weights", ["tiles", [0, 1, 0, 0, 0, 1, 0], [0, 0, 1, 0, 1, 0, 0]])
def test_edges_alone_are_as_enumeration_has_them(tiles: Any, weights: Any) -> None:
    """All 64 floors of 3 x 2 tiles; priors that rule out numbers between too."""
    s, grid = sensor(**EDGES), np.array(tiles)
    data = drawn_data(s, grid, 14, int(grid.sum()))
    prior = log_prior(weights, 6)
    wanted = above_by_enumeration(
        np.exp(prior), log_likelihoods(s, (3, 2), data, np.ones(6), np.ones(2)), 0.5
    )
    above, error = by_chains(s, (3, 2), data, chain_target(prior, 0.5))
    assert error < 0.01
    assert abs(above - wanted) < 4 * error + 1e-4  # nine of these: 4 errors are 0.06 % in all


def test_factors_are_as_quadrature_has_them() -> None:
    """Two tiles and two robots: 4 floors by 7^4 nodes, with edges; the product form is far too sure."""
    s = sensor(**EDGES, tile_spread=0.5, robot_spread=0.4)
    tiles, shape = np.array([[1, 0]]), (1, 2)
    robot, x, y, _ = drawn_data(s, tiles, 10, 4)
    data = (robot, x, y, np.array([1, 1, 0, 1, 1, 1, 0, 1, 1, 1], dtype=np.uint8))
    z, w = np.polynomial.hermite_e.hermegauss(7)
    w = w / w.sum()
    total: dict[tuple[int, ...], float] = {}
    for a, b, c, d in itertools.product(range(7), repeat=4):
        factors = np.exp(s.tile_spread * z[[a, b]] - s.tile_spread**2 / 2)  # type: ignore[operator]
        of_robot = np.exp(s.robot_spread * z[[c, d]] - s.robot_spread**2 / 2)  # type: ignore[operator]
        for floor, log in _fast(s, shape, data, factors, of_robot).items():
            total[floor] = total.get(floor, 0.0) + w[a] * w[b] * w[c] * w[d] * math.exp(log)
    prior = np.array([0.5, 0.0, 0.5])  # none or both
    wanted = above_by_enumeration(prior, {k: math.log(v) for k, v in total.items()}, 0.5)
    target = chain_target(log_prior(prior, 2), 0.5)
    above, error = by_chains(s, shape, data, target, 20_000)
    assert error < 0.01
    assert abs(above - wanted) < 4 * error + 2e-3  # of the quadrature: 7 nodes against 9 differ by less
    plain = above_by_enumeration(prior, log_likelihoods(sensor(), shape, data, np.ones(2), np.ones(2)), 0.5)
    assert 1 - plain < (1 - wanted) / 1000  # of a posterior error of 1.5 %


def _fast(
    s: Sensor, shape: tuple[int, int], data: tuple[np.ndarray, ...], factors: np.ndarray, of_robot: np.ndarray
) -> dict[tuple[int, ...], float]:
    """As ``log_likelihoods``, by the likelihood that the first test holds to the model."""
    robot, x, y, bit = data
    evidence = evidence_of(s, floor_of(np.zeros(shape)), 2, robot, x, y, bit)
    return {
        floor: sum(
            math.log(of_evidence(evidence, k, np.array(floor), factors, of_robot)) for k in range(bit.size)
        )
        for floor in itertools.product([0, 1], repeat=shape[0] * shape[1])
    }


def calibrated_runs(seed: int, runs: int, t_end_s: float = 200.0) -> list[Result]:
    """Runs of ``calibrated`` on floors of both sides, so many on each."""
    values = {"run.t_end_s": t_end_s}
    return [
        simulate(
            preset("calibrated").with_values(values | {"floor.source": f"random:{fill}"}),
            seed + side, runs, energies=False,
        )
        for side, fill in enumerate((0.48, 0.52))
    ]  # fmt: skip


def miscalibration(above: np.ndarray, truth: np.ndarray) -> float:
    """Spiegelhalter's z: standard normal if truth is 1 with probability ``above``; positive for too sure."""
    terms, spread = (truth - above) * (1 - 2 * above), (1 - 2 * above) ** 2 * above * (1 - above)
    return float(terms.sum() / math.sqrt(spread.sum()))


def test_floors_are_as_often_above_as_the_posterior_says_and_factors_rank_evenly() -> None:
    """Simulation-based calibration (Talts 2018) after 200 s; three tests at 0.4 % each, and the product form fails."""
    exact, product, truths, ranks = [], [], [], []
    for result in calibrated_runs(31, 60):
        run, bit = result.motion["run"].to_numpy(), result.observations["observation"].to_numpy()
        scenario = result.scenario
        plain = log_ratios(_taken_as_plain(result))
        for r, truth in result.runs.select("run", "truth").iter_rows():
            low, high = (int(k) for k in np.searchsorted(run, [r, r + 1]))
            floor, part = result.floor(r), result.motion[low:high]
            prior = log_prior(mirrored(int(floor.tiles.sum()), 25, 0.5), 25)
            evidence = evidence_of(
                scenario.sensor, floor, 5, *(part[name].to_numpy() for name in ("robot", "x_m", "y_m")),
                bit[low:high],
            )  # fmt: skip
            chains = Chains(evidence, chain_target(prior, 0.5), 5, 77, r)
            chains.sweep(high - low, 60)
            exact.append(_estimate(np.array([chains.sweep(high - low, 60) for _ in range(2)])).above)
            sums = np.bincount(result.observations["tile"][low:high], plain[low:high], 25)
            product.append(sides_of(sums[None, :], prior, 0.5)[0][0])
            truths.append(truth)
            factors = response_of(scenario, result.seed or 0, np.array([r]), [25]).factors
            true = math.log(factors[1 + r % 25] / factors[0])  # of this tile
            ranks.append(int((chains.states.log_tile[:, r % 25] < true).sum()))
    above, truth_is = np.clip(exact, 1e-9, 1 - 1e-9), np.array(truths)
    bias = float((truth_is - above).sum() / math.sqrt((above * (1 - above)).sum()))
    limit = float(stats.norm.isf(0.002))
    assert abs(bias) < limit
    assert abs(miscalibration(above, truth_is)) < limit
    assert stats.chisquare(np.bincount(ranks, minlength=9)).pvalue > 0.004  # 8 chains: 9 ranks
    assert miscalibration(np.clip(product, 1e-9, 1 - 1e-9), truth_is) > 2 * limit


def _taken_as_plain(result: Result) -> Result:
    """The same bits, with a likelihood that takes each as of the tile below, and all tiles and robots as alike."""
    return replace(result, scenario=result.scenario.with_values(PLAIN))
