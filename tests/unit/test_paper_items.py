"""All items: what they measure fits the claims, and their pictures can be drawn."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

from vibroswarm.analysis.sampling import walk_figures
from vibroswarm.documents.reproduction import reproduction_document
from vibroswarm.networks.loss_by_size import share_lost
from vibroswarm.observation.energy_model import error_rates
from vibroswarm.paper.cells import READ, Cell, CellResult, CellResults, summarise
from vibroswarm.paper.claims import all_claims, decide
from vibroswarm.paper.columns import COLUMNS, parameters, published, scenario_of
from vibroswarm.paper.item import CLAIMS, Settings, Tables, Work
from vibroswarm.paper.items import all_items, experiments, items_named, search
from vibroswarm.paper.reproduce import ItemResult, Reproduction
from vibroswarm.scenario.scenario import preset
from vibroswarm.show.document import Section
from vibroswarm.simulation import simulate
from vibroswarm.study.batch_table import arrays_of

RUNS = 4
SETTINGS = Settings(runs=RUNS)


@pytest.fixture(scope="module")
def template() -> CellResult:
    """What came of one real cell."""
    cell = SETTINGS.cell("paper", {"run.t_end_s": 300.0})
    result = simulate(cell.scenario, 1, RUNS)
    runs = result.runs.join(walk_figures(result.motion, result.observations, 25).drop("samples"), on="run")
    rows = result.robots.join(runs, on="run").with_columns(cell=0).select(READ)
    (results,) = summarise([cell], *arrays_of(rows, [0], RUNS, cell.scenario.swarm.robots))
    return results


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


RECORDED = ("calibration", "unseen-session")
"""Items that need recordings."""


def test_two_items_alone_are_skipped_without_recordings(tables: dict[str, Tables]) -> None:
    assert {item.name for item in all_items()} - set(tables) == set(RECORDED)
    for item in items_named(list(RECORDED)):
        assert "recordings" in str(item.skipped(SETTINGS))
        assert "lacks CAL_1.csv" in str(item.skipped(Settings(recordings=Path("no such folder"))))


def test_the_tables_that_are_shown_are_there_with_their_columns(tables: dict[str, Tables]) -> None:
    for item in all_items():
        for shown in item.shown if item.name in tables else ():
            there = set(tables[item.name][shown.table].columns)
            missing = set(shown.columns) - there - {"printed_s"}
            assert not missing, (item.name, shown.table)


@pytest.mark.parametrize("name", [item.name for item in all_items() if item.name not in RECORDED])
def test_pictures_have_names_of_their_own_and_can_be_drawn(name: str, tables: dict[str, Tables]) -> None:
    item = next(item for item in all_items() if item.name == name)
    pictures = list(item.pictures(tables[name], SETTINGS))
    names = [picture.figure.name for picture in pictures]
    assert len(set(names)) == len(names)
    assert bool(names) == (name != "difficulty")
    if pictures:
        drawn = pictures[-1].figure.draw("column")
        assert drawn.numbers.height > 0
        assert drawn.svg().startswith("<?xml")


@pytest.mark.parametrize(("name", "table"), [("sharing", "costs"), ("experiments-beside", "distance")])
def test_the_page_leaves_out_tables_of_a_preset_that_was_not_requested(
    name: str, table: str, template: CellResult, tmp_path: Path
) -> None:
    settings = replace(SETTINGS, columns=("calibrated",))
    item = next(item for item in all_items() if item.name == name)
    cells = item.cells(settings)
    made = item.compute(Work(settings, cells, _made_up(list(cells.values()), template), tmp_path))
    assert table not in made
    reproduction = Reproduction(settings, (ItemResult(item, made),), cells={}, results=None)
    document = reproduction_document(reproduction)
    (caption,) = (view.caption for view in item.shown if view.table == table)
    assert any(item.title in part.title for part in document.parts if isinstance(part, Section))
    assert not any(shown.caption.startswith(caption) for shown in document.tables.values())


def test_the_search_is_the_papers(tables: dict[str, Tables]) -> None:
    whole = search.search_of(Settings(runs=1000))
    assert whole.budget == 15_000
    assert whole.final_runs == 0
    assert (whole.pso.particles, whole.pso.iterations) == (25, 50)
    assert search.search_of(Settings(runs=10_000)).budget == 15_000
    truth = tables["search"]["truth"]
    assert truth["parameters"].to_list() == ["winner", "P0", "P*", "optimised-cost"]
    assert truth["min_observations"].to_list()[1:3] == [320, 381]
    assert tables["search"]["history"].height == 2


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


def test_cells_of_all_items_are_few_enough_and_share_motion(cells: dict[str, dict[Any, Cell]]) -> None:
    from vibroswarm.paper.cells import study_of
    from vibroswarm.study.plan import plan_of

    first = {c.key: c for own in cells.values() for c in own.values() if c.block == 0 and c.motion == "event"}
    study = study_of(first, (1, "event", RUNS))
    assert study.command == "reproduce"  # which `show` names in its folder: evaluate would compare its cells
    groups = plan_of(study).groups
    assert len(first) > 500
    assert len(groups) < 50
    largest = max(groups, key=lambda group: len(group.cells))
    assert len(largest.cells) > 80
    assert {cell.column for cell in first.values()} == set(COLUMNS)


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


def test_controls_and_empirical_parameters_have_the_numbers_that_they_name() -> None:
    assert error_rates(scenario_of("paper", control="false-positives").sensor) == pytest.approx((0.24, 0.045))
    slow, paper = scenario_of("paper", control="standstill"), preset("paper")
    assert slow.robot.full_speed_m_s == pytest.approx(paper.robot.full_speed_m_s / 20)
    empirical = scenario_of("paper", parameter_set="P0")
    assert {name: empirical[name] for name in parameters("P0")} == parameters("P0")


OF_SHORT_SEARCHES = (
    "late-change-of-parameter",
    "believed-score-over-fresh",
    "gap-of-bests-left",
    "change-of-mean-cost",
)


def test_a_search_that_is_long_enough_gets_a_verdict() -> None:
    table = pl.DataFrame({"gap_left": [0.2, 0.3], "cost_change": [-0.1, -0.2]})
    for iterations, asked in ((6, True), (5, False)):
        rows = list(search._measured_repeats(table, iterations))
        assert [row["cannot"] is None for row in rows] == [asked, asked]


def test_what_cannot_be_asked_is_found_in_every_item(tables: dict[str, Tables]) -> None:
    """In `text` what is decided on floors of 0.52 and 0.56, in `calibrated` patterns of small tiles; else none but
    what so short searches cannot say."""
    measured = pl.concat([made[CLAIMS] for made in tables.values()])
    of_short = measured.filter(pl.col("value").is_in(OF_SHORT_SEARCHES))
    assert of_short.height >= len(OF_SHORT_SEARCHES)
    assert of_short["cannot"].str.contains("fewer than").all()
    measured = measured.filter(~pl.col("value").is_in(OF_SHORT_SEARCHES))
    there = pl.col("cannot").is_not_null()
    assert measured.filter(there & (pl.col("column") == "paper")).is_empty()
    text = measured.filter(pl.col("column") == "text")
    far = pl.col("cell").str.contains(r"0\.5[26]")
    assert text.filter(far).height >= 20
    assert text.filter(far & ~there).is_empty()
    assert text.filter(there & ~far).is_empty()
    patterns = {claim.value for claim in all_claims() if claim.item == "patterns"}
    calibrated = measured.filter(pl.col("column") == "calibrated")
    assert set(calibrated.filter(there)["value"]) == patterns
    assert calibrated.filter(pl.col("value").is_in(patterns) & ~there).is_empty()
