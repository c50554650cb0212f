"""How long for a wanted error: by hand and on seeds; and points that no other beats."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vibroswarm.documents.detection import detection_document, hardest
from vibroswarm.inference.outcomes import ROBOTS, RUNS
from vibroswarm.scenario.scenario import preset
from vibroswarm.statistics.detection import detection_curve, needed, pairs
from vibroswarm.statistics.fronts import pareto_front
from vibroswarm.statistics.intervals import generator, wilson
from vibroswarm.study.detection import Detection, fills_around
from vibroswarm.study.options import detection_scenario

SHORT = preset("paper").with_values({"run.t_end_s": 300.0, "floor.source": "random:0.40"})


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
    curve = detection_curve([cell([10.0, 20.0, None, 30.0])], 100.0, [15.0, 100.0])
    assert curve["missed"].to_list() == [0.75, 0.25]
    assert curve["robots_missed"].to_list() == [0.75, 0.25]
    assert curve["missed_high"][0] == pytest.approx(wilson(3, 4).high)
    assert curve["missed_low"][0] == pytest.approx(wilson(3, 4).low)
    assert curve.select("fill_ratio", "robots", "runs").row(0) == (0.4, 2, 4)
    assert detection_curve([cell([1.0])], 100.0)["horizon_s"].to_list() == pytest.approx(
        [100 * k / 6 for k in range(1, 7)]
    )


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


def test_false_alarms_are_too_many_when_their_upper_limit_is_not_below_the_rate_wanted_of_them() -> None:
    """That of 6 in 100 is above 0.12."""
    robots, runs = cell([float(t) for t in range(1, 101)])
    consensus = pl.lit("wrong").cast(RUNS["consensus"])
    wrong = robots.with_columns(decision=pl.lit(1, pl.Int8)), runs.with_columns(consensus=consensus)
    found = needed([wrong], 100.0, 0.5, false_alarms=0.12).row(0, named=True)
    assert (found["needed_s"], found["clear_until_s"], found["false_alarm"]) == (None, 6.0, 1.0)


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
    assert hardest(found).select("fill_ratio_below", "robots", "time_s", "fewest").rows() == [
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


def test_the_document_of_a_detection_names_each_limit_and_draws_the_latest_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("vibroswarm.documents.detection.MOST_CURVES", 1)
    times: list[float | None] = [float(t) for t in range(1, 101)]
    answers_more = {"decision": pl.lit(1, pl.Int8)}, {"truth": pl.lit(1, pl.Int8), "fill_ratio": pl.lit(0.6)}
    cells = [cell(times, robots) for robots in (1, 2)]
    cells += [
        tuple(frame.with_columns(**columns) for frame, columns in zip(one, answers_more, strict=True))
        for one in cells
    ]
    sooner = cell([t / 2 for t in times], 1)  # type: ignore[operator]
    cells.append((sooner[0], sooner[1].with_columns(truth=pl.lit(1, pl.Int8), fill_ratio=pl.lit(0.8))))
    need, curve = needed(cells, 100.0, 0.12, false_alarms=0.2), detection_curve(cells, 100.0)
    scenario = SHORT.with_values({"run.t_end_s": 100.0})
    tables = {"detection": curve, "needed": need, "pairs": pairs(need)}
    found = Detection(tables, scenario, 5, 0.12, 0.2)
    assert wilson(0, found.runs_needed).high < 0.12 < wilson(0, found.runs_needed - 1).high
    for most, tolerated in zip(found.most_wrong, (0.12, 0.2), strict=True):
        assert wilson(most, 100).high < tolerated < wilson(most + 1, 100).high
    document = detection_document(found)
    assert document.answer[0] == (
        "1 robot with strategy none finds 60 % vibrating within 95 s, with at most 12 % misses, and at most 20 % false "
        "alarms on floors up to 40 %; 80 % within 48 s."
    )
    assert document.tables["needed"].frame["clear_until_s"].to_list() == [100.0, 100.0, None, None, None]
    at_the_end = document.figures["detection-robots"].drawn.numbers
    assert at_the_end["missed"].to_list() == [0.0] * 5
    assert document.figures["detection-1-robots"].title == "1 robot (drawn: 1 of 2 swarms)"
    tables["needed"] = need.with_columns(runs=pl.Series([100, 100, 101, 100, 100]))
    assert Detection(tables, scenario, 5, 0.12, 0.2).runs == 100  # the fewest
    tables["pairs"] = tables["pairs"].with_columns(time_s=pl.when(pl.col("fill_ratio") < 0.7).then("time_s"))
    strict = detection_document(Detection(tables, scenario, 5, 0.05, 0.2)).answer
    assert strict[0].endswith("; not 80 % by 100 s.")
    assert strict[-1].startswith(
        "Of 100 runs of each floor, at most 0 may be missed, and at most 12 be false"
    )


def test_fill_ratios_are_dense_just_above_a_boundary() -> None:
    for more_than, below, above in (
        (0.03, [0.0, 0.01, 0.02], [0.04, 0.05, 0.06, 0.08, 0.10]),
        (0.97, [0.0, 0.32, 0.65], [0.98, 0.99, 1.0]),
    ):
        scenario = detection_scenario(more_than, tiles="10x10")
        assert fills_around(scenario) == below + above
        assert scenario.decision.boundary_of == "tiles"
