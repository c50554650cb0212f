"""What an energy says for a vibrating tile, against the laws from which energies are drawn."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import gamma

from vibroswarm.observation.energy_model import (
    MOST,
    energies_of,
    error_rates,
    log_likelihood,
    log_ratios,
    log_ratios_of_classes,
    typical_factors,
)
from vibroswarm.scenario.fields import Sensor
from vibroswarm.scenario.scenario import preset

U = (np.arange(10_000) + 0.5) / 10_000


def drawn(sensor: Sensor, vibrating: bool) -> np.ndarray:
    """Energies at even quantiles."""
    return energies_of(sensor, np.full(U.size, vibrating), U)


def ratios(sensor: Sensor, energy: np.ndarray) -> np.ndarray:
    return log_ratios(sensor, (energy > np.float32(sensor.rms_threshold)).astype(np.uint8), energy)


def test_it_is_the_ratio_of_gamma_densities() -> None:
    sensor, energy = Sensor(), np.linspace(0.3, 6.0, 300).astype(np.float32)
    laws = [
        gamma(
            getattr(sensor, f"{kind}_shape"),
            getattr(sensor, f"{kind}_location"),
            getattr(sensor, f"{kind}_scale"),
        )
        for kind in ("vibrating", "still")
    ]
    of_each = [law.logpdf(energy.astype(np.float64)) for law in laws]
    expected = np.clip(of_each[0] - of_each[1], -MOST, MOST)
    known = np.isfinite(of_each[0]) | np.isfinite(of_each[1])
    assert known.sum() > 200
    assert ratios(sensor, energy)[known] == pytest.approx(expected[known], abs=1e-5)


@pytest.mark.parametrize("spread", [None, 0.2])
def test_readings_of_a_ratio_are_as_much_likelier_on_vibrating_tiles(spread: float | None) -> None:
    """In every bin of the ratio; a law with factors is not that without them."""
    sensor = Sensor(tile_spread=spread)
    factors, weights = typical_factors(sensor)
    chances = []
    for kind in (True, False):
        energy, weight = drawn(sensor, kind).astype(np.float64), np.ones(U.size)
        found = [ratios(sensor, (energy * factor).astype(np.float32)) for factor in factors]
        hit = [np.histogram(each, np.arange(-4.0, 4.5, 0.5), weights=weight)[0] for each in found]
        chances.append(np.einsum("k,kb->b", weights, np.array(hit)) / U.size)
    middle = np.arange(-3.75, 4.0, 0.5)
    common = (chances[0] > 1e-3) & (chances[1] > 1e-3)
    assert common.sum() >= 8
    assert np.log(chances[0] / chances[1])[common] == pytest.approx(middle[common], abs=0.26)
    at = np.linspace(0.0, 40.0, 4001)
    for kind in (False, True):  # factors have the mean 1, and so leave the mean energy as it is
        mean = np.trapezoid(at * np.exp(log_likelihood(sensor, kind, at)), at)
        assert mean == pytest.approx(drawn(sensor, kind).mean(), rel=0.005)


def measured(still: np.ndarray, vibrating: np.ndarray) -> Sensor:
    of_each = [tuple(energies.tolist()) for energies in (still, vibrating)]
    return Sensor(model="energies", still_energies=of_each[0], vibrating_energies=of_each[1])


@pytest.mark.parametrize("at", [0.0, 10.0])
def test_measured_energies_have_a_density_also_beyond_the_last(at: float) -> None:
    """At 6 values beyond each end there was that of the outer bin of a histogram."""
    laws = gamma(4.0, at, 0.25), gamma(6.0, at, 0.4)
    sensor = measured(*(law.ppf((np.arange(300) + 0.5) / 300) for law in laws))
    value = at + np.linspace(0.05, 6.0, 200)
    for kind, law in enumerate(laws):
        found, known = np.exp(log_likelihood(sensor, kind, value)), law.pdf(value)
        assert np.trapezoid(found, value) == pytest.approx(1.0, abs=0.02)
        assert np.abs(found - known).max() < 0.15 * known.max()
        assert found[-1] < 0.03 * known.max()
    expected = np.subtract(*(law.logpdf(value) for law in reversed(laws)))
    clear = (expected > -3.0) & (expected < 4.0)
    assert ratios(sensor, value.astype(np.float32))[clear] == pytest.approx(expected[clear], abs=0.6)


@pytest.mark.parametrize(
    ("still", "vibrating", "at", "expected"),
    [
        (np.repeat([0.0, 1.0], [90, 10]), np.repeat([0.0, 1.0], [40, 60]), [0.0, 1.0], [4 / 9, 6.0]),
        (np.repeat([1.0, 2.0], [99, 1]), np.repeat([1.0, 2.0], [50, 50]), [1.0, 2.0], [50 / 99, 50.0]),
        (np.zeros(20), np.zeros(5), [0.0, 9.0], [1.0] * 2),
    ],
)
def test_of_equal_energies_the_shares_count(
    still: np.ndarray, vibrating: np.ndarray, at: list[float], expected: list[float]
) -> None:
    found = np.exp(ratios(measured(still, vibrating), np.array(at, dtype=np.float32)))
    assert found == pytest.approx(expected, rel=0.3)


def test_of_several_kinds_it_is_that_of_any_but_still() -> None:
    three = {"sensor.model": "confusion", "sensor.confusion.accuracy": 0.8, "strategy.name": "dirichlet"}
    sensor = preset("paper").with_values({**three, "task.name": "majority"}).sensor
    assert np.exp(log_ratios_of_classes(sensor, np.arange(3))) == pytest.approx([0.1 / 0.8, 4.5, 4.5])
    assert np.exp(log_ratios_of_classes(sensor, np.arange(3), 1)) == pytest.approx([0.1 / 0.8, 8.0, 1.0])


def test_a_bit_that_is_not_the_energys_counts_as_a_bit() -> None:
    """A sensor stuck at 1 reads still energies; only its bit says so."""
    sensor = Sensor()
    positive, negative = error_rates(sensor)
    energy = drawn(sensor, False)[:100]
    assert (energy < sensor.rms_threshold).all()
    stuck = log_ratios(sensor, np.ones(100, dtype=np.uint8), energy)
    assert stuck == pytest.approx(np.log((1.0 - negative) / positive))
    sound = log_ratios(sensor, np.zeros(100, dtype=np.uint8), energy)
    assert np.unique(sound).size > 90
    assert sound.max() < stuck.min()
