from __future__ import annotations

import numpy as np
import pytest

from helpers.commands import json_of, output_of, refusal_of
from vibroswarm.cli import main
from vibroswarm.floors.difficulty import measure
from vibroswarm.floors.io import read_tiles
from vibroswarm.floors.source import NAMES


def tables(capsys, *words):
    """The tables that a command prints as JSON."""
    return json_of(capsys, "floors", *words, "--json")["tables"]


def test_list_names_every_pattern(capsys):
    lines = output_of(capsys, "floors", "list").splitlines()
    assert [line.split()[0] for line in lines[3 : 3 + len(NAMES)]] == list(NAMES)
    assert lines[3].split()[1:] == ["10x10", "48", "0.4800", "0.734", "1.000", "1"]


def test_list_as_json(capsys):
    found = {entry["floor"]: entry for entry in tables(capsys, "list")["floors"]}
    assert found["alternating:0.46"]["ones"] == 46
    assert found["alternating:paper-0.46"]["moran_index"] == pytest.approx(-0.9145, abs=1e-4)


def test_list_with_the_papers_table(capsys):
    lines = output_of(capsys, "floors", "list", "--paper").splitlines()
    assert [line.split()[0] for line in lines if line.endswith("differs")] == [
        "diagonal:0.46",
        "stripe:0.46",
        "alternating:0.46",
        "random-fixed:0.46",
    ]
    assert sum(entry["wrong"] for entry in tables(capsys, "list", "--paper")["difficulty"]) == 4


def test_show_draws_here_and_to_a_file(capsys, tmp_path):
    path = tmp_path / "f.svg"
    command = ("floors", "show", "stripe:0.46", "--out", path)
    out = output_of(capsys, *command)
    assert "fill ratio 0.46, Moran index 0.876, entropy 1.000, 1 cluster." in " ".join(out.split())
    assert out.splitlines()[-1] == f"Saved: {path}"
    assert path.read_text().startswith("<?xml")
    assert "--force" in refusal_of(capsys, *command)
    output_of(capsys, *command, "--force")


def test_show_tells_seeds_apart(capsys):
    command = ("floors", "show", "random:0.48", "--tiles", "10x10", "--seed")
    outs = [output_of(capsys, *command, seed) for seed in (1, 1, 2)]
    assert outs[0] == outs[1] != outs[2]


@pytest.mark.parametrize(
    "words", [("show", "diagonal:0.48"), ("measure", "diagonal:0.48", "hill:0.3,0.6,0.2")]
)
def test_a_seed_where_no_floor_is_random_is_refused(words, capsys):
    assert "--seed: applies to random floors, not to 'diagonal:0.48'" in refusal_of(
        capsys, "floors", *words, "--seed", 0
    )
    output_of(capsys, "floors", "measure", "random:0.48", "diagonal:0.48", "--seed", 3)


def test_measure_as_text_and_json(capsys, tmp_path, monkeypatch):
    monkeypatch.setenv("COLUMNS", "400")  # paths may be long
    (tmp_path / "still.txt").write_text("000\n000\n")
    lines = output_of(capsys, "floors", "measure", tmp_path / "still.txt", "diagonal:0.48").splitlines()
    assert lines[3].split()[1:] == ["2x3", "0", "0.0000", "-", "-", "0"]
    assert lines[4].split()[1:] == ["10x10", "48", "0.4800", "0.734", "1.000", "1"]
    (entry,) = tables(capsys, "measure", tmp_path / "still.txt")["floors"]
    assert entry["moran_index"] is None
    assert entry["fill_ratio"] == 0


@pytest.mark.parametrize("suffix", ["txt", "csv", "png"])
def test_make_writes_what_it_made(capsys, tmp_path, suffix):
    path = tmp_path / f"made.{suffix}"
    words = ("make", "--tiles", "10x12", "--fill-ratio", 0.45, "--moran", 0.4, "--entropy", 0.8, "--seed", 2)
    printed = tables(capsys, *words, "--out", path)
    found = measure(read_tiles(path))
    (made,) = printed["floors"]
    assert made["reached"] is True
    assert printed["asked"] == [{"fill_ratio": 0.45, "moran_index": 0.4, "entropy": 0.8}]
    assert made["moran_index"] == found.moran_index == pytest.approx(0.4, abs=0.02)
    assert made["entropy"] == found.entropy == pytest.approx(0.8, abs=0.02)
    rows = [[int(tile) for tile in row["row"]] for row in printed["tiles"]]
    assert np.array_equal(rows, read_tiles(path))
    assert "exists already" in refusal_of(capsys, "floors", *words, "--out", path)
    assert "made: 10 x 12 tiles of which 54 vibrate" in output_of(
        capsys, "floors", *words, "--out", path, "--force"
    )


def test_make_says_and_gives_the_nearest_with_exit_code_1(capsys, tmp_path):
    path = tmp_path / "near.txt"
    asked = ("--tiles", "5x5", "--fill-ratio", "0.48", "--moran", "0.95")
    assert main(["floors", "make", *asked, "--out", str(path)]) == 1
    assert "The nearest found has fill ratio 0.48, Moran index 0.699" in capsys.readouterr().out
    assert measure(read_tiles(path)).moran_index == pytest.approx(0.699, abs=1e-3)


def test_make_refuses_before_it_works(capsys, tmp_path, monkeypatch):
    monkeypatch.setattr("vibroswarm.floors.design.make_floor", None)
    make, old = ("floors", "make", "--fill-ratio", "0.48", "--moran", "0"), tmp_path / "old.txt"
    old.touch()
    assert "--tiles: '5' is not a size" in refusal_of(capsys, *make, "--tiles", "5")
    for out, words in ((tmp_path / "a.gif", "end the name with"), (old, "exists already")):
        assert words in refusal_of(capsys, *make, "--tiles", "5x5", "--out", out)


def test_patches_are_shown_where_they_are(capsys):
    answer, *drawing = output_of(capsys, "floors", "show", "patch:0.3@0.5", "--seed", 3).splitlines()
    assert answer == "1 patch on a still floor: fill ratio 0.045."
    cells = [line for line in drawing if len(line) == 80 and not set(line) - set("#.·█")]
    marked = np.array([[mark in "#█" for mark in line[::2]] for line in cells])
    rows, columns = marked.any(axis=1).sum(), marked.any(axis=0).sum()
    assert marked.sum() == rows * columns
    assert {12, 13} >= {rows, columns}  # 0.3 m in cells of 25 mm
    x_m, y_m = (float(word) for word in drawing[-1].split()[1:3])
    middle = (
        (marked.any(axis=0).nonzero()[0].mean() + 0.5) / 40,
        1 - (marked.any(axis=1).nonzero()[0].mean() + 0.5) / 40,
    )
    assert np.abs(np.subtract(middle, (x_m, y_m))).max() < 0.02
    assert tables(capsys, "measure", "patch:0.3@0.5")["floors"][0]["fill_ratio"] == pytest.approx(0.045)
