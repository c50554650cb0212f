"""The error of a fitted law: does it say how far laws of sessions are from the sensor that the sessions had?"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import binom

from helpers.inspections import drawn_samples
from vibroswarm import preset, simulate
from vibroswarm.calibrate.dataset import dataset_of
from vibroswarm.errors import InputError
from vibroswarm.inspection.damage import drawn_values, patch_of, random_places, ratios_at
from vibroswarm.inspection.laws import law_of_measured, law_of_sessions
from vibroswarm.inspection.patches import (
    declared,
    log_likelihoods,
    scan_statistic,
    shares_of,
)
from vibroswarm.inspection.samples import Law, Samples
from vibroswarm.inspection.scan import intact_statistics, p_value
from vibroswarm.inspection.stopping import Question, rule_of
from vibroswarm.observation.energy_model import energy_of
from vibroswarm.scenario.fields import Sensor

Floats = NDArray[np.float64]
SESSIONS = range(6)
TRUTH = Law(preset("paper").sensor, "the truth")


def log_means(sensor: Sensor) -> np.ndarray:
    """Log of the mean energy on still and on vibrating tiles."""
    return np.log(
        [
            sensor.still_shape * sensor.still_scale + sensor.still_location,
            sensor.vibrating_shape * sensor.vibrating_scale + sensor.vibrating_location,
        ]
    )


@pytest.fixture(scope="module")
def laws() -> list[Law]:
    scenario = preset("calibrated").with_values({"run.t_end_s": 600.0, "floor.source": "random:0.48"})
    found = dataset_of([simulate(scenario, 3, len(SESSIONS), poses=True)])
    return [law_of_sessions(found, [session], "one session", draws=10) for session in SESSIONS]


def test_laws_are_as_wrong_as_they_say(laws: list[Law]) -> None:
    truth = log_means(preset("calibrated").sensor)
    errors = np.array([log_means(law.sensor) - truth for law in laws])
    stated = np.array([np.std([log_means(one.judge) for one in law.draws], axis=0, ddof=1) for law in laws])
    assert 0.4 < np.sqrt(np.mean((errors / stated) ** 2)) < 1.6


@cache
def law_of(seed: int, values: int) -> Law:
    """A law of so many measured values of each kind, which several tests use."""
    random = np.random.default_rng(seed)
    vibrating, still = (
        np.abs(energy_of(TRUTH.sensor, kind, random.random(values)).astype(np.float64)) for kind in (1, 0)
    )
    return law_of_measured(vibrating, still, f"{values} values of each kind")


def measured_law(seed: int, samples: int, values: int) -> tuple[np.random.Generator, Samples, Law]:
    """Places of samples with the true law, and a law of so many measured values of each kind."""
    at = replace(drawn_samples(seed, count=samples, spread_m=0.0), law=TRUTH)
    return np.random.default_rng([seed, 1]), at, law_of(seed, values)


def false_calls(with_error: bool, laws: int) -> float:
    """Share of intact surfaces that are called at 5 %, by laws of 60 measured values of each kind, 4 by each law."""
    called = []
    for seed in range(laws):
        random, samples, law = measured_law(seed, 300, 60)
        measured = replace(samples, law=law if with_error else replace(law, draws=()))
        patches = declared(samples.size_m, (0.1, 0.2))
        shares = shares_of(samples, patches)
        drawn = intact_statistics(measured, patches, shares, 256, seed)
        logs = log_likelihoods(shares, ratios_at(law, drawn_values(random, samples, 4)))
        called += [p_value(t, drawn) <= 0.05 for t in scan_statistic(patches, logs)]
    return float(np.mean(called))


@pytest.mark.long
def test_intact_surfaces_are_seldom_called_by_a_law_of_few_values() -> None:
    """Drawn surfaces are judged as the surface is: by a law that has not seen the values that they measure."""
    assert false_calls(True, 12) * 48 <= binom.ppf(0.999, 48, 0.05)
    # The control: as if the law were exact.
    assert false_calls(False, 25) * 100 > binom.ppf(0.999, 100, 0.05)


@pytest.mark.long
def test_drawn_surfaces_measure_more_than_the_largest_measured_value_as_often_as_others_do() -> None:
    """None did: by 40 values 13 % of intact surfaces were called at 5 %, and by 400 values 7 %."""
    beyond = []
    for seed in range(20):
        random, samples, law = measured_law(seed, 50, 40)
        drawn = drawn_values(random, replace(samples, law=law), 64)
        beyond.append((drawn > max(law.sensor.still_energies or ())).mean())
    assert 0.5 / 41 < np.mean(beyond) < 2.0 / 41


def refusals(seeds: int, drawn: Callable[[np.random.Generator], tuple[Floats, Floats]]) -> int:
    """How often values of vibrating and still tiles are refused because they cannot be told apart."""
    count = 0
    for seed in range(seeds):
        try:
            law_of_measured(*drawn(np.random.default_rng(seed)), "values of each kind")
        except InputError as error:
            count += "cannot be told apart" in str(error)
    return count


@pytest.mark.parametrize(("apart", "least", "most"), [(0.0, 9, 10), (0.5, 0, 2)])
def test_values_that_do_not_differ_are_refused_and_others_are_not(
    apart: float, least: int, most: int
) -> None:
    """Of 10, at p = 1 %."""
    refused = refusals(10, lambda random: (random.normal(5.0 + apart, 0.5, 60), random.normal(5.0, 0.5, 60)))
    assert least <= refused <= most


@pytest.mark.parametrize(("ones", "expected"), [(0.2, 4), (0.7, 0)])
def test_values_that_are_often_equal_are_judged_as_others_are(ones: float, expected: int) -> None:
    """Of equal values those that vibrate ranked below the others: 20 and 70 % of readings of 1 were refused."""

    def drawn(random: np.random.Generator) -> tuple[Floats, Floats]:
        vibrating, still = ((random.random(200) < share).astype(np.float64) for share in (ones, 0.2))
        return vibrating, still

    assert refusals(4, drawn) == expected


@pytest.mark.parametrize(("ones", "least", "most"), [(0.5, 9, 10), (0.65, 0, 4)])
def test_few_weak_readings_are_told_apart(ones: float, least: int, most: int) -> None:
    """Of 10 references with 300 readings of a kind; those of .5 and .65 were refused in 5 of 6."""

    def drawn(random: np.random.Generator) -> tuple[Floats, Floats]:
        vibrating, still = ((random.random(300) < share).astype(np.float64) for share in (ones, 0.5))
        return vibrating, still

    assert least <= refusals(10, drawn) <= most


def cleared_damage(contrasts: tuple[float, ...]) -> list[tuple[int, float]]:
    """Surfaces with damage of each contrast that are cleared at 5 %, of as many as are intact, and how many risks say.

    100 of each by each of 12 laws of 60 measured values of each kind.
    """
    cleared = np.zeros((len(contrasts), 2))
    for seed in range(12):
        random, samples, law = measured_law(seed, 100, 60)
        judged = replace(samples, law=law)
        rule = rule_of(judged, declared(judged.size_m, [0.2]), Question(0.2, (1.0,)))
        for k, contrast in enumerate(contrasts):
            centre_m = random_places(random, np.full(100, 0.2), samples.size_m)
            damaged = drawn_values(random, samples, 100, patch_of(*centre_m, 0.2, contrast))
            risk = rule.told(np.hstack([damaged, drawn_values(random, samples, 100)]))[0]
            cleared[k] += (risk[:100] <= 0.05).sum(), risk[risk <= 0.05].sum()
    return [(int(truly), told) for truly, told in cleared]


@pytest.mark.long
def test_risks_by_laws_of_few_values_are_not_above_the_told_ones() -> None:
    (truly, told), (weaker, told_of_weaker) = cleared_damage((1.0, 0.5))
    assert truly <= told
    assert weaker > 1.5 * told_of_weaker  # the control: damage that is weaker than the law says
