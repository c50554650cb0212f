"""Tasks: numbers that are estimated, sides of symmetric floors, and what mistakes cost, against sums by hand."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import pytest
from scipy import stats

from vibroswarm import InputError, preset, simulate
from vibroswarm.inference.outcomes import costs_of, forced_errors
from vibroswarm.league.fronts import guess_level
from vibroswarm.search.costs import COSTS
from vibroswarm.search.outcomes import outcomes_of
from vibroswarm.statistics.figures import run_figures
from vibroswarm.statistics.verdict import verdict
from vibroswarm.tasks import Task, base, register

PAPER = preset("paper").with_values({"run.t_end_s": 300.0, "decision.min_observations": 40})
SHARE = PAPER.with_values({"task.name": "share"})
THREE: dict[str, Any] = {
    "sensor.model": "confusion",
    "floor.source": "random:0.4,0.36,0.24",
    "task.name": "majority",
    "strategy.name": "dirichlet",
}


# Numbers


def test_estimates_are_scored_and_no_decision_is_right() -> None:
    asked, paper = simulate(SHARE, 1, 20), simulate(PAPER, 1, 20)
    assert asked.robots.drop("belief_in_truth").equals(paper.robots.drop("belief_in_truth"))
    assert asked.runs["truth"].null_count() == 20
    assert set(asked.runs["consensus"]) <= {"truth_undefined", "split", "incomplete"}
    figures = run_figures(asked.robots, asked.runs, 300.0)
    misses = (asked.robots["estimate"] - 0.48).abs().to_numpy().reshape(20, 5)
    np.testing.assert_allclose(figures["estimate_error"].to_numpy(), misses.mean(axis=1), rtol=1e-12)
    inside = misses <= 1.6448536269514722 * asked.robots["estimate_spread"].to_numpy().reshape(20, 5)
    np.testing.assert_allclose(figures["estimate_coverage"].to_numpy(), inside.mean(axis=1))
    assert 0 < inside.mean() < 1
    found = verdict(asked, run=0)
    assert found.estimate_error == pytest.approx(misses[0].mean())
    assert verdict(paper, run=0).estimate_error is None
    robots = [robot for run in (2, 14) for robot in verdict(paper, run).robots if robot.decision != -1]
    assert {robot.decision for robot in robots} == {0, 1}
    assert (
        min(robot.belief_in_decision or 0.0 for robot in robots) >= paper.scenario.decision.credible_threshold
    )


def test_a_guess_is_the_cheapest_answer_on_all_floors() -> None:
    """Answer 1 costs 1, 0 and 1 of 4; each truth costs more on average."""
    three = PAPER.with_values({**THREE, "task.costs": [[0, 1, 4], [4, 0, 2], [2, 1, 0]]})
    assert guess_level(three) == pytest.approx(0.8 * 0.5 / 3)


def test_the_share_of_any_kind_may_be_asked_for() -> None:
    three = {
        "sensor.model": "confusion",
        "floor.source": "random:0.4,0.36,0.24",
        "strategy.name": "dirichlet",
    }
    results = [
        simulate(PAPER.with_values({**three, "task.name": "share", "task.share.kind": kind}), 1, 2)
        for kind in (0, 1, 2)
    ]
    assert [result.runs["fill_ratio"][0] for result in results] == pytest.approx([0.4, 0.36, 0.24])
    for kind, result in enumerate(results):
        counts = result.reports.filter(run=1, robot=3).sort("index")["value"].to_numpy()[-3:]  # type: ignore[union-attr]
        robot = result.robots.filter(run=1, robot=3)
        marginal = stats.beta(counts[kind], counts.sum() - counts[kind])  # of a Dirichlet distribution
        assert robot["estimate"][0] == pytest.approx(marginal.mean())
        assert robot["estimate_spread"][0] == pytest.approx(marginal.std())
    with pytest.raises(InputError, match=r"task\.share\.kind: is not a kind from 0 to 2"):
        PAPER.with_values({**three, "task.name": "share", "task.share.kind": 3})


def test_a_task_of_ones_own_may_ask_for_another_number() -> None:
    left = Task(
        name="left", truth=lambda floor, asked, p: float(floor.tiles[:, :2].mean()), estimated="left share"
    )
    register(left)
    try:
        scenario = PAPER.with_values({"task.name": "left"})
        result = simulate(scenario, 1, 8)
        by_hand = [result.floor(run).tiles[:, :2].mean() for run in range(8)]
        assert result.runs["fill_ratio"].to_list() == by_hand
        assert len(set(by_hand)) > 2
        decides = Task(name="decides", truth=lambda floor, asked, p: 1, scored=left.truth)
        register(decides)
        both = simulate(PAPER.with_values({"task.name": "decides"}), 1, 2).runs
        assert (both["fill_ratio"].to_list(), both["truth"].to_list()) == (by_hand[:2], [1, 1])
        outcomes = outcomes_of([scenario], 1, range(8))[0]
        expected = np.abs(outcomes.estimate - np.array(by_hand)[:, None]).mean(axis=1)
        np.testing.assert_allclose(COSTS["estimate_error"](outcomes)[:, 0], expected)
    finally:
        for name in ("left", "decides"):
            base.forget(name)


# Sides


# Costs


def test_forced_errors_of_k_answers_are_those_of_a_guess() -> None:
    decision, belief = np.array([-1, 0, 2, 1]), np.full(4, np.nan)
    for k in (2, 3, 5):
        found = forced_errors(decision, belief, np.array(1.0), 1.0 - np.eye(k)) if k > 2 else None
        if found is not None:
            np.testing.assert_allclose(found, [1 - 1 / k, 1, 1, 0])
    assert forced_errors(decision[:1], belief[:1], np.array(1.0))[0] == 0.5
    result = simulate(PAPER.with_values({**THREE, "run.t_end_s": 20.0}), 1, 4)  # too short to decide
    assert (result.robots["decision"] == -1).all()
    figures = run_figures(result.robots, result.runs, 20.0, costs=costs_of(result.scenario))
    np.testing.assert_allclose(figures["forced_error"].to_numpy(), 2 / 3)


def test_costs_are_those_of_every_combination_by_hand() -> None:
    costs = np.array([[0.0, 1.0], [4.0, 0.0]])
    given = PAPER.with_values({"task.costs": costs.tolist()})
    relative = costs_of(given)
    assert relative is not None
    assert relative.max() == 1.0
    for decision, belief, truth in product((-1, 0, 1), (np.nan, 0.2, 0.5, 0.8), (np.nan, 0.0, 1.0)):
        found = forced_errors(np.array([decision]), np.array([belief]), np.array([truth]), relative)[0]
        if np.isnan(truth):
            assert np.isnan(found)
            continue
        t = int(truth)
        dear = costs[t, 1 - t] / 4.0
        undecided = dear / 2 if np.isnan(belief) or belief == 0.5 else dear * (belief < 0.5)
        assert found == (undecided if decision == -1 else dear * (decision != t))


def test_equal_costs_change_nothing_and_unequal_ones_do() -> None:
    floors = ["random:0.44", "random:0.56"]
    for source in floors:
        scenario = PAPER.with_values({"floor.source": source, "run.t_end_s": 600.0})
        tables = {
            costs: simulate(scenario.with_values({"task.costs": [[0, costs], [1, 0]]}), 1, 30)
            for costs in (1, 4)
        }
        figures = {
            costs: run_figures(one.robots, one.runs, 600.0, costs=costs_of(one.scenario))
            for costs, one in tables.items()
        }
        plain = run_figures(tables[1].robots, tables[1].runs, 600.0)
        assert figures[1].equals(plain)
        factor = (
            1.0 if source == "random:0.44" else 0.25
        )  # a false alarm is the dearest, a miss costs a quarter
        np.testing.assert_allclose(
            figures[4]["forced_error"].to_numpy(), factor * plain["forced_error"].to_numpy()
        )
        assert plain["forced_error"].sum() > 0
        (outcomes,) = outcomes_of([tables[4].scenario], 1, range(30))
        np.testing.assert_allclose(outcomes.mistakes, factor * outcomes.wrong)


# Bad input
