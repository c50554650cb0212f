"""Deliveries of a network for strategies that send once per sample: template of a kernel.

Senders and times then follow from the samples, so the deliveries do not depend on the content of messages and are
computed once for all such strategies. The generated module holds the network's functions.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import inner, kernel, signed
from vibroswarm.inference.agents import loss_draws, send_draws, world_of_robot
from vibroswarm.inference.default_hooks import HAS_SEND, READS_POSITIONS, clear_network, lost, send
from vibroswarm.inference.replay_arrays import (
    BUFFER_FULL,
    DONE,
    Deliveries,
    DeliveryScratch,
    Rows,
    Stops,
    clear_inbox,
    put_message,
    take_first,
)
from vibroswarm.inference.sender_positions import Tracks, positions_at
from vibroswarm.strategies.world import World


@kernel
def deliver(
    rows: Rows, stops: Stops, tracks: Tracks, scratch: DeliveryScratch, found: Deliveries, world: World,
    network_params: NDArray[np.void], network_state: NDArray[np.void], network_arrays: Any, bytes_on_air: int,
    seed: int,
) -> int:  # fmt: skip
    """Fill in ``found``: the messages that each robot reads before each of its samples and after its last one.

    Returns ``DONE``, or ``BUFFER_FULL`` if more messages were under way at a time than ``scratch`` holds; ``found`` is
    then incomplete.

    Args:
        tracks: empty unless the network reads positions. network_params, network_state: (1,).
        network_arrays: the network's arrays, or 0.
    """
    robots, filled = world.robots, 0
    for r in range(rows.runs.size):
        low, high, run, first = rows.bounds[r], rows.bounds[r + 1], rows.runs[r], r * robots
        network_state[0] = scratch.zero_network_state[0]
        clear_network(network_arrays)
        clear_inbox(scratch.inbox)
        scratch.sent[:] = 0
        if READS_POSITIONS:
            for e in range(first, first + robots):
                tracks.at[e] = tracks.bounds[e]
        for k in range(low, high):
            i, m, tick = signed(rows.robot[k]), k - low, stops.tick[k]
            filled = read_until(i, stops.stop_tick[k] - 1, scratch, found, filled)
            found.until[k] = filled
            scratch.arrival[:] = -1  # robots that the network leaves out hear nothing
            if HAS_SEND:
                if READS_POSITIONS:
                    positions_at(tracks, first, tick, world.tick_ms, scratch.x_m, scratch.y_m)
                d = send_draws(seed, run, i, scratch.sent[i])
                send(
                    network_state[0], network_arrays, i, tick, scratch.sent[i], bytes_on_air, scratch.x_m,
                    scratch.y_m, scratch.arrival, d, network_params[0], world_of_robot(world, i),
                )  # fmt: skip
            else:
                for j in range(robots):
                    d = loss_draws(seed, run, j, i, scratch.sent[i])
                    if not lost(i, j, d, network_params[0], world_of_robot(world, j)):
                        scratch.arrival[j] = tick + 1
            for j in range(robots):
                arrives = j != i and scratch.arrival[j] >= 0
                if arrives and not put_message(scratch.inbox, j, m, max(scratch.arrival[j], tick + 1)):
                    return BUFFER_FULL
            if scratch.log.size > 0:
                for j in range(robots):
                    at = scratch.arrival[j] if j != i else -1
                    scratch.log[k, j] = max(at, tick + 1) if at >= 0 else -1
            scratch.sent[i] += 1
        for i in range(robots):
            filled = read_until(i, stops.walked_tick[first + i], scratch, found, filled)
            found.until_at_end[first + i] = filled
    return DONE


@inner
def read_until(i: int, walked: int, scratch: DeliveryScratch, found: Deliveries, filled: Any) -> Any:
    """Append the messages that robot ``i`` reads up to tick ``walked``; return the new length of ``found.which``."""
    inbox = scratch.inbox
    while inbox.first[i] >= 0 and inbox.arrival_tick[inbox.first[i]] <= walked:
        found.which[filled] = inbox.message[inbox.first[i]]
        filled += 1
        take_first(inbox, i)
    return filled
