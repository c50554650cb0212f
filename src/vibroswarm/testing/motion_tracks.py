"""Where robots are, worked out from the table of segments alone, with formulas that no engine shares."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.motion.contract import Motion
from vibroswarm.scenario import Scenario
from vibroswarm.testing.findings import hold

Floats = NDArray[np.float64]

NEAR_M: Final = 1e-9
"""Poses from segments agree with the other tables to this."""


@dataclass(frozen=True)
class Track:
    """One robot's segments as arrays."""

    start_s: Floats
    pose: Floats
    """(segments, 3): x, y, heading."""
    speed: Floats
    rate: Floats
    kind: NDArray[np.str_]

    def at(self, time_s: Floats) -> tuple[Floats, NDArray[np.str_]]:
        """Poses (times, 3), and what the robot does from then on. A segment reaches to the next one's start.

        Raises:
            AssertionError: a time lies before the first segment.
        """
        k = np.searchsorted(self.start_s, time_s + 1e-9, side="right") - 1
        hold((k >= 0).all(), "a time lies before the first segment")
        return self.after(k, time_s - self.start_s[k]), self.kind[k]

    def after(self, k: NDArray[np.intp], dt_s: Floats) -> Floats:
        """Pose ``dt_s`` after the beginning of segments ``k``: the integral of v (cos, sin)(h + w t)."""
        x, y, heading = self.pose[k].T
        v, w = self.speed[k], self.rate[k]
        turned = heading + w * dt_s
        slow = np.abs(w * dt_s) < 1e-7
        radius = v / np.where(slow, 1.0, w)
        along_x = np.where(
            slow, v * dt_s * np.cos(heading + w * dt_s / 2), radius * (np.sin(turned) - np.sin(heading))
        )
        along_y = np.where(
            slow, v * dt_s * np.sin(heading + w * dt_s / 2), radius * (np.cos(heading) - np.cos(turned))
        )
        return np.stack([x + along_x, y + along_y, turned], axis=1)


def tracks(motion: Motion, run: int) -> dict[int, Track]:
    """The tracks of a run, by robot.

    Raises:
        AssertionError: the motion has no segments.
    """
    if motion.segments is None:
        raise AssertionError(f"there are no segments of run {run}")
    found = {}
    for (robot,), rows in motion.segments.filter(pl.col("run") == run).group_by("robot", maintain_order=True):
        column = {name: rows[name].to_numpy() for name in rows.columns if name != "kind"}
        pose = np.stack([column["x_m"], column["y_m"], column["heading_rad"]], axis=1)
        kind = np.array(rows["kind"].to_list())
        found[int(robot)] = Track(
            column["start_s"], pose, column["speed_m_s"], column["turn_rate_rad_s"], kind
        )
    return found


def at_all_ticks(motion: Motion, scenario: Scenario, run: int) -> tuple[Floats, NDArray[np.str_]]:
    """Poses (robots, ticks, 3) and kinds (robots, ticks) at each control period of a run."""
    times: Floats = np.arange(scenario.ticks, dtype=np.float64) * scenario.tick_s
    here = tracks(motion, run)
    hold(sorted(here) == list(range(scenario.swarm.robots)), f"a robot of run {run} has no segments")
    found = [here[robot].at(times) for robot in sorted(here)]
    return np.stack([pose for pose, _ in found]), np.stack([kind for _, kind in found])


def gap_of(poses: Floats, others: Floats) -> Floats:
    """Differences of poses, (..., 3), in m and rad; that of headings the shorter way round."""
    gap: Floats = poses - others
    gap[..., 2] = np.remainder(gap[..., 2] + math.pi, math.tau) - math.pi
    return gap
