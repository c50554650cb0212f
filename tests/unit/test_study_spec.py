"""A study: checked, named, hashed, TOML in and out."""

from __future__ import annotations

import tomllib
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from vibroswarm.scenario.scenario import preset
from vibroswarm.study.precision import Precision
from vibroswarm.study.spec import Study

GRID = {"floor.source": ["random:0.44", "diagonal:0.46"], "strategy.name": ["none", "soft"]}


def test_cells_are_scenarios_with_names():
    study = Study({"preset": "paper", "swarm": {"robots": 8}}, {"grid": GRID}, runs=3)
    assert [cell.number for cell in study.cells] == [0, 1, 2, 3]
    assert study.cells[3].name == "diagonal:0.46, soft"
    assert study.cells[3].scenario == preset("paper").with_values(
        {"swarm.robots": 8, "floor.source": "diagonal:0.46", "floor.tiles": None, "strategy.name": "soft"}
    )
    assert study.varied == ["floor.source", "strategy.name"]


def test_the_hash_is_of_what_changes_a_run():
    study = Study(vary={"grid": GRID}, runs=10)
    same = [Study(vary={"grid": GRID}, runs=20), Study(vary={"grid": GRID}, runs=None, until=Precision(0.02)),
            Study(vary={"grid": GRID}, name="mine")]  # fmt: skip
    assert {one.hash for one in same} == {study.hash}
    other = [
        Study(vary={"grid": GRID}, seed=2),
        Study(vary={"grid": GRID}, motion="fixed-step"),
        Study(vary={"grid": {**GRID, "strategy.name": ["soft", "none"]}}),
        Study({"swarm": {"robots": 6}}, {"grid": GRID}),
    ]
    assert len({study.hash, *(one.hash for one in other)}) == 5


FIELDS: dict[str, st.SearchStrategy[Any]] = {
    "swarm.robots": st.integers(1, 20),
    "strategy.name": st.sampled_from(["none", "positive", "soft"]),
    "strategy.soft.eta": st.floats(0.5, 10.0),
    "floor.source": st.sampled_from(["random:0.44", "diagonal:0.46", "mine", "yours"]),
    "decision.gate": st.sampled_from(["total", "own"]),
    "preset": st.sampled_from(["paper", "text"]),
}


@st.composite
def studies(draw: st.DrawFn) -> Study:
    fields = draw(st.lists(st.sampled_from(sorted(FIELDS)), min_size=1, max_size=3, unique=True))
    cut = draw(st.integers(0, len(fields)))
    blocks: dict[str, Any] = {}
    names = draw(st.permutations(["grid", "list"]))
    for name, part in zip(names, (fields[:cut], fields[cut:]), strict=False):
        if not part:
            continue
        if name == "list":
            entry = st.fixed_dictionaries({field: FIELDS[field] for field in part})
            blocks[name] = draw(st.lists(entry, min_size=1, max_size=3))
        else:
            size = draw(st.integers(1, 3))
            values = {f: draw(st.lists(FIELDS[f], min_size=size, max_size=size)) for f in part}
            if name == "grid" and draw(st.booleans()):  # a range among lists, and tables within tables
                values = {"decision": {"credible_threshold": {"from": 0.8, "to": 0.9, "steps": 2}}} | values
            blocks[name] = values
    until = draw(st.none() | st.builds(Precision, st.floats(0.001, 0.5)))
    base: dict[str, Any] = {} if "preset" in fields else {"preset": draw(FIELDS["preset"])}
    return Study(
        base | {"run": {"t_end_s": draw(st.sampled_from([60.0, 60.5, 1200.0]))}},
        blocks,
        None if until else draw(st.integers(1, 10**6)),
        until,
        seed=draw(st.integers(0, 2**63 - 1)),
        floors={"mine": ("01", "10"), "yours": ("111", "000")},
        name=draw(st.text(st.characters(exclude_categories=["Cs"]), max_size=8)),
    )


@given(studies())
@settings(max_examples=40, deadline=None)
def test_toml_there_and_back(study):
    text = study.to_toml()
    back = Study.from_values(tomllib.loads(text))
    assert [c.point for c in back.cells] == [c.point for c in study.cells]
    assert [c.scenario for c in back.cells] == [c.scenario for c in study.cells]
    assert (back.hash, back.runs, back.seed) == (study.hash, study.runs, study.seed)
    assert (back.name, back.motion) == (study.name, study.motion)
    assert back.to_toml() == text
