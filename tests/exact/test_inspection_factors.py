"""Values without the factors of their robots: against known factors, and what that does to the told risk."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom, gamma

from helpers.inspections import drawn_samples
from vibroswarm.inspection import stopping
from vibroswarm.inspection.damage import drawn_values, patch_of, random_places
from vibroswarm.inspection.factors import of_typical_robots
from vibroswarm.inspection.patches import declared
from vibroswarm.inspection.samples import Law
from vibroswarm.inspection.stopping import LOOKS, Question, rule_of
from vibroswarm.scenario.scenario import preset

SENSOR = preset("paper").sensor
DIFFER = Law(SENSOR.model_copy(update={"robot_spread": 0.12}), "robots differ")
ALIKE = Law(SENSOR, "robots are alike")
FACTORS = np.array([0.8, 0.9, 1.0, 1.1, 1.25])


def drawn(count: int, damaged: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Values of five robots in turn, the factor of each sample, and its look of 8."""
    random = np.random.default_rng(4)
    still = gamma(SENSOR.still_shape, SENSOR.still_location, SENSOR.still_scale)
    vibrating = gamma(SENSOR.vibrating_shape, SENSOR.vibrating_location, SENSOR.vibrating_scale)
    value = np.where(random.random(count) < damaged, vibrating.rvs(count, random), still.rvs(count, random))
    factor = FACTORS[np.arange(count) % 5]
    return (value * factor)[:, None], factor, np.arange(count) * 8 // count


@pytest.mark.parametrize(("damaged", "bias"), [(0.0, 0.0), (0.04, 0.02)])
def test_factors_are_found_though_some_of_the_surface_is_damaged(damaged, bias):
    samples = drawn_samples(5, count=20_000, spread_m=0.0)
    value, factor, look = drawn(20_000, damaged)
    found = (value / of_typical_robots(samples, DIFFER, value, look, 8))[:, 0]
    last = look == 7
    np.testing.assert_allclose(np.log(found[last] / factor[last]), bias, atol=0.035)


def test_only_samples_so_far_count_and_few_say_little():
    samples = drawn_samples(5, count=400, spread_m=0.0)
    value, factor, look = drawn(400, 0.0)
    later = np.where(look[:, None] > 3, 3.0 * value, value)
    found, other = (of_typical_robots(samples, DIFFER, each, look, 8) for each in (value, later))
    np.testing.assert_array_equal(found[look <= 3], other[look <= 3])
    assert (found[look > 3] < other[look > 3]).all()
    error = np.abs(np.log(value[:, 0] / found[:, 0]))
    assert error[look == 0].mean() < 0.7 * np.abs(np.log(factor)).mean()


def test_values_stay_where_robots_do_not_differ_or_only_say_yes_or_no():
    samples = drawn_samples(5, count=400, spread_m=0.0)
    value, _, look = drawn(400, 0.0)
    for law in (ALIKE, replace(DIFFER, bits=True)):
        assert of_typical_robots(samples, law, value, look, 8) is value


@pytest.mark.slow
def test_the_told_risk_is_true_where_robots_differ(monkeypatch):
    """The control: robots whose factors are not estimated. Told 4 %, damage was then there in 10 %."""

    def told_and_true() -> tuple[float, int, int]:
        random, told = np.random.default_rng(1), []
        question = Question(0.1, (0.5,), risk=0.05)
        for seed in range(60):
            samples = replace(drawn_samples(seed, count=2000, spread_m=0.0, rows=5), law=DIFFER)
            rule = rule_of(samples, declared(samples.size_m, [0.1]), question, LOOKS)
            damage = patch_of(*random_places(random, np.full(10, 0.1), samples.size_m), 0.1, 0.5)
            values = np.hstack([drawn_values(random, samples, 10, each) for each in (damage, None)])
            told.append(rule.told(values))
        risk = np.hstack(told)
        cleared = (risk <= question.risk).any(axis=0)
        first = risk[(risk <= question.risk).argmax(axis=0), np.arange(risk.shape[1])]
        damaged = np.arange(risk.shape[1]) % 20 < 10
        return float(first[cleared].mean()), int((cleared & damaged).sum()), int(cleared.sum())

    told, missed, cleared = told_and_true()
    assert cleared > 400
    assert binom.sf(missed - 1, cleared, told) > 0.01
    monkeypatch.setattr(stopping, "of_typical_robots", lambda samples, law, values, look, looks: values)
    told, missed, cleared = told_and_true()
    assert binom.sf(missed - 1, cleared, told) < 0.001
