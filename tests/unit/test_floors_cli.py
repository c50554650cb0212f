from __future__ import annotations

import pytest

from helpers.commands import json_of, output_of, refusal_of
from vibroswarm.floors.difficulty import measure
from vibroswarm.floors.io import read_tiles


def tables(capsys, *words):
    """The tables that a command prints as JSON."""
    return json_of(capsys, "floors", *words, "--json")["tables"]


def test_measure_as_text_and_json(capsys, tmp_path, monkeypatch):
    monkeypatch.setenv("COLUMNS", "400")  # paths may be long
    (tmp_path / "still.txt").write_text("000\n000\n")
    assert "0.734" in output_of(capsys, "floors", "measure", tmp_path / "still.txt", "diagonal:0.48")
    (entry,) = tables(capsys, "measure", tmp_path / "still.txt")["floors"]
    assert entry["moran_index"] is None
    assert entry["fill_ratio"] == 0


@pytest.mark.parametrize("suffix", ["txt", "csv", "png"])
def test_make_writes_what_it_made(capsys, tmp_path, suffix):
    path = tmp_path / f"made.{suffix}"
    words = ("make", "--tiles", "10x12", "--fill-ratio", 0.45, "--moran", 0.4, "--entropy", 0.8, "--seed", 2)
    (made,) = tables(capsys, *words, "--out", path)["floors"]
    found = measure(read_tiles(path))
    assert made["moran_index"] == found.moran_index == pytest.approx(0.4, abs=0.02)
    assert made["entropy"] == found.entropy == pytest.approx(0.8, abs=0.02)
    assert "exists already" in refusal_of(capsys, "floors", *words, "--out", path)
    output_of(capsys, "floors", *words, "--out", path, "--force")
