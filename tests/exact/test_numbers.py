"""A sensor that measures several numbers, of which the first says nothing: robots read and weigh by all of them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import polars as pl
import pytest
from scipy.stats import norm

from vibroswarm import Scenario, preset, simulate, strategies
from vibroswarm.sensors import SensorModel, forget, register
from vibroswarm.strategies import Strategy
from vibroswarm.testing.tiles import check_sensor


def sense(samples: Any, p: Any) -> Any:
    """A number that is noise, and one that is the kind of the tile with noise."""
    place = samples.place
    row = ((place.top_m - samples.y_m) / place.height_m).astype(int)
    column = ((samples.x_m - place.left_m) / place.width_m).astype(int)
    kind = samples.tiles[row * place.columns + column]
    chance = np.random.default_rng([samples.seed % 2**32, samples.run])
    noise = chance.normal(size=(2, 512, 2))[samples.robot, samples.sample]
    return np.stack([noise[:, 0], kind + 0.5 * noise[:, 1]], axis=1)


def likelihood(kind: int, value: Any, p: Any) -> Any:
    return norm.pdf(value[:, 1], kind, 0.5)


class WeighsParams:
    """Its robots weigh what they measure."""

    energies: bool = True


class WeighsState:
    """Sum of the log ratios of own samples."""

    total: float


def begin(s: Any, a: Any, d: Any, p: Any, w: Any) -> None:
    s.total = 0.0


def on_message(s: Any, a: Any, m: Any, sender: int, t_s: float, d: Any, p: Any, w: Any) -> None:
    pass


def on_sample(s: Any, a: Any, x: Any, out: Any, d: Any, p: Any, w: Any) -> bool:
    s.total += x.log_ratio
    return False


def decision(s: Any, a: Any, p: Any, w: Any) -> int:
    return -1


@pytest.fixture(autouse=True)
def _two_numbers() -> Iterator[None]:
    register(
        SensorModel(
            name="two",
            sense=sense,
            numbers=lambda p: ("noise", "signal"),
            reading=lambda value, p: value[:, 1] > 0.5,
            likelihood=likelihood,
        )
    )
    strategies.register(
        Strategy(
            name="weighs", params=WeighsParams, state=WeighsState, begin=begin, on_message=on_message,
            on_sample=on_sample, decision=decision, reports=("total",),
        )
    )  # fmt: skip
    yield
    forget("two")
    strategies.base.forget("weighs")


def scenario() -> Scenario:
    return preset("paper").with_values(
        {"sensor.model": "two", "strategy.name": "weighs", "run.t_end_s": 60.0, "swarm.robots": 2}
    )


def test_robots_weigh_all_numbers() -> None:
    result = simulate(scenario(), 3, 1)
    seen = result.observations
    assert seen.columns[-1] == "signal"
    assert np.array_equal(seen["observation"], seen["signal"] > 0.5)
    signal = seen["signal"].cast(pl.Float64).to_numpy()
    ratio = (norm.logpdf(signal, 1, 0.5) - norm.logpdf(signal, 0, 0.5)).clip(-8, 8)
    assert result.reports is not None
    for robot in range(2):
        told = result.reports.filter(pl.col("robot") == robot).sort("sample")["value"]
        np.testing.assert_allclose(told, ratio[seen["robot"] == robot].cumsum(), rtol=1e-6)


def test_shares_are_counted_on_floors_with_as_much_of_each_kind() -> None:
    three = SensorModel(
        name="three",
        kinds=lambda p: 3,
        readings=lambda p: 3,
        sense=sense,
        numbers=lambda p: ("noise", "signal"),
        reading=lambda value, p: np.digitize(value[:, 1], (0.5, 1.5)),
    )
    p = three.params()
    for kind, values in enumerate(three.reference_values(p)):
        assert len(values) == pytest.approx(100_000 / 3, rel=0.015)
        counts = np.bincount(three.classes(values, p), minlength=3) + 0.5
        (shares,) = three.shares_up_to(kind, np.ones(1), p)
        assert shares == pytest.approx(np.cumsum(counts)[:2] / counts.sum())


def test_it_passes_its_checks() -> None:
    assert [finding for finding in check_sensor("two") if not finding.holds] == []
