"""Names of folders that are not Unicode, or that the locale cannot encode."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import polars as pl
import pytest

import vibroswarm
from vibroswarm.cli import main
from vibroswarm.core.atomic_io import write_file
from vibroswarm.core.tables import read_frame, write_frame

NOT_UNICODE = os.fsdecode(b"y\xff")
SHORT = ["--robots", "2", "--set", "run.t_end_s=20"]
STUDY = ["--runs", "2", "--strategy", "none,soft", "--no-confirm", "--no-pictures", "-q"]

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="other systems have no such names")


@pytest.mark.parametrize("name", ["☃" * 85, "a" * 255])
def test_the_longest_names_are_written(name: str, tmp_path: Path) -> None:
    write_file(tmp_path / name, "x")
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_a_table_is_written_and_read_whatever_its_folder_is_called(tmp_path):
    folder = tmp_path / NOT_UNICODE
    folder.mkdir()
    table = pl.DataFrame({"a": [1, 2]})
    write_frame(table, folder / "t.parquet", {"b": "c"})
    assert read_frame(folder / "t.parquet", "t").equals(table)
    assert pl.read_parquet_metadata((folder / "t.parquet").read_bytes())["b"] == "c"


def test_names_that_are_not_unicode(tmp_path, capsys):
    folder = tmp_path / NOT_UNICODE
    folder.mkdir()
    assert main(["run", *SHORT, "--out", str(folder / "run")]) == 0
    assert main(["show", str(folder / "run")]) == 0
    assert main(["show", str(folder / "run" / "robots.parquet")]) == 0
    assert main(["evaluate", *SHORT, *STUDY, "--out", str(folder / "study")]) == 0
    assert main(["show", str(folder / "study")]) == 0
    assert main(["evaluate", *SHORT, *STUDY, "--out", str(folder / "study")]) == 0, "it is resumed"
    assert "Saved in" in capsys.readouterr().out


@pytest.mark.slow
def test_names_that_the_locale_cannot_encode(tmp_path):
    source = str(Path(vibroswarm.__file__).parents[1])
    environment = os.environ | {"PYTHONPATH": source, "PYTHONUTF8": "0", "LC_ALL": "C"}
    for words in (["run", *SHORT, "--out"], ["evaluate", *SHORT, *STUDY, "--out"], ["show"]):
        name = "mäße☃" if words[0] != "evaluate" else "☃"
        done = subprocess.run(
            [sys.executable, "-P", "-m", "vibroswarm", *words, name],
            cwd=tmp_path, env=environment, capture_output=True, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
    assert sorted(path.name for path in tmp_path.iterdir()) == ["mäße☃", "☃"]
