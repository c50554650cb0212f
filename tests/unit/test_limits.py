"""Limits are stated, and hold before memory is taken."""

from __future__ import annotations

import os
import stat
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from vibroswarm.core.atomic_io import write_file
from vibroswarm.errors import InputError
from vibroswarm.floors import grid_text
from vibroswarm.floors.io import read_tiles
from vibroswarm.observation import measured_csv
from vibroswarm.observation.measured_csv import read_energies
from vibroswarm.recordings.column_map import column_map
from vibroswarm.recordings.log_readers import read_log
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.study.spec import Study

READERS: list[Callable[[Path], Any]] = [
    read_tiles, read_energies, read_log, Scenario.read, Study.read, lambda path: read_log(__file__, columns=path),
]  # fmt: skip
NAMES = ("floor", "energies", "log", "scenario", "study", "column map")


@pytest.mark.parametrize("read", READERS, ids=NAMES)
def test_a_large_file_is_refused_before_it_is_read(read: Callable[[Path], Any], tmp_path: Path) -> None:
    path = tmp_path / "large"
    with path.open("wb") as stream:
        stream.truncate(470_000_000)  # of zeros, that take no room on the disk
    tracemalloc.start()
    with pytest.raises(InputError, match=r"is larger than .*; that is not"):
        read(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1_000_000


@pytest.mark.parametrize("read", READERS, ids=NAMES)
@pytest.mark.parametrize(
    ("kind", "words"),
    [("pipe", "regular"), ("device", "regular"), ("folder", "is a folder"), ("loop", "cannot be read")],
)
def test_what_may_never_end_is_not_opened(
    read: Callable[[Path], Any], kind: str, words: str, tmp_path: Path
) -> None:
    path = tmp_path / "it"
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    else:
        path.symlink_to("/dev/zero" if kind == "device" else path.name)
    with pytest.raises(InputError, match=words):
        read(path)


@pytest.mark.parametrize("text", ["0,1\n" * 40, "0\r" * 40, "1\n" * 11])
def test_a_floor_of_too_many_lines_is_refused(
    text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(grid_text, "MAX_LINES", 10)
    path = tmp_path / "floor.txt"
    path.write_text(text)
    with pytest.raises(InputError, match=r"10 lines|at most 10"):
        read_tiles(path, (1000, 2000))
    path.write_text("0 1\n" * 10)
    assert read_tiles(path).shape == (10, 2)


def test_a_floor_of_too_many_tiles_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(grid_text, "TILE_LIMIT", 12)
    path = tmp_path / "floor.txt"
    for text in ("0 " * 13, "0,1,1\n" * 5, "0" * 13):
        path.write_text(text)
        with pytest.raises(InputError, match="12 tiles"):
            read_tiles(path)


def test_too_many_energies_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(measured_csv, "MAX_ENERGIES", 3)
    path = tmp_path / "energies.csv"
    path.write_text("kind,energy\nstill,0.5\n" + "vibrating,2\n" * 3)
    assert read_energies(path) == ((2.0, 2.0, 2.0), (0.5,))
    path.write_text("kind,energy\nstill,0.5\n" + "vibrating,2\n" * 4)
    with pytest.raises(InputError, match="more than 3 energies"):
        read_energies(path)


def test_a_column_map_is_no_place_for_wrong_types() -> None:
    for text in (
        "columns = 3",
        "[columns]\nrobot = 1",
        "missing = [1]\n[columns]",
        "[columns.robot]\nname = []",
        "[columns.robot]\nname = 'id'\ntimes = 18446744073709551616",
        "[columns.robot]\nname = 'id'\ntimes = " + "9" * 400,
    ):
        with pytest.raises(InputError):
            column_map(text, "map")
    with pytest.raises(InputError, match="enery: unknown column, did you mean 'energy'"):
        column_map('[columns]\nrobot = "r"\nenery = "e"', "map")


def test_a_result_folder_that_is_a_pipe_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "it")
    with pytest.raises(InputError):
        Result.read(tmp_path / "it")


def test_a_device_is_not_replaced_by_a_file(tmp_path: Path) -> None:
    """A file is renamed to its name when it is whole: with the rights to do so, ``/dev/null`` would be lost."""
    os.mkfifo(tmp_path / "pipe.toml")
    with pytest.raises(InputError, match="is a device or a pipe"):
        write_file(tmp_path / "pipe.toml", "text")
    assert stat.S_ISFIFO((tmp_path / "pipe.toml").stat().st_mode)
    assert len(list(tmp_path.iterdir())) == 1
