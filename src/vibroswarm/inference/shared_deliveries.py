"""Deliveries: which messages each robot hears over a network before each of its samples.

They are computed once for all strategies that send a bit at each sample.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import read_only, zero_rows
from vibroswarm.inference.agents import sizes_of, strategy_used, world_of
from vibroswarm.inference.code_errors import translate_errors
from vibroswarm.inference.deliveries import Timeline
from vibroswarm.inference.generated_kernels import kernels, network_arrays_for
from vibroswarm.inference.replay_arrays import (
    BUFFER_FULL,
    Deliveries,
    DeliveryScratch,
    Rows,
    Stops,
    empty_inbox,
    start_capacity,
)
from vibroswarm.inference.sender_positions import NO_TRACKS, Tracks
from vibroswarm.networks import network as network_of
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.strategies import strategy as strategy_of

MAX_DELIVERIES: Final = 30_000_000
"""If there may be more deliveries than this, they would need too much memory. They are then not computed, and
strategies are replayed message by message."""


def deliveries_of(scenario: Scenario, seed: int, timeline: Timeline) -> Deliveries | None:
    """Return the deliveries of a scenario's network over the runs of a timeline; None if there may be too many.

    They are cached in the timeline.

    Raises:
        InputError: the network reads positions, and the motion has no table of moves; or the network cannot be
            compiled.
        CodeError: a function of the network raised an error.
    """
    robots = timeline.robots
    most = timeline.rows.robot.size * max(robots - 1, 0)  # if each message reaches each other robot
    if most > MAX_DELIVERIES:
        return None
    network, strategy = network_of(scenario.network.name), strategy_used(scenario)
    world = world_of(scenario, timeline.longest)
    # The key contains all that deliveries depend on; the world's ``beliefs`` follow from its boundary.
    known = {name: value for name, value in world._asdict().items() if name != "beliefs"}
    key = (network, repr((scenario.network.params, strategy.bytes_on_air, seed, known)))
    if key not in timeline.deliveries:
        tracks = timeline.tracks if network.reads_positions else NO_TRACKS
        timeline.deliveries[key] = compute_deliveries(
            scenario, seed, timeline.rows, timeline.stops, tracks, log=NO_ARRIVALS
        )
    return timeline.deliveries[key]


NO_ARRIVALS: Final = np.empty((0, 0), dtype=np.int64)
"""Given to ``compute_deliveries`` if the ticks of arrival are not needed."""


def compute_deliveries(
    scenario: Scenario, seed: int, rows: Rows, stops: Stops, tracks: Tracks, log: NDArray[np.int64]
) -> Deliveries:
    """Return the deliveries of a scenario's network if each robot sends one message at each of its samples.

    Args:
        rows, stops: samples of the runs, and when their robots stand. tracks: moves of all runs; 0 unless the
            network reads positions.
        log: (rows, robots), written: tick from which each robot can read the message of each row, -1: never;
            ``NO_ARRIVALS`` if this is not needed.
    Raises:
        InputError: the network cannot be compiled.
        CodeError: a function of the network raised an error.
    """
    robots, strategy = scenario.swarm.robots, strategy_used(scenario)
    network, sizes = network_of(scenario.network.name), sizes_of(scenario)
    deliveries = Deliveries(
        which=np.empty(rows.robot.size * max(robots - 1, 0), dtype=np.int32),
        until=np.empty(rows.robot.size, dtype=np.int64),
        until_at_end=np.empty(rows.runs.size * robots, dtype=np.int64),
    )
    network_params, network_state = zero_rows(1, network.params_type), zero_rows(1, network.state_type)
    network_params[0] = network.params_row(scenario.network.params)
    sender = strategy_of("none")  # any strategy will do: only the network's functions are called
    network_arrays = network_arrays_for(sender, network, scenario.network.params, sizes)
    deliver = kernels(sender, network, "deliver_messages").deliver
    longest, capacity, status = int(np.diff(rows.bounds).max(initial=0)), start_capacity(robots), BUFFER_FULL
    world = world_of(scenario, longest)
    with translate_errors(sender, network):
        while status == BUFFER_FULL:  # begin again with room for more messages under way
            scratch = DeliveryScratch(
                arrival=np.empty(robots, dtype=np.int64),
                inbox=empty_inbox(robots, capacity),
                sent=np.zeros(robots, dtype=np.int64),
                x_m=np.zeros(robots if network.reads_positions else 0),
                y_m=np.zeros(robots if network.reads_positions else 0),
                zero_network_state=zero_rows(1, network.state_type),
                log=log,
            )
            status = deliver(
                rows, stops, tracks, scratch, deliveries, world, network_params, network_state, network_arrays,
                strategy.bytes_on_air, seed,
            )  # fmt: skip
            capacity *= 4
    return Deliveries(  # of the same types as NO_DELIVERIES: another kernel would be compiled for others
        which=read_only(deliveries.which),
        until=read_only(deliveries.until),
        until_at_end=read_only(deliveries.until_at_end),
    )
