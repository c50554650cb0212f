"""Laws at contrasts, and robots that are wrong about the rates of their sensor."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from scipy import stats

from vibroswarm import Result, Scenario, preset, simulate
from vibroswarm.errors import CodeError, InputError
from vibroswarm.inference.deliveries import timeline_of
from vibroswarm.inference.replay import infer
from vibroswarm.motion.motion_tables import Motion
from vibroswarm.observation.energy_model import likelihood_at
from vibroswarm.scenario.fields import Sensor
from vibroswarm.sensors import SensorModel, forget, register

RUNS: dict[str, Any] = {"run.t_end_s": 200.0, "decision.min_observations": 20}
SURE = [[0.99, 0.01], [0.01, 0.99]]


@pytest.fixture(autouse=True)
def _forget_the_sensor() -> Iterator[None]:
    yield
    forget("mine")


def mine(**parts: Any) -> Sensor:
    """A sensor that measures Normal(kind, 0.3) and reads 1 above 1/2, unless ``parts`` say otherwise."""
    measured: dict[str, Any] = {
        "measure": lambda kind, u, p: stats.norm.ppf(u, kind, 0.3),
        "reading": lambda value, p: value > 0.5,
    }
    forget("mine")
    register(SensorModel(name="mine", **measured | parts))
    return Sensor(model="mine")


@pytest.mark.parametrize("contrast", [0.0, 0.3, 1.0])
def test_the_law_at_a_contrast_is_that_of_mixed_quantiles(contrast: float) -> None:
    """Of normal laws it is normal: mean and standard deviation are mixed."""
    sensor = mine(measure=lambda kind, u, p: stats.norm.ppf(u, *((0.2, 0.2), (4.0, 0.5))[kind]), scales=True)
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
    stated = mine(scales=True, likelihood_at=lambda c, value, p: np.full(value.shape, 1.0 + c))
    assert (likelihood_at(stated, contrast, value) == 1.0 + contrast).all()
    with pytest.raises(CodeError, match="likelihood_at: returned"):
        likelihood_at(mine(likelihood_at=lambda c, value, p: -value), contrast, value)


def test_wrong_robots_reason_like_right_ones_with_the_sensor_that_they_claim() -> None:
    """The readings of one sensor are replayed by robots that have another, whose true rates are those claimed."""
    base = preset("paper").with_values(
        {
            **RUNS,
            "sensor.model": "confusion",
            "sensor.confusion.kinds": 2,
            "floor.source": "random:0.48",
            "strategy.name": "places",
            "localisation.method": "true",
        }
    )
    wrong, right = (
        base.with_values({f"sensor.{name}": SURE}) for name in ("claimed_rates", "confusion.rates")
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
    found = infer(scenario, 4, timeline(scenario, result), result.observations)[2]
    assert found is not None
    return found["value"].to_numpy()


def timeline(scenario: Scenario, result: Result) -> Any:
    return timeline_of(scenario, Motion(result.motion, result.ends, None, result.moves))


# What is said


@pytest.mark.parametrize(
    ("claimed", "says"),
    [
        ([[0.9, 0.1]], "at least 2"),
        ([[0.9, 0.1], [0.2, 0.8], [0.5, 0.5]], "give 2 rows, one for each kind of tile"),
        ([[0.9, 0.1], [0.2, 0.3, 0.5]], "row 1 has 3 classes"),
        ([[0.9, 0.1], [0.2, 0.7]], "sums to 0.9"),
        ([[0.9, 0.1], [-0.2, 1.2]], "greater than or equal to 0"),
    ],
)
def test_wrong_rates_are_refused(claimed: list[list[float]], says: str) -> None:
    with pytest.raises(InputError, match=says) as error:
        preset("paper").with_values({"sensor.claimed_rates": claimed})
    assert str(error.value).startswith("sensor.claimed_rates")
