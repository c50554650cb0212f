"""What robots claim of their sensor and what is true: rates against theory, and who goes by which."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from scipy import stats

from vibroswarm import Result, Scenario, preset, simulate
from vibroswarm.errors import CodeError, InputError
from vibroswarm.inference.deliveries import timeline_of
from vibroswarm.inference.replay import infer_and_report
from vibroswarm.motion.source import Motion
from vibroswarm.observation.energy_model import claimed_rates, claims_differ, likelihood_at, rates
from vibroswarm.scenario.fields import Sensor
from vibroswarm.sensors import SensorModel, forget, register

Likelihood = Callable[[int, Any, Any], Any]
RUNS: dict[str, Any] = {"run.t_end_s": 200.0, "decision.min_observations": 20}
SURE = [[0.99, 0.01], [0.01, 0.99]]
TURNED = [[0.8, 0.15, 0.05], [0.1, 0.6, 0.3], [0.3, 0.1, 0.6]]
THREE: dict[str, Any] = {
    "sensor.model": "confusion",
    "floor.source": "random:0.4,0.36,0.24",
    "task.name": "majority",
    "strategy.name": "places",
    "localisation.method": "true",
}


@pytest.fixture(autouse=True)
def _forget_the_sensor() -> Iterator[None]:
    yield
    forget("mine")


def mine(likelihood: Likelihood | None, **parts: Any) -> Sensor:
    """A sensor that measures Normal(kind, 0.3) and reads 1 above 1/2, unless ``parts`` say otherwise."""
    measured: dict[str, Any] = {
        "measure": lambda kind, u, p: stats.norm.ppf(u, kind, 0.3),
        "reading": lambda value, p: value > 0.5,
    }
    forget("mine")
    register(SensorModel(name="mine", likelihood=likelihood, **measured | parts))
    return Sensor(model="mine")


def claimed_of(*below: float) -> Any:
    """Rates of two classes, by the share on each kind that reads as 0."""
    return np.array([[share, 1.0 - share] for share in below])


# What is claimed


@pytest.mark.parametrize(
    "law",
    [
        stats.norm(0.2, 0.3), stats.norm(0.2, 3.0), stats.norm(0.45, 0.01), stats.norm(5.0, 0.05),
        stats.cauchy(0.1, 0.2), stats.gamma(0.5), stats.lognorm(1.5), stats.uniform(-1.0, 3.0),
    ],
    ids=["as wide", "wider", "narrow", "elsewhere", "cauchy", "infinite at 0", "long tail", "with steps"],
)  # fmt: skip
def test_a_density_gives_the_rates_of_its_distribution_function(law: Any) -> None:
    """Whatever is measured: the law of kind 1 is that of kind 0 turned round."""
    sensor = mine(lambda kind, value, p: law.pdf(value if kind == 0 else 1.0 - value))
    expected = claimed_of(law.cdf(0.5), law.sf(0.5))
    np.testing.assert_allclose(claimed_rates(sensor), expected, atol=5e-5)
    assert claims_differ(sensor)
    np.testing.assert_allclose(rates(sensor), claimed_of(stats.norm.cdf(0.5 / 0.3), stats.norm.sf(0.5 / 0.3)))


@pytest.mark.parametrize("contrast", [0.0, 0.3, 1.0])
def test_the_law_at_a_contrast_is_that_of_mixed_quantiles(contrast: float) -> None:
    """Of normal laws it is normal: mean and standard deviation are mixed. The likelihood is not what is measured."""
    laws = stats.norm(0.2, 0.2), stats.norm(4.0, 0.5)
    sensor = mine(lambda kind, value, p: laws[kind].pdf(value), scales=True)
    between = stats.norm(0.2 + contrast * 3.8, 0.2 + contrast * 0.3)
    value = between.ppf(np.linspace(0.005, 0.995, 100))
    np.testing.assert_allclose(likelihood_at(sensor, contrast, value), between.pdf(value), rtol=0.01)
    assert not np.allclose(likelihood_at(sensor, 0.5 + 0.1 * contrast, value), between.pdf(value), rtol=0.1)
    assert (likelihood_at(sensor, contrast, np.array([-50.0, 50.0])) == 0.0).all()
    # Factors of tiles and robots widen it, as they widen the law of a kind.
    spread = sensor.model_copy(update={"tile_spread": 0.3})
    at = np.linspace(-3.0, 12.0, 4001)
    assert np.trapezoid(likelihood_at(spread, contrast, at), at) == pytest.approx(1.0, abs=0.01)
    # A sensor may state it.
    stated = mine(None, scales=True, likelihood_at=lambda c, value, p: np.full(value.shape, 1.0 + c))
    assert (likelihood_at(stated, contrast, value) == 1.0 + contrast).all()
    with pytest.raises(CodeError, match="likelihood_at: returned"):
        likelihood_at(mine(None, likelihood_at=lambda c, value, p: -value), contrast, value)


def test_whole_and_few_values_are_summed() -> None:
    counts = {"measure": lambda kind, u, p: stats.poisson.ppf(u, 3.0 + kind), "reading": lambda v, p: v > 4}
    sensor = mine(lambda kind, value, p: stats.poisson.pmf(value, 2.0 + 4.0 * kind), **counts)
    np.testing.assert_allclose(
        claimed_rates(sensor), claimed_of(*stats.poisson.cdf(4, [2.0, 6.0])), atol=3e-3
    )
    np.testing.assert_allclose(
        claimed_rates(sensor, factor=2.0), claimed_of(*stats.poisson.cdf(2, [2.0, 6.0])), atol=3e-3
    )
    forget("mine")
    few = {"measure": lambda kind, u, p: np.where(u < 0.5, 0.25, 0.75) + 0.5 * kind}
    sensor = mine(
        lambda kind, value, p: np.where(value < 0.6, 0.9, 0.05) if kind == 0 else value * 0 + 1 / 3, **few
    )
    np.testing.assert_allclose(claimed_rates(sensor), claimed_of(0.9, 1 / 3))


def test_factors_of_tiles_widen_what_is_claimed() -> None:
    """Against a million draws of the claimed law times the factor."""
    law, spread = stats.gamma([1.0, 2.0]), 0.3
    sensor = mine(lambda kind, value, p: stats.gamma.pdf(value, 1.0 + kind), scales=True)
    np.testing.assert_allclose(claimed_rates(sensor, factor=2.0), claimed_of(*law.cdf(0.25)), atol=5e-5)
    sensor = sensor.model_copy(update={"tile_spread": spread})
    generator = np.random.default_rng(3)
    factor = np.exp(spread * generator.standard_normal((250_000, 1)) - 0.5 * spread**2)
    below = (law.rvs((250_000, 2), random_state=generator) * factor <= 0.5).mean(axis=0)
    np.testing.assert_allclose(claimed_rates(sensor), claimed_of(*below), atol=5 * 0.5 / 500)
    assert abs(below[0] - law.cdf(0.5)[0]) > 0.01  # a control: without factors it is another


def test_without_a_likelihood_robots_know_the_truth() -> None:
    sensor = mine(None)
    assert np.array_equal(claimed_rates(sensor), rates(sensor))
    assert not claims_differ(sensor)


# Who goes by it


def alike(likelihood_spread: float) -> Scenario:
    """Robots with one and the same sensor, which claim another spread of its values (0.3 is true)."""
    forget("mine")
    mine(lambda kind, value, p: stats.norm.pdf(value, kind, likelihood_spread))
    return preset("paper").with_values({**RUNS, "sensor.model": "mine", "decision.decision_boundary": 0.4})


@pytest.mark.parametrize(
    "values",
    [
        {"strategy.name": "places", "localisation.method": "true"},
        {"strategy.name": "none", "decision.boundary_of": "tiles"},
    ],
    ids=["places", "tiles"],
)
def test_two_sensors_that_measure_alike_differ_in_what_robots_make_of_it(values: dict[str, Any]) -> None:
    honest, sure = (simulate(alike(spread).with_values(values), 5, 2) for spread in (0.3, 0.1))
    assert honest.observations.equals(sure.observations)
    assert not honest.inference["belief_below"].equals(sure.inference["belief_below"])
    # A control: robots that take readings at face value do not care.
    at_face = [simulate(alike(spread), 5, 2).inference for spread in (0.3, 0.1)]
    assert at_face[0].equals(at_face[1])


@pytest.mark.parametrize("kinds", [2, 3])
def test_wrong_robots_reason_like_right_ones_with_the_sensor_that_they_claim(kinds: int) -> None:
    """The readings of one sensor are replayed by robots that have another, whose true rates are those claimed."""
    claimed = SURE if kinds == 2 else TURNED
    of_two = {"sensor.confusion.kinds": 2, "floor.source": "random:0.48", "task.name": "fill_ratio"}
    base = preset("paper").with_values({**RUNS, **THREE, **(of_two if kinds == 2 else {})})
    wrong, right = (
        base.with_values({f"sensor.{name}": claimed}) for name in ("claimed_rates", "confusion.rates")
    )
    found = simulate(wrong, 4, 2)
    assert found.reports is not None
    as_claimed = reports(right, found)
    np.testing.assert_allclose(
        as_claimed, found.reports["value"], rtol=1e-9
    )  # rates may differ in their last digits
    truly = reports(wrong.with_values({"sensor.claimed_rates": None}), found)
    assert np.abs(truly - as_claimed).max() > 0.1


def reports(scenario: Scenario, result: Result) -> Any:
    """What robots report of their maps if they replay the readings of a result under another scenario."""
    found = infer_and_report(scenario, 4, timeline(scenario, result), result.observations)[2]
    assert found is not None
    return found["value"].to_numpy()


def timeline(scenario: Scenario, result: Result) -> Any:
    return timeline_of(scenario, Motion(result.motion, result.ends, None, result.moves))


# What is said


@pytest.mark.parametrize(
    ("claimed", "says"),
    [
        ([[0.9, 0.1]], "at least 2"),
        ([[0.9, 0.1], [0.2, 0.8], [0.5, 0.5]], "has 3 rows; give 2, one for each kind of tile"),
        ([[0.9, 0.1], [0.2, 0.3, 0.5]], "row 1 has 3 classes; give 2"),
        ([[0.9, 0.1], [0.2, 0.7]], "row 1 sums to 0.9"),
        ([[0.9, 0.1], [-0.2, 1.2]], "greater than or equal to 0"),
    ],
)
def test_wrong_rates_are_refused(claimed: list[list[float]], says: str) -> None:
    with pytest.raises(InputError, match=says) as error:
        preset("paper").with_values({"sensor.claimed_rates": claimed})
    assert str(error.value).startswith("sensor.claimed_rates")
