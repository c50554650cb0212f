"""Runs that the source of motion gives up are counted and named in a study: table, report, results, JSON."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import polars as pl
import pytest

from helpers.commands import json_of, output_of, words_of
from vibroswarm import Study
from vibroswarm.motion.fixed_step import FixedStepRun
from vibroswarm.motion.kernel_run import batch_of
from vibroswarm.motion.recorder import Failure
from vibroswarm.motion.source import Source, register
from vibroswarm.study.store import Store
from vibroswarm.study.study_result import StudyResult
from vibroswarm.study.summary import outcome_of

FAILED = (1, 4)
AT_TICK = 500


class FailingRun(FixedStepRun):
    """Gives up runs 1 and 4 at 10 s, where robots stand from then on."""

    def move_on(self, until: int) -> int:
        if self.run in FAILED and until > AT_TICK:
            if self.failure is None:
                self.failure = Failure(self.run, AT_TICK, "the test wants it")
            return until
        return super().move_on(until)


@pytest.fixture
def failing() -> str:
    register(Source("gives-up", FailingRun, partial(batch_of, FailingRun), is_ours=True))
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
    result = StudyResult.open(out)
    assert result.failed_runs().select("cell", "run", "time_s").rows() == [
        (cell, run, 10.0) for cell in (0, 1) for run in FAILED
    ]
    assert result.failed_runs(1)["strategy.name"].unique().to_list() == ["soft"]
    assert result.summary()["failed_runs"].to_list() == [2, 2]
    assert result.runs(0)["undecided"].to_list()[1] == 2
    summary = json_of(capsys, "evaluate", *BRIEF, "--motion", failing, "--json")["tables"]["summary"]
    assert [cell["failed_runs"] for cell in summary] == [2, 2]


@pytest.mark.usefixtures("one_picture")
def test_a_study_whose_runs_all_end_says_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "study"
    assert "failed" not in output_of(capsys, "evaluate", *BRIEF, "--motion", "fixed-step", "--out", out)
    assert "failed" not in (out / "report.html").read_text()
    result = StudyResult.open(out)
    assert "failed_runs" not in result.summary().columns
    assert result.failed_runs().is_empty()
    assert {"cell", "strategy.name", "run", "time_s", "reason"} <= set(result.failed_runs().columns)


def test_a_run_that_fails_after_the_end_of_a_shorter_cell_has_not_failed_there(failing: str) -> None:
    study = Study(
        base={"swarm": {"robots": 2}}, vary={"grid": {"run.t_end_s": [8.0, 30.0]}}, runs=6, motion=failing
    )
    assert [cell.failed.height for cell in outcome_of(study.run()).cells] == [0, 2]


def test_a_failed_run_that_two_shards_hold_is_listed_once(failing: str, tmp_path: Path) -> None:
    study = Study(base={"run": {"t_end_s": 30.0}, "swarm": {"robots": 2}}, runs=6, motion=failing)
    result = study.run(tmp_path / "study")
    result.store.by_group[0] *= 2
    assert result.failed_runs()["run"].to_list() == list(FAILED)


def test_a_damaged_list_of_failed_runs_is_reported(failing: str, tmp_path: Path) -> None:
    study = Study(base={"run": {"t_end_s": 30.0}, "swarm": {"robots": 2}}, runs=6, motion=failing)
    study.run(tmp_path / "study")
    (shard,) = (tmp_path / "study" / "shards").glob("*.failures.parquet")
    shard.write_bytes(shard.read_bytes()[:-9])
    (words,) = Store.open(tmp_path / "study").damaged
    assert shard.name in words
