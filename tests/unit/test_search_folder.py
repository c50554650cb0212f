"""A search's folder after whatever can befall it: killed processes, two at once, damaged files."""

from __future__ import annotations

import logging
import multiprocessing
import os
import time
from pathlib import Path

import pytest

from vibroswarm.cli import main
from vibroswarm.core.atomic_io import LOCK_FILE, folder_lock
from vibroswarm.errors import InputError
from vibroswarm.optimize.journal import JOURNAL, held
from vibroswarm.optimize.loop import run_search
from vibroswarm.optimize.search_files import candidate_table
from vibroswarm.optimize.spec import Search

SMALL = (
    Path(__file__).parents[1] / "helpers" / "small_search.toml"
).read_text() + "iterations = 2\n[search]\nfinal = 0\n"


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
    before = (folder / JOURNAL).read_bytes()
    spawn = multiprocessing.get_context("spawn")
    ready = spawn.Event()
    other = spawn.Process(target=hold, args=(folder, ready))
    other.start()
    try:
        assert ready.wait(30)
        assert main(command) == 2
        said = capsys.readouterr().err
        assert f"{folder}: is in use by process {other.pid} on " in said
    finally:
        other.kill()
        other.join()
    assert (folder / LOCK_FILE).exists(), "left behind, and no obstacle"
    assert main(command) == 0
    assert not (folder / LOCK_FILE).exists()
    assert (folder / JOURNAL).read_bytes() == before


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


def test_a_folder_that_was_begun_is_gone_on_with(tmp_path: Path) -> None:
    """The kill that was no longer gone on with: after the search, before the head."""
    search = Search.from_toml(SMALL)
    whole = candidate_table(run_search(search, tmp_path / "whole"))
    for names in ([], ["search.toml"], ["search.toml", JOURNAL], [".search.toml.abc", ".lock"]):
        folder = tmp_path / f"begun {len(names)}{names[:1]}"
        folder.mkdir()
        for name in names:
            (folder / name).write_text(search.to_toml() if name == "search.toml" else "")
        assert candidate_table(run_search(search, folder)).equals(whole)
    for name, text in (("search.toml", "seed = 4\n"), (JOURNAL, "{}\n"), ("notes.txt", "")):
        folder = tmp_path / f"foreign {name}"
        folder.mkdir()
        (folder / name).write_text(text)
        with pytest.raises(InputError, match="is not a search"):
            run_search(search, folder)
        assert [path.name for path in folder.iterdir()] == [name]


@pytest.mark.parametrize(
    "damaged",
    [b"{", b"\x00\x00", b"[]", b"3", b'{"asks": [[0, 1]], "origins": ["x"], "values": [], "found": [[]]}',
     b'{"asks": [[0, 1]], "origins": ["x"], "values": [], "found": [["", ""]]}', b"[" * 5000],
)  # fmt: skip
def test_a_damaged_line_is_named_by_all_who_read_it(
    damaged: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    search = Search.from_toml(SMALL)
    run_search(search, tmp_path)
    journal = tmp_path / JOURNAL
    lines = journal.read_bytes().split(b"\n")
    journal.write_bytes(b"\n".join([lines[0], damaged, *lines[2:]]))
    for read in (lambda: held(tmp_path), lambda: run_search(search, tmp_path)):
        with pytest.raises(InputError, match="line 2 is damaged"):
            read()
    assert main(["show", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert str(journal) in said
    assert "line 2 is damaged" in said


def test_a_torn_last_line_is_dropped_and_said(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    search = Search.from_toml(SMALL)
    run_search(search, tmp_path)
    journal = tmp_path / JOURNAL
    data = journal.read_bytes()
    run_search(search, tmp_path)
    assert not caplog.records, "nothing was torn"
    journal.write_bytes(data[:-9])
    with caplog.at_level(logging.WARNING):
        run_search(search, tmp_path)
    assert [f"{journal}: the last line is incomplete" in r.getMessage() for r in caplog.records] == [True]
    assert journal.read_bytes() == data


@pytest.mark.parametrize("name", ["search.toml", JOURNAL])
def test_a_folder_in_place_of_a_file_of_a_search_is_refused(tmp_path: Path, name: str) -> None:
    (tmp_path / name).mkdir()
    with pytest.raises(InputError, match="exists but is not a search"):
        run_search(Search.from_toml(SMALL), tmp_path)
