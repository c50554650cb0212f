"""Items that were asked later: what they measure, against brute force and made-up truths."""

from __future__ import annotations

import shlex
from itertools import combinations
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from vibroswarm.cli.command_line import bound
from vibroswarm.cli.commands import parsed
from vibroswarm.cli.scenario_options import scenario_from
from vibroswarm.paper.cells import differences
from vibroswarm.paper.item import CLAIMS, Settings
from vibroswarm.paper.items import (
    example_run,
    experiment_accuracy,
    experiments,
    feedback,
    hidden_threshold,
    readings,
    search,
    side_claims,
)
from vibroswarm.paper.items.experiments import error_of_difference, in_standard_errors
from vibroswarm.paper.reproduce import reproduce

RUNS = 6


def test_a_choice_of_equal_worth_has_no_regret_on_average_though_a_naive_one_would() -> None:
    random, fair, naive = np.random.default_rng(5), [], []
    for _ in range(400):
        there, here = random.normal(1.0, 1.0, (2, 12, 40))  # all choices cost the same everywhere
        fair.append(feedback.regrets(there, here).mean())
        chosen = [int(costs.mean(axis=1).argmin()) for costs in (there, here)]
        naive.append(here[chosen[0]].mean() - here[chosen[1]].mean())
    error = np.std(fair) / np.sqrt(len(fair))
    assert abs(np.mean(fair)) < 4 * error
    assert np.mean(naive) > 10 * error  # the control: what was lucky here is judged by the same luck


def test_a_choice_that_is_worse_here_has_the_regret_that_it_costs() -> None:
    random = np.random.default_rng(6)
    cost = np.linspace(0.0, 1.1, 12)
    there = cost[::-1, None] + random.normal(0.0, 0.02, (12, 400))
    here = cost[:, None] + random.normal(0.0, 0.02, (12, 400))
    assert feedback.regrets(there, here).mean() == pytest.approx(1.1, abs=0.01)
    assert feedback.regrets(here, here).mean() == pytest.approx(0.0, abs=1e-12)


def made_up_front(random: np.random.Generator, runs: int) -> dict[float, dict[str, np.ndarray]]:
    """Times that rise with p_c and errors that fall; runs have luck in common."""
    luck = random.normal(0.0, 1.0, runs)
    return {
        p: {
            "decision_time_s": 1000.0 * p + 50.0 * luck + random.normal(0.0, 20.0, runs),
            "wrong_share": 0.5 * (1.0 - p) + 0.05 * luck + random.normal(0.0, 0.02, runs),
            "undecided_share": 0.4 * p - 0.05 * luck,
        }
        for p in (0.6, 0.7, 0.8, 0.9)
    }


def test_a_strategy_with_another_threshold_gains_nothing_and_a_better_one_what_it_is_better_by() -> None:
    """Soft feedback made up: half way between two thresholds of the front, and the same with 4 points less wrong."""
    random, same, better = np.random.default_rng(9), [], []
    for _ in range(60):
        front = made_up_front(random, 200)
        soft = {name: (front[0.7][name] + front[0.8][name]) / 2 for name in hidden_threshold.FIGURES}
        found = hidden_threshold.match(front, soft)
        assert found is not None
        figures, thresholds = found
        assert thresholds == pytest.approx([0.75, 0.75], abs=0.02)
        same.append((figures["wrong_share"] - soft["wrong_share"]).mean())
        less = {**soft, "wrong_share": soft["wrong_share"] - 0.04}
        again = hidden_threshold.match(front, less)
        assert again is not None
        better.append((again[0]["wrong_share"] - less["wrong_share"]).mean())
    assert abs(np.mean(same)) < 4 * np.std(same) / np.sqrt(60) + 1e-6
    assert np.mean(better) == pytest.approx(0.04, abs=0.002)


def test_beyond_the_front_nothing_is_matched() -> None:
    front = made_up_front(np.random.default_rng(10), 50)
    for time_s in (100.0, 2000.0):
        soft = {**front[0.7], "decision_time_s": np.full(50, time_s)}
        assert hidden_threshold.match(front, soft) is None


def test_spread_over_subsets_is_that_of_all_subsets_of_a_pool() -> None:
    random, count, noise = np.random.default_rng(7), 13, 0.001
    found = []
    chosen = np.array(list(combinations(range(experiment_accuracy.POOL), count)))
    for _ in range(600):
        pool = random.normal(0.17, 0.02, experiment_accuracy.POOL)
        found.append(np.var(pool[chosen].mean(axis=1)))
    drawn = random.normal(0.17, 0.02, (4000, count)).mean(axis=1) + random.normal(0.0, noise, 4000)
    plain = 0.17 + random.normal(0.0, noise, 4000)
    ours = experiment_accuracy._subset_sd(drawn, plain, count)
    assert ours == pytest.approx(np.sqrt(np.mean(found)), rel=0.05)
    assert ours != pytest.approx(np.std(drawn), rel=0.3)  # the control: not the spread of ever other robots
    assert np.isnan(experiment_accuracy._subset_sd(plain, drawn, count))


def test_packet_losses_are_held_against_their_own_line() -> None:
    loss = experiment_accuracy._loss()
    robots, plotted = (loss[name].to_numpy().astype(float) for name in ("robots", "plotted"))
    design = np.column_stack([np.ones(6), robots])
    solved = np.linalg.solve(design.T @ design, design.T @ plotted)
    assert loss["line"].to_numpy() == pytest.approx(design @ solved)
    assert loss["off the line"].sum() == pytest.approx(0.0, abs=1e-12)


def test_errors_beside_published_means_are_those_of_repeated_draws() -> None:
    random = np.random.default_rng(8)
    ours, theirs = random.normal(0.0, 3.0, (4000, 40)), random.normal(0.0, 5.0, (4000, 15)).mean(axis=1)
    found = np.mean([error_of_difference(values, 5.0) for values in ours])
    assert found == pytest.approx(np.std(ours.mean(axis=1) - theirs), rel=0.05)
    assert error_of_difference(np.zeros(9)) == 0.0
    assert in_standard_errors(1.0, 0.0) is None


def test_short_searches_have_seeds_of_their_own_and_grow_in_number_with_the_runs() -> None:
    few, many = (search.searches_of(Settings(runs=runs)) for runs in (1000, 5000))
    assert (len(few), len(many)) == (4, 20)
    assert len({search.seed for search in many}) == 20
    assert 1 not in {search.seed for search in many}  # the whole search has that one
    assert {(s.pso.particles, s.pso.iterations) for s in many} == {(10, 12)}
    assert len(search.searches_of(Settings(runs=4))) == 2


def test_cells_differ_in_what_is_asked_alone() -> None:
    hidden = hidden_threshold.cells(Settings())
    for robots in hidden_threshold.SIZES:
        pair = [hidden[robots, "random:0.52", "none", p].scenario for p in (0.7, 0.95)]
        assert set(differences(*pair)) == {"decision.credible_threshold"}
    timers = readings.cells_of_timers(Settings())
    always, frozen = (timers[name, "none"].scenario for name in (readings.ALWAYS, readings.FROZEN))
    assert differences(always, frozen) == {"sample.timer": "always"}
    shared = feedback.cells(Settings())
    for column in ("paper", "calibrated"):
        pair = [shared[column, 8, feedback.HERE, name].scenario for name in ("none", "positive")]
        assert set(differences(*pair)) == {"strategy.name"}
        assert pair[0].network.name == "ideal"  # all hear all, in `calibrated` too
    pool = experiment_accuracy.cells(Settings())
    like = pool[experiment_accuracy._key("paper", 9)].scenario
    assert differences(pool["pool", 9].scenario, like) == {"robot.speed_redraw": "robot"}


def test_the_timers_item_finds_what_it_was_given(tmp_path: Path) -> None:
    """Small, but whole: the timer that is always on samples nearer, by far more than chance."""
    made = reproduce(Settings(runs=RUNS, columns=("paper",)), tmp_path, [readings.TIMER])
    measured = made.made[0].tables[CLAIMS]
    near = measured.filter(pl.col("value") == "distance-timer-always-less-frozen").row(0, named=True)
    assert near["estimate"] < -0.02
    assert near["estimate"] < -10 * near["standard_error"]


def test_bands_are_over_all_thresholds_and_say_how_wide_they_are(tmp_path: Path) -> None:
    assert experiments.THRESHOLDS == (1.33, 1.40, 1.55)
    cells = experiments.cells(Settings(columns=("paper",)))
    found = {key[2:4] for key in cells if isinstance(key, tuple)}
    assert found == {(t, gate) for t in (1.33, 1.40, 1.55) for gate in ("total", "own")}
    table = pl.DataFrame(
        {
            "column": "paper", "packets": "with loss", "theta_E": [1.33, 1.40, 1.55], "gate": "own",
            "robots": 5, "strategy": "none", "decision_time_s": [700.0, 650.0, 450.0],
        }
    )  # fmt: skip
    band = experiments._bands(table).row(0, named=True)
    assert (band["least"], band["most"], band["width"], band["inside"]) == (450.0, 700.0, 250.0, True)


def test_nothing_is_divided_by_a_spread_of_zero(tmp_path: Path) -> None:
    """Where no message arrives nobody decides, and all runs are alike."""
    settings = Settings(runs=2, columns=("paper",), control="no-messages")
    made = reproduce(settings, tmp_path, [experiments.ITEM])
    assert made.made[0].tables["fit"]["in errors"].null_count() == 18


def test_a_run_without_samples_has_no_density_in_the_corners() -> None:
    x, y, run = np.array([0.1, 0.5, 0.1]), np.array([0.1, 0.5, 0.9]), np.array([0, 0, 2])
    density = side_claims._corners(x, y, run, 4)
    np.testing.assert_array_equal(density, [25 / 8, np.nan, 25 / 4, np.nan])


def test_the_command_below_the_example_run_makes_its_scenario() -> None:
    settings = Settings(runs=2, columns=("text", "paper"), control="threshold", seed=5)
    samples = pl.DataFrame({"x": [1.0]})
    (picture,) = example_run.pictures({"samples": samples}, settings)
    _, command, _ = picture.figure.draw("column").caption.split("`")
    run, values = parsed(shlex.split(command)[1:])
    arguments = bound(run.function(), vars(values)).arguments["scenario"]
    assert scenario_from(arguments).hash == example_run.example(settings).scenario.hash
    assert arguments.seed == 5
