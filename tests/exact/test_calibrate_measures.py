"""Cosine similarity between null and ceiling, energy distance, classifier: against what must be so."""

from __future__ import annotations

import math

import numpy as np
import polars as pl
import pytest
from scipy import stats
from scipy.spatial.distance import cdist

from vibroswarm.calibrate.compare import (
    at_equal_counts,
    ceiling,
    compare_feature,
    distances,
    mean_distance,
    null_similarity,
    recognised,
)
from vibroswarm.calibrate.samples import (
    FEATURES,
    by_session,
    histogram,
    sample_table,
    shapeless,
    values_of,
)
from vibroswarm.scenario.scenario import preset
from vibroswarm.simulation import simulate

pytest.importorskip("sklearn", reason="scikit-learn is not installed: pip install 'vibroswarm[lab]'")


def test_two_samples_of_one_distribution_reach_the_ceiling() -> None:
    rng = np.random.default_rng(4)
    draw = lambda n: np.clip(rng.beta(0.7, 0.9, (n, 2)), 1e-6, 1 - 1e-6)  # noqa: E731
    reached = np.mean([at_equal_counts("places", draw(1500), draw(1500), 1500) for _ in range(40)])
    expected = np.mean([ceiling("places", draw(1500), 1500, 1500) for _ in range(40)])
    assert reached == pytest.approx(expected, abs=0.003)
    assert null_similarity("places", draw(1500), 1500) < reached - 0.05
    assert ceiling("still", np.ones((10, 1)), 10, 10) == pytest.approx(1.0)  # all in one bin


def test_a_shapeless_simulation_is_near_its_null_however_high_its_similarity() -> None:
    """Why the figure alone misleads: evenly spread points score nearly what the truth itself would."""
    rng = np.random.default_rng(6)
    nearly_even = [np.clip(rng.beta(0.93, 0.93, (1800, 2)), 1e-6, 1 - 1e-6) for _ in range(3)]
    even = [rng.random((1800, 2)) for _ in range(3)]
    found = compare_feature("places", nearly_even, even)
    assert found.as_published > 0.93
    assert abs(found.at_equal_counts - found.null) < 0.006
    assert found.ceiling > found.null


def effect_size(x: np.ndarray, y: np.ndarray) -> float:
    return distances([x], [y])[0].estimate


def test_energy_distance_is_that_of_scipy_less_its_bias() -> None:
    rng = np.random.default_rng(7)
    x, y = rng.gamma(2.0, size=300), rng.gamma(3.0, size=400)
    across = np.abs(x[:, None] - y).mean()
    biased = stats.energy_distance(x, y) ** 2 / 2  # scipy: D^2 / 2 in our words... of means with own pairs
    inside = [np.abs(v[:, None] - v).mean() for v in (x, y)]
    assert 2 * across - sum(inside) == pytest.approx(2 * biased, rel=1e-9)
    unbiased = (2 * across - inside[0] * 300 / 299 - inside[1] * 400 / 399) / (2 * across)
    assert effect_size(x[:, None], y[:, None]) == pytest.approx(unbiased, rel=1e-9)


def test_energy_distance_is_zero_on_average_between_equals() -> None:
    rng = np.random.default_rng(8)
    for count, columns in ((1, 2), (7, 2), (8, 3), (61, 2)):
        x, y = rng.random((60, columns)), rng.random((count, columns))
        assert mean_distance(x, y) == pytest.approx(cdist(x, y).mean(), rel=1e-12)
        assert mean_distance(x) == pytest.approx(cdist(x, x).sum() / (60 * 59), rel=1e-12)
    equal = [effect_size(rng.random((60, 2)), rng.random((60, 2))) for _ in range(200)]
    assert abs(np.mean(equal)) < 3 * np.std(equal) / math.sqrt(200)
    assert min(equal) < 0 < max(equal)
    shifted = [effect_size(rng.random((60, 2)), rng.random((60, 2)) + 0.15) for _ in range(20)]
    assert np.mean(shifted) > 0.02
    assert effect_size(np.zeros((5, 1)), np.ones((5, 1))) == 1.0


def test_limits_among_sessions_allow_for_pairs_that_overlap() -> None:
    """Limits of the means over each session's pairs hold the truth in two of three cases, of two sessions never."""
    rng = np.random.default_rng(10)

    def sessions(count: int) -> list[np.ndarray]:
        return [rng.normal(0.3 * rng.normal(), size=(100, 1)) for _ in range(count)]

    truth = np.mean([effect_size(*sessions(2)) for _ in range(3000)])
    held = []
    for _ in range(300):
        found = distances(sessions(4), sessions(1))[1]
        assert found is not None
        held.append(found.low <= truth <= found.high)
    assert np.mean(held) > 0.77
    two = distances(sessions(2), sessions(1))[1]
    assert two is not None
    assert math.isinf(two.high)


@pytest.fixture(scope="module")
def simulations() -> tuple[object, ...]:
    base = preset("paper-empirical").with_values({"floor.source": "random:0.48", "floor.redraw": "study"})
    other = base.with_values({"robot.full_speed_m_s": 0.045, "walk.avoidance_threshold_mm": 80.0})
    return simulate(base, 3, 2), simulate(base, 4, 2), simulate(other, 5, 2)


def test_a_simulation_is_not_told_from_itself_but_from_another(simulations: tuple[object, ...]) -> None:
    """The negative control of the whole chain."""
    one, again, other = (by_session(result) for result in simulations)  # type: ignore[arg-type]
    alike, apart = recognised(one, again), recognised(one, other)
    assert alike is not None
    assert apart is not None
    assert abs(alike.estimate - 0.5) < 0.15
    assert apart.estimate > 0.75
    steps = [[values_of(session, "distances") for session in each] for each in (one, again, other)]
    same, different = (compare_feature("distances", steps[0], each) for each in steps[1:])
    assert abs(same.distance.estimate) < 0.003
    assert different.distance.estimate > 0.01


def test_the_sample_table(simulations: tuple[object, ...]) -> None:
    result = simulations[0]
    table = sample_table(result)  # type: ignore[arg-type]
    first = table.filter(pl.col("sample") == 0)
    assert first["dx_m"].null_count() == first.height == 10
    assert first["avoid_s"].null_count() == first.height
    assert table["dx_m"].null_count() == 10
    tiles = result.observations.join(table, on=["run", "robot", "sample"])  # type: ignore[attr-defined]
    floor = result.floor(0).tiles.ravel()  # type: ignore[attr-defined]
    assert (tiles["vibrating"].to_numpy() == (floor[tiles["tile"].to_numpy()] == 1)).all()
    counts = histogram(values_of(table, "avoidance"), "avoidance")
    assert counts.sum() == (table["avoid_s"].drop_nulls() > 1e-9).sum()


def four_samples() -> pl.DataFrame:
    """Four samples of a robot, which does not move in its second interval and whose counter wraps in its third."""
    return pl.DataFrame({
        "time_s": [3.0, 10.0, 20.0, 30.0], "x_m": [0.1, 0.1, 0.1, 0.16], "y_m": [0.1, 0.2, 0.2, 0.28],
        "energy": [4.9, 5.0, 2.9, 3.0], "vibrating": [True, True, False, False],
        "dx_m": [None, 0.0, 0.0, 0.06], "dy_m": [None, 0.1, 0.0, 0.08], "distance_m": [None, 0.1, 0.0, 0.1],
        "spacing_s": [None, 7.0, 10.0, 10.0], "avoid_s": [None, 1.0, 0.0, 2.5],
    })  # fmt: skip


@pytest.mark.parametrize(
    ("feature", "values"),
    [
        ("avoidance", [[1.0], [2.5]]),
        ("vibrating", [[4.9]]),
        ("still", [[2.9]]),
        ("places", [[0.1, 0.1], [0.1, 0.2], [0.1, 0.2], [0.16, 0.28]]),
        ("distances", [[10.0, 0.1], [30.0, 0.1]]),
        ("steps", [[0.0, 0.1], [0.0, 0.0], [0.06, 0.08]]),
    ],
)
def test_values_of_a_feature_by_hand(feature: str, values: list[list[float]]) -> None:
    assert values_of(four_samples(), feature).tolist() == values


RANGES = {
    "avoidance": [(0.0, 8.0)],
    "vibrating": [(0.0, 6.0)],
    "still": [(0.0, 6.0)],
    "distances": [(0.0, 1200.0), (0.05, 0.2)],
    "steps": [(-0.2, 0.2), (-0.2, 0.2)],
}
DROPPED_FROM = {"vibrating": 5.0, "still": 3.0}
BINS = {"avoidance": 79, "vibrating": 59, "still": 59, "places": 225, "distances": 576, "steps": 1521}


@pytest.mark.parametrize("feature", FEATURES)
def test_histograms_have_the_published_bins_and_shapeless_values_fill_them(feature: str) -> None:
    low, high = shapeless(feature, np.array([[0.0, 0.0], [1.0, 1.0]]))
    counts = histogram(np.array([low, high]), feature)
    assert (counts.size, counts.sum()) == (BINS[feature], 2.0)
    for axis, (least, most) in enumerate(RANGES.get(feature, [])):
        inside = np.tile((low + high) / 2, (4, 1))
        inside[:, axis] = [least, most, least - 1e-3, most + 1e-3]
        assert histogram(inside, feature).sum() == 2.0
        assert (low[axis], high[axis]) == (least, DROPPED_FROM.get(feature, most))
