"""Runs that the source of motion gives up are counted in a study, and named in its frame."""

from __future__ import annotations

from pathlib import Path

import polars as pl

from vibroswarm.cli import main
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


def test_failed_runs_are_counted(tmp_path: Path) -> None:
    register(Source("gives-up", FailingRun, is_ours=True))
    out = tmp_path / "study"
    brief = ["--set", "run.t_end_s=30", "--robots", "2", "--runs", "6", "--strategy", "none,soft"]
    assert main(["evaluate", *brief, "--motion", "gives-up", "--out", str(out), "--no-pictures"]) == 0
    assert pl.read_csv(out / "summary.csv")["failed_runs"].to_list() == [2, 2]
    frame = Study.open(out)[1].frame
    assert frame.drop_nulls("failed").select("cell", "run", "failed_s").rows() == [
        (cell, run, 10.0) for cell in (0, 1) for run in FAILED
    ]
    assert frame["robots_undecided"].to_list()[1] == 2
