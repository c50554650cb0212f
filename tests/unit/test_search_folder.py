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
from vibroswarm.errors import InputError, warn_once
from vibroswarm.optimize import optuna_samplers
from vibroswarm.optimize.journal import JOURNAL, held
from vibroswarm.optimize.loop import run_search
from vibroswarm.optimize.optuna_samplers import DAMAGED, Dashboard
from vibroswarm.optimize.optuna_samplers import FILE as OPTUNA
from vibroswarm.optimize.search_report import candidate_table
from vibroswarm.optimize.spec import Search

SMALL = (
    Path(__file__).parents[1] / "helpers" / "small_search.toml"
).read_text() + "iterations = 2\n[search]\nfinal = 0\n"
SHOWN = SMALL + "dashboard = true\n"


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


@pytest.mark.parametrize("left", ["to nowhere", "to the journal", "file"])
def test_a_lock_left_behind_is_taken_over(left: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("optuna")
    monkeypatch.setattr(optuna_samplers, "LOCK_S", 0.2)
    monkeypatch.chdir(tmp_path)
    search = Search.from_toml(SHOWN)
    run_search(search, "out/s")
    lock = tmp_path / "out" / "s" / f"{OPTUNA}.lock"
    if left == "file":
        lock.touch()
    else:
        lock.symlink_to(lock.with_suffix("") if left == "to the journal" else Path("out/s") / OPTUNA)
    (tmp_path / "out" / "s" / JOURNAL).write_bytes(b"")
    began_s, busy_s = time.monotonic(), time.process_time()
    run_search(search, "out/s")
    assert time.monotonic() - began_s < 30
    assert time.process_time() - busy_s < 20
    assert not os.path.lexists(lock)


def test_a_lock_that_is_held_is_waited_for(tmp_path: Path) -> None:
    """Negative control: only what does not change is taken over."""
    first, second = optuna_samplers.Lock(tmp_path / OPTUNA), optuna_samplers.Lock(tmp_path / OPTUNA)
    assert first.acquire()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(optuna_samplers, "LOCK_S", 0.4)
        began_s = time.monotonic()
        assert second.acquire()
        assert time.monotonic() - began_s >= 0.4
    second.release()
    first.release()


def test_a_torn_or_damaged_copy_for_optuna_does_not_stop_a_search(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    optuna = pytest.importorskip("optuna")
    warn_once.cache_clear()
    search = Search.from_toml(SHOWN)
    found = run_search(search, tmp_path)
    copy = tmp_path / OPTUNA
    data = copy.read_bytes()
    middle = data.index(b"\n", len(data) // 2) + 1

    def keys() -> list[int]:
        backend = optuna.storages.journal.JournalFileBackend(str(copy))
        (study,) = optuna.get_all_study_names(storage := optuna.storages.JournalStorage(backend))
        trials = optuna.load_study(study_name=study, storage=storage).trials
        return sorted(trial.user_attrs["key"] for trial in trials)

    whole = keys()
    assert len(whole) == len(found.archive)
    for torn in (data[:-5], data[: middle + 20], b"", data[:middle]):
        copy.write_bytes(torn)
        run_search(search, tmp_path)
        assert keys() == whole
        assert not (tmp_path / DAMAGED).exists()
    for damaged in (
        data[:middle] + b"{\n" + data[middle:],
        b"\x00\n" * 9,
        b'{"op_code": 99}\n' + data,
        b"[]\n",
    ):
        copy.write_bytes(damaged)
        with caplog.at_level(logging.WARNING):
            run_search(search, tmp_path)
        assert keys() == whole
        assert (tmp_path / DAMAGED).read_bytes() == damaged
    assert "optuna.journal is damaged" in caplog.text


def test_a_dashboard_knows_its_file_by_its_whole_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A working folder that changes under it, as notebooks do, changes nothing."""
    pytest.importorskip("optuna")
    found = run_search(Search.from_toml(SMALL))
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    monkeypatch.chdir(tmp_path / "a")
    shown = Dashboard(Path(), found.archive, "x")
    monkeypatch.chdir(tmp_path / "b")
    shown.show()
    assert (tmp_path / "a" / OPTUNA).stat().st_size > 1000
    assert not list((tmp_path / "b").iterdir())


@pytest.mark.parametrize("name", ["search.toml", JOURNAL])
def test_a_folder_in_place_of_a_file_of_a_search_is_refused(tmp_path: Path, name: str) -> None:
    (tmp_path / name).mkdir()
    with pytest.raises(InputError, match="exists but is not a search"):
        run_search(Search.from_toml(SMALL), tmp_path)
