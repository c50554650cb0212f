"""Replay of a strategy that counts bits, over the samples of runs: template of a kernel.

Without losses everybody hears everything, so the ones a robot has received follow from the ones all robots have
sent, minus its own. With losses messages are read one by one, and the losses are drawn once for all strategies.
For other networks, ``Deliveries`` lists the messages that each robot has read.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import inlined, inner, kernel, signed, unsigned
from vibroswarm.inference.agents import (
    Swarm,
    begin_agent,
    begin_draws,
    is_lost,
    sample_draws,
    steering_draws,
    world_of_robot,
)
from vibroswarm.inference.default_hooks import (
    HAS_STEER,
    begin,
    belief,
    bit_of,
    decision,
    on_counts,
    on_sample,
    opposite,
    steer,
    views,
)
from vibroswarm.inference.deliveries import HEARD_ROWS, LAST_OWN, OTHERS, Reach, in_lane
from vibroswarm.inference.replay_arrays import (
    DOES_NOT_SEND,
    DONE,
    Counts,
    Deliveries,
    Log,
    Readings,
    Rows,
    own_reading,
)
from vibroswarm.strategies.world import World


@inlined
def update_counts(swarm: Swarm, e: int, i: int, ones: int, others: int, world: World) -> None:
    """Update robot ``i``, in row ``e``, which has now heard ``others`` messages, ``ones`` of them ones."""
    row = swarm.agents[e]
    new, new_ones = others - row.received, ones - row.ones
    row.received, row.ones = others, ones
    on_counts(swarm.states[e], new_ones, new - new_ones, swarm.params[i], world_of_robot(world, i))


@inner
def read_one_by_one(
    swarm: Swarm, e: int, i: int, until: int, rows: Rows, low: int, messages: NDArray[np.void], world: World,
    seed: int, run: int, loss: float,
) -> None:  # fmt: skip
    """Let robot ``i`` read the messages before index ``until`` of the run that it has not read yet, except lost
    ones."""
    ones = count = 0
    for m in range(swarm.agents[e].heard, until):
        sender = signed(rows.robot[low + m])
        if sender != i and not is_lost(seed, run, i, sender, signed(rows.sample[low + m]), loss):
            ones += bit_of(messages[low + m])
            count += 1
    row = swarm.agents[e]
    row.heard = until
    if count > 0:
        update_counts(swarm, e, i, row.ones + ones, row.received + count, world)


@inlined
def read_before_sample(
    swarm: Swarm, e: int, i: int, heard: Any, lossy: bool, others: int, rows: Rows, low: int,
    messages: NDArray[np.void], counts: Counts, deliveries: Deliveries, start: int, end: int, world: World,
    seed: int, run: int, loss: float,
) -> None:  # fmt: skip
    """Let robot ``i`` read what it has heard before a sample.

    Args:
        heard: row of ``Timeline.heard``, read unless there are deliveries.
        lossy: whether losses are given in ``counts.ones_reached``. others: number of messages heard, read if lossy.
        start, end: range of the new messages in ``deliveries.which``.
    """
    if deliveries.until_at_end.size > 0:
        ones, row = 0, swarm.agents[e]
        for place in range(start, end):
            ones += bit_of(messages[low + deliveries.which[place]])
        if end > start:
            update_counts(swarm, e, i, row.ones + ones, row.received + end - start, world)
    elif lossy:
        ones = in_lane(counts.ones_reached[unsigned(heard[HEARD_ROWS])], signed(i))
        update_counts(swarm, e, i, ones, others, world)
    elif loss > 0.0:
        read_one_by_one(swarm, e, i, signed(heard[HEARD_ROWS]), rows, low, messages, world, seed, run, loss)
    else:
        ones = counts.ones_sent[unsigned(heard[HEARD_ROWS])]
        if heard[LAST_OWN] >= 0:
            ones -= counts.own_ones[unsigned(heard[LAST_OWN])]
        update_counts(swarm, e, i, ones, signed(heard[OTHERS]), world)


@kernel
def replay(
    rows: Rows, readings: Readings, replayed: NDArray[np.int64], swarm: Swarm, messages: NDArray[np.void],
    counts: Counts, log: Log, steering: NDArray[np.float64], world: World, seed: int, loss: float, reach: Reach,
    deliveries: Deliveries, from_start: bool, to_end: bool, limit_s: float,
) -> int:  # fmt: skip
    """Replay the runs, one after the other, from where they stopped; return ``DONE`` or an error code.

    Args:
        replayed: (runs,): number of samples replayed so far, updated. messages: (rows,), written. log: written, or
            empty. steering: (rows, 2), written if the strategy steers, else empty. deliveries: of whole runs, over
            networks other than ideal and loss, else empty. from_start: restart at the prior. to_end: also read the
            messages that arrive after the last sample. limit_s: replay no later samples.
    """
    robots = swarm.params.size
    lossy, words = reach.words.shape[1] > 0, unsigned(reach.words.shape[1])
    start = 0
    counts.ones_sent[0] = 0
    for w in range(words):
        counts.ones_reached[0, w] = 0
    for r in range(rows.runs.size):
        low, high, run, first = rows.bounds[r], rows.bounds[r + 1], rows.runs[r], r * robots
        if from_start:
            replayed[r] = 0
            for i in range(robots):
                e = first + i
                begin_agent(swarm.agents[e])
                begin(swarm.states[e], views(swarm.arrays, e), begin_draws(seed, run, i), swarm.params[i],
                      world_of_robot(world, i))  # fmt: skip
        for m in range(unsigned(replayed[r]), unsigned(high - low)):
            k, after = unsigned(low) + m, m + unsigned(1)
            if rows.time_s[k] > limit_s:
                break
            i = signed(rows.robot[k])
            e = first + i
            others = signed(reach.others[k]) if lossy else 0
            end = deliveries.until[k] if deliveries.until.size > 0 else 0
            read_before_sample(
                swarm, e, i, rows.heard[k], lossy, others, rows, low, messages, counts, deliveries, start, end,
                world, seed, run, loss,
            )  # fmt: skip
            start = end
            if not take(swarm, e, i, k, rows, readings, messages, log, steering, world, seed, run):
                return DOES_NOT_SEND
            bit = bit_of(messages[k])
            counts.ones_sent[after] = counts.ones_sent[m] + bit
            swarm.agents[e].own_ones += bit
            counts.own_ones[m] = swarm.agents[e].own_ones
            for w in range(words):
                more = reach.words[k, w] if bit == 1 else np.uint64(0)
                counts.ones_reached[after, w] = counts.ones_reached[m, w] + more
            replayed[r] += 1
        if to_end:
            for i in range(robots):
                e = first + i
                row = swarm.agents[e]
                if row.samples > 0:
                    row.belief = belief(
                        swarm.states[e], views(swarm.arrays, e), swarm.params[i], world_of_robot(world, i)
                    )
                others = signed(reach.others_at_end[e]) if lossy else 0
                end = deliveries.until_at_end[e] if deliveries.until_at_end.size > 0 else 0
                read_before_sample(
                    swarm, e, i, rows.heard_at_end[e], lossy, others, rows, low, messages, counts, deliveries,
                    start, end, world, seed, run, loss,
                )  # fmt: skip
                start = end
    return DONE


@inlined
def take(
    swarm: Swarm, e: int, i: int, k: int, rows: Rows, readings: Readings, messages: NDArray[np.void], log: Log,
    steering: NDArray[np.float64], world: World, seed: int, run: int,
) -> bool:  # fmt: skip
    """Process the sample in row ``k`` of robot ``i``: message, decision, steering and log; return whether it sends."""
    row, s, p, w = swarm.agents[e], swarm.states[e], swarm.params[i], world_of_robot(world, i)
    a, number = views(swarm.arrays, e), signed(rows.sample[k])
    x = own_reading(readings, k, rows.time_s[k], number)
    known_uniform = readings.uniforms[k] if readings.uniforms.size > 0 else -1.0
    sends = on_sample(s, a, x, messages[k], sample_draws(seed, run, i, number, known_uniform), p, w)
    if x.t_s >= swarm.failures[e].opposite_from_s:
        opposite(messages[k])
    row.samples += 1
    row.sent += 1
    new = decision(s, a, p, w)
    if new != row.decision:
        if row.decision == -1:
            row.first_decided_s = rows.time_s[k]
        row.decision, row.decided_s = new, rows.time_s[k]
        row.belief_at_decision = belief(s, a, p, w)
    if HAS_STEER:
        steering[k, 0], steering[k, 1] = steer(s, a, x, steering_draws(seed, run, i, number), p, w)
    if log.belief.size > 0:
        log.states[k], log.decision[k], log.received[k] = s, new, row.received
        log.belief[k] = belief(s, a, p, w)
    return sends
