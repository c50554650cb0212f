"""Saved runs are simulated again and compared; a changed number is seen."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from helpers.commands import output_of
from vibroswarm import InputError, Result, Study, preset, simulate
from vibroswarm.cli import main
from vibroswarm.core.folders import read_described, write_described
from vibroswarm.core.tables import parquet_bytes
from vibroswarm.documents.saved import begin
from vibroswarm.optimize import verify as module
from vibroswarm.optimize.loop import run_search
from vibroswarm.optimize.spec import Search
from vibroswarm.optimize.steps import held
from vibroswarm.optimize.validation import score_fresh
from vibroswarm.optimize.verify import verify
from vibroswarm.study.batch import Batch, BatchResult, do_batch

SHORT = preset("paper").with_values({"run.t_end_s": 60.0, "swarm.robots": 2})


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("verify") / "result"
    simulate(SHORT, 3, 4, segments=True).write(folder)
    return folder


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("verify") / "study"
    Study.of(SHORT, 6, 5, strategy__name=["none", "soft"]).run(folder, progress=False)
    return folder


def test_a_result_is_the_same(result: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    simulate(SHORT, 3).write(tmp_path / "one")
    for folder, runs in ((result, "all 4 runs"), (tmp_path / "one", "the run")):
        assert f"Verified: {runs} came out the same again, bit by bit." in output_of(
            capsys, "verify", str(folder)
        )


@pytest.mark.parametrize(
    ("table", "column"), [("robots", "belief_below"), ("segments", "x_m"), ("motion", "time_s")]
)
def test_one_bit_is_seen(tmp_path: Path, result: Path, table: str, column: str) -> None:
    """Negative control: the last bit of one number of one run is changed."""
    read = Result.read(result)
    frame: pl.DataFrame = getattr(read, table)
    values = frame[column].to_numpy().copy()
    place = int((frame["run"] == 2).arg_true()[0])
    values.view("uint64")[place] ^= 1
    changed = frame.with_columns(pl.Series(column, values))
    object.__setattr__(read, table, changed)
    read.write(tmp_path / "changed")
    found = verify(tmp_path / "changed")
    assert not found.holds
    assert found.runs.filter(~found.runs["same"]).rows() == [("", 2, False, table)]


def test_a_study_is_the_same_and_a_sample_says_how_sure_that_is(study: Path) -> None:
    assert verify(study).runs.height == 12
    some = verify(study, 5, seed=2)
    assert (some.runs.height, some.saved, some.holds) == (5, 12, True)
    assert some.share_that_differs.high == pytest.approx(0.434, abs=1e-3)  # Wilson, 0 of 5
    assert set(some.runs["cell"]) <= {"none", "soft"}


def test_other_runs_are_seen(
    study: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Negative control: runs of another seed."""

    def with_another_seed(work: Batch) -> BatchResult:
        return do_batch(replace(work, seed=work.seed + 1))

    monkeypatch.setattr(module, "do_batch", with_another_seed)
    assert main(["verify", str(study), "--runs", "3", "--json"]) == 1
    told = json.loads(capsys.readouterr().out)
    assert told["answer"] == [
        "NOT VERIFIED: 3 of 12 runs, drawn at random, were simulated again, and 3 came out differently."
    ]
    assert [row["tables"] for row in told["tables"]["differing"]] == ["robots"] * 3


def test_every_table_of_a_study_is_compared(tmp_path: Path) -> None:
    """Negative control: the last bit of one number in each table, and in a column of how robots sampled."""
    folder = tmp_path / "study"
    own = {"strategy.name": "places", "change.at_s": 30.0, "change.to": "invert"}
    study = replace(Study.of(SHORT.with_values(own), 2, 5), keep=("samples",))
    study.run(folder, progress=False)
    (description,) = (folder / "shards").glob("*.json")
    whole = json.loads(description.read_text(encoding="utf-8"))
    about = {key: value for key, value in whole.items() if key not in ("format", "kind", "files", "sha256")}
    content = {
        path.name.removeprefix(description.stem).removesuffix(".parquet").strip(".")
        or "robots": path.read_bytes()
        for path in (folder / "shards").glob("*.parquet")
    }
    assert verify(folder).holds
    changed = {
        "robots": "spacing_s",
        "samples": "energy",
        "agreements": "right_time_share",
        "maps": "map_brier",
        "reported": "value",
    }
    assert set(changed) == set(content)
    for name, column in changed.items():
        table = pl.read_parquet(content[name])
        values = table[column].to_numpy().copy()
        of_run_1 = (table["run"] == 1).arg_true().to_numpy()
        values[of_run_1] = np.nextafter(
            values[of_run_1], np.float32(2.0)
        )  # all robots have a column of their run
        other = parquet_bytes(table.with_columns(pl.Series(column, values, nan_to_null=True)))
        write_described(folder / "shards", description.stem, "batch", {**content, name: other}, **about)
        found = verify(folder)
        assert found.runs.filter(~found.runs["same"]).select("run", "tables").rows() == [(1, name)], name


@pytest.fixture(scope="module")
def search(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("verify") / "search"
    small = Path(__file__).parents[1] / "helpers" / "small_search.toml"
    run_search(Search.from_toml(small.read_text() + "[search]\nbudget = 60\n"), folder, workers=1)
    return folder


def test_other_figures_of_a_search_are_seen(search: Path, study: Path, tmp_path: Path) -> None:
    """Negative control: the last bit of one figure of one run of a step, in a folder such as that of a reproduction."""
    folder = tmp_path / "runs" / "changed"
    shutil.copytree(study, tmp_path / "runs" / "study")
    shutil.copytree(search, folder)
    begin(tmp_path, "reproduce")
    assert verify(tmp_path, 2).holds
    path = folder / "steps" / "00001.parquet"
    table = pl.read_parquet(path)
    figures = table["figure_0"].to_numpy().copy()
    figures.view("uint64")[0] ^= 1
    table = table.with_columns(pl.Series("figure_0", figures))
    write_described(path.parent, path.stem, "step", {"step": parquet_bytes(table)})
    found = verify(tmp_path, 10**6)
    assert found.saved == found.runs.height == 12 + held(search)["runs_there"]
    (differing,) = found.runs.filter(~found.runs["same"])["cell"]
    assert differing.startswith("runs/changed: candidate ")


def test_fresh_runs_of_a_search_are_simulated_again(search: Path, tmp_path: Path) -> None:
    """Negative control: the last bit of one figure of one fresh run."""
    folder = tmp_path / "search"
    shutil.copytree(search, folder)
    steps = verify(folder, 1).saved
    read = Search.read(folder / "search.toml")
    score_fresh(
        read, [("middle", read.space.values([0.5] * len(read.space.names)))], 3, folder=folder, workers=1
    )
    assert verify(folder, 10**6).holds
    (path,) = (folder / "fresh").glob("*.json")
    about, files = read_described(path, "fresh")
    table = pl.read_parquet(files["fresh"])
    figures = table["figure_0"].to_numpy().copy()
    figures.view("uint64")[0] ^= 1
    changed = {"fresh": parquet_bytes(table.with_columns(pl.Series("figure_0", figures)))}
    more = {key: about[key] for key in ("failed", "why", "made_from")}
    write_described(path.parent, path.stem, "fresh", changed, **more)
    found = verify(folder, 10**6)
    assert found.saved == steps + 3
    assert found.runs.filter(~found.runs["same"]).rows() == [(path.stem, 0, False, "fresh")]
    values = about["made_from"][0]
    for wrong in (7, ["values"], ["x", 3, 1, 1], [values, "3", 1, 1]):
        write_described(path.parent, path.stem, "fresh", changed, **{**more, "made_from": wrong})
        assert path.stem in "".join(verify(folder, 1).damaged), wrong
    write_described(
        path.parent, path.stem, "fresh", changed, **{**more, "made_from": [{"walk.none": 1}, 3, 1, 1]}
    )
    assert not verify(folder, 10**6).holds
    (folder / "fresh" / f"{path.stem}.parquet").unlink()
    assert "is missing" in verify(folder, 1).damaged[0]


def test_what_is_damaged_is_not_verified(
    study: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("cut", "whole"):
        shutil.copytree(study, tmp_path / name)
    begin(tmp_path, "reproduce")
    (table,) = (tmp_path / "cut" / "shards").glob("*.parquet")
    table.write_bytes(table.read_bytes()[:-1])
    assert main(["verify", str(tmp_path), "--json"]) == 1
    told = json.loads(capsys.readouterr().out)
    assert told["answer"][0].startswith(
        "NOT VERIFIED: 1 file cannot be read. Of the others, all 12 runs came out"
    )
    assert "is cut off" in told["warnings"][0]
    with pytest.raises(InputError, match=r"holds no runs; damaged: .*is cut off"):
        verify(tmp_path / "cut")


def test_other_versions_are_named(result: Path, tmp_path: Path) -> None:
    read = Result.read(result)
    older = {**read.versions, "numpy": "1.0"}
    object.__setattr__(read, "versions", older)
    read.write(tmp_path / "older")
    found = verify(tmp_path / "older", 1)
    assert found.other_versions == {"numpy": ("1.0", Result.read(result).versions["numpy"])}
    assert found.holds


@pytest.mark.parametrize("content", [None, "notes.txt"])
def test_what_holds_no_runs_is_refused(tmp_path: Path, content: str | None) -> None:
    if content:
        (tmp_path / content).write_text("x", encoding="utf-8")
    with pytest.raises(InputError, match="is not a folder of vibroswarm"):
        verify(tmp_path)
    assert main(["verify", str(tmp_path / "nowhere")]) == 2
