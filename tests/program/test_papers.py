"""The experiments of others run by the command on their pages, and show the direction that the pages state."""

from __future__ import annotations

from pathlib import Path

import polars as pl
import pytest

from vibroswarm.cli import main
from vibroswarm.study.study_result import StudyResult

PAPERS = Path(__file__).parents[2] / "examples" / "papers"


@pytest.mark.slow
def test_cross_inhibition_makes_agreements_last(tmp_path: Path) -> None:
    study, out = PAPERS / "zakir-2022" / "study.toml", tmp_path / "zakir"
    command = [
        "evaluate",
        str(study),
        "--trust",
        "--no-confirm",
        "--no-pictures",
        "--runs",
        "30",
        "--out",
        str(out),
    ]
    assert main(command) == 0
    summary = StudyResult.open(out).summary().filter(pl.col("strategy.opinions.asocial") == 0.05)
    lasted = dict(
        summary.filter(pl.col("floor.source") == "random:0.5")
        .select("strategy.opinions.inhibits", "agreement_lasted")
        .iter_rows()
    )
    assert lasted[True] > lasted[False] + 0.15
