"""What robots report: estimates against recomputation, their scores against theory and numerical integration."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import polars as pl
import pytest

from vibroswarm import Scenario, preset, simulate
from vibroswarm.observation.energy_model import error_rates
from vibroswarm.plots.reports import draw_run_reports
from vibroswarm.statistics.figures import BY_NAME, Swarms
from vibroswarm.statistics.over_time import reports_over_time
from vibroswarm.strategies import Report, Strategy, array, register
from vibroswarm.strategies.base import forget

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


class Counted:
    """Own readings, their share of ones, messages, and how often each other robot agreed with the last reading."""

    ones: int
    heard: int
    seen: int
    share: float
    agreed = array("int64", 3)
    last: int
    decision: int


def begin(s: Any, a: Any, d: Any, p: Any, w: Any) -> None:
    s.decision, s.share = -1, math.nan


def on_message(s: Any, a: Any, m: Any, sender: int, t_s: float, d: Any, p: Any, w: Any) -> None:
    s.heard += 1
    if sender < 3:
        s.agreed[sender] += m.bit == s.last


def on_sample(s: Any, a: Any, x: Any, out: Any, d: Any, p: Any, w: Any) -> bool:
    s.ones, s.seen, s.last = s.ones + x.reading, s.seen + 1, x.reading
    s.share = s.ones / s.seen
    if s.decision == -1 and s.seen >= 8:
        s.decision = int(s.share > 0.5)
    out.bit = x.reading
    return True


def decision(s: Any, a: Any, p: Any, w: Any) -> int:
    kept: int = s.decision
    return kept


@pytest.fixture(scope="module")
def counted() -> Iterator[Scenario]:
    """Robots that report an estimate by another name, in percent of tiles, and an array of their state."""
    register(
        Strategy(
            name="counted", state=Counted, begin=begin, on_message=on_message, on_sample=on_sample, decision=decision,
            reports=("agreed", "heard", Report("share", "of tiles", estimates=True)),
        )
    )  # fmt: skip
    yield PAPER.with_values({"strategy.name": "counted", "run.t_end_s": 80.0, "swarm.robots": 3})
    forget("counted")


def test_an_array_of_the_state_is_reported_after_each_sample(counted: Scenario) -> None:
    result = simulate(counted, seed=4, runs=1)
    assert result.reports is not None
    agreed = result.reports.filter(pl.col("name") == "agreed")
    assert agreed.height == 3 * result.motion.height
    assert agreed["index"].unique().to_list() == [0, 1, 2]
    # A robot never hears itself, and counts only rise.
    assert (agreed.filter(pl.col("robot") == pl.col("index"))["value"] == 0).all()
    rises = agreed.select(pl.col("value").diff().over("robot", "index").min()).item()
    assert rises >= 0
    assert agreed["value"].max() > 3
    drawn = reports_over_time(result)
    assert drawn["name"].unique().sort().to_list() == ["agreed 0", "agreed 1", "agreed 2", "heard", "share"]
    picture = draw_run_reports(result)
    assert [axes.get_title() for axes in picture.figure.axes if axes.get_title()][-1] == "share (of tiles)"
    assert "dashed: the true number, 0.48" in picture.caption
