"""The reproduction of a few items: what the command leaves, and that it is continued."""

from __future__ import annotations

from pathlib import Path

import polars as pl
import pytest

from vibroswarm.cli import main
from vibroswarm.paper.cells import study
from vibroswarm.paper.item import Settings, items_named
from vibroswarm.paper.reproduce import reproduce


def test_the_command_leaves_verdicts_tables_and_a_page(tmp_path: Path) -> None:
    out, items = tmp_path / "out", ["difficulty", "fill-ratios"]
    asked = ["--runs", "20", "--columns", "paper,text", "--out", str(out)]
    assert main(["reproduce", "--only", *items, *asked]) == 0
    assert "<svg" in (out / "report.html").read_text(encoding="utf-8")
    measured = pl.read_csv(out / "claims-measured.csv")
    printed = measured.filter(pl.col("claim") == "difficulty-printed")
    assert printed["verdict"].unique().to_list() == ["not reproduced"]
    cells = pl.read_csv(out / "fill-ratios.csv")
    assert cells.height == 2 * 4 * 3
    # Alone, a study gives the same numbers.
    of_study = study("fill-ratios", "text").with_runs(20).run()
    alone = [own["decision_time_s"].mean() for own in of_study.frame.partition_by("cell")]
    assert cells.filter(pl.col("column") == "text")["decision_time_s"].to_list() == pytest.approx(alone)
    # A second call finds its runs.
    done = list[int]()
    settings = Settings(runs=20, columns=("paper", "text"))
    reproduce(settings, out, items_named(items), lambda now: done.append(now.done))
    assert not any(done)
