"""A study: checked, named, hashed, TOML in and out."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vibroswarm.errors import InputError
from vibroswarm.scenario.scenario import preset
from vibroswarm.study.precision import Precision
from vibroswarm.study.spec import Study
from vibroswarm.study.words import study_of

GRID = {"floor.source": ["random:0.44", "diagonal:0.46"], "strategy.name": ["none", "soft"]}


def test_cells_are_scenarios_with_names():
    study = Study({"preset": "paper", "swarm": {"robots": 8}}, {"grid": GRID}, runs=3)
    assert [cell.number for cell in study.cells] == [0, 1, 2, 3]
    assert study.cells[3].name == "diagonal:0.46, soft"
    assert study.cells[3].scenario == preset("paper").with_values(
        {"swarm.robots": 8, "floor.source": "diagonal:0.46", "floor.tiles": None, "strategy.name": "soft"}
    )
    assert study.varied == ["floor.source", "strategy.name"]


def test_of_takes_a_scenario_and_fields_with_underscores():
    study = Study.of(preset("text"), 7, 3, swarm__robots=np.arange(5, 8), strategy__name=["none", "soft"])
    assert (study.runs, study.seed, len(study.cells)) == (7, 3, 6)
    assert study.cells[0].scenario == preset("text").with_values({"swarm.robots": 5, "strategy.name": "none"})
    assert type(study.cells[0].point["swarm.robots"]) is int
    assert Study.from_toml(study.to_toml()).hash == study.hash
    assert Study(preset("text"), runs=7).cells[0].scenario == preset("text")


def test_the_hash_is_of_what_changes_a_run():
    study = Study(vary={"grid": GRID}, runs=10)
    same = [Study(vary={"grid": GRID}, runs=20), Study(vary={"grid": GRID}, runs=None, until=Precision(0.02)),
            Study(vary={"grid": GRID}, name="mine")]  # fmt: skip
    assert {one.hash for one in same} == {study.hash}
    other = [
        Study(vary={"grid": GRID}, seed=2),
        Study(vary={"grid": GRID}, motion="fixed-step"),
        Study(vary={"grid": GRID}, keep=("samples",)),
        Study(vary={"grid": {**GRID, "strategy.name": ["soft", "none"]}}),
        Study({"swarm": {"robots": 6}}, {"grid": GRID}),
    ]
    assert len({study.hash, *(one.hash for one in other)}) == 6


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
    names = draw(st.permutations(["grid", "list", "zip"]))
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
    if draw(st.booleans()):
        kind = draw(st.sampled_from(["random", "sobol"]))
        ranges = {"arena.width_m": {"from": 1, "to": 2, "scale": "log"}, "run.stop": ["t_end", "all_decided"]}
        blocks = {kind: {"points": draw(st.integers(1, 3)), "seed": 5, **ranges}} | blocks
    levels = st.just(0.95) | st.floats(0.5, 0.999)
    until = draw(st.none() | st.builds(Precision, st.floats(0.001, 0.5), level=levels))
    base: dict[str, Any] = {} if "preset" in fields else {"preset": draw(FIELDS["preset"])}
    return Study(
        base | {"run": {"t_end_s": draw(st.sampled_from([60.0, 60.5, 1200.0]))}},
        blocks,
        None if until else draw(st.integers(1, 10**6)),
        until,
        seed=draw(st.integers(0, 2**63 - 1)),
        keep=draw(st.sampled_from([(), ("samples",)])),
        floors={"mine": ("01", "10"), "yours": ("111", "000")},
        name=draw(st.text(st.characters(exclude_categories=["Cs"]), max_size=8)),
    )


@given(studies())
@settings(max_examples=40, deadline=None)
def test_toml_there_and_back(study):
    text = study.to_toml()
    back = Study.from_toml(text)
    assert [c.point for c in back.cells] == [c.point for c in study.cells]
    assert [c.scenario for c in back.cells] == [c.scenario for c in study.cells]
    assert (back.hash, back.runs, back.until, back.seed) == (study.hash, study.runs, study.until, study.seed)
    assert (back.keep, back.name, back.motion) == (study.keep, study.name, study.motion)
    assert back.to_toml() == text


def test_a_level_is_in_the_text_only_if_it_is_not_the_default() -> None:
    study = Study(runs=None, until=Precision(0.02, level=0.9))
    assert "max_runs = 100000\nlevel = 0.9\n" in study.to_toml()
    assert Study.from_toml(study.to_toml()).until == study.until
    default = Study(runs=None, until=Precision(0.02))
    assert "level" not in default.to_toml().partition("[scenario.")[0]
    assert study.hash == default.hash
    assert (
        Study(runs=None, until=Precision(np.float64(0.02), level=np.float64(0.9))).to_toml()
        == study.to_toml()
    )


def test_the_text_stands_alone(tmp_path: Path) -> None:
    (tmp_path / "world.txt").write_text("01\n11\n")
    (tmp_path / "other.txt").write_text("00\n01\n")
    (tmp_path / "base.toml").write_text('preset = "text"\n[floor]\nsource = "world.txt"\n')
    (tmp_path / "s.toml").write_text(
        'scenario = "base.toml"\nruns = 2\n[grid]\n"floor.source" = ["other.txt", "random:0.44", "diagonal:0.46"]\n'
    )
    study = Study.read(tmp_path / "s.toml")
    assert study.cells[0].scenario.floor.tiles == ("00", "01")
    assert study.cells[2].scenario.floor.tiles is None
    text = study.to_toml()
    for name in ("world.txt", "other.txt", "base.toml"):
        (tmp_path / name).unlink()
    assert Study.from_toml(text).hash == study.hash
    assert "preset" not in text, "a later version may have other presets"
    assert "walk_duration_scale_ms" in text


VALUES = ((0.0, 0.5), (1.0, 0.25))


def test_tiles_are_the_same_as_an_array_as_numbers_and_as_text() -> None:
    """Numbers gave the study another hash; in ``floors`` they were values, whose scenarios have other hashes."""
    text = ["01", "10"]
    forms = [np.array([[0, 1], [1, 0]], dtype=np.uint8), [[0, 1], [1, 0]], ((0, 1), (1, 0)), text]
    varied = [Study(vary={"grid": {"floor.tiles": [rows]}}) for rows in forms]
    named = [Study(vary={"grid": {"floor.source": ["mine"]}}, floors={"mine": rows}) for rows in forms]
    for studies in (varied, named):
        assert len({study.hash for study in studies}) == 1
        assert {study.cells[0].scenario.floor.tiles for study in studies} == {tuple(text)}
        assert all(Study.from_toml(study.to_toml()).hash == study.hash for study in studies)


def test_floors_of_values_may_be_varied_and_take_no_effect_elsewhere(tmp_path: Path) -> None:
    """Files of values were once read as kinds of tile, and values of the base stayed on all floors."""
    (tmp_path / "v.csv").write_text("0,0.5\n1,0.25\n")
    varied = '"floor.source" = ["values:v.csv", "random:0.48", "own", "diagonal:0.46"]'
    (tmp_path / "s.toml").write_text(
        f'[scenario]\nfloor = {{source = "values:v.csv"}}\n[grid]\n{varied}\n[floors]\nown = [[0.1, 0.9]]\n'
    )
    study = Study.read(tmp_path / "s.toml")
    floors = [cell.scenario.floor for cell in study.cells]
    assert [floor.values for floor in floors] == [VALUES, None, ((0.1, 0.9),), None]
    assert [floor.tiles for floor in floors] == [None] * 4
    (tmp_path / "v.csv").unlink()
    assert Study.from_toml(study.to_toml()).hash == study.hash


@pytest.mark.parametrize(
    "values",
    [
        {"floor.values": VALUES, "floor.source": "gone.csv"},
        {"change.at_s": 20.0, "change.to": "invert", "robot.misalignment_drift": 0.02},
    ],
    ids=["values of a file", "optional fields"],
)
def test_scenarios_with_and_without_a_field_are_compared_in_any_order(values: dict[str, Any]) -> None:
    """If the first one had it, it was refused: the base lost the field that later ones do not have."""
    without = preset("paper")
    with_field = without.with_values(values)
    for scenarios in ({"a": with_field, "b": without}, {"b": without, "a": with_field}):
        study = Study.of_scenarios(scenarios, 2)
        assert [cell.scenario for cell in study.cells] == list(scenarios.values())
        assert Study.from_toml(study.to_toml()).hash == study.hash
    assert Study.of(with_field, 2, strategy__name=["none", "soft"]).cells[0].scenario == with_field


HEAD = "runs = 3\n"
BAD = {
    "not TOML": ("runs = ", "is not TOML"),
    "a scenario": (
        "[run]\nt_end_s = 60.0",
        "run: belongs to a scenario: write \\[scenario.run\\], or give a scenario's file by --scenario",
    ),
    "unknown key": ("rnus = 3", "did you mean 'runs'"),
    "runs 0": ("runs = 0", "runs: 0 is wrong"),
    "runs a text": ('runs = "3"', "'3' is wrong"),
    "runs true": ("runs = true", "True is wrong"),
    "runs 1.5": ("runs = 1.5", "1.5 is wrong"),
    "runs of thousands of digits": (f"runs = {'9' * 5000}", "is not TOML: .{,200}$"),
    "runs and until": ('runs = 3\nuntil = "2%"', "either a number of runs or a precision"),
    "until without a sign": ('until = "2"', "not a percentage"),
    "until 0": ('until = "0%"', "not a percentage"),
    "until nan": ('until = "nan%"', "not a percentage"),
    "figure without until": (HEAD + 'figure = "right"', "only together with 'until'"),
    "unknown figure": ('until = "2%"\nfigure = "robots_rihgt"', "did you mean 'robots_right'"),
    "max_runs too few": ('until = "2%"\nmax_runs = 99', "whole number from 100"),
    "level of 1.5": (
        'until = "2%"\nlevel = 1.5',
        "level: 1.5 is not a level of confidence; give a share such as 0.95",
    ),
    "level nan": ('until = "2%"\nlevel = nan', "level: nan is not a level"),
    "level a text": ('until = "2%"\nlevel = "95%"', "level: '95%' is not a level"),
    "level 1": ('until = "2%"\nlevel = 1', "level: 1 is not a level"),
    "level without until": (HEAD + "level = 0.9", "only together with 'until'"),
    "seed": (HEAD + "seed = -1", "seed: -1 is wrong"),
    "seed true": (HEAD + "seed = true", "seed: True is wrong"),
    "seed too large": (HEAD + f"seed = {2**63}", "seed"),
    "motion": (HEAD + 'motion = "evnt"', "did you mean 'event'"),
    "motion 3": (HEAD + "motion = 3", "3 is not the name of a source of motion"),
    "keep": (HEAD + 'keep = ["sample"]', "did you mean 'samples'"),
    "keep a text": (HEAD + 'keep = "samples"', "is not a list"),
    "keep a number": (HEAD + "keep = [1]", "keep"),
    "keep a list": (HEAD + "keep = [[1]]", "keep"),
    "name 1": (HEAD + "name = 1", "name: 1 is"),
    "newer": (HEAD + "format = 99", "update vibroswarm"),
    "format a text": (HEAD + 'format = "1"', "format"),
    "format a list": (HEAD + "format = []", "format"),
    "scenario a list": (HEAD + 'scenario = ["a"]', "scenario"),
    "preset 1": (HEAD + "[scenario]\npreset = 1", "preset"),
    "scenario 3": (HEAD + "scenario = 3", "must be a table"),
    "scenario nowhere": (HEAD + 'scenario = "nowhere.toml"', "cannot be read"),
    "scenario field": (HEAD + "[scenario.walk]\ngamma = 3", "no such field"),
    "scenario preset": (HEAD + '[scenario]\npreset = "papr"', "did you mean 'paper'"),
    "preset of a cell": (HEAD + '[grid]\npreset = ["papr"]', "in the cell with preset = papr"),
    "value of a cell": (HEAD + "[grid]\n'swarm.robots' = [5, 0]", "in the cell with swarm.robots = 0"),
    "date": (HEAD + "[grid]\n'swarm.robots' = [1979-05-27]", "swarm.robots"),
    "floors": (HEAD + "floors = 3", "3 is not a table of floors"),
    "floor rows": (HEAD + "[floors]\na = '01'", "list of rows"),
    "floor rows of numbers": (HEAD + "[floors]\na = [1]", "floors"),
    "floor tiles": (HEAD + "[floors]\na = ['02']\n[scenario.floor]\nsource = 'a'", "floor"),
    "floor nowhere": (HEAD + "[grid]\n'floor.source' = ['nowhere.txt']", "nowhere.txt"),
    "grid empty": (HEAD + "[grid]\n", "grid: is empty"),
}


@pytest.mark.parametrize("what", BAD)
def test_what_is_wrong_is_said(what: str) -> None:
    text, words = BAD[what]
    with pytest.raises(InputError, match=words):
        Study.from_toml(text)


def test_a_varied_field_that_no_cell_uses_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "study.toml"
    text = '[grid]\n"strategy.name" = ["none", "positive"]\n"strategy.soft.eta" = [1, 2]\n'
    file.write_text(text)
    words = r"strategy.soft.eta: has no effect: strategy.name is 'none' and 'positive'; set it to 'soft'"
    with pytest.raises(InputError, match=words):
        Study.read(file)
    file.write_text(text.replace("positive", "soft"))
    assert len(Study.read(file).cells) == 4
    with pytest.raises(InputError, match=r"network.loss.share: has no effect: network.name is 'ideal'"):
        Study.of(preset("paper"), network__loss__share=[0.1, 0.2])


def test_a_varied_field_of_faults_or_places_is_refused_only_if_no_cell_uses_it() -> None:
    paper = preset("paper")
    with pytest.raises(InputError, match=r"faults.sensor_from_s: has no effect without faults.stuck_at_0, "):
        Study.of(paper, faults__sensor_from_s=[0.0, 60.0])
    assert len(Study.of(paper, faults__stuck_at_1=[0.0, 0.2], faults__sensor_from_s=[0.0, 60.0]).cells) == 4
    assert len(Study.of(paper, faults__biased=[0.0], faults__misread_shift=[0.0, 0.1]).cells) == 2, (
        "off on purpose"
    )
    with pytest.raises(InputError, match=r"rays.noise_m: has no effect on robots that estimate no places"):
        Study.of(paper, rays__noise_m=[0.0, 0.01])
    assert len(Study.of(paper, strategy__name=["none", "places"], rays__noise_m=[0.0, 0.01]).cells) == 4
    assert len(Study.of(paper, localisation__method=["true", "mixture"]).cells) == 2
    mixed = study_of(vary=["faults.misread_shift=0,0.1"], runs=1, settings=["faults.biased=0"])
    assert len(mixed.cells) == 2, "off on purpose, too"


def test_a_study_file_that_is_none(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        Study.read(tmp_path / "nowhere.toml")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00PAR1")
    with pytest.raises(InputError, match="UTF-8"):
        Study.read(tmp_path / "binary.toml")
    with (tmp_path / "huge.toml").open("wb") as stream:
        stream.truncate(65 * 2**20)
    with pytest.raises(InputError, match="64 MiB"):
        Study.read(tmp_path / "huge.toml")
    with pytest.raises(InputError, match="is a folder"):
        Study.read(tmp_path)


@given(st.text(max_size=60) | st.sampled_from([t for t, _ in BAD.values()]).flatmap(
    lambda text: st.integers(0, len(text)).map(lambda k: text[:k] + "[" + text[k:])))  # fmt: skip
@settings(max_examples=200, deadline=None)
def test_nothing_but_a_study_or_an_input_error_comes_of_any_text(text):
    with suppress(InputError):
        assert Study.from_toml(text).cells


def test_a_varied_preset_is_not_hidden_by_the_base() -> None:
    study = Study({"swarm": {"robots": 8}}, {"grid": {"preset": ["paper", "text"]}}, runs=1)
    for cell, name in zip(study.cells, ("paper", "text"), strict=True):
        assert cell.scenario == preset(name).with_values({"swarm.robots": 8})
    made = study_of(vary=["preset=paper,text"], strategy=["soft"], settings=["strategy.soft.eta=700"], runs=1)
    assert [cell.scenario.strategy.soft.eta for cell in made.cells] == [700.0, 700.0]
    with pytest.raises(InputError, match="a complete scenario overrides every preset"):
        Study.of(preset("paper"), preset=["paper", "text"])


def test_a_base_need_not_fit_together_without_what_varies() -> None:
    """The paper's strategy reads two classes, and the sensor of the base tells three."""
    base = {"sensor": {"model": "confusion"}, "task": {"name": "majority"}}
    base |= {"floor": {"source": "random:0.4,0.2,0.2,0.2"}}
    names, kinds = ["dirichlet", "averaging"], "sensor.confusion.kinds"
    study = Study(base, {"grid": {"strategy.name": names, kinds: [4]}}, runs=1)
    found = [(c.scenario.strategy.name, c.scenario.sensor.confusion.kinds) for c in study.cells]
    assert found == [(name, 4) for name in names]
    assert Study.from_toml(study.to_toml()).hash == study.hash
    tiles = {"floor": {"tiles": ["012", "012", "002"]}}
    grid = {"strategy.name": names, "floor.source": ["random:0.4,0.36,0.24"]}
    assert [c.scenario.floor.tiles for c in Study(base | tiles, {"grid": grid}, runs=1).cells] == [None, None]
    words = {"floor": "random:0.4,0.36,0.24", "task": "majority", "settings": ["sensor.model=confusion"]}
    made = study_of(vary=["strategy.name=dirichlet,averaging"], runs=1, **words)
    assert [cell.scenario.strategy.name for cell in made.cells] == names
    with pytest.raises(InputError, match=r"'soft' reads 0 or 1.* \(in the cell with strategy.name = soft"):
        assert Study(base, {"grid": {"strategy.name": ["dirichlet", "soft"], kinds: [4]}}, runs=1).cells
    with pytest.raises(InputError, match=r"faults.stuck_class"):
        assert study_of(vary=["strategy.name=dirichlet"], **words | {"settings": [
            "sensor.model=confusion", "faults.stuck=0.2", "faults.stuck_class=9"]}).cells  # fmt: skip
    with pytest.raises(InputError, match=r"strategy: .*a table"):
        assert Study(base | {"strategy": "soft"}, {"grid": {"strategy.name": names}}, runs=1).cells
    with pytest.raises(InputError, match=r"strategy.soft: .*a table"):
        assert Study({"strategy": {"soft": 3}}, {"grid": {"strategy.soft.eta": [1, 2]}}, runs=1).cells


@pytest.mark.parametrize("scenarios", [{}, [preset("paper")], {"a": 3}, {"": preset("paper")}, None])
def test_scenarios_by_label_are_checked(scenarios: Any) -> None:
    with pytest.raises(InputError, match="scenarios"):
        Study.of_scenarios(scenarios)


@pytest.mark.parametrize("label", ["", "  ", []])
def test_a_label_has_words(label: Any) -> None:
    with pytest.raises(InputError, match=r"list\[1\]\.label: .* give a text"):
        Study(vary={"list": [{"label": "a"}, {"label": label}]})
