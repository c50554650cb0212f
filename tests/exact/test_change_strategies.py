"""Strategies for floors that change, against plain Python; answers over time by hand; figures of studies and runs."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import polars as pl
import pytest
from polars.testing import assert_frame_equal

from vibroswarm import Result, Scenario, Study, preset, simulate
from vibroswarm.robot.belief import belief_below
from vibroswarm.statistics.over_time import Answer, answers_in, course_of, judged
from vibroswarm.study.summary import outcome_of

GRID = {"floor.source": "random:0.3", "floor.rows": 10, "floor.columns": 10, "decision.min_observations": 40}
INVERTED = {"change.at_s": 300, "change.to": "invert", "decision.revise": True, "run.t_end_s": 600.0}


def scenario(name: str, **values: Any) -> Scenario:
    return preset("paper").with_values({**GRID, "strategy.name": name, **values})


NAN = math.nan

# Answers over time, by hand


def course(
    *rows: tuple[int, float, int],
    counts: tuple[bool, ...] = (True, True),
    changed_s: tuple[float, ...] | None = None,
    **values: Any,
) -> Any:
    """The course of two robots from (robot, time, decision); the truth is 0 until 100 s, then 1, until 200 s."""
    still = preset("paper").with_values(
        {"floor.tiles": ["01", "00"], "floor.source": "ours", "run.t_end_s": 200.0}
    )
    changed = still.with_values({"change.at_s": 100, "change.to": "invert", **values})
    columns = (np.array(column) for column in zip(*rows, strict=True))
    told_s = None if changed_s is None else np.array(changed_s)
    return course_of(changed, changed.floor_for(1, 0), *columns, np.array(counts), 200.0, told_s)


RIGHT_THEN_NEW = ((0, 10.0, 0), (1, 20.0, 0), (0, 110.0, 1), (1, 150.0, 0), (1, 160.0, 1))


def test_answers_over_time_by_hand() -> None:
    found = course(*RIGHT_THEN_NEW)
    assert found.swarm == [Answer(20.0, 0), Answer(160.0, 1)]
    assert found.robots == [[Answer(10.0, 0), Answer(110.0, 1)], [Answer(20.0, 0), Answer(160.0, 1)]]
    numbers = judged(found)
    assert numbers["right_at_decision"] == 1.0
    # robot 0: 10 to 100 and 110 to 200; robot 1: 20 to 100 and 160 to 200
    assert numbers["right_time_share"] == pytest.approx((180 + 120) / 400)
    assert numbers["answer_delay_s"] == 60.0
    assert numbers["false_changes_per_h"] == 0.0
    assert judged(course(*RIGHT_THEN_NEW, **{"change.at_s": [100, 200]})) == numbers  # the run ends at 200 s


def test_robots_with_faults_do_not_count() -> None:
    found = course((0, 10.0, 0), (1, 20.0, 1), counts=(True, False))
    assert found.swarm == [Answer(10.0, 0)]
    assert len(found.robots) == 1
    all_dead = simulate(scenario("forget", **INVERTED, **{"faults.radio_dead": 1.0}), 3, 1)
    assert answers_in(all_dead)["right_time_share"].item() > 0.0  # then all count


def test_without_a_change_of_the_truth_there_is_no_delay() -> None:
    numbers = judged(course(*RIGHT_THEN_NEW, **{"change.to": "redraw"}))
    assert math.isnan(numbers["answer_delay_s"])
    assert numbers["false_changes_per_h"] == pytest.approx(18.0)  # the swarm leaves at 160 s
    assert numbers["right_at_decision"] == 0.0


ANEW = {
    "strategy.name": "reset",
    "strategy.reset.tells_change": True,
    "strategy.reset.tells_anew": True,
    "task.name": "changed",
    "task.changed.since": "answer",
    "change.at_s": [100, 150],
}
TOLD = ((0, 10.0, 0), (1, 20.0, 0), (0, 110.0, 1), (0, 115.0, 0), (0, 130.0, 1), (0, 140.0, 0))
REPORTED_S = (NAN, NAN, 104.0, 104.0, 120.0, 120.0)
"""Robot 0 tells of the change at 100 s, and then of none; robot 1 of none. The floor is inverted at 100 and 150 s."""


def test_each_robot_is_asked_anew_after_its_own_answer_by_hand() -> None:
    own = course(*TOLD, changed_s=REPORTED_S, **ANEW)
    # Robot 0 is asked since 0, 110 and 130 s. At 150 s the floor is again as robot 1 knows it.
    assert [[(since_s, right) for since_s, _, right in one.spans] for one in own.truths] == [
        [(0, 0), (100, 1), (110, 0), (150, 1)],
        [(0, 0), (100, 1), (150, 0)],
    ]
    assert np.isnan([right for *_, right in own.truth.spans]).all()
    numbers = judged(own)
    assert numbers["right_at_decision"] == 0.5  # robot 0 told of no change, robot 1 never answered 1
    # robot 0: 10 to 100, 115 to 130 and 140 to 150; robot 1: 20 to 100 and 150 to 200
    assert numbers["right_time_share"] == pytest.approx((90 + 15 + 10 + 80 + 50) / 400)
    assert numbers["answer_delay_s"] == pytest.approx((10 + 50 + 50) / 3)
    assert numbers["false_changes_per_h"] == pytest.approx(0.5 * 3600 / 200)
    assert numbers["change_time_error_s"] == 4.0  # the answer at 130 s, to no change, does not count


@pytest.fixture(scope="module")
def forgetful() -> Result:
    return simulate(scenario("forget", **INVERTED, **{"strategy.forget.memory": 60.0}), 3, 4)


def test_a_study_and_a_run_have_the_same_figures(forgetful: Result) -> None:
    runs, found = Study.of(forgetful.scenario, runs=4, seed=3).run(), answers_in(forgetful)
    assert_frame_equal(runs.frame.select(found.columns), found, check_exact=True, check_dtypes=False)
    assert found["answer_delay_s"].min() > 0
    table = outcome_of(runs).tables["summary"]
    assert table["answer_delay_s"].item() == pytest.approx(found["answer_delay_s"].mean())
    assert 0.5 < table["right_time_share"].item() < 1.0
    still = Study.of(
        forgetful.scenario.with_values({"change.at_s": None, "change.to": None}), runs=4, seed=3
    ).run()
    assert outcome_of(still).tables["summary"]["answer_delay_s"].null_count() == 1


# Strategies


def test_a_memory_of_nothing_forgotten_is_no_feedback() -> None:
    """Bit by bit, with a radio that dies."""
    values = {"faults.radio_dead": 0.2, "run.t_end_s": 400.0}
    none, forget = (simulate(scenario(name, **values), 2, 3) for name in ("none", "forget"))
    never = simulate(forget.scenario.with_values({"strategy.forget.memory": 0.0}), 2, 3)
    assert_frame_equal(none.inference, never.inference, check_exact=True)
    assert_frame_equal(none.robots, never.robots, check_exact=True)
    assert not forget.inference["alpha"].equals(none.inference["alpha"])  # negative control


def bits_in_order(result: Result, run: int, robot: int) -> list[tuple[list[int], int]]:
    """For each own sample of a robot, the bits of others sent before it, and then its own, over the ideal network."""
    return [([bit for bit, _ in heard], own) for heard, (own, _) in timed_bits(result, run, robot)]


def timed_bits(
    result: Result, run: int, robot: int
) -> list[tuple[list[tuple[int, float]], tuple[int, float]]]:
    """As ``bits_in_order``, each bit with the time at which it was read."""
    key = ["run", "robot", "sample"]
    rows = (
        result.motion.filter(pl.col("run") == run)
        .join(result.observations, on=key)
        .join(result.inference.select(*key, "messages_received"), on=key)
        .sort("time_s", "robot")
    )
    others = rows.filter(pl.col("robot") != robot).select("observation", "time_s").rows()
    found, heard = [], 0
    for bit, time_s, received in (
        rows.filter(pl.col("robot") == robot).select("observation", "time_s", "messages_received").iter_rows()
    ):
        found.append((others[heard:received], (bit, time_s)))
        heard = received
    return found


def test_counts_are_forgotten_as_the_formula_says(forgetful: Result) -> None:
    ones = zeros = 0.0
    own = forgetful.inference.filter((pl.col("run") == 1) & (pl.col("robot") == 2))
    expected = []
    for heard, bit in bits_in_order(forgetful, 1, 2):
        new = [*heard, bit]
        kept = math.exp(-len(new) / 60.0)
        ones, zeros = ones * kept + sum(new), zeros * kept + len(new) - sum(new)
        expected.append((1 + math.floor(ones + 0.5), 1 + math.floor(zeros + 0.5)))
    assert own.select("alpha", "beta").rows() == expected
    assert max(map(sum, expected)) < 75  # the memory and a few bits
    below = [belief_below(alpha, beta, 0.5) for alpha, beta in expected]
    np.testing.assert_allclose(own["belief_below"].to_numpy(), below, atol=1e-12)


GATE = GRID["decision.min_observations"]


def plain_cusum(bits: Any, threshold: float, gate: int = GATE) -> list[tuple[int, int, int, float]]:
    """alpha, beta, changes and time of the last after each own sample, of a robot that does not follow."""
    base, excursion, score, changes, rows, least = [0, 0], [0, 0], 0.0, 0, [], 0.05
    began_s, changed_s, counted = NAN, NAN, 0
    for heard, own in bits:
        for bit, time_s in (*heard, own):
            counted += 1
            if counted <= gate:  # the robot may not decide yet
                base[bit] += 1
                continue
            share = (1 + base[1]) / (2 + sum(base))
            apart = max(abs(share - 0.5), least) * (1 if share > 0.5 else -1)
            if_new, if_old = (min(max(p, 0.01), 0.99) for p in (0.5 - apart, 0.5 + apart))
            score += math.log(if_new / if_old) if bit else math.log((1 - if_new) / (1 - if_old))
            began_s = time_s if excursion == [0, 0] else began_s
            excursion[bit] += 1
            if score < 1e-3 or score > threshold:
                if score > threshold:
                    base, changes, changed_s = [0, 0], changes + 1, began_s
                base = [base[0] + excursion[0], base[1] + excursion[1]]
                excursion, score = [0, 0], 0.0
        rows.append((1 + base[1] + excursion[1], 1 + base[0] + excursion[0], changes, changed_s))
    return rows


@pytest.mark.parametrize("threshold", [2.0, 6.0])
def test_changes_are_those_of_a_cumulative_sum(threshold: float) -> None:
    values = {"strategy.reset.threshold": threshold, "strategy.reset.follows": False}
    result = simulate(scenario("reset", **INVERTED, **values), 3, 2)
    own = result.inference.filter((pl.col("run") == 1) & (pl.col("robot") == 2))
    expected = plain_cusum(timed_bits(result, 1, 2), threshold)
    assert own.select("alpha", "beta").rows() == [row[:2] for row in expected]
    reports = result.reports
    assert reports is not None
    told = reports.filter((pl.col("run") == 1) & (pl.col("robot") == 2) & (pl.col("name") == "changes"))
    assert told["value"].to_list() == [row[2] for row in expected]
    assert expected[-1][2] >= 1
    # negative controls
    assert expected != plain_cusum(timed_bits(result, 1, 2), threshold + 1.0)
    if threshold == 2.0:  # with 6.0 nothing happens before the gate
        assert expected != plain_cusum(timed_bits(result, 1, 2), threshold, gate=0)
    when = reports.filter((pl.col("run") == 1) & (pl.col("robot") == 2) & (pl.col("name") == "changed_s"))
    # A message is read in the next control period in which the robot walks.
    stop_s = (result.motion["time_s"] - result.motion["stop_start_s"]).max() + 2 * result.scenario.tick_s
    late_s = when["value"].fill_null(NAN).to_numpy() - np.array([row[3] for row in expected])
    assert np.isnan(late_s).tolist() == [row[2] == 0 for row in expected]
    assert 0.0 <= np.nanmin(late_s) <= np.nanmax(late_s) <= stop_s


def test_robots_that_follow_count_anew_when_they_are_told() -> None:
    """A robot that reads always 0, and so notices nothing by itself, follows the others over a network with losses."""
    lossy = {**INVERTED, "network.name": "loss", "network.loss.share": 0.7, "faults.stuck_at_0": [0]}
    alphas = {}
    for follows in (True, False):
        result = simulate(scenario("reset", **lossy, **{"strategy.reset.follows": follows}), 5, 20)
        first = result.robots.filter(pl.col("robot") == 0)
        alphas[follows] = float((first["alpha"] + first["beta"]).mean())
    assert alphas[True] < alphas[False]


# The task
