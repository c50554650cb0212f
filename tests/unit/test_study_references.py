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
