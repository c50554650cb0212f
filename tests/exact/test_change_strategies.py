"""Strategies for floors that change, against plain Python; answers over time by hand; figures of studies and runs."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import polars as pl
import pytest
from polars.testing import assert_frame_equal

from helpers.commands import output_of
from vibroswarm import Result, Scenario, Study, preset, simulate, strategies
from vibroswarm.errors import InputError
from vibroswarm.robot.belief import belief_below
from vibroswarm.statistics.answers_over_time import Answer, answers_in, course_of, judged
from vibroswarm.strategies.base import forget as forget_strategy
from vibroswarm.strategies.reset import on_sample as count_reading
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


@pytest.mark.parametrize(
    ("rows", "share", "delay_s", "false"),
    [
        # they never answer anew: right until the change, and when they decided
        (((0, 10.0, 0), (1, 20.0, 0)), 0.425, 100.0, 0),
        # one of them does: the swarm's answer stays
        (((0, 10.0, 0), (1, 20.0, 0), (0, 120.0, 1)), 0.625, 100.0, 0),
        # they leave at 50 s without a change: the answer is right from the change on, which they have not noticed
        (((0, 10.0, 0), (1, 20.0, 0), (0, 40.0, 1), (1, 50.0, 1)), 0.65, NAN, 1),
        # they answer anew at the very change
        (((0, 10.0, 0), (1, 20.0, 0), (0, 100.0, 1), (1, 100.0, 1)), 0.925, 0.0, 0),
        # leave and come back: one false change
        (((0, 0.0, 0), (1, 0.0, 0), (0, 40.0, 1), (1, 40.0, 1), (0, 50.0, 0), (1, 50.0, 0)), 0.45, 100.0, 1),
        # first answer wrong, then right: no right answer was left
        (((0, 10.0, 1), (1, 10.0, 1), (0, 60.0, 0), (1, 60.0, 0)), 0.2, 100.0, 0),
    ],
)
def test_more_answers_by_hand(rows: Any, share: float, delay_s: float, false: int) -> None:
    numbers = judged(course(*rows))
    assert numbers["right_time_share"] == pytest.approx(share)
    assert numbers["answer_delay_s"] == pytest.approx(delay_s, nan_ok=True)
    assert numbers["false_changes_per_h"] == pytest.approx(false * 3600 / 200)


def test_a_robot_that_never_answers_is_never_right() -> None:
    numbers = judged(course((0, 10.0, 0)))
    assert numbers["right_time_share"] == pytest.approx(90 / 400)
    assert numbers["right_at_decision"] == 0.5
    assert numbers["answer_delay_s"] == 100.0


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


def test_where_no_answer_is_ever_right_nothing_is_judged(capsys: pytest.CaptureFixture[str]) -> None:
    """Such as the share of tiles that vibrate, which is estimated: decisions beside it are not wrong."""
    assert all(map(math.isnan, judged(course(*RIGHT_THEN_NEW, **{"task.name": "share"})).values()))
    changed = ["--set", "run.t_end_s=60", "--set", "change.at_s=20", "--set", "change.to=redraw"]
    said = output_of(capsys, "evaluate", *changed, "--task", "share", "--runs", "2")
    assert "The floor changes" not in said


@pytest.mark.parametrize(
    ("rows", "delay_s", "false"),
    [
        # "the floor has changed" at 50 s, as the first answer: a false change, and none that was noticed
        (((0, 40.0, 1), (1, 50.0, 1)), NAN, 1),
        # taken back in time, and given again after the change
        (((0, 40.0, 1), (1, 50.0, 1), (0, 60.0, 0), (1, 60.0, 0), (0, 130.0, 1), (1, 130.0, 1)), 30.0, 1),
        # one robot alone is not the swarm
        (((0, 40.0, 1), (0, 60.0, 0), (0, 130.0, 1), (1, 140.0, 1)), 40.0, 0),
        # as it was, then changed
        (((0, 40.0, 0), (1, 50.0, 0), (0, 130.0, 1), (1, 140.0, 1)), 40.0, 0),
    ],
)
def test_a_change_that_is_told_before_it_comes_is_false(rows: Any, delay_s: float, false: int) -> None:
    changed = {"task.name": "changed", "strategy.name": "reset", "strategy.reset.tells_change": True}
    numbers = judged(course(*rows, **changed))
    assert numbers["answer_delay_s"] == pytest.approx(delay_s, nan_ok=True)
    assert numbers["false_changes_per_h"] == pytest.approx(false * 3600 / 200)


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
    assert [list(zip(one.since_s, one.answer, strict=True)) for one in own.truths] == [
        [(0, 0), (100, 1), (110, 0), (150, 1)],
        [(0, 0), (100, 1), (150, 0)],
    ]
    assert np.isnan(own.truth.answer).all()
    numbers = judged(own)
    assert numbers["right_at_decision"] == 0.5  # robot 0 told of no change, robot 1 never answered 1
    # robot 0: 10 to 100, 115 to 130 and 140 to 150; robot 1: 20 to 100 and 150 to 200
    assert numbers["right_time_share"] == pytest.approx((90 + 15 + 10 + 80 + 50) / 400)
    assert numbers["answer_delay_s"] == pytest.approx((10 + 50 + 50) / 3)
    assert numbers["false_changes_per_h"] == pytest.approx(0.5 * 3600 / 200)
    assert numbers["change_time_error_s"] == 4.0  # the answer at 130 s, to no change, does not count


def test_an_answer_at_the_time_of_a_change_comes_after_it() -> None:
    own = course((0, 10.0, 0), (1, 20.0, 0), (0, 100.0, 1), (0, 110.0, 0), **ANEW).truths[0]
    assert own.since_s.tolist() == [0, 100, 100, 150]
    assert own.answer.tolist() == [0, 1, 0, 1]  # the answer ends the span in which it is right


def test_the_same_answers_are_others_since_the_start() -> None:
    """Negative control of the test before; the time of the change is scored here, too."""
    start = course(*TOLD, changed_s=REPORTED_S, **{**ANEW, "task.changed.since": "start"})
    assert start.truth.answer.tolist() == [0, 1, 0]
    numbers = judged(start)
    assert numbers["right_at_decision"] == 0.5  # the last answer of robot 0, 0 at 140 s, is wrong
    assert numbers["right_time_share"] == pytest.approx((90 + 5 + 10 + 50 + 80 + 50) / 400)
    assert numbers["change_time_error_s"] == pytest.approx((4 + 20) / 2)
    assert math.isnan(judged(course(*TOLD, **ANEW))["change_time_error_s"])
    before = course(
        (0, 10.0, 0), (1, 20.0, 0), changed_s=(8.0, NAN)
    )  # robot 0 tells of a change that never was
    assert math.isnan(judged(before)["change_time_error_s"])


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


def test_a_map_fades() -> None:
    """With a memory of 1 s nothing is left of a map between two samples; with a long one it is that of places."""
    base = {**INVERTED, "run.t_end_s": 200.0, "localisation.method": "true"}
    maps = {}
    for name, memory_s in (("places", None), ("fading", 1e9), ("fading", 1.0)):
        values = {} if memory_s is None else {"strategy.fading.memory_s": memory_s}
        result = simulate(scenario(name, **base, **values, **{f"strategy.{name}.min_samples": 5}), 2, 1)
        assert result.reports is not None
        rows = result.reports.filter((pl.col("name") == "p") & (pl.col("robot") == 0)).sort("index")
        maps[memory_s] = rows["value"].to_numpy(), result.robots["belief_below"].to_numpy()
    np.testing.assert_allclose(maps[1e9][1], maps[None][1], atol=1e-5)
    assert np.abs(maps[1.0][1] - 0.5).max() < 0.2
    assert np.abs(maps[None][1] - 0.5).max() > 0.3


@pytest.mark.parametrize("name", ["forget", "reset", "fading"])
def test_answers_are_revised_only_if_they_may_be(name: str) -> None:
    for revise in (True, False):
        values = {**INVERTED, "decision.revise": revise, "run.t_end_s": 1200.0, "localisation.method": "true"}
        if name == "fading":
            values |= {"strategy.fading.memory_s": 150.0, "strategy.fading.trust_limit": 1000.0}
        decisions = simulate(scenario(name, **values), 7, 4).robots["decision"].to_list()
        assert decisions == [int(revise)] * 20


# The task


def test_changed_asks_whether_the_floor_is_as_it_was() -> None:
    values = {**INVERTED, "task.name": "changed", "strategy.reset.tells_change": True, "run.t_end_s": 1200.0}
    result = simulate(scenario("reset", **values), 3, 6)
    assert result.runs["truth"].to_list() == [1] * 6
    assert result.runs["consensus"].to_list() == ["right"] * 6
    delays = answers_in(result)["answer_delay_s"]
    assert 0 < delays.mean() < 600
    still = simulate(result.scenario.with_values({"change.at_s": None, "change.to": None}), 3, 6)
    assert still.runs["truth"].to_list() == [0] * 6
    assert still.runs["right"].sum() > still.runs["wrong"].sum()
    few = result.scenario.with_values({"change.to": "redraw", "task.changed.more_than": 0.9})
    assert simulate(few, 3, 1).runs["truth"].to_list() == [0]


@pytest.mark.parametrize("floor", [{"floor.values": [[0.2, 0.8]]}, {"floor.source": "patch:0.3"}])
def test_values_and_patches_have_not_changed(floor: dict[str, Any]) -> None:
    """The share of tiles that differ was that of the patches, or the mean of the values: the answer was "changed"."""
    told = scenario("reset", **{**floor, "task.name": "changed", "strategy.reset.tells_change": True})
    assert simulate(told.with_values({"run.t_end_s": 60.0}), 1, 2).runs["truth"].to_list() == [0, 0]


def test_robots_answer_each_change_once_and_say_when_it_was() -> None:
    sure = {"strategy.reset.threshold": 12.0, "strategy.reset.least": 0.12, "run.t_end_s": 1200.0}
    anew = scenario("reset", **INVERTED).with_values(ANEW | sure | {"change.at_s": [400, 800]})
    result = simulate(anew, 3, 12)
    assert result.runs["truth"].null_count() == 12
    assert (result.robots["decision"] == 0).mean() > 0.9  # none since the last answer
    found = answers_in(result)
    assert found["answer_delay_s"].mean() < 200.0
    assert (
        found["false_changes_per_h"].mean() < 0.6
    )  # two robots that notice the same change answer once each
    assert found["change_time_error_s"].mean() < 80.0
    runs = Study.of(anew, runs=12, seed=3).run()
    assert_frame_equal(runs.frame.select(found.columns), found, check_exact=True, check_dtypes=False)
    # Negative control: robots that are asked since the start are right with their first answer for good.
    start = simulate(
        anew.with_values({"task.changed.since": "start", "strategy.reset.tells_anew": False}), 3, 12
    )
    assert start.runs["truth"].to_list() == [0] * 12  # inverted twice
    assert (start.robots["decision"] == 1).mean() > 0.9


def on_sample_with_news(s: Any, a: Any, x: Any, out: Any, d: Any, p: Any, w: Any) -> bool:
    """With its third and its fifth sample, robot 1 says that it has started counting anew, though it has not."""
    sends = count_reading(s, a, x, out, d, p, w)
    if w.robot == 1 and x.number in (2, 4):
        out.anew = 1
    return sends


@pytest.mark.parametrize("follows", [True, False])
def test_news_of_a_change_is_believed_without_doubts_of_ones_own(follows: bool) -> None:
    """All bits are 0 and there are enough of them, so that the cumulative sum of each robot is 0 when it is told."""
    strategies.register(replace(strategies.strategy("reset"), name="teller", on_sample=on_sample_with_news))
    try:
        values = {
            "task.name": "changed",
            "sensor.model": "confusion",
            "sensor.confusion.rates": [[1.0, 0.0], [0.0, 1.0]],
            "floor.source": "random:0.0",
            "strategy.teller.tells_change": True,
            "strategy.teller.follows": follows,
            "run.t_end_s": 300.0,
        }
        result = simulate(scenario("teller", **values), 1, 2)
    finally:
        forget_strategy("teller")
    told = (result.robots["robot"] != 1) & follows
    assert result.robots["decision"].to_list() == told.cast(int).to_list()
    assert result.reports is not None
    changes = result.reports.filter(pl.col("name") == "changes").group_by("run", "robot", maintain_order=True)
    last = changes.agg(pl.col("value").last()).sort("run", "robot")["value"]
    assert last.to_list() == told.cast(float).to_list()  # the second message reports no new change


@pytest.mark.parametrize(
    ("name", "values", "field"),
    [
        ("none", {"task.name": "changed"}, "task.name"),
        ("reset", {"strategy.reset.tells_change": True}, "task.name"),
        ("reset", ANEW | {"strategy.reset.tells_anew": False, "change.to": "invert"}, "task.changed.since"),
    ],
)
def test_questions_and_answers_must_fit(name: str, values: dict[str, Any], field: str) -> None:
    with pytest.raises(InputError) as caught:
        scenario(name, **values)
    assert caught.value.field == field
