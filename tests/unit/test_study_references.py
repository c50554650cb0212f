"""References beside cells: of cells that differ in their end, and what is said where they are no bound."""

from __future__ import annotations

from vibroswarm.scenario.scenario import preset
from vibroswarm.study.baselines import References, references_of
from vibroswarm.study.spec import Study

SHORT = preset("paper").with_values({"run.t_end_s": 60.0})
RUNS = 20


def found(grid: dict[str, list[object]]) -> list[References]:
    return references_of(Study(SHORT, {"grid": grid}, RUNS).run())


def test_cells_that_differ_in_their_end() -> None:
    ends = found({"run.t_end_s": [20.0, 60.0], "strategy.name": ["none", "soft"]})
    assert [one.cell.scenario.run.t_end_s for one in ends] == [20.0, 20.0, 60.0, 60.0]
    assert all(one.known is not None for one in ends)
    assert [one.known.time_s.estimate <= one.cell.scenario.run.t_end_s for one in ends if one.known] == [
        True
    ] * 4


def test_runs_that_stop_early_are_not_replayed() -> None:
    soon = {"run.stop": ["all_decided"], "decision.min_observations": [5], "strategy.soft.eta": [1e3, 2e3]}
    assert [one.pooled for one in found(soon)] == [None, None]


def test_what_is_said_where_it_is_no_bound() -> None:
    drawn, fixed, neither = found({"floor.source": ["random:0.48", "stripe:0.48", "random:0.52"]})
    assert drawn.says == neither.says == ()
    assert drawn.known is not None
    truths = drawn.known.runs["truth"].to_list()
    assert truths[0] == 0  # every second run is on the other side
    assert truths[1] == 1
    assert fixed.known is not None
    assert fixed.known.runs["truth"].unique().to_list() == [0]
    assert "is no bound here" in fixed.says[0]


def test_what_is_said_where_there_is_none() -> None:
    on_boundary = found({"floor.source": ["random:0.48"], "decision.decision_boundary": [0.48]})[0]
    assert (on_boundary.known, on_boundary.as_row().get("known_time_s")) == (None, None)
    assert "is on the boundary" in on_boundary.says[0]
    cut = found({"floor.tile_width_m": [0.22]})[0]
    assert cut.known is None
    assert "cuts some of the tiles" in cut.says[0]


def test_no_reference_where_a_reading_depends_on_more_than_the_tile_below() -> None:
    edges, tiles = found({"sensor.edge_blur_m": [0.01]}) + found({"sensor.tile_spread": [0.2]})
    for reference in (edges, tiles):
        assert reference.known is None
        assert reference.pooled is not None
        assert "does not depend on the tile below alone" in reference.says[0]


def test_cells_that_steer_alike_have_references() -> None:
    """A parameter of a strategy that is not used makes cells of one group, whose scenarios have the same effect."""
    base = SHORT.with_values({"localisation.method": "mixture", "swarm.robots": 2})
    grid = {"strategy.name": ["explore"], "strategy.soft.eta": [1000.0, 2000.0]}
    ends = references_of(Study(base, {"grid": grid}, RUNS).run())
    assert len(ends) == 2
    assert ends[0].as_row().get("packet_loss") == ends[1].as_row().get("packet_loss")
