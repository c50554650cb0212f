"""The event-driven engine's arrays have room for all that a scenario may ask of them."""

from __future__ import annotations

import numpy as np
import pytest

from helpers.commands import printed_by
from vibroswarm.motion.event.neighbours import SMALL_SWARM, empty_lists, list_radius_m, most_listed
from vibroswarm.motion.robot_params import setup_of
from vibroswarm.scenario.scenario import Scenario

SLOW = {"robot.full_speed_m_s": 0.0005, "walk.avoidance_threshold_mm": 0.0, "run.t_end_s": 6.0}
CROWD = {"arena.width_m": 0.2, "arena.height_m": 0.2, "swarm.start_margin_m": 0.0}


def densest(radius_m: float, within_m: float) -> int:
    """How many discs lie with their centres within a distance of another's, in the densest packing there is."""
    across = int(within_m / radius_m) + 2
    i, j = np.meshgrid(np.arange(-across, across + 1), np.arange(-across, across + 1))
    x, y = 2 * radius_m * (i + 0.5 * j), 2 * radius_m * np.sqrt(0.75) * j
    return int((x * x + y * y <= within_m * within_m * (1 + 1e-9)).sum()) - 1


@pytest.mark.parametrize("robots", [17, 40, 10_000])
@pytest.mark.parametrize("speed", [1e-9, 1e-4, 1e-3, 0.0549, 0.4])
@pytest.mark.parametrize("threshold", [0.0, 33.0, 3000.0])
def test_lists_have_room_for_the_densest_crowd(robots, speed, threshold):
    values = {"robot.full_speed_m_s": speed, "walk.avoidance_threshold_mm": threshold, "rays.range_m": 5.0}
    setup = setup_of(
        Scenario().with_values(
            values | {"swarm.robots": robots, "arena.width_m": 10.0, "arena.height_m": 10.0}
        )
    )
    most = min(robots - 1, densest(float(setup["radius_m"]), list_radius_m(setup)))
    assert most_listed(robots, setup) >= most


@pytest.mark.parametrize("robots", range(1, SMALL_SWARM + 1))
def test_small_swarms_list_everybody_else(robots):
    lists = empty_lists(robots, setup_of(Scenario().with_values(SLOW | {"swarm.robots": robots})))
    assert [set(row[1 : 1 + row[0]]) for row in lists] == [set(range(robots)) - {i} for i in range(robots)]


RUN = """
import warnings
import numpy as np
from vibroswarm.motion.event import event_run
from vibroswarm.motion.event.event_run import EventRun
from vibroswarm.motion.motion_tables import Collected
from vibroswarm.scenario.scenario import Scenario
def whole(scenario):
    state = EventRun(scenario)
    state.begin(3, 0)
    state.advance(scenario.ticks, Collected(20).sink)
warnings.simplefilter("ignore", RuntimeWarning)  # of places in which there is no robot
for robots in (1, 2, 16, 17, 36):  # 16: the largest swarm without lists of neighbours
    scenario = Scenario().with_values({values!r} | {{"swarm.robots": robots}})
    whole(scenario)
small = event_run.empty_lists(36, EventRun(scenario).setup)[:, :4].copy()
event_run.empty_lists = lambda robots, setup: small
try:
    whole(scenario)
except IndexError:
    print("seen")
"""


@pytest.mark.slow
@pytest.mark.parametrize("more", [{}, CROWD], ids=["an arena of 1 m", "a crowd"])
def test_no_index_is_beyond_an_array(more):
    """Compiled code would not say so; as plain Python the kernels do, of lists that are too short too."""
    if not more:
        more = {"rays.range_m": 5.0, "walk.avoidance_threshold_mm": 3000.0, "run.t_end_s": 0.5}
    assert printed_by(RUN.format(values=SLOW | more), VIBROSWARM_PLAIN="1") == "seen\n"
