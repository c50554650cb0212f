"""The reproduction of a few items: what is computed, kept, taken again, and shown."""

from __future__ import annotations

from pathlib import Path

import polars as pl
import pytest

from helpers.commands import json_of
from vibroswarm.cli import main
from vibroswarm.paper.item import Settings
from vibroswarm.paper.items import items_named
from vibroswarm.paper.reproduce import reproduce

RUNS = 40
NAMES = ["difficulty", "fill_ratios"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The command's output for two items and two columns."""
    out = tmp_path_factory.mktemp("paper") / "out"
    asked = ["--runs", str(RUNS), "--columns", "paper,text", "--pictures", "--out", str(out)]
    assert main(["reproduce", "--only", *NAMES, *asked]) == 0
    return out


def test_the_command_leaves_report_tables_and_pictures(folder: Path) -> None:
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "<svg" in page
    assert "reproduce --only fill-ratios --runs 40 --seed 1 --columns paper,text" in page
    assert "inconclusive: 40 runs are too few to decide; use " in page
    assert 'src="http' not in page
    captions = pl.read_csv(folder / "pictures" / "captions.csv")
    assert captions.height == 6 + 3
    for name in captions["name"]:
        for kind in ("svg", "pdf", "csv"):
            assert (folder / "pictures" / f"{name}.{kind}").stat().st_size > 100
    cells = pl.read_csv(folder / "tables" / "fill-ratios-cells.csv")
    assert cells.height == 2 * 4 * 3
    shares = pl.col("robots_right") + pl.col("robots_wrong") + pl.col("robots_undecided")
    assert (cells.select(shares).to_series() - 1.0).abs().max() < 1e-9  # type: ignore[operator]


def test_one_cell_alone_gives_the_same_numbers(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cells = pl.read_csv(folder / "tables" / "fill-ratios-cells.csv")
    row = cells.filter((pl.col("column") == "text") & (pl.col("strategy") == "soft")).row(1, named=True)
    words = row["command"].split()[1:]
    (told,) = json_of(capsys, *words, "--json")["tables"]["summary"]
    assert told["decision_time_s"] == row["decision_time_s"]
    assert told["belief_in_truth_low"] == row["belief_in_truth_low"]


def test_a_second_run_takes_what_is_there(folder: Path) -> None:
    settings = Settings(runs=RUNS, columns=("paper", "text"))
    told: list[str] = []
    made = reproduce(settings, folder, items_named(NAMES), lambda what, share: told.append(what))
    assert told == []
    assert {one.claim.item for one in made.decided} == {"difficulty", "fill-ratios"}
