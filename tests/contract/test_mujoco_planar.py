"""Planar robots in MuJoCo keep the contract, and move as the kinematic robots do where nothing touches them."""

from __future__ import annotations

import sys

import numpy as np
import polars as pl
import pytest

from vibroswarm.errors import InputError
from vibroswarm.motion.fixed_step import FIXED_STEP
from vibroswarm.motion.physics import library
from vibroswarm.motion.physics.sources import PLANAR
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.testing.motion import check_motion
from vibroswarm.testing.motion_cases import SHORT_CASE, motion_of
from vibroswarm.testing.motion_segments import check_bodies, check_segments_join
from vibroswarm.testing.motion_tables import check_copies

OPEN = {"arena.width_m": 1000.0, "arena.height_m": 1000.0, "swarm.robots": 1, "run.t_end_s": 40.0}
"""An arena so large that no wall is near."""


@pytest.mark.slow
def test_planar_keeps_the_contract() -> None:
    broken = [finding for finding in check_motion(PLANAR.name) if not finding.holds]
    assert not broken


@pytest.mark.parametrize("check", [check_copies, check_bodies, check_segments_join])
def test_planar_in_a_crowd(check: object, monkeypatch: pytest.MonkeyPatch) -> None:
    """Copies and pieces are bit-equal where robots push each other most."""
    for module in ("motion_segments", "motion_tables"):
        monkeypatch.setattr(f"vibroswarm.testing.{module}.CASES", (SHORT_CASE,))
    check(PLANAR)  # type: ignore[operator]


def test_robots_touch_in_the_crowd() -> None:
    """Else the checks above would look at nothing."""
    motion = motion_of(PLANAR, SHORT_CASE)
    assert motion.segments is not None
    slips = motion.segments.filter((pl.col("kind") == "drive") & (pl.col("speed_m_s").abs() < 0.02))
    assert slips.height > 100


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
