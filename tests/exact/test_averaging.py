"""Averaging over neighbours, and the example of a majority rule with many options: what they compute, by hand."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

from vibroswarm import load_code, preset, simulate
from vibroswarm.statistics.figures import run_figures
from vibroswarm.strategies import base

EXAMPLES = Path(__file__).parents[2] / "examples"
PAPER = preset("paper").with_values({"run.t_end_s": 600.0, "task.name": "share"})
THREE: dict[str, Any] = {"sensor.model": "confusion", "floor.source": "random:0.4,0.36,0.24"}
MAJORITY: dict[str, Any] = {**THREE, "floor.source": "random:0.24,0.2,0.56", "task.name": "majority"}


@pytest.fixture(autouse=True)
def loaded() -> Iterator[None]:
    file = EXAMPLES / "kinds/majority_rule.py"
    assert file.read_text(encoding="utf-8").count("\n") <= 80
    load_code(f"{file}:rule")
    yield
    base.forget("rule")


def test_a_robot_alone_estimates_the_share_of_its_own_readings() -> None:
    for more, kinds in (({}, 2), ({**THREE, "task.share.kind": 2}, 3)):
        alone = PAPER.with_values({"strategy.name": "averaging", "swarm.robots": 1, **more})
        result = simulate(alone, 3, 4)
        for run in range(4):
            classes = result.observations.filter(pl.col("run") == run)["observation"].to_numpy()
            found = result.robots.filter(pl.col("run") == run)
            share = ((classes == kinds - 1).sum() + 1) / (classes.size + kinds)
            assert found["estimate"][0] == pytest.approx(share, abs=1e-12)
            spread = np.sqrt(share * (1 - share) / (classes.size + 1))
            assert found["estimate_spread"][0] == pytest.approx(spread, rel=1e-9)


@pytest.mark.parametrize("more", [{}, {**THREE, "task.share.kind": 0}], ids=["two kinds", "three kinds"])
def test_averaging_is_more_exact_than_one_robot_and_than_not_listening(more: dict[str, Any]) -> None:
    def error(name: str = "averaging", **fields: float) -> float:
        result = simulate(PAPER.with_values({**more, "strategy.name": name, **fields}), 3, 150)
        return float(run_figures(result.robots, result.runs, 600.0)["estimate_error"].mean())  # type: ignore[arg-type]

    together, deaf = error(), error(**{"strategy.averaging.weight": 0.0})
    assert together < 0.7 * deaf  # a control: robots that do not listen
    assert together < 1.25 * error(
        "dirichlet" if more else "none"
    )  # those that count all readings of all robots


def test_averaging_decides_as_those_that_count() -> None:
    for more, least in (({"floor.source": "random:0.4", "task.name": "fill_ratio"}, 0.8), (MAJORITY, 0.9)):
        result = simulate(PAPER.with_values({"strategy.name": "averaging", **more}), 3, 100)
        assert result.runs["right"].sum() > least * 5 * 100
        assert result.runs["right"].sum() > 10 * result.runs["wrong"].sum()
        # The first to decide do so at their 20th reading, the least by default; samples count from 0.
        assert result.inference.filter(pl.col("decision") >= 0)["sample"].min() == 19


def test_the_majority_rule_takes_each_kind_that_most_read() -> None:
    three = preset("paper").with_values(
        {
            "sensor.model": "confusion",
            "task.name": "majority",
            "strategy.name": "rule",
            "run.t_end_s": 600.0,
            "floor.source": "random:0.8,0.12,0.08",
        }
    )
    for kind, shares in enumerate(("0.8,0.12,0.08", "0.08,0.8,0.12", "0.12,0.08,0.8")):
        result = simulate(three.with_values({"floor.source": f"random:{shares}"}), 1, 20)
        assert (result.robots["decision"] == kind).mean() > 0.8
        assert result.reports is not None
        assert set(result.reports["value"].unique()) <= {0.0, 1.0, 2.0}
