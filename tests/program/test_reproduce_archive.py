"""Archives of a reproduction: what they hold, and the same bytes again."""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
from pathlib import Path

import polars as pl
import pytest

from helpers.commands import refusal_of
from vibroswarm.cli import main
from vibroswarm.paper.archive import HEAD

Entries = dict[str, bytes]
ASKED = ["reproduce", "--only", "fill-ratios", "--columns", "paper", "--runs", "12", "--no-pictures"]


@pytest.fixture(scope="module")
def archive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of one item, twelve cells of 12 runs; in the folder of the results."""
    path = tmp_path_factory.mktemp("archive") / "out" / "paper.zip"
    assert main([*ASKED, "--out", str(path.parent), "--archive", str(path)]) == 0
    return path


def _entries(path: Path) -> Entries:
    with zipfile.ZipFile(path) as file:
        return {name: file.read(name) for name in file.namelist()}


def test_an_archive_holds_what_is_needed_and_no_more(archive: Path) -> None:
    entries = _entries(archive)
    head = json.loads(entries[HEAD])
    cells = pl.read_csv(io.BytesIO(entries["cells.csv"]))
    assert cells.height == 12
    assert {f"scenarios/{name}.toml" for name in cells["scenario"]} <= set(entries)
    assert head["sha256"] == {n: hashlib.sha256(d).hexdigest() for n, d in entries.items() if n != HEAD}
    assert {"vibroswarm", "numba", "architecture", "code"} <= set(head["versions"])
    assert not any(name.endswith((".pkl", ".pickle", ".parquet")) for name in entries)


def test_the_same_reproduction_gives_the_same_bytes(archive: Path, tmp_path: Path) -> None:
    """And the archive in the folder is no strange file, for which the same command would be refused."""
    before = archive.read_bytes()
    for path in (tmp_path / "again.zip", archive):
        assert main([*ASKED, "--out", str(archive.parent), "--archive", str(path)]) == 0
        assert path.read_bytes() == before


def test_an_archive_that_cannot_be_written_is_refused_before_the_work(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It was refused after hours of work, without a report, in the name of --out."""
    for archive in (tmp_path, tmp_path / "nowhere" / "paper.zip"):
        assert "error: --archive: " in refusal_of(
            capsys, "reproduce", "--out", str(tmp_path / "out"), "--archive", str(archive)
        )
        assert not (tmp_path / "out" / "tables").exists()
