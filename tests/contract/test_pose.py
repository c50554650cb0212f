"""``pose`` against the contract suite's own evaluation of a segment table."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import polars as pl
import pytest
from numpy.typing import NDArray

from helpers.walk_checks import CASES, OF_THREE_RAYS, Case, motion_of, tracks
from vibroswarm.errors import InputError
from vibroswarm.motion.fixed_step import FIXED_STEP
from vibroswarm.motion.pose import pose

Pose = Callable[[pl.DataFrame, int, int, NDArray[np.float64]], NDArray[np.float64]]


def largest_gap(case: Case, evaluate: Pose) -> float:
    """Largest difference to the suite's poses, m and rad, at random times of the whole run."""
    motion, rng, gap = motion_of(FIXED_STEP, case), np.random.default_rng(3), 0.0
    assert motion.segments is not None
    for run in case.runs:
        for robot, track in tracks(motion, run).items():
            times = rng.uniform(0.0, case.scenario.run.t_end_s, 60)
            off = evaluate(motion.segments, run, robot, times) - track.at(times - 1e-9)[0]
            off[:, 2] = np.remainder(off[:, 2] + math.pi, math.tau) - math.pi
            gap = max(gap, float(np.abs(off).max()))
    return gap


def at_starts(
    segments: pl.DataFrame, run: int, robot: int, times: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Where the robot was when the segment began: what one gets by looking up rows only."""
    own = segments.filter((pl.col("run") == run) & (pl.col("robot") == robot))
    k = np.searchsorted(own["start_s"].to_numpy(), times, side="right") - 1
    return own.select("x_m", "y_m", "heading_rad").to_numpy()[k]


@pytest.mark.parametrize("case", OF_THREE_RAYS, ids=lambda case: case.name)
def test_pose_is_on_the_arc(case: Case) -> None:
    assert largest_gap(case, pose) < 1e-7  # the times differ by a nanosecond, for the periods' ends
    assert largest_gap(case, at_starts) > 1e-4  # negative control


@pytest.mark.parametrize("case", CASES[:2], ids=lambda case: case.name)
def test_pose_at_the_beginning_of_a_segment_is_the_segments_own(case: Case) -> None:
    """From the very first on, at time 0."""
    segments = motion_of(FIXED_STEP, case).segments
    assert segments is not None
    for (run, robot), rows in segments.group_by("run", "robot"):
        found = pose(segments, int(run), int(robot), rows["start_s"])  # type: ignore[call-overload]
        assert rows["start_s"][0] == 0.0
        np.testing.assert_allclose(found, rows.select("x_m", "y_m", "heading_rad").to_numpy(), atol=1e-12)


def test_shape_and_range() -> None:
    case = CASES[0]
    segments = motion_of(FIXED_STEP, case).segments
    assert segments is not None
    assert pose(segments, 0, 0, 3.0).shape == (3,)
    assert pose(segments, 0, 0, np.zeros((4, 2))).shape == (4, 2, 3)
    assert pose(segments, 0, 0, []).shape == (0, 3)
    headings = pose(segments, 0, 0, np.linspace(0, case.scenario.run.t_end_s, 5000))[:, 2]
    assert headings.min() >= -math.pi
    assert headings.max() < math.pi


@pytest.mark.parametrize(
    ("run", "robot", "time_s"),
    [(99, 0, 1.0), (0, 99, 1.0), (0, 0, -1.0), (0, 0, [1.0, -0.5]), (0, 0, math.nan)],
)
def test_what_is_not_there_is_refused(run: int, robot: int, time_s: float | list[float]) -> None:
    segments = motion_of(FIXED_STEP, CASES[0]).segments
    assert segments is not None
    with pytest.raises(InputError):
        pose(segments, run, robot, time_s)
