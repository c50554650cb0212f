"""Cells summed up many at a time say what the figures of one cell say."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest

from vibroswarm.paper.cells import Cell, CellResult, run_cells
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import simulate
from vibroswarm.statistics.cell_summary import summary
from vibroswarm.statistics.figures import run_figures
from vibroswarm.statistics.sampling import walk_figures
from vibroswarm.study.batch import WALK

RUNS, ROBOTS = 24, 4
VALUES = {
    "floor.source": "random:0.48",
    "run.t_end_s": 400.0,
    "swarm.robots": ROBOTS,
    "decision.min_observations": 5,
}
WAYS = {"none": 0.48, "soft": 0.5, "positive": 0.5}
"""Strategies and boundaries; on the first, which is the fill ratio, no decision is right."""
CELLS = [
    Cell("paper", Scenario().with_values({**VALUES, "strategy.name": name, "decision.decision_boundary": at}))
    for name, at in WAYS.items()
]


@pytest.fixture(scope="module")
def results() -> list[Result]:
    return [simulate(cell.scenario, 3, RUNS) for cell in CELLS]


@pytest.fixture(scope="module")
def came(tmp_path_factory: pytest.TempPathFactory) -> list[CellResult]:
    found = run_cells(CELLS, RUNS, 3, tmp_path_factory.mktemp("cells"), 1, lambda share: None)
    return [found[cell] for cell in CELLS]


def test_rows_are_those_of_the_summary_whatever_their_order(
    came: list[CellResult], results: list[Result]
) -> None:
    for one, cell, result in zip(came, CELLS, results, strict=True):
        found = summary(result.robots, result.runs, cell.scenario.run.t_end_s).as_row()
        alike = [name for name in one.row if name in found]
        assert {name: one.row[name] for name in alike} == {name: found[name] for name in alike}
        assert len(alike) == 22
        belief = result.robots["belief_in_truth"].drop_nulls().to_numpy()
        bar = belief.std() / np.sqrt(RUNS) if belief.size else None
        assert one.row["belief_in_truth_bar"] == bar
        time_s = result.robots["decision_time_s"].fill_null(400.0).to_numpy()
        assert one.row["decision_time_s_bar"] == pytest.approx(time_s.std() / np.sqrt(RUNS))


def test_figures_are_those_of_each_run(came: list[CellResult], results: list[Result]) -> None:
    for one, cell, result in zip(came, CELLS, results, strict=True):
        table = run_figures(result.robots, result.runs, cell.scenario.run.t_end_s)
        walk = walk_figures(result.motion, result.observations, 25)
        for name, values in one.figures.items():
            if name != "estimate" and name in (walk if name in WALK else table):
                there = (walk if name in WALK else table)[name].cast(pl.Float64).to_numpy()
                np.testing.assert_array_equal(values, there)
        estimate = result.robots.group_by("run", maintain_order=True).agg(
            (pl.col("alpha") / (pl.col("alpha") + pl.col("beta"))).mean()
        )["alpha"]
        np.testing.assert_allclose(one.figures["estimate"], estimate.to_numpy(), rtol=1e-14)
