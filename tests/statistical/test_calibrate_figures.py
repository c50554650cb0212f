"""What a simulation was made with comes out of its figures again, from whole paths and from a log of them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from helpers.recordings import write_log
from vibroswarm.lab.calibrate.drive import drive_table
from vibroswarm.lab.calibrate.few_groups import drawn_means, drawn_variances
from vibroswarm.lab.calibrate.samples import sample_table
from vibroswarm.lab.calibrate.session_statistics import FIGURES, _of_drives, figures_of
from vibroswarm.lab.recordings.assemble_recording import recording_of
from vibroswarm.lab.recordings.read import read_log
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import preset
from vibroswarm.simulation import simulate


def made(runs: int = 2, **changes: Any) -> Result:
    values = {name.replace("__", "."): value for name, value in changes.items()}
    base = preset("paper-empirical").with_values({"floor.redraw": "study", **values})
    return simulate(base, 21, runs, poses=True)


def test_the_papers_robots() -> None:
    """Speed factor of mean 1.094 and standard deviation 0.14 redrawn at samples; 14.3 % lost in 1200 s."""
    result = made(4)
    found = {one.name: one.interval for one in figures_of(result)}
    assert found["start_speed_m_s"].estimate == pytest.approx(0.0549 * 1.094, rel=0.02)
    assert found["drop"].estimate == pytest.approx(1200 / 8400, abs=0.02)
    assert found["share_between"].estimate < 0.05
    assert abs(found["lag_one"].estimate) < 0.08
    assert found["within_m_s"].estimate / found["speed_m_s"].estimate == pytest.approx(0.14, abs=0.015)
    assert found["packet_loss"].estimate == 0.0
    assert set(found) == set(FIGURES)


def test_speeds_that_robots_keep() -> None:
    result = made(robot__speed_redraw="robot")
    found = {one.name: one.interval for one in figures_of(result)}
    assert found["share_between"].estimate > 0.9
    assert found["within_m_s"].estimate < 0.002
    untracked = drive_table(replace(result, poses=None), sample_table(result))["speed_m_s"].mean()
    assert untracked == pytest.approx(found["speed_m_s"].estimate, rel=0.05)


@pytest.mark.parametrize("misalignment", [-0.03, 0.02])
def test_a_veer(misalignment: float) -> None:
    """w = 2 v m_d / track, anticlockwise where the right wheel is the faster."""
    result = made(1, robot__misalignment_min=misalignment, robot__misalignment_max=misalignment)
    found = _of_drives(drive_table(result, sample_table(result)))
    wanted = 2 * found["speed_m_s"] * misalignment / 0.0394
    assert found["veer_rad_s"] == pytest.approx(wanted, rel=0.06)
    assert found["veer_between_rad_s"] < 0.01


def test_laws_of_few_robots_by_hand() -> None:
    """The mean follows Student's t (2 degrees of freedom), the variance an inverse chi-square (4)."""
    means = drawn_means(np.array([1.0, 2.0, 3.0]), np.array([0.025, 0.975]))
    assert means == pytest.approx(2.0 + np.array([-1.0, 1.0]) * 4.302653 / 3**0.5)
    assert drawn_variances(3.0, 4, np.array([0.5])) == pytest.approx(12.0 / 3.356694)


def test_a_log_tells_the_same_as_the_paths(tmp_path: Path) -> None:
    result = made(1, floor__tiles=("01", "10"), robot__speed_redraw="robot")
    write_log(result, tmp_path / "log.csv")
    logged = recording_of([read_log(tmp_path / "log.csv")], result.floor(), preset("paper"))
    ours = {one.name: one.interval.estimate for one in figures_of(result) if one.interval is not None}
    theirs = {one.name: one.interval.estimate for one in figures_of(logged, 1.33) if one.interval is not None}
    for name in ("speed_m_s", "drop", "between_m_s", "avoid_s", "false_positive", "lag_one_bits"):
        assert theirs[name] == pytest.approx(ours[name], rel=0.05, abs=0.01 if name == "drop" else 1e-3), name
    assert theirs["veer_between_rad_s"] == pytest.approx(ours["veer_between_rad_s"], rel=0.1)
    # Places in the log are where the camera saw the robot last: up to a loop before it stopped.
    assert theirs["distance_m"] == pytest.approx(ours["distance_m"], rel=0.02)
