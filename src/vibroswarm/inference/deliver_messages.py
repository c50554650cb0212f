"""Deliveries of a network for strategies that send once per sample: template of a kernel.

The senders and times of messages are then those of the samples. So deliveries do not depend on the content of messages,
and are computed once for all such strategies. ``generated_kernels`` puts the network's functions in this text.
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
from vibroswarm.inference.sender_positions import positions_at
from vibroswarm.strategies.world import World


@kernel
def deliver(
    rows: Rows, stops: Stops, tracks: Any, scratch: DeliveryScratch, found: Deliveries, world: World,
    network_params: NDArray[np.void], network_state: NDArray[np.void], network_arrays: Any, bytes_on_air: int,
    seed: int,
) -> int:  # fmt: skip
    """List the messages that each robot reads before each of its samples, and after its last one.

    Args:
        rows, stops: samples of some runs, and when their robots stand. tracks: moves of these runs; 0 unless the
            network reads positions. scratch: memory; if its ``log`` is not empty, the arrivals of all messages are
            written there. found: the lists, written. world: as robot 0 knows it.
        network_params, network_state: (1,): rows of the network's parameters and state. network_arrays: the network's
            arrays, or 0 if it has none.
        bytes_on_air: length of a message.
    Returns: ``DONE``; or ``BUFFER_FULL`` if more messages were under way at one time than ``scratch`` holds, so that
        ``found`` is incomplete.
    """
    robots, filled = world.robots, 0  # filled: number of entries of ``found.which`` so far
    for r in range(rows.runs.size):
        low, high, run, first = rows.bounds[r], rows.bounds[r + 1], rows.runs[r], r * robots
        network_state[0] = scratch.zero_network_state[0]
        clear_network(network_arrays)
        clear_inbox(scratch.inbox)
        scratch.sent[:] = 0
        if READS_POSITIONS:  # begin at each robot's first move
            for e in range(first, first + robots):
                tracks.at[e] = tracks.bounds[e]
        for k in range(low, high):
            i, m, tick = signed(rows.robot[k]), k - low, stops.tick[k]  # m: index of the message in its run
            # Before this sample the robot has read what had arrived when it last walked, the tick before its stop.
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
            # max: a network may not deliver a message in the control period in which it was sent.
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
    """Move the messages that robot ``i`` reads up to a tick from its inbox to the end of ``found.which``.

    Args:
        walked: last tick at which the robot walks, and so reads. scratch, found: changed. filled: number of entries of
            ``found.which`` so far.
    Returns: the new number of entries.
    """
    inbox = scratch.inbox
    while inbox.first[i] >= 0 and inbox.arrival_tick[inbox.first[i]] <= walked:
        found.which[filled] = inbox.message[inbox.first[i]]
        filled += 1
        take_first(inbox, i)
    return filled
