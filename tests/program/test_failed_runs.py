"""Runs that the source of motion gives up are counted and named in a study: table, report, results, JSON."""

from __future__ import annotations

from pathlib import Path

import polars as pl
import pytest

from helpers.commands import json_of, words_of
from vibroswarm.motion.fixed_step import FixedStepRun
from vibroswarm.motion.motion_tables import Failure
from vibroswarm.motion.source import Source, register
from vibroswarm.study.spec import Study

FAILED = (1, 4)
AT_TICK = 500


class FailingRun(FixedStepRun):
    """Gives up runs 1 and 4 at 10 s, where robots stand from then on."""

    def move_on(self, until: int) -> int:
        if self.run in FAILED and until > AT_TICK:
            if self.failure is None:
                self.failure = Failure(self.run, AT_TICK * self.tick_ms / 1000.0, "the test wants it")
            return until
        return super().move_on(until)


@pytest.fixture
def failing() -> str:
    register(Source("gives-up", FailingRun, is_ours=True))
    return "gives-up"


BRIEF = ["--set", "run.t_end_s=30", "--robots", "2", "--runs", "6", "--strategy", "none,soft", "--quiet"]


@pytest.mark.usefixtures("one_picture")
def test_failed_runs_are_counted_in_table_report_and_results(
    failing: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "study"
    printed = words_of(capsys, "evaluate", *BRIEF, "--motion", failing, "--out", out)
    words = (
        "none and soft: 2 of 6 runs failed in the source of motion; the robots have stood still since and "
        "count as undecided (run 1 at 10 s: the test wants it)."
    )
    assert "failed runs" in printed
    assert f"Warning: {words}" in printed
    page = (out / "report.html").read_text()
    assert "failed runs" in page
    assert words in " ".join(page.split())
    assert pl.read_csv(out / "summary.csv")["failed_runs"].to_list() == [2, 2]
    frame = Study.open(out)[1].frame
    assert frame.drop_nulls("failed").select("cell", "run", "failed_s").rows() == [
        (cell, run, 10.0) for cell in (0, 1) for run in FAILED
    ]
    assert frame["robots_undecided"].to_list()[1] == 2
    summary = json_of(capsys, "evaluate", *BRIEF, "--motion", failing, "--json")["tables"]["summary"]
    assert [cell["failed_runs"] for cell in summary] == [2, 2]
