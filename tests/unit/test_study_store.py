"""The store: append-only, whole, checked, safe with several writers."""

from __future__ import annotations

import io
import json
import shutil
from pathlib import Path

import polars as pl
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from polars.testing import assert_frame_equal

from helpers.manifests import resealed
from vibroswarm.core.folders import FORMAT
from vibroswarm.errors import InputError
from vibroswarm.simulation import versions
from vibroswarm.study.batch import Batch, BatchResult, batch_of, do_batch
from vibroswarm.study.batch_table import ROWS
from vibroswarm.study.plan import plan_of
from vibroswarm.study.spec import Study
from vibroswarm.study.store import SHARDS, Store
from vibroswarm.study.study_result import StudyResult

STUDY = Study(
    {"swarm": {"robots": 2}, "run": {"t_end_s": 60.0}}, {"grid": {"strategy.name": ["none", "soft"]}}, 30
)


def add(store: Store, first: int, last: int) -> None:
    store.add(do_batch(batch_of(store.study, plan_of(store.study).groups[0], first, last)))


def made_up(store: Store, first: int, last: int, writer: int = 0) -> None:
    """A batch of made-up rows: nobody decided, and the belief says who wrote them."""
    keys = [(cell, run, robot) for cell in (0, 1) for run in range(first, last) for robot in (0, 1)]
    told = {"decision": -1, "alpha": 1, "beta": 1, "samples": 0, "sent": 0, "messages_received": 0,
            "consensus": "incomplete",
            "fill_ratio": 0.5, "right": 0, "wrong": 0, "undecided": 2, "end_s": 60.0, "stopped_early": False,
            "belief_below": writer / 10}  # fmt: skip
    frame = pl.DataFrame(keys, schema=["cell", "run", "robot"], orient="row").with_columns(
        pl.lit(told.get(name)).alias(name) for name in ROWS if name not in ("cell", "run", "robot")
    )
    frame = frame.select(pl.col(name).cast(kind) for name, kind in ROWS.items())
    data = io.BytesIO()
    frame.write_parquet(data)
    work = Batch(
        study=store.study.hash, group=0, observed=(), first=first, last=last, seed=1, motion="event", keep=()
    )
    store.add(BatchResult(work, {"robots": data.getvalue()}, frame.height, versions()))


@pytest.fixture(scope="module")
def filled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    store = Store.open_or_create(tmp_path_factory.mktemp("store") / "a", STUDY)
    add(store, 0, 20)
    add(store, 20, 30)
    return store.folder


@pytest.fixture
def copy(filled: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(filled, tmp_path / "a copy"))


def test_what_was_added_is_found_again(filled: Path) -> None:
    store = Store.open(filled)
    assert sorted(store.ranges(0)) == [(0, 20), (20, 30)]
    assert store.damaged == []
    assert store.left_over == 0
    assert store.missing(plan_of(STUDY).groups[0], 30) == []
    assert store.runs(0) == 30
    rows = StudyResult.open(filled).rows().collect()
    assert rows.select("cell", "run", "robot").rows() == [
        (c, r, k) for c in (0, 1) for r in range(30) for k in (0, 1)
    ]


def test_a_batch_that_is_done_twice_is_the_same_file(copy: Path) -> None:
    before = {p.name: p.read_bytes() for p in (copy / SHARDS).iterdir()}
    add(Store.open(copy), 0, 20)
    assert {p.name: p.read_bytes() for p in (copy / SHARDS).iterdir()} == before


@given(st.lists(st.tuples(st.integers(0, 30), st.integers(0, 30)).map(sorted), min_size=1, max_size=8),
       st.integers(1, 40))  # fmt: skip
@settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_scan_gives_each_run_once_whatever_overlaps(tmp_path_factory, ranges, runs):
    store = Store.open_or_create(tmp_path_factory.mktemp("scan") / "s", STUDY)
    for writer, (first, last) in enumerate(ranges):
        if first < last:
            made_up(store, first, last, writer)
    store.refresh()
    assert store.damaged == []
    there = sorted({run for first, last in ranges for run in range(first, last) if run < runs})
    found = store.scan(0, runs)
    rows = [] if found is None else found.filter(cell=0, robot=0).collect()["run"].sort().to_list()
    assert rows == there


def one_of(folder: Path, pattern: str) -> Path:
    return sorted((folder / SHARDS).glob(pattern))[0]


HARM = [
    "cut",
    "emptied",
    "changed",
    "gone",
    "about cut",
    "newer",
    "of another study",
]


@pytest.mark.parametrize("harm", HARM)
def test_a_damaged_shard_is_found_and_said_and_made_again(harm: str, copy: Path, filled: Path) -> None:
    shard, about = one_of(copy, "*.parquet"), one_of(copy, "*.json")
    told = json.loads(about.read_text())
    if harm == "cut":
        shard.write_bytes(shard.read_bytes()[:-100])
    elif harm == "emptied":
        shard.write_bytes(b"")
    elif harm == "changed":
        data = bytearray(shard.read_bytes())
        data[50] ^= 1
        shard.write_bytes(data)
    elif harm == "gone":
        shard.unlink()
    elif harm == "about cut":
        about.write_text(about.read_text()[:50])
    elif harm == "newer":
        about.write_text(json.dumps(told | {"format": FORMAT + 1}))
    else:
        about.write_text(json.dumps(told | {"study": "0" * 16}))
    store = Store.open(copy)
    assert len(store.damaged) == 1
    assert about.name in store.damaged[0]
    assert len(store.shards) == 1
    again = STUDY.run(copy, workers=1)
    assert again.store.damaged == []
    assert_frame_equal(again.rows().collect(), StudyResult.open(filled).rows().collect())
    assert Store.open(copy).damaged == []


def test_files_of_writers_that_were_killed_do_not_count(copy: Path) -> None:
    (copy / SHARDS / ".abc.parquet.x1.parquet").write_bytes(b"half")
    (copy / SHARDS / "0123.parquet").write_bytes(b"whole, but not described")
    (copy / ".study.toml.x.toml").write_bytes(b"")
    store = Store.open(copy)
    assert (store.left_over, len(store.shards), store.damaged) == (2, 2, [])


@pytest.mark.parametrize(
    "left", [(), ("shards",), ("shards", "study.toml"), ("shards", ".study.toml.k3.toml")]
)
def test_a_writer_killed_at_its_beginning_is_no_obstacle(left: tuple[str, ...], tmp_path: Path) -> None:
    whole = Store.open_or_create(tmp_path / "whole", STUDY.with_runs(7)).folder
    folder = tmp_path / "begun"
    folder.mkdir()
    for name in left:
        if name == "shards":
            (folder / name).mkdir()
        else:
            shutil.copy(whole / "study.toml", folder / name)
    assert Store.existing(folder, STUDY) is None
    assert Store.open_or_create(folder, STUDY).study.runs == 30
    assert Store.open(folder).study.runs == 30


def test_other_versions_are_not_mixed_unless_told(copy: Path) -> None:
    about = one_of(copy, "*.json")
    text = about.read_text().replace(versions()["numpy"], "0.1").replace(versions()["code"], "other code")
    about.write_text(text)
    resealed(about)
    assert STUDY.run(copy).runs().height == 60, "what is all there can be read"
    with pytest.raises(InputError, match=r"numpy 0\.1 there"):
        STUDY.with_runs(31).run(copy)
    more = STUDY.with_runs(31).run(copy, mixed=True, workers=1)
    assert more.runs().height == 62
    assert len(more.store.made_by) == 2
    assert set(more.runs()["code"]) == {"other code", versions()["code"]}
