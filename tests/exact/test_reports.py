"""What robots report: estimates against recomputation, their scores against theory and numerical integration."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from vibroswarm import Result, preset, simulate
from vibroswarm.analysis.figures import BY_NAME, Swarms
from vibroswarm.errors import InputError
from vibroswarm.observation.energy_model import error_rates
from vibroswarm.strategies import Strategy, strategy

PAPER = preset("paper").with_values({"run.t_end_s": 300.0})
RUNS, ROBOTS = 4000, 5


def swarms(estimate: np.ndarray, spread: np.ndarray, truth: np.ndarray) -> Swarms:
    """Runs whose robots report these estimates, (runs, robots)."""
    robots = {"estimate": estimate, "estimate_spread": spread, "decision": np.zeros(estimate.shape)}
    return Swarms.of_arrays(robots, {"fill_ratio": truth}, 1200.0)


def test_an_estimator_that_is_right_by_construction_scores_as_theory_says() -> None:
    generator = np.random.default_rng(3)
    truth = generator.random(RUNS)
    spread = generator.uniform(0.02, 0.1, (RUNS, ROBOTS))
    estimate = truth[:, None] + spread * generator.standard_normal((RUNS, ROBOTS))
    right = swarms(estimate, spread, truth)
    found = {name: BY_NAME[name].of_run(right).mean() for name in BY_NAME if name.startswith("estimate_")}
    assert found["estimate_coverage"] == pytest.approx(0.9, abs=4 * 0.3 / math.sqrt(RUNS * ROBOTS))
    assert found["estimate_error"] == pytest.approx(spread.mean() * math.sqrt(2 / math.pi), rel=0.02)
    assert found["estimate_crps"] == pytest.approx(spread.mean() / math.sqrt(math.pi), rel=0.02)
    # Controls: robots that are too sure cover less and score worse, as do those that are not sure enough.
    for factor, covers in ((0.5, 0.589), (2.0, 0.999)):
        wrong = swarms(estimate, factor * spread, truth)
        assert BY_NAME["estimate_coverage"].of_run(wrong).mean() == pytest.approx(covers, abs=0.02)
        assert BY_NAME["estimate_crps"].of_run(wrong).mean() > 1.05 * found["estimate_crps"]


@pytest.mark.parametrize(
    ("estimate", "spread", "truth"), [(0.4, 0.1, 0.55), (0.5, 0.02, 0.5), (0.9, 0.3, 0.1)]
)
def test_crps_is_the_integral_of_squared_differences(estimate: float, spread: float, truth: float) -> None:
    from scipy.stats import norm

    x = np.linspace(estimate - 12 * spread, estimate + 12 * spread, 2_000_001)
    integral = np.trapezoid((norm.cdf(x, estimate, spread) - (x >= truth)) ** 2, x)
    one = swarms(np.array([[estimate]]), np.array([[spread]]), np.array([truth]))
    assert BY_NAME["estimate_crps"].of_run(one)[0] == pytest.approx(integral, abs=1e-6)


def test_a_robot_that_claims_certainty_is_scored_by_its_error() -> None:
    certain = swarms(np.array([[0.7]]), np.array([[0.0]]), np.array([0.5]))
    assert BY_NAME["estimate_crps"].of_run(certain)[0] == pytest.approx(0.2)
    nothing = swarms(np.array([[math.nan]]), np.array([[math.nan]]), np.array([0.5]))
    assert all(
        np.isnan(BY_NAME[f"estimate_{name}"].of_run(nothing)[0]) for name in ("error", "coverage", "crps")
    )


def test_mcp_alone_reports_its_estimate_after_each_reading() -> None:
    alone = PAPER.with_values({"strategy.name": "mcp", "swarm.robots": 1, "decision.boundary_of": "tiles"})
    result = simulate(alone, seed=2, runs=2)
    false_positive, false_negative = error_rates(alone.sensor)
    assert result.reports is not None
    for run in (0, 1):
        read = result.observations.filter(pl.col("run") == run)["observation"].to_numpy()
        share = np.cumsum(read) / np.arange(1, read.size + 1)
        expected = np.clip((share - false_positive) / (1 - false_positive - false_negative), 0.0, 1.0)
        reported = result.reports.filter((pl.col("run") == run) & (pl.col("name") == "estimate"))
        np.testing.assert_allclose(reported["value"].to_numpy(), expected, atol=1e-9)
        at_end = result.robots.filter(pl.col("run") == run)["estimate"][0]
        assert at_end == reported["value"][-1]


def test_estimates_of_counts_are_moments_of_the_posterior() -> None:
    from scipy.stats import beta

    robots = simulate(PAPER, seed=1, runs=1).robots
    posterior = beta(robots["alpha"].to_numpy(), robots["beta"].to_numpy())
    np.testing.assert_allclose(robots["estimate"].to_numpy(), posterior.mean(), rtol=1e-14)
    np.testing.assert_allclose(robots["estimate_spread"].to_numpy(), posterior.std(), rtol=1e-12)


def test_arrays_are_reported_at_the_end_and_results_keep_reports(tmp_path: Path) -> None:
    result = simulate(PAPER.with_values({"strategy.name": "dirichlet"}), seed=1, runs=2)
    assert result.reports is not None
    counts = result.reports.filter(pl.col("name") == "counts")
    assert counts.height == 2 * 5 * 2
    heard = result.robots["samples"] + result.robots["messages_received"] + 2  # and the prior
    totals = counts.group_by("run", "robot", maintain_order=True).agg(pl.col("value").sum())["value"]
    assert totals.cast(pl.Int64).to_list() == heard.to_list()
    result.write(tmp_path / "kept")
    assert Result.read(tmp_path / "kept") == result
    assert simulate(PAPER, seed=1, runs=1).reports is None


def test_a_report_that_is_nowhere_declared_is_refused() -> None:
    given = strategy("mcp")
    parts = {
        name: getattr(given, name)
        for name in ("state", "begin", "on_sample", "decision", "arrays", "message")
    }
    with pytest.raises(
        InputError, match="'estimat' is neither a field of State nor an array, did you mean 'estimate'"
    ):
        Strategy(name="other", on_message=given.on_message, reports=("estimat",), **parts).check_hooks()
