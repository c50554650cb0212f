"""How long for a wanted error: by hand and on seeds; and points that no other beats."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vibroswarm.inference.outcomes import ROBOTS, RUNS
from vibroswarm.report.detection import hardest_pairs
from vibroswarm.statistics.best_group import pareto_front
from vibroswarm.statistics.intervals import generator, wilson
from vibroswarm.study.detection import detection_curve, fills_around, needed, pairs
from vibroswarm.study.options import detection_scenario


def test_pareto_by_hand() -> None:
    front = pareto_front([1, 2, 3, 3, 1, np.nan], [0.5, 0.2, 0.2, 0.1, 0.5, 0.0])
    assert front.tolist() == [True, True, False, True, True, False]


@settings(deadline=None)
@given(
    st.integers(1, 3).flatmap(
        lambda n: st.lists(st.tuples(*[st.integers(0, 5)] * n), min_size=1, max_size=30)
    )
)
def test_pareto_as_said(points: list[tuple[int, ...]]) -> None:
    front = pareto_front(*zip(*points, strict=True))
    assert front.any()
    for own, on in zip(points, front, strict=True):
        beaten = any(
            other != own and all(a <= b for a, b in zip(other, own, strict=True)) for other in points
        )
        assert on == (not beaten)


def cell(times: list[float | None], robots: int = 2, fill: float = 0.4) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Runs whose robots all decide right at the run's time, or never."""
    of_runs, of_robots = [], []
    for run, t in enumerate(times):
        outcome = "incomplete" if t is None else "right"
        right = 0 if t is None else robots
        of_runs.append((run, outcome, t, fill, 0, right, 0, robots - right, 100.0, False))
        decision = -1 if t is None else 0
        of_robots += [(run, i, decision, t, None, 0.5, 0.5, 1, 1, 0.5, 0.3, 1, 1, 1) for i in range(robots)]
    return (
        pl.DataFrame(of_robots, schema=ROBOTS, orient="row"),
        pl.DataFrame(of_runs, schema=RUNS, orient="row"),
    )


def test_detection_by_hand() -> None:
    curve = detection_curve([cell([10.0, 20.0, None, 30.0])], 100.0)
    assert curve["horizon_s"].to_list() == pytest.approx([100 * k / 6 for k in range(1, 7)])
    assert curve["missed"].to_list() == curve["robots_missed"].to_list() == [0.75, *[0.25] * 5]
    limits = wilson(3, 4)
    assert curve.select("missed_low", "missed_high").row(0) == pytest.approx((limits.low, limits.high))
    assert curve.select("fill_ratio", "robots", "runs").row(0) == (0.4, 2, 4)


def test_needed_by_hand() -> None:
    """Of 100 runs at least 95 have to be right for an upper limit below 0.12: that of 5 in 100 is 0.112."""
    times: list[float | None] = [float(t) for t in range(1, 101)]
    assert wilson(5, 100).high < 0.12 < wilson(6, 100).high
    few, more = cell(times), cell([t / 2 for t in times], robots=4)  # type: ignore[operator]
    none = cell([None] * 100, robots=1)
    frame = needed([more, few, none], 100.0, 0.12)
    assert frame["robots"].to_list() == [1, 2, 4]
    assert frame["needed_s"].to_list() == [None, 95.0, 47.5]
    assert frame["fewest"].to_list() == [False, True, False]
    assert frame["missed"].to_list() == pytest.approx([1.0, 0.0, 0.0])
    assert needed([cell([1.0] * 70)], 100.0, 0.05)["needed_s"].to_list() == [
        None
    ]  # too few runs say too little
    assert needed([cell([1.0] * 80)], 100.0, 0.05)["needed_s"].to_list() == [1.0]


def test_pairs_by_hand() -> None:
    """If false alarms become too many at the very time at which misses become few enough, no time is left."""
    rows = [
        (0.6, 1, 3, 20.0, None),
        (0.4, 0, 3, None, None),
        (0.2, 0, 3, None, None),
        (0.6, 1, 2, 50.0, None),
        (0.4, 0, 2, None, 50.0),
        (0.3, 0, 2, None, 50.5),
        (0.2, 0, 2, None, None),
    ]
    names = ["fill_ratio", "truth", "robots", "needed_s", "clear_until_s"]
    found = pairs(pl.DataFrame(rows, schema=names, orient="row"))
    assert found.select("fill_ratio_below", "robots", "time_s", "fewest").rows() == [
        (0.2, 2, 50.0, True), (0.2, 3, 20.0, False), (0.3, 2, 50.0, True), (0.4, 2, None, False), (0.4, 3, 20.0, True),
    ]  # fmt: skip
    assert hardest_pairs(found).select("fill_ratio_below", "robots", "time_s", "fewest").rows() == [
        (0.3, 2, 50.0, True), (0.4, 3, 20.0, True),
    ]  # fmt: skip


def test_on_the_boundary_nothing_can_be_missed() -> None:
    robots, runs = cell([1.0, 2.0], fill=0.5)
    on = (
        robots,
        runs.with_columns(
            truth=pl.lit(None, dtype=pl.Int8), consensus=pl.lit("truth_undefined").cast(RUNS["consensus"])
        ),
    )
    assert detection_curve([on], 100.0)["missed"].null_count() == 6
    assert needed([on], 100.0, 0.5)["needed_s"].to_list() == [None]


def test_what_is_said_to_be_enough_is_enough() -> None:
    """Runs of known miss: the time said to do misses more than wanted in few studies; by the estimate in half."""
    random = generator(6, "needed")
    wanted, too_soon, by_estimate = 0.1, 0, 0
    for _ in range(200):
        times = random.exponential(20.0, 150)  # the miss at t is exp(-t / 20)
        found = needed([cell([float(t) if t < 100 else None for t in times], robots=1)], 100.0, wanted)[
            "needed_s"
        ][0]
        too_soon += found is not None and np.exp(-found / 20.0) > wanted
        by_estimate += np.exp(-np.quantile(times, 1 - wanted) / 20.0) > wanted
    assert too_soon / 200 <= 0.05
    assert by_estimate / 200 > 0.3  # the negative control


def test_fill_ratios_are_dense_just_above_a_boundary() -> None:
    for more_than, below, above in (
        (0.03, [0.0, 0.01, 0.02], [0.04, 0.05, 0.06, 0.08, 0.10]),
        (0.97, [0.0, 0.32, 0.65], [0.98, 0.99, 1.0]),
    ):
        scenario = detection_scenario(more_than, tiles="10x10")
        assert fills_around(scenario) == below + above
        assert scenario.decision.boundary_of == "tiles"
