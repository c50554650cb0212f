"""No two bodies overlap and none leaves the arena, at any tick: ``benchmarks/overlap.py`` with 10^6 robot-steps."""

from __future__ import annotations

import numpy as np
import pytest

import overlap
from vibroswarm.motion.recorder import SEGMENT_ROW
from vibroswarm.motion.robot_params import setup_of


@pytest.mark.parametrize("engine", ["fixed-step", "event"])
def test_a_million_robot_steps(engine):
    for swarm in overlap.SWARMS:
        found = overlap.check(engine, overlap.swarm(*swarm), 32, 1e6 / len(overlap.SWARMS))
        assert found.robot_steps >= 1e6 / len(overlap.SWARMS)
        assert found.good, f"{swarm}: {found}"


@pytest.mark.parametrize(
    ("y_m", "width_m", "between_m", "to_wall_m"),
    [(0.529, 1.0, -0.001, 0.485 - 0.029), (0.531, 0.95, 0.001, -0.015)],
)
def test_the_check_sees_an_overlap_and_an_escape_between_events(y_m, width_m, between_m, to_wall_m):
    """Negative control: one robot drives from x = 0 past one that stands at x = 0.5, off its line."""
    scenario = overlap.swarm(2, 1.0, 0.0).with_values({"arena.width_m": width_m})
    segments = np.zeros(2, dtype=SEGMENT_ROW)
    segments["robot"] = [0, 1]
    segments["x_m"], segments["y_m"] = [0.05, 0.5], [0.5, y_m]
    segments["speed_m_s"] = [0.05, 0.0]
    least, places = np.full(2, np.inf), np.zeros((2, 2))
    setup = setup_of(scenario)
    overlap.checked_arcs(segments, setup, 900, np.zeros(2, dtype=np.int64), places, least)
    found = overlap.gaps(setup, 1800, least)
    assert found.between_m == pytest.approx(between_m, abs=1e-12)
    assert not found.good
