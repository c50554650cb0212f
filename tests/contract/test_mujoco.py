"""Robots in MuJoCo keep the contract, and drive and turn as they were fitted."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from itertools import combinations
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from vibroswarm.documents.run import result_document
from vibroswarm.motion.fixed_step import FIXED_STEP
from vibroswarm.motion.footprint import overlap
from vibroswarm.motion.kernel_run import batch_of
from vibroswarm.motion.physics.sources import WHEELS
from vibroswarm.motion.physics.wheels_model import LENGTH_M, MARGIN_M, WIDTH_M
from vibroswarm.motion.physics.wheels_run import WheelsRun
from vibroswarm.motion.source import Source, forget, join, register
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.show.document import Text
from vibroswarm.simulation import replay, simulate
from vibroswarm.testing import motion as motion_checks
from vibroswarm.testing import motion_tables
from vibroswarm.testing.motion import (
    at_all_ticks,
    check_bodies,
    check_ends,
    check_motion,
    check_segments_join,
)
from vibroswarm.testing.motion_cases import CASES, SHORT_CASE, Case, Check, fitted, motion_of, same
from vibroswarm.testing.motion_tables import check_copies

BRIEF = Case("brief crowd", SHORT_CASE.values | {"run.t_end_s": 10.0}, (0,))
OPEN = {"arena.width_m": 1000.0, "arena.height_m": 1000.0, "swarm.robots": 1, "run.t_end_s": 40.0}
"""An arena so large that no wall is near."""


@pytest.mark.slow
@pytest.mark.long
def test_they_keep_the_contract(monkeypatch: pytest.MonkeyPatch) -> None:
    """One run of each case, of those with many robots the beginnings, of 5 s and more: all kinds of movement."""
    share = 0.08
    cases = tuple(
        replace(
            case,
            values=case.values
            | {"run.t_end_s": max(share * case.values["run.t_end_s"], 5.0 if robots > 2 else 40.0)},
            runs=case.runs[:1],
        )
        for case in CASES
        for robots in [case.scenario.swarm.robots]
    )
    for case in fitted(cases, WHEELS):
        motion = motion_of(WHEELS, case)
        assert motion.segments is not None
        found = set(motion.segments["kind"].unique())
        assert found | ({"turn", "avoid"} if "cell" in case.name else set()) == set(motion_tables.KINDS), (
            case.name
        )
        assert motion.samples["run"].n_unique() == len(case.runs), case.name
    for module in (motion_checks, motion_tables):
        monkeypatch.setattr(module, "CASES", cases)
        monkeypatch.setattr(module, "SHORT_CASE", cases[CASES.index(SHORT_CASE)])
    broken = [finding for finding in check_motion(WHEELS.name) if not finding.holds]
    assert not broken


@pytest.mark.slow
@pytest.mark.parametrize("check", [check_copies, check_bodies, check_segments_join, check_ends])
def test_they_keep_it_in_a_crowd(check: Check, monkeypatch: pytest.MonkeyPatch) -> None:
    """Copies are bit-equal, and bodies apart, where robots push each other most."""
    monkeypatch.setattr(motion_checks, "CASES", (BRIEF,))
    monkeypatch.setattr(motion_tables, "SHORT_CASE", BRIEF)
    check(WHEELS)


def test_robots_touch_in_the_crowd() -> None:
    """Else the checks above would look at nothing."""
    poses, _ = at_all_ticks(motion_of(WHEELS, BRIEF), BRIEF.scenario, 0)  # (robots, ticks, 3)
    touching = [
        (overlap(one, other, (LENGTH_M, WIDTH_M))[0] > -MARGIN_M).any()
        for one, other in combinations(poses, 2)
    ]
    assert sum(touching) > 5


def test_robots_on_wheels_that_start_too_near_are_moved_apart() -> None:
    """Starts of discs, of which some have a corner in a wall; the others start where they start for every source."""
    scenario = Scenario().with_values(
        {"swarm.robots": 30, "run.t_end_s": 1.0, "swarm.start_margin_m": 0.0, "arena.width_m": 0.5}
    )
    rolled, stepped = (
        source.init(scenario, 3, 0, segments=True).advance(0.02).segments for source in (WHEELS, FIXED_STEP)
    )
    assert rolled is not None
    assert stepped is not None
    both = (
        rolled.group_by("robot").first().join(stepped.group_by("robot").first(), on="robot", suffix="_disc")
    )
    moved_m = np.hypot(both["x_m"] - both["x_m_disc"], both["y_m"] - both["y_m_disc"])
    assert 0 < (moved_m > 0).sum() < 15
    assert moved_m.max() < 0.01


def test_wheels_drive_veer_and_turn_as_they_were_fitted() -> None:
    """Robots far from walls: speed as commanded; they veer and turn as on longer axles."""
    own = {"robot.speed_redraw": "robot", "robot.misalignment_min": 0.05, "robot.misalignment_max": 0.05}
    scenario = Scenario().with_values(OPEN | own)
    rolled, stepped = (
        source.batch(scenario, 5, [0, 1, 2], segments=True).segments for source in (WHEELS, FIXED_STEP)
    )
    assert rolled is not None
    assert stepped is not None
    drives, stepped_drives = (segments.filter(pl.col("kind") == "drive") for segments in (rolled, stepped))

    def most(segments: pl.DataFrame, kind: str, column: str) -> float:
        values = segments.filter((pl.col("kind") == kind) & (pl.col("run") == 0))[column].abs()
        return float(values.max())  # type: ignore[arg-type]

    assert most(drives, "drive", "speed_m_s") == pytest.approx(
        most(stepped_drives, "drive", "speed_m_s"), rel=0.02
    )
    veer = most(stepped, "drive", "turn_rate_rad_s") / float(drives["turn_rate_rad_s"].abs().median())  # type: ignore[arg-type]
    assert 2.36 < veer < 2.46  # an effective track of 95 mm, not 39.4
    turn = most(stepped, "turn", "turn_rate_rad_s") / most(rolled, "turn", "turn_rate_rad_s")
    assert 1.13 < turn < 1.24  # 54.5 mm, not 46


def test_a_warning_marks_the_run_failed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its robots stand from then on, in whatever pieces, and in copies; nothing is written to the working directory."""
    monkeypatch.chdir(tmp_path)
    few = BRIEF.scenario.with_values({"swarm.robots": 5})
    whole, pieces = (WHEELS.init(few, 3, 4, segments=True) for _ in range(2))
    for state in (whole, pieces):
        state.advance(5.0)
        state.data.qvel[0] = 1e20  # type: ignore[attr-defined]
    branch = pieces.copy()
    in_pieces = join([pieces.advance(until_s) for until_s in (5.1, 9.0, 10.0)])
    at_once = whole.advance(10.0)
    same(in_pieces, at_once)
    assert in_pieces.failures is not None
    assert in_pieces.failures.rows() == at_once.failures.rows()  # type: ignore[union-attr]
    assert [row[:2] for row in in_pieces.failures.rows()] == [(4, 5.0)]
    assert "not finite" in in_pieces.failures["reason"][0]
    assert not list(tmp_path.iterdir())
    assert at_once.samples.filter(pl.col("time_s") > 6.01).is_empty()
    assert at_once.ends["x_m"].is_finite().all()
    assert branch.advance(10.0).failures is not None
    assert WHEELS.init(few, 3, 4).advance(10.0).failures is None


def test_a_failed_run_is_shown_and_kept(tmp_path: Path) -> None:
    """A result says which of its runs failed, and keeps it on disk."""
    scenario = Scenario().with_values({"run.t_end_s": 20.0, "swarm.robots": 2})

    class Failing(WheelsRun):
        def start(self, seed: int, run: int) -> None:
            super().start(seed, run)
            if run == 1:
                self.data.qvel[0] = 1e20

    name = "failing for a test"
    register(Source(name, Failing, partial(batch_of, Failing), is_ours=True))
    try:
        result = simulate(scenario, 1, 3, motion=name)
    finally:
        forget(name)
    assert result.failures is not None
    assert result.failures["run"].to_list() == [1]
    assert "1 failed" in repr(result)
    assert result.runs["consensus"].to_list() == ["incomplete"] * 3
    result.write(tmp_path / "kept")
    assert Result.read(tmp_path / "kept").failures.equals(result.failures)  # type: ignore[union-attr]
    assert "RUN FAILED at 0.02 s: MuJoCo warned of" in result_document(result).answer[0]
    assert replay(result, scenario.with_values({"strategy.name": "soft"})).failures.equals(result.failures)  # type: ignore[union-attr]


def test_a_run_says_that_robots_on_wheels_are_boxes_whatever_their_radius() -> None:
    result = simulate(Scenario().with_values({"run.t_end_s": 20.0, "robot.body_radius_m": 0.035}), 1)
    for source, swarm in (("mujoco", "5 robots (boxes of 33 x 25 mm), "), ("event", "5 robots, ")):
        words = [
            part.words
            for part in result_document(replace(result, source=source)).parts
            if isinstance(part, Text)
        ]
        assert words[0].startswith(swarm)
