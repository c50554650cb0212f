"""Costs against results made by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom

from helpers.result_outcomes import from_result
from vibroswarm import preset, simulate
from vibroswarm.core.numbers import with_limits
from vibroswarm.errors import InputError
from vibroswarm.search import costs
from vibroswarm.search.evaluate import Figures
from vibroswarm.search.objective import Objective, bootstrap, corrected, worst_case
from vibroswarm.search.outcomes import Outcomes, outcomes_of
from vibroswarm.search.validation import Scored, paired_score, scored_of
from vibroswarm.statistics.figures import BY_NAME
from vibroswarm.statistics.intervals import Interval

NAN = math.nan


def made(
    decision: list[list[int]], time_s: list[list[float]], estimate: list[list[float]], fill: float = 0.48
) -> Outcomes:
    runs = len(decision)
    return Outcomes(
        run=np.arange(runs),
        decision=np.array(decision),
        decision_time_s=np.array(time_s),
        estimate=np.array(estimate),
        sent=np.zeros(np.shape(decision), dtype=np.int64),
        end_s=np.full(runs, 1200.0),
        fill_ratio=np.full(runs, fill),
        truth=np.full(runs, NAN if fill == 0.5 else float(fill > 0.5)),
        tiles=25,
        t_end_s=1200.0,
    )


# Two robots: one right at 600 s with f exact; one wrong at 300 s, a tile (0.04) off. Then one undecided, two tiles off.
BY_HAND = made([[0, 1], [0, -1]], [[600, 300], [1200, NAN]], [[0.48, 0.52], [0.44, 0.40]])


@pytest.mark.parametrize(
    ("name", "first", "second"),
    [
        ("intended", 1 * 0.5 + 2 * 5, 2 * 1.0 + 3 * 1),
        ("printed", 0.5 + (1 + 0.04 / 25) * 5, (1 + 0.04 / 25) * 1.0 + (1 + 0.08 / 25) * 1),
        ("authors_code", 0 * 0.5 + 1 * 5, 1 * 1.0 + 2 * 3),
        ("decision_time", 450.0, 1200.0),
        ("errors", (0.5 + 5) / 2, (1.0 + 1) / 2),
        ("robots_wrong", 0.5, 0.0),
        ("robots_undecided", 0.0, 0.5),
        ("swarm_wrong", 0.0, 0.0),  # split, and incomplete
        ("consensus_time_s", 1200.0, 1200.0),
    ],
)
def test_costs_of_two_runs_made_by_hand(name: str, first: float, second: float) -> None:
    assert costs.COSTS[name](BY_HAND)[:, 0].tolist() == pytest.approx([first, second], abs=1e-12)


def test_searches_minimise_no_figure_of_which_more_is_better() -> None:
    """The control is ``robots_wrong``, of which less is better."""
    right, wrong = (replace(BY_NAME[name], of_decisions=True) for name in ("robots_right", "robots_wrong"))
    assert (right.is_cost, wrong.is_cost) == (False, True)


def test_a_swarm_that_agrees_wrongly_costs() -> None:
    wrong = made([[1, 1], [0, 0]], [[600, 300], [900, 800]], [[0.5, 0.5], [0.5, 0.5]])
    assert costs.COSTS["swarm_wrong"](wrong)[:, 0].tolist() == [1.0, 0.0]
    assert costs.COSTS["consensus_time_s"](wrong)[:, 0].tolist() == [600.0, 900.0]
    assert (Objective("consensus_time_s").unit, Objective("swarm_wrong").unit) == ("s", "")


def test_intervals_of_scores_of_few_runs_stay_within_what_scores_can_be() -> None:
    never, seldom = np.zeros((20, 1, 1)), np.array([1.0] + [0.0] * 19)[:, None, None]
    of_runs, of_robots = Objective("swarm_wrong", "mean"), Objective("robots_wrong", "mean")
    assert of_runs.interval(never)[1:3] == (0.0, pytest.approx(0.161, abs=5e-4))  # Wilson's
    assert of_robots.interval(seldom).low == 0.0
    few = Objective("swarm_wrong").interval(seldom[:5])  # mean + sd: a bootstrap
    assert with_limits(few) == "0.6"  # it was 0.6 [0, ∞], which says nothing
    own = Objective("mine", "mean", function=lambda outcomes: outcomes.end_s)
    assert own.interval(seldom).low < 0.0


@pytest.mark.parametrize("objective", [Objective("robots_wrong"), Objective("decision_time", "mean")])
def test_scores_of_runs_that_are_nearly_all_alike_have_no_limits(objective: Objective) -> None:
    """They were 0 [0, 0] if no robot was wrong in any run, and 1200 [1200, 1200] if none decided."""
    for others, has_limits in ((0, False), (5, False), (6, True)):
        values = np.array([0.5] * others + [1.0] * (200 - others))[:, None, None]
        assert math.isfinite(objective.interval(values).high) == has_limits
        assert math.isfinite(objective.interval(values).low) == has_limits
    assert math.isfinite(objective.interval(np.arange(50.0)[:, None, None]).high)


def test_an_expected_time_without_a_right_run_has_no_limits() -> None:
    """Its score counts half a run as right: with 100 runs of 1200 s it was 240000 [238000, 242000]."""
    objective, random = Objective("expected_time_to_right"), np.random.default_rng(4)
    rows = np.stack([random.uniform(900.0, 1200.0, 100), np.zeros(100)], axis=1)[:, None, :]
    assert objective.interval(rows)[1:3] == (-math.inf, math.inf)
    rows[0, 0, 1] = 1.0
    assert objective.interval(rows).high < math.inf


def test_the_score_is_mean_plus_standard_deviation_with_ddof_0() -> None:
    rows = np.array([1.0, 2.0, 6.0])[:, None, None]
    assert Objective("intended").score(rows) == pytest.approx(3.0 + math.sqrt((4 + 1 + 9) / 3))
    assert Objective("intended", "mean").score(rows) == pytest.approx(3.0)


def test_the_worst_case_counts() -> None:
    rows = np.array([[1.0, 10.0], [3.0, 20.0]])[:, :, None]
    assert Objective("intended", "mean").score(rows) == 15.0
    two = Interval(5.0, 4.0, 6.0, 0.95, 9, "surer"), Interval(4.0, 1.0, 9.0, 0.95, 9, "may be worse")
    assert worst_case(lambda k, level: two[k], 2)[:3] == (5.0, 4.0, 9.0)


def test_a_false_alarm_and_a_miss_cost_by_their_kind() -> None:
    alarm = made([[1, 1]], [[120, 120]], [[0.5, 0.5]], fill=0.48)
    miss = made([[0, 0]], [[120, 120]], [[0.5, 0.5]], fill=0.52)
    objective = Objective("errors", "mean", parameters={"false_alarm": 2.0, "miss": 20.0})
    assert objective.figures(alarm)[0, 0] == 2.0
    assert objective.figures(miss)[0, 0] == 20.0


def test_expected_time_to_a_right_consensus_counts_the_time_of_failed_inspections() -> None:
    found = made([[0, 0], [1, 1], [0, -1]], [[300, 600], [200, 400], [100, NAN]], [[0.5, 0.5]] * 3)
    objective = Objective("expected_time_to_right")
    rows = objective.figures(found)[:, None, :]
    assert rows[:, 0].tolist() == [[600.0, 1.0], [400.0, 0.0], [1200.0, 0.0]]
    assert objective.score(rows) == 2200.0
    assert objective.score(rows[1:]) == 3200.0  # none was right: no division by zero


def test_time_at_an_error_pays_for_what_exceeds_the_limits() -> None:
    objective = Objective("time_at_error", parameters={"max_error": 0.05, "max_undecided": 0.10})
    good = made([[0] * 10], [[500.0] * 10], [[0.5] * 10])
    assert objective.score(objective.figures(good)[:, None, :]) == 500.0
    one_wrong = made([[0] * 9 + [1]], [[500.0] * 10], [[0.5] * 10])  # 10 % wrong: 5 % too many
    assert objective.score(objective.figures(one_wrong)[:, None, :]) == pytest.approx(500 + 1200 * 1.0)
    undecided = made([[0] * 8 + [-1] * 2], [[500.0] * 8 + [NAN] * 2], [[0.5] * 10])  # 20 %: 10 % too many
    expected = (8 * 500 + 2 * 1200) / 10 + 1200 * 1.0
    assert objective.score(objective.figures(undecided)[:, None, :]) == pytest.approx(expected)


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_a_case_in_which_no_robot_decides_hides_no_error_of_another(order: tuple[int, int]) -> None:
    """Of the robots of one case none decides; of those of the other 40 % are wrong."""
    objective = Objective("time_at_error")
    silent = made([[-1] * 5] * 20, [[NAN] * 5] * 20, [[0.5] * 5] * 20)
    erring = made([[0, 0, 0, 1, 1]] * 20, [[500.0] * 5] * 20, [[0.5] * 5] * 20)
    cases = [objective.figures(found) for found in (silent, erring)]
    rows = np.stack([cases[k] for k in order], axis=1)
    scored = scored_of("made", {}, objective, Figures(rows, np.arange(20)))
    assert scored.parts["robot_error"].estimate == pytest.approx(0.4)
    assert scored.parts["robots_undecided"].estimate == 1.0
    assert scored.parts["robot_error"].low > 0.05


def test_a_mistake_that_costs_less_is_a_part_of_an_error() -> None:
    """The score counted a quarter of an error for each, the share beside it none."""
    rows = np.array([[500.0, 0.25, 5.0, 5.0, 1200.0]] * 60)[:, None, :]
    parts = scored_of("made", {}, Objective("time_at_error"), Figures(rows, np.arange(60))).parts
    assert parts["robot_error"].estimate == pytest.approx(0.05)


def test_no_decision_is_right_on_the_boundary() -> None:
    found = made([[0]], [[1.0]], [[0.5]], fill=0.5)
    for cost in (costs.intended, costs.errors, costs.consensus, costs.at_error):
        with pytest.raises(InputError, match="boundary"):
            cost(found)


def test_the_estimate_is_that_of_the_moment_when_all_had_decided() -> None:
    scenario = preset("paper").with_values({"decision.min_observations": 50, "floor.source": "random:0.32"})
    result = simulate(scenario, seed=2, runs=1)
    found = from_result(result)
    last_s = result.robots["decision_time_s"].max()
    assert last_s is not None
    end_s = math.ceil(float(last_s) / 20.0) * 20.0  # type: ignore[arg-type]
    assert found.end_s.tolist() == [end_s]
    assert end_s < 1200.0
    for robot in range(5):
        mine = result.inference.filter(
            (result.inference["robot"] == robot) & (result.motion["time_s"] <= end_s)
        ).tail(1)
        assert found.estimate[0, robot] == mine["alpha"][0] / (mine["alpha"][0] + mine["beta"][0])


def test_floors_of_one_motion_share_it_and_give_what_each_gives_alone() -> None:
    base = preset("paper").with_values({"run.t_end_s": 300.0})
    floors = [base.with_values({"floor.source": s}) for s in ("stripe:0.48", "diagonal:0.48")]
    soft = floors[1].with_values({"strategy.name": "soft"})
    slower = base.with_values({"sample.sample_interval_ms": 5000.0})
    together = outcomes_of([*floors, soft, slower], 1, [0, 1])
    for scenario, found in zip([*floors, soft, slower], together, strict=True):
        (alone,) = outcomes_of([scenario], 1, [0, 1])
        assert (found.estimate == alone.estimate).all()
        assert (found.decision == alone.decision).all()
    assert (together[0].estimate != together[1].estimate).any()
    assert (together[0].estimate != together[3].estimate).any()


def test_the_jackknife_frees_mean_plus_sd_of_its_bias() -> None:
    random = np.random.default_rng(1)
    objective = Objective("intended")
    truth = 2.0  # of an exponential distribution: mean 1, standard deviation 1
    plain, freed = [], []
    for _ in range(2000):
        rows = random.exponential(1.0, (10, 1, 1))
        plain.append(objective.score(rows))
        freed.append(corrected(objective.score, rows)[0])
    assert np.mean(plain) < truth - 0.12  # the control: 10 evaluations flatter
    assert abs(np.mean(freed) - truth) < 0.05


def test_the_bootstrap_of_a_score_holds_the_truth_as_often_as_it_says() -> None:
    random = np.random.default_rng(2)
    objective = Objective("intended")
    held = 0
    for k in range(100):
        low, high = bootstrap(objective.score, random.exponential(1.0, (400, 1, 1)), seed=k, draws=300)[1:3]
        held += low <= 2.0 <= high
    assert 86 <= held <= 100


def test_limits_of_a_mean_plus_sd_allow_for_skew_costs() -> None:
    """Percentiles of resamples were below the truth for 12 of 100 sets of 50 exponential costs, for 28 of 5 costs."""
    costs_of_runs = -np.log((np.arange(50) + 0.5) / 50)[:, None, None] * np.array([[[1.0], [0.5]]])
    found = Objective("intended").interval(costs_of_runs)
    assert found.high - found.estimate > 1.4 * (found.estimate - found.low)
    few = Objective("intended").interval(costs_of_runs[:49])
    assert few[1:3] == (-math.inf, math.inf)  # of the worst case it was 0 and infinity


@pytest.mark.slow
def test_limits_of_the_worst_of_equal_cases_hold_its_score() -> None:
    """The highest of five estimates is too high, and the bootstrap of it is above the truth (the control)."""
    random, objective, low = np.random.default_rng(5), Objective("decision_time", "mean"), [0, 0]
    for k in range(100):
        rows = random.normal(600.0, 100.0, (60, 5, 1))
        found = objective.interval(rows)
        assert found.high > 600.0
        low[0] += found.low > 600.0
        low[1] += bootstrap(objective.score, rows, seed=k, draws=300).low > 600.0
    assert low[0] <= binom.ppf(1 - 1e-4, 100, 0.025) < low[1]


@pytest.mark.parametrize("runs", [2, 10])
def test_the_bootstrap_of_few_runs_seldom_says_that_equal_scores_differ(runs: int) -> None:
    random, objective = np.random.default_rng(3), Objective("intended")

    def difference(rows: np.ndarray) -> float:
        return objective.score(rows[:, :, :1]) - objective.score(rows[:, :, 1:])

    differ = 0
    for k in range(100):
        rows = random.normal(10.0, 1.0, (runs, 1, 1)) + random.normal(0.0, 0.5, (runs, 1, 2))
        differ += bootstrap(difference, rows, seed=k, draws=200).excludes(0.0)
    assert differ <= binom.ppf(1 - 1e-4, 100, 0.08)  # with 2 runs it was half of the time


def test_few_runs_that_differ_call_no_score_better() -> None:
    """The bootstrap of 60 runs, 5 of which are sooner, excludes that scores are equal; a sign test has p = .06."""
    objective, runs = Objective("decision_time"), np.arange(60)
    times = 400.0 + 5.0 * runs

    def scored(sooner: int) -> Scored:
        rows = np.where(runs < sooner, times - 20.0, times)[:, None, None]
        return scored_of("name", {}, objective, Figures(rows, runs))

    first = scored(0)
    assert paired_score(objective, first, scored(0))[1:3] == (-math.inf, math.inf)
    assert paired_score(objective, first, scored(5))[1:3] == (-math.inf, math.inf)
    assert paired_score(objective, scored(6), first).excludes(0.0)
    later = scored(20)
    assert paired_score(objective, first, later).estimate == pytest.approx(
        objective.score(first.figures.rows) - objective.score(later.figures.rows)
    )


def test_only_smooth_scores_are_corrected() -> None:
    random = np.random.default_rng(4)
    rows = random.exponential(1.0, (20, 1, 1))
    smooth = Objective("intended")
    assert smooth.estimate(rows)[0] > smooth.score(rows)
    two = np.concatenate([rows, rows[::-1]], axis=1)
    assert smooth.estimate(two)[0] == smooth.score(two)  # the worst of two cases
    limits = Objective("time_at_error")
    robots = np.full((20, 1, 1), 5.0)
    wrong = random.binomial(5, 0.05, (20, 1, 1))
    counts = np.concatenate([100.0 * rows, wrong, robots, robots, np.full((20, 1, 1), 1200.0)], axis=2)
    assert limits.estimate(counts)[0] == limits.score(counts) >= float(100.0 * rows.mean())


def test_scores_are_paired_by_the_number_of_the_run() -> None:
    random, objective = np.random.default_rng(3), Objective("intended", "mean")
    cost, runs = random.gamma(2.0, 1.0, 60), np.arange(60)
    first, other = (
        scored_of("cell", {}, objective, Figures((cost[kept] + more)[:, None, None], runs[kept]))
        for kept, more in ((runs[10:], 0.5), (runs[:50], 0.0))
    )
    assert paired_score(objective, first, other)[:3] == pytest.approx((0.5, 0.5, 0.5))
