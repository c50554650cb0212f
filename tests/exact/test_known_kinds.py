"""What could be known of the most common of several kinds: against enumeration, and its errors as they should be."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import stats

from vibroswarm import Result, Study, preset, simulate
from vibroswarm.analysis.oracle_posterior import could_be_known, on_both_sides
from vibroswarm.analysis.tile_posterior import log_prior, most_common_of, permuted, posterior_of_counts
from vibroswarm.study.baselines import references_of

THREE = preset("paper").with_values(
    {
        "sensor.model": "confusion",
        "sensor.confusion.accuracy": 0.8,
        "floor.source": "random:0.4,0.36,0.24",
        "task.name": "majority",
        "strategy.name": "dirichlet",
        "run.t_end_s": 600.0,
    }
)


@pytest.fixture(scope="module")
def three() -> Result:
    return simulate(THREE, 21, 120)


def by_enumeration(ratios: np.ndarray[Any, Any], of_prior: np.ndarray[Any, Any]) -> list[float]:
    """P(kind j has the most tiles) by going through all floors, each with its share of the prior of its numbers."""
    tiles, kinds = ratios.shape[0], ratios.shape[1] + 1
    logs = np.concatenate([np.zeros((tiles, 1)), ratios], axis=1)
    most, total = [0.0] * kinds, 0.0
    for floor in itertools.product(range(kinds), repeat=tiles):
        numbers = [floor.count(kind) for kind in range(kinds)]
        floors = math.factorial(tiles) // math.prod(map(math.factorial, numbers))
        weight = np.exp(of_prior[tuple(numbers[1:])]) / floors * math.exp(sum(logs[range(tiles), floor]))
        total += weight
        if numbers.count(max(numbers)) == 1:
            most[numbers.index(max(numbers))] += weight
    return [each / total for each in most]


@settings(deadline=None, max_examples=25, derandomize=True)
@given(st.sampled_from([(5, 3), (4, 4), (6, 2)]), st.sampled_from(["tiles", "counts", "mirror"]), st.data())
def test_the_posterior_of_the_most_common_kind_is_that_of_all_floors(
    size: tuple[int, int], prior: str, data: st.DataObject
) -> None:
    tiles, kinds = size
    ratios = data.draw(arrays(float, (tiles, kinds - 1), elements=st.floats(-8, 8)))
    numbers = [tiles - 1, 1, *[0] * (kinds - 2)]
    of_prior = log_prior(permuted(numbers) if prior == "mirror" else prior, tiles, kinds)
    found = most_common_of(ratios[None], of_prior)[:, 0]
    np.testing.assert_allclose(found, by_enumeration(ratios, of_prior), atol=1e-12)


def test_of_two_kinds_it_is_the_posterior_of_the_number_of_vibrating_tiles() -> None:
    ratios = np.random.default_rng(2).normal(0, 3, (4, 30))
    for prior in ("tiles", "counts", permuted([17, 13])):
        of_prior = log_prior(prior, 30)
        one, other = posterior_of_counts(ratios[..., None], of_prior), posterior_of_counts(ratios, of_prior)
        np.testing.assert_allclose(one, other, atol=1e-12)


def test_readings_that_the_prior_rules_out_do_not_underflow() -> None:
    ratios = np.full((1, 40, 2), 300.0)  # all tiles look like kinds 1 and 2, which have at most 12 each
    found = most_common_of(ratios, log_prior(permuted([16, 12, 12]), 40, 3))[:, 0]
    np.testing.assert_allclose(found, [0.0, 0.5, 0.5], atol=1e-9)


def test_runs_are_in_turn_on_floors_with_the_shares_in_each_order(three: Result) -> None:
    found = on_both_sides(three)
    orders = []
    for run in range(6):
        orders.append(tuple(np.bincount(found.floor(run).tiles.ravel(), minlength=3).tolist()))
        assert found.runs["truth"][run] == int(np.argmax(orders[-1]))
    assert len(set(orders)) == 6
    assert orders[0] == (10, 9, 6)
    assert found.motion is three.motion
    own = pl.col("run") % 6 == 0
    assert found.observations.filter(own).equals(three.observations.filter(own))


def test_claimed_errors_of_kinds_are_those_that_happen(three: Result) -> None:
    """Over floors of all orders the share wrong is the mean of the claimed errors, at most alpha, at any times."""
    of_all, times_s = on_both_sides(three), np.arange(0.0, 601.0, 10.0)
    found = could_be_known(of_all, "mirror", alpha=0.2, times_s=times_s)
    assert found.claimed.high < 0.2
    n, wrong = found.wrong.n, round(found.wrong.estimate * found.wrong.n)
    assert n > 100
    assert stats.binomtest(wrong, n, found.claimed.estimate).pvalue > 0.01
    # Negative control: a prior that takes floors with so small a lead for rare claims less than happens.
    boast = could_be_known(of_all, "counts", alpha=0.2, times_s=times_s)
    assert boast.wrong.low > boast.claimed.high


def test_it_is_known_at_once_if_the_sensor_never_errs_and_never_if_it_guesses() -> None:
    for accuracy, known in ((1.0, 1.0), (1.0 / 3.0, 0.0)):
        scenario = THREE.with_values({"sensor.confusion.accuracy": accuracy, "run.t_end_s": 200.0})
        result = simulate(scenario, 3, 6)
        found = could_be_known(on_both_sides(result), "mirror")
        assert found.known.estimate == known
        assert found.wrong.estimate == 0.0 or found.wrong.n == 0


def test_studies_have_it_beside_their_strategies() -> None:
    short = THREE.with_values({"run.t_end_s": 300.0})
    (found,) = references_of(Study(short, {"grid": {"strategy.name": ["dirichlet"]}}, 20).run())
    assert found.pooled is None
    assert found.known is not None
    assert found.says == ()
    assert 0.0 < found.known.time_s.estimate <= 300.0
