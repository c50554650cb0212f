"""Robots in MuJoCo keep the contract, and drive and turn as they were fitted."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import numpy as np
import polars as pl
import pytest

import vibroswarm.testing.motion as checks
from helpers.motion_runs import begun, poses_at_ticks
from vibroswarm.motion.fixed_step import FIXED_STEP, FixedStepRun
from vibroswarm.motion.motion_tables import Collected
from vibroswarm.motion.physics.wheels_model import LENGTH_M, MARGIN_M, WIDTH_M
from vibroswarm.motion.physics.wheels_run import MUJOCO, WheelsRun, overlap
from vibroswarm.motion.pose import poses_of
from vibroswarm.motion.source import moved
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.testing.motion_cases import SHORT_CASE, Case, Check, motion_of, same

BRIEF = Case("brief crowd", SHORT_CASE.values | {"run.t_end_s": 10.0}, (0,))
OPEN = {"arena.width_m": 1000.0, "arena.height_m": 1000.0, "swarm.robots": 1, "run.t_end_s": 40.0}
"""An arena so large that no wall is near."""


EXACT = (
    checks.check_bodies,
    checks.check_moves_lead_to_the_next,
    checks.check_poses_at_samples,
    checks.check_ends,
)
"""What soft contact keeps only nearly: bodies overlap by up to 1 mm, and robots that stand roll out."""


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("check", [one for one in checks.MOTION_CHECKS if one not in EXACT])
def test_they_keep_the_contract(check: Check, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(checks, "CASES", (BRIEF,))
    monkeypatch.setattr(checks, "SHORT_CASE", BRIEF)
    monkeypatch.setattr(checks, "SHORT_S", 6.0)
    check(MUJOCO)


def test_robots_touch_in_the_crowd_and_hardly_overlap() -> None:
    poses = poses_at_ticks(WheelsRun, BRIEF.scenario, BRIEF.seed, 0)  # (robots, ticks, 3)
    deepest = [overlap(one, other, (LENGTH_M, WIDTH_M))[0].max() for one, other in combinations(poses, 2)]
    assert sum(depth > -MARGIN_M for depth in deepest) > 5
    assert max(deepest) < 0.001
    motion = motion_of(MUJOCO, BRIEF)
    assert motion.moves is not None
    table = poses_of(motion.moves, motion.ends, 20).filter(pl.col("time_s") < 10.0 - 1e-9)
    off = np.abs(table.select("x_m", "y_m").to_numpy() - poses[..., :2].reshape(-1, 2))
    assert off.max() < 0.002, "moves are arcs through the poses"


def test_robots_on_wheels_that_start_too_near_are_moved_apart() -> None:
    """Starts of discs, of which some have a corner in a wall; the others start where they start for every source."""
    scenario = Scenario().with_values(
        {"swarm.robots": 30, "run.t_end_s": 1.0, "swarm.start_margin_m": 0.0, "arena.width_m": 0.5}
    )
    rolled, stepped = (moved(source, scenario, 3, [0], until=[1]).ends for source in (MUJOCO, FIXED_STEP))
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
        moved(source, scenario, 5, [0, 1, 2], moves=True).moves for source in (MUJOCO, FIXED_STEP)
    )
    assert rolled is not None
    assert stepped is not None
    drives, stepped_drives = (moves.filter(kind="drive") for moves in (rolled, stepped))

    def most(moves: pl.DataFrame, kind: str, column: str) -> float:
        values = moves.filter((pl.col("kind") == kind) & (pl.col("run") == 0))[column].abs()
        return float(values.max())  # type: ignore[arg-type]

    assert most(drives, "drive", "speed_m_s") == pytest.approx(
        most(stepped_drives, "drive", "speed_m_s"), rel=0.02
    )
    veer = most(stepped, "drive", "turn_rate_rad_s") / float(drives["turn_rate_rad_s"].abs().median())  # type: ignore[arg-type]
    assert 2.36 < veer < 2.46  # an effective track of 95 mm, not 39.4
    fastest = [
        np.abs(np.diff(poses_at_ticks(engine, scenario, 5, 0)[0, :, 2])).max()
        for engine in (FixedStepRun, WheelsRun)
    ]
    turn = fastest[0] / fastest[1]
    assert 1.13 < turn < 1.24  # 54.5 mm, not 46


def test_a_warning_marks_the_run_failed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its robots stand from then on, in whatever pieces; nothing is written to the working directory."""
    monkeypatch.chdir(tmp_path)
    few = BRIEF.scenario.with_values({"swarm.robots": 5})
    found = []
    for pieces in ((500,), (255, 450, 500)):
        state, taken = begun(WheelsRun, few, 3, 4), Collected(20)
        state.advance(250, taken.sink)
        state.data.qvel[0] = 1e20
        for until in pieces:
            state.advance(until, taken.sink)
        taken.end(state)
        found.append(taken.motion())
    same(*found)
    in_pieces, at_once = found
    assert in_pieces.failures is not None
    assert in_pieces.failures.rows() == at_once.failures.rows()  # type: ignore[union-attr]
    assert [row[:2] for row in in_pieces.failures.rows()] == [(4, 5.0)]
    assert "not finite" in in_pieces.failures["reason"][0]
    assert not list(tmp_path.iterdir())
    assert at_once.samples.filter(pl.col("time_s") > 6.01).is_empty()
    assert at_once.ends["x_m"].is_finite().all()
    assert moved(MUJOCO, few, 3, [4]).failures is None
