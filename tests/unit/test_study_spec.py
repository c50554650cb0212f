"""A study: checked, named, hashed, TOML in and out."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from vibroswarm.errors import InputError
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


@given(st.text(max_size=60) | st.sampled_from([t for t, _ in BAD.values()]).flatmap(
    lambda text: st.integers(0, len(text)).map(lambda k: text[:k] + "[" + text[k:])))  # fmt: skip
@settings(max_examples=200, deadline=None)
def test_nothing_but_a_study_or_an_input_error_comes_of_any_text(text):
    with suppress(InputError):
        assert Study.from_toml(text).cells
