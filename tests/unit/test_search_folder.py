"""A search's folder after whatever can befall it: killed processes, two at once, damaged files."""

from __future__ import annotations

import logging
import os
import shutil
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import polars as pl
import pytest

from helpers.commands import output_of, refusal_of
from helpers.forked import FORKED
from helpers.search_functions import steps_of
from vibroswarm.cli import main
from vibroswarm.core.atomic_io import LOCK_FILE, folder_lock
from vibroswarm.core.folders import write_described
from vibroswarm.core.tables import parquet_bytes
from vibroswarm.errors import InputError, RunError
from vibroswarm.optimize.loop import run_search
from vibroswarm.optimize.search_files import candidate_table
from vibroswarm.optimize.spec import Search
from vibroswarm.optimize.steps import held

SMALL = (
    Path(__file__).parents[1] / "helpers" / "small_search.toml"
).read_text() + "iterations = 2\n[search]\nfinal = 0\n"


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, pl.DataFrame]:
    """A search that is done: its folder and its candidates."""
    folder = tmp_path_factory.mktemp("done") / "s"
    return folder, candidate_table(run_search(Search.from_toml(SMALL), folder))


@pytest.fixture
def whole(done: tuple[Path, pl.DataFrame]) -> pl.DataFrame:
    return done[1]


@pytest.fixture
def folder(done: tuple[Path, pl.DataFrame], tmp_path: Path) -> Path:
    """A copy of the folder."""
    return Path(shutil.copytree(done[0], tmp_path / "s"))


def hold(folder: Path, ready: object) -> None:
    with folder_lock(folder):
        ready.set()  # type: ignore[attr-defined]
        time.sleep(60)


def test_a_second_search_is_refused_in_words_and_may_begin_when_the_first_was_killed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, file = tmp_path / "s", tmp_path / "search.toml"
    file.write_text(SMALL)
    command = ["optimize", str(file), "--fresh", "10", "--no-pictures", "--out", str(folder)]
    assert main(command) == 0
    before = steps_of(folder)
    ready = FORKED.Event()
    other = FORKED.Process(target=hold, args=(folder, ready))
    other.start()
    try:
        assert ready.wait(30)
        said = refusal_of(capsys, *command)
        assert f"{folder}: is in use by process {other.pid} on " in said
    finally:
        other.kill()
        other.join()
    assert (folder / LOCK_FILE).exists(), "left behind, and no obstacle"
    assert main(command) == 0
    assert not (folder / LOCK_FILE).exists()
    assert steps_of(folder) == before


def test_two_in_one_process_are_two(tmp_path: Path) -> None:
    with (
        folder_lock(tmp_path),
        pytest.raises(InputError, match=f"in use by process {os.getpid()}"),
        folder_lock(tmp_path),
    ):
        pass
    with folder_lock(tmp_path):
        assert (tmp_path / LOCK_FILE).exists()
    assert not (tmp_path / LOCK_FILE).exists()


@pytest.mark.skipif(os.name != "posix", reason="links and pipes of POSIX")
def test_what_is_in_the_place_of_a_lock_is_refused_and_stays(tmp_path: Path) -> None:
    """What a link led to was overwritten; a folder let several processes in; a pipe failed as "Invalid argument"."""
    other, lock = tmp_path / "other.txt", tmp_path / LOCK_FILE
    other.write_text("precious")
    for make in (lambda: lock.symlink_to(other), lambda: os.mkfifo(lock), lock.mkdir):
        make()
        with pytest.raises(InputError, match="in the place of a file: move it away"), folder_lock(tmp_path):
            pass
        lock.rename(tempfile.mkdtemp(dir=tmp_path) if lock.is_dir() else tmp_path / "away")
    assert other.read_text() == "precious"


def test_a_folder_that_was_begun_is_gone_on_with(whole: pl.DataFrame, tmp_path: Path) -> None:
    """The kill that was no longer gone on with: after the search, before the head."""
    search = Search.from_toml(SMALL)
    for names in ([], ["search.toml"], [".search.toml.abc", ".lock"]):
        folder = tmp_path / f"begun {len(names)}{names[:1]}"
        folder.mkdir()
        for name in names:
            (folder / name).write_text(search.to_toml() if name == "search.toml" else "")
        assert candidate_table(run_search(search, folder)).equals(whole)
    for name, text in (("search.toml", "seed = 4\n"), ("notes.txt", "")):
        folder = tmp_path / f"foreign {name}"
        folder.mkdir()
        (folder / name).write_text(text)
        with pytest.raises(InputError, match="is not a search"):
            run_search(search, folder)
        assert [path.name for path in folder.iterdir()] == [name]


STEP = "00002.parquet"


def rewritten(change: Callable[[pl.DataFrame], pl.DataFrame]) -> Callable[[Path], None]:
    """Change the table of a step, and its description too, as no accident does."""

    def write(path: Path) -> None:
        data = parquet_bytes(change(pl.read_parquet(path)))
        write_described(path.parent, path.stem, "step", {"step": data})

    return write


def changed(**columns: pl.Expr) -> Callable[[Path], None]:
    return rewritten(lambda table: table.with_columns(**columns))


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-9])


DAMAGES: dict[str, Callable[[Path], None]] = {
    "torn": cut,
    "empty": lambda path: path.write_bytes(b""),
    "other bytes": lambda path: path.write_bytes(b"PAR1" + b"\0" * 50 + b"PAR1"),
    "other figures": lambda path: (
        pl.read_parquet(path).with_columns(pl.col("figure_0") + 1).write_parquet(path)
    ),
    "no rows": rewritten(lambda table: table.clear()),
    "a figure less": rewritten(lambda table: table.drop("figure_0")),
    "a figure more": changed(figure_1=pl.lit(1.0)),
    "a figure of words": changed(figure_0=pl.lit("1")),
    "no number": changed(figure_0=pl.lit(float("nan"))),
    "no figure": changed(figure_0=pl.lit(None, dtype=pl.Float64)),
    "figures of a failed run": changed(failed=pl.lit("why")),
    "no candidate": changed(candidate=pl.lit(None, dtype=pl.UInt32)),
    "a row twice": changed(run=pl.lit(0, dtype=pl.UInt32)),
    "a folder": lambda path: (path.unlink(), path.mkdir())[1],
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_step_is_said_and_its_runs_repeated(
    damage: str,
    whole: pl.DataFrame,
    folder: Path,
    capsys: pytest.CaptureFixture[str],
    caplog: pytest.LogCaptureFixture,
) -> None:
    search = Search.from_toml(SMALL)
    before, path = steps_of(folder), folder / "steps" / STEP
    DAMAGES[damage](path)
    with caplog.at_level(logging.WARNING):
        assert held(folder)["steps"] == len(before) - 1
    assert str(path) in caplog.text
    said = output_of(capsys, "show", str(folder))
    assert "to resume" in said
    if path.is_dir():
        with pytest.raises(InputError, match=r"is in the place of a file"):
            run_search(search, folder)
        path.rmdir()
    assert candidate_table(run_search(search, folder)).equals(whole)
    assert steps_of(folder) == before


def test_a_step_of_other_requests_is_refused(folder: Path) -> None:
    search = Search.from_toml(SMALL)
    path = folder / "steps" / STEP
    for change in (
        changed(candidate=pl.col("candidate") + 1),
        changed(origin=pl.lit("other")),
        changed(run=pl.col("run") + 1),
    ):
        kept = pl.read_parquet(path)
        change(path)
        with pytest.raises(RunError, match="requests other runs than this folder holds"):
            run_search(search, folder)
        rewritten(lambda table, kept=kept: kept)(path)
    run_search(search, folder)  # control


@pytest.mark.parametrize("damage", ["", "[search\n", "seed = 4\n", None])
def test_a_damaged_definition_is_refused_when_its_search_is_resumed(
    tmp_path: Path, whole: pl.DataFrame, damage: str | None
) -> None:
    search, file = Search.from_toml(SMALL), tmp_path / "search.toml"
    assert candidate_table(run_search(search, tmp_path)).equals(whole)
    text = file.read_text(encoding="utf-8")
    file.unlink() if damage is None else file.write_text(damage, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        run_search(search, tmp_path)
    assert str(file) in str(caught.value)
    file.write_text(text, encoding="utf-8")
    assert candidate_table(run_search(search, tmp_path)).equals(whole)  # control


@pytest.mark.parametrize("name", ["search.toml", "vibroswarm.json"])
def test_a_folder_in_place_of_a_file_of_a_search_is_refused(tmp_path: Path, name: str) -> None:
    (tmp_path / name).mkdir()
    with pytest.raises(InputError, match=r"exists but is not a search|is a folder"):
        run_search(Search.from_toml(SMALL), tmp_path)


def test_the_fields_of_space_keep_their_order_in_the_folder_and_another_order_is_refused(
    tmp_path: Path,
) -> None:
    gate = '"decision.gate" = ["own", "total"]\n'
    search = Search.from_toml(SMALL.replace("[pso]", f"{gate}[pso]"))
    run_search(search, tmp_path, workers=1)
    assert Search.read(tmp_path / "search.toml").space == search.space
    moved = Search.from_toml(SMALL.replace("[space]", f"[space]\n{gate}"))
    assert moved.hash == search.hash
    with pytest.raises(
        InputError, match=r"order of the fields of space is .*min_observations.*decision.gate.* there"
    ):
        run_search(moved, tmp_path)
