"""A steered run that is followed by a closed loop of its own, held against its tables."""

from __future__ import annotations

import numpy as np

from helpers.motion_runs import Taken
from vibroswarm.inference.closed_loop import ClosedLoop, steer_on, steerable
from vibroswarm.motion.source import started
from vibroswarm.observation.observe import sensed_floors
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import simulate


def followed(scenario: Scenario, seed: int) -> tuple[ClosedLoop, Result]:
    """Run 0 of a strategy that steers: what read and decided as it moved, and what tables have."""
    result = simulate(scenario, seed, 1)
    loop = ClosedLoop(scenario, seed)
    (ground,) = sensed_floors(scenario, seed, [0], {0: result.floor(0)})
    loop.begin(0, ground)
    state = steerable(started("event", scenario, moves=True), "event")
    state.begin(seed, 0)
    while state.tick < scenario.ticks:
        steer_on(state, loop, scenario.ticks, Taken().sink)
    return loop, result


def reads_as_tables(loop: ClosedLoop, result: Result) -> bool:
    """Whether each sample was read and each robot decided as tables have it."""
    read, decided = loop.readings.observation[: loop.samples], loop.replayer.swarm.agents["decision"]
    tables = result.observations["observation"].to_numpy(), result.robots["decision"].to_numpy()
    return read.size > 20 and np.array_equal(read, tables[0]) and np.array_equal(decided, tables[1])
