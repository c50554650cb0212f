"""All items: what they measure fits the claims, and their pictures can be drawn."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import polars as pl
import pytest

from vibroswarm.networks.loss_by_size import share_lost
from vibroswarm.paper.cells import Cell, CellResult, CellResults, run_cells
from vibroswarm.paper.claims import all_claims, decide
from vibroswarm.paper.columns import published, scenario_of
from vibroswarm.paper.item import CLAIMS, Settings, Tables, Work
from vibroswarm.paper.items import all_items, experiments
from vibroswarm.scenario.scenario import preset

RUNS = 4
SETTINGS = Settings(runs=RUNS)


@pytest.fixture(scope="module")
def template(tmp_path_factory: pytest.TempPathFactory) -> CellResult:
    """What came of one real cell."""
    cell = SETTINGS.cell("paper", {"run.t_end_s": 300.0})
    return run_cells([cell], RUNS, 1, tmp_path_factory.mktemp("cells"), 1, lambda share: None)[cell]


def _made_up(cells: list[Cell], template: CellResult) -> CellResults:
    """Cells whose figures were shaken at random: no simulation, and no two alike."""
    random, found = np.random.default_rng(3), {}
    shaken = (
        "decision_time_s",
        "belief_in_truth",
        "wrong_share",
        "avoid_per_sample_s",
        "distance_m",
        "estimate",
    )
    for cell in cells:
        factor = random.uniform(0.9, 1.1, (len(shaken), RUNS))
        other = {name: template.figures[name] * f for name, f in zip(shaken, factor, strict=True)}
        other |= {name: np.minimum(other[name], 1.0) for name in ("belief_in_truth", "wrong_share")}
        found[cell.key] = replace(template, figures={**template.figures, **other})
    return CellResults(SETTINGS.seed, RUNS, found)


@pytest.fixture(scope="module")
def cells() -> dict[str, dict[Any, Cell]]:
    """The cells of each item."""
    return {item.name: item.cells(SETTINGS) for item in all_items()}


@pytest.fixture(scope="module")
def tables(
    cells: dict[str, dict[Any, Cell]], template: CellResult, tmp_path_factory: pytest.TempPathFactory
) -> dict[str, Tables]:
    """The tables of all items but those that need recordings."""
    folder = tmp_path_factory.mktemp("work")
    found = {}
    for item in all_items():
        if item.skipped(SETTINGS):
            continue
        own = cells[item.name]
        results = _made_up(list(own.values()), template)
        found[item.name] = item.compute(Work(SETTINGS, own, results, folder / item.name))
    return found


def test_every_claim_is_measured_in_every_column_it_is_asked_in(tables: dict[str, Tables]) -> None:
    measured = pl.concat([made[CLAIMS] for made in tables.values()])
    decided = decide(measured)  # raises where a claim has other values than it asks for
    found = {(one.claim.id, one.column) for one in decided}
    asked = {(c.id, column) for c in all_claims() if c.item in tables for column in c.columns}
    assert found == asked
    assert set(measured["value"]) == {claim.value for claim in all_claims() if claim.item in tables}
    assert measured.height == sum(c.cells * len(c.columns) for c in all_claims() if c.item in tables)


def test_losses_are_of_messages_addressed_to_a_robot() -> None:
    plotted = published("experiments.packet_loss_percent")
    assert experiments.loss_of(5) == pytest.approx(plotted[0] / 100 * 5 / 4)
    assert experiments.loss_of(10) == pytest.approx(0.0901, abs=1e-4)


def test_loss_changes_nothing_but_the_network() -> None:
    cells = experiments.cells(Settings(columns=("paper",)))
    with_loss = cells["paper", "with loss", 1.55, "own", 8, "none"].scenario
    without = cells["paper", "without loss", 1.55, "own", 8, "none"].scenario
    assert with_loss.with_values({"network.name": "loss", "network.loss.share": 0.0}) == without
    assert with_loss.decision.min_observations == 76
    assert with_loss.floor.tiles is not None


def test_larger_swarms_of_calibrated_robots_lose_messages_by_size() -> None:
    five, ten = (scenario_of("calibrated", {"swarm.robots": robots}) for robots in (5, 10))
    assert (five.network.name, ten.network.name) == ("loss", "loss_by_size")
    assert ten == preset("calibrated-swarm")
    own = scenario_of("calibrated", {"swarm.robots": 10, "network.name": "loss", "network.loss.share": 0.5})
    assert own.network.name == "loss"
    assert scenario_of("paper", {"swarm.robots": 10}).network.name == preset("paper").network.name
    # The preset's share is that of the messages addressed to a robot which were lost, as plotted.
    for robots in range(6, 11):
        assert share_lost(robots) == pytest.approx(experiments.loss_of(robots), abs=0.0045)
