"""Swarms with no room for places at random start on a lattice, as chance would deal its sites."""

from __future__ import annotations

import numpy as np
import pytest

from helpers.motion_runs import begun
from vibroswarm.core.rng import OF_SITE, PLACEMENT, uniform
from vibroswarm.motion.event.event_run import EventRun
from vibroswarm.motion.fixed_step import FixedStepRun
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.scenario.validation import lattice_sites, start_region

CROWDED = Scenario().with_values({"arena.width_m": 0.4, "arena.height_m": 0.4, "swarm.robots": 90})


def dealt(scenario: Scenario, seed: int, run: int) -> set[tuple[int, float, float]]:
    """Robots and their sites: each robot takes one at random of those that are left."""
    (left, right, low, high), (columns, rows) = start_region(scenario), lattice_sites(scenario)
    sites = [(x, y) for y in np.linspace(low, high, rows) for x in np.linspace(left, right, columns)]
    found = set()
    for i in range(scenario.swarm.robots):
        other = i + int((len(sites) - i) * uniform(seed, run, i, PLACEMENT, 0, OF_SITE))
        sites[i], sites[other] = sites[other], sites[i]
        found.add((i, round(float(sites[i][0]), 9), round(float(sites[i][1]), 9)))
    return found


@pytest.mark.parametrize("engine", [EventRun, FixedStepRun])
def test_each_robot_has_a_site_of_its_own(engine: type[EventRun | FixedStepRun]) -> None:
    for run in (0, 1):
        swarm = begun(engine, CROWDED, 5, run).swarm
        places = zip(swarm["x_m"].round(9).tolist(), swarm["y_m"].round(9).tolist(), strict=True)
        found = {(i, x, y) for i, (x, y) in enumerate(places)}
        assert found == dealt(CROWDED, 5, run)
        assert len({(x, y) for _, x, y in found}) == 90


def test_a_swarm_with_room_does_not_start_on_the_lattice() -> None:
    fewer = CROWDED.with_values({"swarm.robots": 20})
    assert np.unique(begun(EventRun, fewer, 5, 0).swarm["x_m"]).size == 20
