"""The examples of an estimator by averaging, and of a majority rule with many options: what they compute, by hand."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from vibroswarm import load_code, preset, simulate
from vibroswarm.analysis.figures import run_figures
from vibroswarm.strategies import base

EXAMPLES = Path(__file__).parents[2] / "examples"
PAPER = preset("paper").with_values({"run.t_end_s": 600.0, "task.name": "share"})


@pytest.fixture(autouse=True)
def loaded() -> Iterator[None]:
    for file, name in (("strategies/averaging.py", "averaging"), ("kinds/majority_rule.py", "rule")):
        lines = (EXAMPLES / file).read_text(encoding="utf-8").count("\n")
        assert lines <= 80
        load_code(f"{EXAMPLES / file}:{name}")
    yield
    for name in ("averaging", "rule"):
        base.forget(name)


def test_a_robot_alone_estimates_the_share_of_its_own_readings() -> None:
    alone = PAPER.with_values({"strategy.name": "averaging", "swarm.robots": 1})
    result = simulate(alone, 3, 4)
    for run in range(4):
        bits = result.observations.filter(pl.col("run") == run)["observation"].to_numpy()
        found = result.robots.filter(pl.col("run") == run)
        assert found["estimate"][0] == pytest.approx(bits.mean(), abs=1e-12)
        share = (bits.sum() + 1) / (bits.size + 2)
        assert found["estimate_spread"][0] == pytest.approx(np.sqrt(share * (1 - share) / bits.size))


def test_averaging_is_more_exact_than_one_robot_and_than_not_listening() -> None:
    def error(**more: float) -> float:
        result = simulate(PAPER.with_values({"strategy.name": "averaging", **more}), 3, 200)
        return float(run_figures(result.robots, result.runs, 600.0)["estimate_error"].mean())  # type: ignore[arg-type]

    together, deaf = error(), error(**{"strategy.averaging.weight": 0.0})
    counting = simulate(PAPER, 3, 200)
    pooled = run_figures(counting.robots, counting.runs, 600.0)["estimate_error"].mean()
    assert together < 0.75 * deaf  # a control: robots that do not listen
    assert together < 1.35 * pooled  # those that count all bits of all robots


def test_the_majority_rule_takes_each_kind_that_most_read() -> None:
    three = preset("paper").with_values(
        {"sensor.model": "confusion", "task.name": "majority", "strategy.name": "rule", "run.t_end_s": 600.0}
    )
    for kind, shares in enumerate(("0.8,0.12,0.08", "0.08,0.8,0.12", "0.12,0.08,0.8")):
        result = simulate(three.with_values({"floor.source": f"random:{shares}"}), 1, 20)
        assert (result.robots["decision"] == kind).mean() > 0.8
        assert result.reports is not None
        assert set(result.reports["value"].unique()) <= {0.0, 1.0, 2.0}
