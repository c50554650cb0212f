"""The store: append-only, whole, checked, safe with several writers."""

from __future__ import annotations

import hashlib
import io
import json
import os
import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import polars as pl
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from polars.testing import assert_frame_equal

from helpers.manifests import resealed
from helpers.scenario_fields import named
from vibroswarm import networks, tasks
from vibroswarm.cli import main
from vibroswarm.core.folders import FORMAT
from vibroswarm.documents.study import study_document
from vibroswarm.documents.study_folder import study_state
from vibroswarm.documents.study_words import warnings_of
from vibroswarm.errors import InputError, RunError
from vibroswarm.motion.source import MotionState, Source, forget, register, source
from vibroswarm.networks import Network
from vibroswarm.simulation import versions
from vibroswarm.study.batch import Batch, BatchResult, batch_of, do_batch
from vibroswarm.study.batch_table import ROWS
from vibroswarm.study.cell_comparison import SECOND, second_block, second_seed
from vibroswarm.study.plan import plan_of
from vibroswarm.study.precision import Precision
from vibroswarm.study.run import merge
from vibroswarm.study.spec import Study
from vibroswarm.study.store import SHARDS, Store
from vibroswarm.study.study_result import StudyResult
from vibroswarm.study.summary import outcome_of, write_outcome
from vibroswarm.tasks import Task

STUDY = Study(
    {"swarm": {"robots": 2}, "run": {"t_end_s": 60.0}}, {"grid": {"strategy.name": ["none", "soft"]}}, 30
)
GOLDEN = Path(__file__).parents[1] / "golden" / "store-format-1"


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


def test_a_shard_is_read_again_only_if_a_file_of_it_has_changed(
    copy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A command opens a study up to three times, and a shard takes milliseconds: minutes of 20,000 of them."""
    monkeypatch.setattr("vibroswarm.study.store.COARSE_NS", -(10**12))  # these files are a moment old
    assert len(Store.open(copy).shards) == 2
    with monkeypatch.context() as patch:
        patch.setattr(Store, "_read", lambda store, path: pytest.fail("read again"))
        assert len(Store.open(copy).shards) == 2
    table = next((copy / SHARDS).glob("*.parquet"))
    whole = table.read_bytes()
    table.write_bytes(whole[:-9] + bytes([whole[-9] ^ 1]) + whole[-8:])  # as long as it was
    (damaged,) = Store.open(copy).damaged
    assert damaged.startswith(f"{table.stem}.json: ")
    assert "is damaged" in damaged
    table.write_bytes(whole)
    assert len(Store.open(copy).shards) == 2


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
    "about is a list",
    "newer",
    "of another study",
    "elsewhere",
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
    elif harm == "about is a list":
        about.write_text("[]")
    elif harm == "newer":
        about.write_text(json.dumps(told | {"format": FORMAT + 1}))
    elif harm == "of another study":
        about.write_text(json.dumps(told | {"study": "0" * 16}))
    else:
        ((name, what),) = told["files"].items()
        about.write_text(json.dumps(told | {"files": {f"../{name}": what}}))
    store = Store.open(copy)
    assert len(store.damaged) == 1
    assert about.name in store.damaged[0]
    assert len(store.shards) == 1
    again = STUDY.run(copy, workers=1)
    assert again.store.damaged == []
    assert_frame_equal(again.rows().collect(), StudyResult.open(filled).rows().collect())
    assert Store.open(copy).damaged == []


def test_a_file_in_the_place_of_the_folder_of_shards_is_named(tmp_path: Path) -> None:
    (tmp_path / SHARDS).touch()
    with pytest.raises(InputError, match=f"{SHARDS}: is not a folder; move it away"):
        Store.open_or_create(tmp_path, STUDY)


def test_a_study_is_not_shown_as_empty_where_a_file_is_in_the_place_of_its_shards(copy: Path) -> None:
    (copy / SHARDS).rename(copy / "away")
    (copy / SHARDS).touch()
    with pytest.raises(InputError, match=f"{SHARDS}: is not a folder; move it away"):
        StudyResult.open(copy)


@pytest.mark.parametrize("what", ["folder", "pipe"])
@pytest.mark.parametrize("kind", ["*.parquet", "*.json"])
def test_something_else_in_the_place_of_a_shard_is_refused_and_stays(
    kind: str, what: str, copy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its runs are missing, but nothing that somebody put there is removed, and nothing simulated in vain."""
    file = one_of(copy, kind)
    whole = file.read_bytes()
    file.unlink()
    file.mkdir() if what == "folder" else os.mkfifo(file)
    assert len(Store.open(copy).damaged) == 1
    with monkeypatch.context() as patch:
        patch.setattr("vibroswarm.study.batch.simulate_batch", None)
        with pytest.raises(InputError, match=f"{file.name}: is in the place of a file: move it away"):
            STUDY.run(copy, workers=1)
    assert file.exists()
    file.rmdir() if what == "folder" else file.unlink()
    assert STUDY.run(copy, workers=1).store.damaged == []
    assert one_of(copy, kind).read_bytes() == whole or kind == "*.json"  # which names versions


def test_runs_that_are_missing_are_said(tmp_path: Path) -> None:
    store = Store.open_or_create(tmp_path, STUDY)
    made_up(store, 0, 20)
    found = outcome_of(StudyResult.open(tmp_path), compare=False)
    assert "20 of 60 runs are missing; run the same command again." in warnings_of(found)


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


def test_a_study_file_of_the_user_is_never_overwritten(tmp_path: Path) -> None:
    (tmp_path / "study.toml").write_text("runs = 30\n# mine\n")
    with pytest.raises(InputError, match="exists but is not a study"):
        Store.open_or_create(tmp_path, STUDY)
    assert (tmp_path / "study.toml").read_text() == "runs = 30\n# mine\n"
    assert len(list(tmp_path.iterdir())) == 1


def test_a_pipe_or_deep_nesting_in_the_place_of_a_study_file_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "study.toml"
    os.mkfifo(file)
    with pytest.raises(InputError, match="exists but is not a study"):
        Store.existing(tmp_path, STUDY)
    file.unlink()
    file.write_text("runs = " + "[" * 10_000)
    with pytest.raises(InputError, match="exists but is not a study"):
        Store.existing(tmp_path, STUDY)


def test_a_folder_of_something_else_is_refused(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("ten years")
    for folder in (tmp_path, tmp_path / "thesis.tex"):
        with pytest.raises(InputError, match="exists but is not a study"):
            Store.open_or_create(folder, STUDY)
    with pytest.raises(InputError, match="cannot be made"):
        Store.open_or_create(tmp_path / "thesis.tex" / "deeper", STUDY)
    assert [p.name for p in tmp_path.iterdir()] == ["thesis.tex"]


def test_another_study_is_refused_and_told_apart(filled: Path) -> None:
    base, vary = STUDY.base, STUDY.vary
    for other, words in {
        "seed is 1 there and 2 here": Study(base, vary, seed=2),
        "it has 2 cells there and 1 here": Study(base),
        "strategy.name of cell 1 is 'soft' there and 'positive' here":
            Study(base, {"grid": {"strategy.name": ["none", "positive"]}}),
        "keep": Study(base, vary, keep=("samples",)),
    }.items():  # fmt: skip
        with pytest.raises(InputError, match=other):
            Store.open_or_create(filled, words)


def test_more_runs_and_a_title_are_the_same_study(copy: Path) -> None:
    store = Store.open_or_create(copy, Study(STUDY.base, STUDY.vary, 50, name="longer"))
    assert len(store.shards) == 2
    assert (Store.open(copy).study.runs, Store.open(copy).study.name) == (50, "longer")


def test_a_precision_and_its_level_are_the_same_study(copy: Path) -> None:
    for until in (Precision(0.5, level=0.9), Precision(0.5)):
        store = Store.open_or_create(copy, Study(STUDY.base, STUDY.vary, None, until))
        assert len(store.shards) == 2
        assert Store.open(copy).study.until == until


def test_a_head_that_is_not_as_it_was_is_said(copy: Path) -> None:
    head, marker = copy / "vibroswarm.json", copy / "study.toml"
    about, text = json.loads(head.read_text()), marker.read_text()
    head.write_text(json.dumps(about | {"format": FORMAT + 1}))
    with pytest.raises(InputError, match="update vibroswarm"):
        Store.open(copy)
    head.write_text("{")
    with pytest.raises(InputError, match="is damaged"):
        Store.open(copy)
    head.write_text(json.dumps(about))
    for changed in ("runs = 31", "seed = 2"):
        key = changed.partition(" ")[0]
        harmed = re.sub(rf"^{key} = \d+", changed, text, flags=re.MULTILINE)
        marker.write_text(harmed)
        with pytest.raises(InputError, match="not what was written; restore it"):
            Store.open(copy)
    marker.write_text(harmed.partition("# sha256")[0])  # as older versions wrote it
    with pytest.raises(InputError, match="is not that for which"):
        Store.open(copy)
    marker.unlink()
    with pytest.raises(InputError, match="cannot be read"):
        Store.open(copy)
    head.unlink()
    with pytest.raises(InputError, match="is not a study of vibroswarm"):
        Store.open(copy)


def test_a_store_whose_hash_a_later_version_would_make_otherwise_is_read(copy: Path) -> None:
    """A later version may know more fields; the hash then differs though the study is the same."""
    old = "f" * 16
    for path in [copy / "vibroswarm.json", *(copy / SHARDS).glob("*.json")]:
        path.write_text(path.read_text().replace(STUDY.hash, old).replace(versions()["code"], "0" * 16))
        resealed(path)
    store = Store.open(copy)
    assert (store.hash, len(store.shards), store.damaged) == (old, 2, [])
    more = STUDY.with_runs(40).run(copy, workers=1, mixed=True)
    assert more.store.damaged == []
    assert more.runs().height == 80
    again = Store.open(copy)
    assert (again.hash, again.study.runs, again.damaged) == (old, 40, [])
    marker = copy / "study.toml"
    changed = marker.read_text().replace("t_end_s = 60.0", "t_end_s = 61.0")
    marker.write_text(changed.partition("# sha256")[0])
    with pytest.raises(InputError, match="restore it"):
        Store.open(copy)


def test_a_hash_that_this_version_makes_otherwise_is_refused(copy: Path) -> None:
    """The same code gives the same study the same hash, or it is another study."""
    for path in [copy / "vibroswarm.json", *(copy / SHARDS).glob("*.json")]:
        path.write_text(path.read_text().replace(STUDY.hash, "f" * 16))
        resealed(path)
    with pytest.raises(InputError, match="restore it"):
        Store.open(copy)


@pytest.mark.parametrize("name", ["random:0.48", "Random:x", "diagonal:0.46", "stripe", "block_diagonal:0.3"])
def test_no_floor_of_a_study_is_called_like_a_pattern(name: str) -> None:
    """Written down and read again such a study had another floor, and took over the shards of the first."""
    with pytest.raises(InputError, match="name of its own"):
        Study({}, {"grid": {"strategy.name": ["none", "soft"]}}, 3, floors={name: ["10", "01"]})


def test_what_is_written_down_is_the_study_that_is_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = Study({"run": {"t_end_s": 61.0}}, {}, 30).to_toml()
    monkeypatch.setattr(Study, "to_toml", lambda study: other)
    with pytest.raises(RunError, match="read as another study"):
        Store.open_or_create(tmp_path / "s", STUDY)
    assert not (tmp_path / "s" / "vibroswarm.json").exists()


FOREIGN: dict[str, Any] = {
    "a column less": lambda f: f.drop("belief_below"),
    "a column more": lambda f: f.with_columns(more=1),
    "another type": lambda f: f.cast({"alpha": pl.Int64}),
    "a row less": lambda f: f.head(f.height - 1),
    "rows twice": lambda f: pl.concat([f.head(f.height - 1), f.head(1)]),
    "no rows": lambda f: f.clear(),
    "another cell": lambda f: f.with_columns(cell=pl.col("cell") + 1),
    "another robot": lambda f: f.with_columns(robot=pl.col("robot") * 2),
    "other runs": lambda f: f.with_columns(run=pl.col("run") + 1000),
    "no outcome": lambda f: f.with_columns(consensus=pl.lit(None, dtype=f.schema["consensus"])),
    "no number": lambda f: f.with_columns(end_s=float("nan")),
    "beyond all": lambda f: f.with_columns(belief_below=7.0),
    "decided at no time": lambda f: f.with_columns(decision=pl.lit(1, dtype=pl.Int8)),
    "more robots than there are": lambda f: f.with_columns(wrong=pl.lit(77, dtype=pl.UInt16)),
}


@pytest.mark.parametrize("harm", FOREIGN)
def test_a_foreign_shard_is_said_and_made_again(harm: str, copy: Path, filled: Path) -> None:
    """Its hash is made to fit, as somebody else's would."""
    about = one_of(copy, "*.json")
    shard = about.with_suffix(".parquet")
    FOREIGN[harm](pl.read_parquet(shard)).write_parquet(shard)
    told = json.loads(about.read_text())
    data = shard.read_bytes()
    told["files"][shard.name] |= {"bytes": len(data), "sha256": hashlib.sha256(data).hexdigest()}
    about.write_text(json.dumps(told))
    store = Store.open(copy)
    assert len(store.damaged) == 1
    assert about.name in store.damaged[0]
    again = STUDY.run(copy, workers=1)
    assert_frame_equal(again.rows().collect(), StudyResult.open(filled).rows().collect())
    assert Store.open(copy).damaged == []


@pytest.mark.parametrize(
    "key", ["format", "study", "group", "first", "last", "seed", "rows", "files", "versions"]
)
def test_a_description_of_wrong_types_is_said(key: str, copy: Path) -> None:
    about = one_of(copy, "*.json")
    whole = json.loads(about.read_text())
    for value in (None, -1, 10**30, "x", [], {"x": 1}, 1.5):
        about.write_text(json.dumps(whole | {key: value}))
        store = Store.open(copy)
        assert len(store.damaged) == 1, value
        assert store.missing(plan_of(STUDY).groups[0], 30), value


def test_a_batch_without_a_version_that_is_shown_is_repeated(copy: Path) -> None:
    about = one_of(copy, "*.json")
    values = json.loads(about.read_text())
    del values["versions"]["architecture"]
    about.write_text(json.dumps(values))
    resealed(about)
    assert main(["show", str(copy)]) == 0
    store = Store.open(copy)
    assert ["'architecture' is missing" in one for one in store.damaged] == [True]
    assert store.missing(plan_of(STUDY).groups[0], 30)


@pytest.mark.parametrize("key", ["format", "hash", "versions"])
def test_a_head_of_wrong_types_is_refused(key: str, copy: Path) -> None:
    head = copy / "vibroswarm.json"
    whole = json.loads(head.read_text())
    for value in (None, "x", [], {"x": 1}, 1.5, float("inf")):
        head.write_text(json.dumps(whole | {key: value}))
        with named(key, value), pytest.raises(InputError):
            Store.open(copy)


def test_a_store_of_an_older_format_is_refused_in_one_sentence() -> None:
    """Its head was written by version 0.1.0, and is kept as it was."""
    with pytest.raises(InputError, match=r"of an older format \(before 6\).*recreate it$") as caught:
        StudyResult.open(GOLDEN)
    assert "\n" not in str(caught.value)


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


def test_runs_of_registered_code_that_has_changed_are_not_continued(tmp_path: Path) -> None:
    """A scenario has only the name of what a program registers, and the functions may be others at the next start."""
    halves = [Task(name="halves", truth=truth) for truth in (lambda f, asked, p: 1, lambda f, asked, p: 0)]
    tasks.register(halves[0])
    try:
        own = Study({"task": {"name": "halves"}, "run": {"t_end_s": 20.0}}, {}, 2)
        own.run(tmp_path / "st", progress=False)
        own.run(tmp_path / "st", progress=False)  # the same is continued
        tasks.base.forget("halves")
        tasks.register(halves[1])
        with pytest.raises(InputError, match="another task halves, whose code has changed since"):
            own.run(tmp_path / "st", progress=False)
    finally:
        tasks.base.forget("halves")


def test_cells_with_and_without_registered_code_are_of_one_version(tmp_path: Path) -> None:
    """Batches name the registered code of their own cells, which is no difference of versions."""
    tasks.register(Task(name="halves", truth=lambda floor, asked, p: 1))
    try:
        vary = {"list": [{"swarm.robots": 4}, {"task.name": "halves"}]}
        own = Study({"run": {"t_end_s": 20.0}}, vary, 2)
        stored = own.run(tmp_path / "st", progress=False).store
        assert len({"task halves" in shard.made_by for shard in stored.shards}) == 2
        assert len(stored.made_by) == 1
        assert stored.made_by[0].items() >= versions().items()
        assert len(merge(tmp_path / "joined", [tmp_path / "st"]).shards) == len(stored.shards)
    finally:
        tasks.base.forget("halves")


def every_third(sender: int, receiver: int, d: Any, p: Any, w: Any) -> bool:
    return bool(d.address % 3 == 2)


def test_runs_of_a_registered_network_are_continued_by_the_next_program(tmp_path: Path) -> None:
    """What a network has cached since, such as its lists, is no change of its code."""
    for runs in (2, 3):
        networks.register(Network(name="thirds", lost=every_third))
        try:
            own = Study({"network": {"name": "thirds"}, "run": {"t_end_s": 20.0}}, {}, runs)
            assert own.run(tmp_path / "st", progress=False).runs().height == runs
        finally:
            networks.base.forget("thirds")


def source_of(part: float) -> Source:
    """A source of motion like the engine, with a setting of its own."""

    class Begin:
        def __init__(self) -> None:
            self.part = part

        def __call__(self, *given: Any, **wanted: Any) -> MotionState:
            return source("event").init(*given, **wanted)

    return Source("same", Begin())


def test_runs_of_a_registered_source_of_motion_that_has_changed_are_not_continued(tmp_path: Path) -> None:
    try:
        for part in (1.0, 1.0):  # the same is continued
            forget("same")
            register(source_of(part))
            own = Study({"run": {"t_end_s": 20.0}}, {}, 2, motion="same")
            own.run(tmp_path / "st", progress=False)
        forget("same")
        register(source_of(2.0))
        with pytest.raises(InputError, match="another motion same, whose code has changed since"):
            own.run(tmp_path / "st", progress=False)
    finally:
        forget("same")


def test_a_full_disk_is_said_and_leaves_nothing_half_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, write, room = tmp_path / "full", Path.write_bytes, [40_000]

    def full(path: Path, data: bytes) -> int:
        room[0] -= len(data)
        if room[0] < 0:
            write(path, data[: len(data) // 2])
            raise OSError(28, "No space left on device")
        return write(path, data)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_bytes", full)
        with pytest.raises(RunError, match="No space left on device"):
            STUDY.with_runs(1500).run(folder, workers=1)
    assert not list(folder.rglob(".*"))
    store = Store.open(folder)
    assert store.damaged == []
    assert 0 < store.runs(0) < 1500
    whole = STUDY.with_runs(1500).run(folder, workers=2)
    assert whole.runs().height == 3000


def test_a_folder_that_can_only_be_read(copy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise OSError(30, "Read-only file system")

    monkeypatch.setattr("vibroswarm.core.atomic_io._make_empty", refuse)
    assert STUDY.run(copy).runs().height == 60
    assert STUDY.with_runs(20).run(copy).runs().height == 40
    with pytest.raises(InputError, match="Read-only file system"):
        STUDY.with_runs(31).run(copy)
    with pytest.raises(RunError, match="Read-only file system"):
        add(Store.open(copy), 30, 31)


def test_failures_are_forgotten_when_their_runs_are_there(copy: Path) -> None:
    store = Store.open(copy)
    work = batch_of(STUDY, plan_of(STUDY).groups[0], 30, 40)
    store.add_failure(work, "because")
    assert [f["batch"] for f in store.failures] == ["0:30-40"]
    assert store.failures[0]["seed"] == STUDY.seed
    add(store, 25, 35)
    assert len(store.failures) == 1
    add(store, 35, 45)
    assert store.failures == []
    (copy / "failures" / "bad.json").write_text("{")
    assert store.failures == []


def test_each_missing_run_of_failed_batches_is_counted_once(copy: Path) -> None:
    """Records of failures may overlap, and some of their runs may have been stored since."""
    store, group = Store.open(copy), plan_of(STUDY).groups[0]
    store.add_failure(batch_of(STUDY, group, 30, 40), "because")
    store.add_failure(batch_of(STUDY, group, 35, 45), "because")
    add(store, 28, 32)
    warnings = study_document(outcome_of(StudyResult.open(copy))).warnings
    assert [words for words in warnings if "13 runs of none and soft failed" in words], warnings


def test_a_merge_leaves_no_damaged_file_of_its_own(copy: Path, tmp_path: Path) -> None:
    out = tmp_path / "joined"
    merge(out, [copy])
    shard = one_of(out, "*.parquet")
    data = shard.read_bytes()
    shard.write_bytes(bytes([data[0] ^ 1]) + data[1:])
    assert len(Store.open(out).damaged) == 1
    assert merge(out, [copy]).damaged == []


def test_a_merge_that_is_not_whole_says_what_is_lost(copy: Path, tmp_path: Path) -> None:
    one_of(copy, "*.parquet").unlink()
    with pytest.raises(
        RunError, match=r"batches 0:\d+-\d+.* are in none of the folders \(damaged: .*is missing"
    ):
        merge(tmp_path / "joined", [copy])
    assert len(Store.open(tmp_path / "joined").shards) == 1


def test_shares_of_different_studies_or_versions_are_not_merged(copy: Path, tmp_path: Path) -> None:
    other = Store.open_or_create(tmp_path / "other", Study(STUDY.base, STUDY.vary, seed=2)).folder
    with pytest.raises(InputError, match="of another study"):
        merge(tmp_path / "out", [copy, other])
    about = one_of(copy, "*.json")
    about.write_text(about.read_text().replace(versions()["numpy"], "0.1"))
    resealed(about)
    with pytest.raises(InputError, match=r"numpy 0\.1"):
        merge(tmp_path / "out", [copy])
    assert len(merge(tmp_path / "mixed", [copy], mixed=True).made_by) == 2
    with pytest.raises(InputError, match="is not a study"):
        merge(tmp_path / "out", [tmp_path])
    assert not (tmp_path / "out").exists()


def test_a_merge_into_more_runs_keeps_their_number(tmp_path: Path) -> None:
    first = STUDY.run(tmp_path / "first")
    merge(tmp_path / "out", [tmp_path / "first"])
    STUDY.with_runs(5).run(tmp_path / "few")
    merge(tmp_path / "out", [tmp_path / "few"])
    assert Store.open(tmp_path / "out").study.runs == first.study.runs == 30


def test_a_second_block_of_which_all_runs_failed_is_said(copy: Path, tmp_path: Path) -> None:
    again = replace(STUDY, seed=second_seed(STUDY.seed))
    store = Store.open_or_create(tmp_path / "again", again)
    store.add_failure(batch_of(again, plan_of(again).groups[0], 0, 30), "because")
    outcome = outcome_of(StudyResult.open(copy), StudyResult.open(tmp_path / "again"))
    assert outcome.replicate is None
    warnings = study_document(outcome).warnings
    (words,) = [words for words in warnings if words.startswith("on other seeds, ")]
    assert "30 runs of none and soft failed" in words


def test_tables_of_comparisons_that_are_not_made_any_more_are_removed(copy: Path, tmp_path: Path) -> None:
    result = StudyResult.open(copy)
    write_outcome(outcome_of(result), tmp_path)
    assert (tmp_path / "comparisons.csv").is_file()
    for name in ("equal_error.parquet", "reported.csv", "references.csv"):
        (tmp_path / name).touch()
    write_outcome(outcome_of(result, compare=False), tmp_path, kept=("references",))
    assert sorted(path.name for path in tmp_path.glob("*.csv")) == ["references.csv", "summary.csv"]
    write_outcome(outcome_of(result, compare=False), tmp_path)
    assert sorted(path.name for path in tmp_path.glob("*.*")) == ["summary.csv", "summary.parquet"]


def test_a_study_with_too_few_runs_says_that_nothing_is_compared_at_equal_error(tmp_path: Path) -> None:
    """A precision asks for 100 runs or more, of which some may have failed."""
    store = Store.open_or_create(tmp_path / "a", replace(STUDY, runs=None, until=Precision(0.1)))
    made_up(store, 0, 19)
    made_up(store, 20, 100)
    outcome = outcome_of(StudyResult.open(store.folder), equal_error=True)
    assert "run 0, and 19 runs can be used" in study_document(outcome).warnings[-1]


def test_a_damaged_batch_of_the_second_block_is_reported_and_recomputed(
    copy: Path, caplog: pytest.LogCaptureFixture
) -> None:
    result = StudyResult.open(copy)
    whole = second_block(result).runs()
    shard = next((copy / SECOND / SHARDS).glob("*.parquet"))
    shard.write_bytes(shard.read_bytes()[:-7])
    (damaged,) = study_state(Store.open(copy))["damaged"]
    assert shard.name in damaged
    assert second_block(result).runs().equals(whole)
    assert f"damaged, will be recomputed: {shard.stem}.json: " in caplog.text
    (copy / SECOND / "study.toml").write_text("=")
    (damaged,) = study_state(Store.open(copy))["damaged"]
    assert damaged.endswith("without the folder second-block, its runs are computed again")
    with pytest.raises(InputError, match="without the folder second-block"):
        second_block(result)
