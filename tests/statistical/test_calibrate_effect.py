"""What other robots change: nothing where they are the same, and on which side it must lie where they are not."""

from __future__ import annotations

import pytest

from vibroswarm.calibrate.effect import effects
from vibroswarm.errors import InputError
from vibroswarm.scenario.scenario import preset
from vibroswarm.study.spec import Study
from vibroswarm.study.summary import outcome_of

EASY = preset("paper").with_values({"floor.source": "random:0.2", "decision.min_observations": 40})


def test_the_same_robots_change_nothing() -> None:
    (one,) = effects(EASY, EASY, runs=6, strategies=("positive",))
    assert all(each.first.difference.estimate == 0.0 for each in one.differences)
    assert not any(each.confirmed for each in one.differences)
    assert one.figures[0] == one.figures[1]


def test_robots_that_sample_half_as_often_decide_later() -> None:
    slow = EASY.with_values({"sample.sample_interval_ms": 9000.0})
    (one,) = effects(EASY, slow, runs=12, strategies=("none",))
    time = next(each for each in one.differences if each.first.figure == "decision_time_s")
    assert time.confirmed
    assert time.second.difference.estimate != time.first.difference.estimate  # other motion, on other floors
    assert time.first.difference.low > 20.0
    assert sum(one.consensus[0].values()) == 1.0


def test_a_consensus_where_neither_decision_is_right_is_counted() -> None:
    on_boundary = EASY.with_values({"floor.source": "random:0.5", "floor.rows": 4, "floor.columns": 4})
    (one,) = effects(on_boundary, on_boundary, runs=6, strategies=("positive",))
    assert one.consensus[0]["truth_undefined"] > 0.0
    assert sum(one.consensus[0].values()) == pytest.approx(1.0)


def test_a_strategy_that_steers_is_compared_like_any_other() -> None:
    short = EASY.with_values({"run.t_end_s": 60.0})
    (one,) = effects(short, short, runs=2, strategies=("explore",))
    assert all(each.first.difference.estimate == 0.0 for each in one.differences)
    (one,) = effects(short, short.with_values({"strategy.name": "explore"}), runs=2, strategies=("none",))
    assert all(each.first.difference.estimate == 0.0 for each in one.differences)


def test_the_figures_of_a_scenario_are_those_of_a_study_of_it() -> None:
    late = {"floor.source": "random:0.48", "decision.min_observations": 95, "run.t_end_s": 120.0}
    costs = preset("paper").with_values({**late, "task.costs": [[0, 1], [4, 0]]})
    (one,) = effects(costs, costs, runs=6, strategies=("none",))
    (cell,) = outcome_of(Study.of_scenarios({"costs": costs}, 6, 1).run()).cells
    for figure in ("forced_error", "decision_time_s"):
        assert one.figures[0][figure] == getattr(cell.summary, figure)


def test_a_field_that_only_one_scenario_has_is_no_obstacle() -> None:
    rows = ("00", "01")
    tiles = EASY.with_values({"floor.source": "corner", "floor.tiles": rows, "run.t_end_s": 60.0})
    drawn = EASY.with_values({"run.t_end_s": 60.0})
    for first, second in ((tiles, drawn), (drawn, tiles)):
        (one,) = effects(first, second, runs=2, strategies=("none",))
        assert one.differences


def test_scenarios_that_end_at_different_times_are_refused() -> None:
    longer = EASY.with_values({"run.t_end_s": 2.0 * EASY.run.t_end_s})
    reported: list[float] = []
    with pytest.raises(InputError, match="in the first scenario and") as refused:
        effects(EASY, longer, runs=1, strategies=("none",), progress=reported.append)
    assert refused.value.field == "run.t_end_s"
    assert reported == []  # nothing was simulated
