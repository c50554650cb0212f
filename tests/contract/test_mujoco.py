"""Robots in MuJoCo keep the contract; where nothing touches them, planar ones move as the kinematic robots do."""

from __future__ import annotations

import sys

import numpy as np
import polars as pl
import pytest

from vibroswarm.errors import InputError
from vibroswarm.motion.fixed_step import FIXED_STEP
from vibroswarm.motion.physics import library
from vibroswarm.motion.physics.sources import PLANAR, WHEELS
from vibroswarm.motion.source import Source
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.testing import motion_segments, motion_tables
from vibroswarm.testing.motion import check_motion
from vibroswarm.testing.motion_cases import SHORT_CASE, Case, Check, motion_of
from vibroswarm.testing.motion_segments import check_bodies, check_ends, check_segments_join
from vibroswarm.testing.motion_tables import check_copies

BRIEF = Case("brief crowd", SHORT_CASE.values | {"run.t_end_s": 20.0}, (0,))
OPEN = {"arena.width_m": 1000.0, "arena.height_m": 1000.0, "swarm.robots": 1, "run.t_end_s": 40.0}
"""An arena so large that no wall is near."""


@pytest.mark.slow
@pytest.mark.parametrize("source", [PLANAR, WHEELS], ids=lambda source: source.name)
def test_they_keep_the_contract(source: Source) -> None:
    broken = [finding for finding in check_motion(source.name) if not finding.holds]
    assert not broken


@pytest.mark.parametrize("source", [PLANAR, WHEELS], ids=lambda source: source.name)
@pytest.mark.parametrize("check", [check_copies, check_bodies, check_segments_join, check_ends])
def test_they_keep_it_in_a_crowd(source: Source, check: Check, monkeypatch: pytest.MonkeyPatch) -> None:
    """Copies are bit-equal, and bodies apart, where robots push each other most."""
    monkeypatch.setattr(motion_segments, "CASES", (BRIEF,))
    monkeypatch.setattr(motion_tables, "SHORT_CASE", BRIEF)
    check(source)


def test_robots_touch_in_the_crowd() -> None:
    """Else the checks above would look at nothing."""
    segments = motion_of(PLANAR, BRIEF).segments
    assert segments is not None
    slips = segments.filter((pl.col("kind") == "drive") & (pl.col("speed_m_s").abs() < 0.02))
    assert slips.height > 10


def test_without_contact_they_move_as_kinematic_robots() -> None:
    """Places at samples differ by what mass costs: a few millimetres after the starts and stops of 40 s."""
    scenario = Scenario().with_values(OPEN)
    planar, stepped = (source.batch(scenario, 5, [0, 1, 2]) for source in (PLANAR, FIXED_STEP))
    both = planar.samples.join(stepped.samples, on=["run", "robot", "sample"], suffix="_by_steps")
    assert both.height == stepped.samples.height == planar.samples.height
    gap_m = np.hypot(both["x_m"] - both["x_m_by_steps"], both["y_m"] - both["y_m_by_steps"])
    assert gap_m.max() < 0.02
    other = FIXED_STEP.batch(scenario.with_values({"robot.full_speed_m_s": 0.058}), 5, [0, 1, 2])
    control = planar.samples.join(other.samples, on=["run", "robot", "sample"], suffix="_by_steps")
    assert (
        np.hypot(control["x_m"] - control["x_m_by_steps"], control["y_m"] - control["y_m_by_steps"]).max()
        > 0.02
    )


def test_missing_mujoco_is_named_with_its_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    library.mujoco.cache_clear()
    try:
        with pytest.raises(InputError, match=r"motion: needs MuJoCo.*pip install 'vibroswarm\[physics\]'"):
            PLANAR.init(Scenario(), 1, 0)
    finally:
        library.mujoco.cache_clear()


def test_another_major_version_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(library, "version", lambda package: "3.9.0")
    library.mujoco.cache_clear()
    try:
        with pytest.raises(InputError, match=r"needs MuJoCo 4, and 3\.9\.0 is installed"):
            PLANAR.init(Scenario(), 1, 0)
    finally:
        library.mujoco.cache_clear()


def test_wheels_drive_veer_and_turn_as_they_were_fitted() -> None:
    """Robots far from walls: speed as commanded; they veer and turn as on longer axles (docs/mujoco.md)."""
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
    assert 1.3 < veer < 1.6
    turn = most(stepped, "turn", "turn_rate_rad_s") / most(rolled, "turn", "turn_rate_rad_s")
    assert 1.0 < turn < 1.1
