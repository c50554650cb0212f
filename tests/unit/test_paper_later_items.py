"""Items that were asked later: what they measure, against brute force and made-up truths."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from vibroswarm.paper.items import (
    experiment_accuracy,
    feedback,
)


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
