"""Replay of a strategy that counts bits, over the samples of runs: the source of a kernel, compiled for each strategy.

Without loss everybody hears everything, so what a robot has received follows from how many ones all have sent so far,
less its own; with loss it is heard message by message, and who loses what is drawn once for all strategies.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vibroswarm.compiled import inlined, inner, kernel, signed, unsigned
from vibroswarm.inference.agents import (
    Swarm,
    begin_agent,
    is_lost,
    of_beginning,
    of_sample,
    of_steering,
    world_for,
)
from vibroswarm.inference.hooks import (
    HAS_STEER,
    begin,
    belief,
    bit_of,
    decision,
    on_counts,
    on_sample,
    steer,
    views,
)
from vibroswarm.inference.rows import DOES_NOT_SEND, DONE, Counts, Log, Readings, Rows
from vibroswarm.inference.timeline import HEARD_ROWS, LAST_OWN, OTHERS, Reach, in_lane
from vibroswarm.strategies.world import Reading, World


@inlined
def come_past(swarm: Swarm, e: int, i: int, ones: int, others: int, world: World) -> None:
    """Robot ``i``, in row ``e``, has heard so many messages in all, so many of them ones."""
    row = swarm.agents[e]
    new, new_ones = others - row.received, ones - row.ones
    row.received, row.ones = others, ones
    on_counts(swarm.states[e], new_ones, new - new_ones, swarm.params[i], world_for(world, i))


@inner
def hear(
    swarm: Swarm, e: int, i: int, until: int, rows: Rows, low: int, messages: NDArray[np.void], world: World,
    seed: int, run: int, loss: float,
) -> None:  # fmt: skip
    """Robot ``i`` reads, message by message, what it has not come past of the run's first ``until`` messages."""
    ones = count = 0
    for m in range(swarm.agents[e].heard, until):
        sender = signed(rows.robot[low + m])
        if sender != i and not is_lost(seed, run, i, sender, signed(rows.sample[low + m]), loss):
            ones += bit_of(messages[low + m])
            count += 1
    row = swarm.agents[e]
    row.heard = until
    if count > 0:
        come_past(swarm, e, i, row.ones + ones, row.received + count, world)


@inlined
def hear_before(
    swarm: Swarm, e: int, i: int, heard: Any, told: bool, others: int, rows: Rows, low: int,
    messages: NDArray[np.void], counts: Counts, world: World, seed: int, run: int, loss: float,
) -> None:  # fmt: skip
    """Robot ``i`` hears what it has come past, a row of ``Timeline.heard``."""
    if told:
        ones = in_lane(counts.ones_reached[unsigned(heard[HEARD_ROWS])], signed(i))
        come_past(swarm, e, i, ones, others, world)
    elif loss > 0.0:
        hear(swarm, e, i, signed(heard[HEARD_ROWS]), rows, low, messages, world, seed, run, loss)
    else:
        ones = counts.ones_sent[unsigned(heard[HEARD_ROWS])]
        if heard[LAST_OWN] >= 0:
            ones -= counts.own_ones[unsigned(heard[LAST_OWN])]
        come_past(swarm, e, i, ones, signed(heard[OTHERS]), world)


@kernel
def replay(
    rows: Rows, readings: Readings, taken: NDArray[np.int64], swarm: Swarm, messages: NDArray[np.void], counts: Counts,
    log: Log, course: NDArray[np.float64], world: World, seed: int, loss: float, reach: Reach, begins: bool,
    ends: bool, limit_s: float,
) -> int:  # fmt: skip
    """The runs, one after the other, from where they stopped; gives ``DONE``, or what is wrong with the strategy.

    Args:
        taken: (runs,): how many samples of each have been replayed, changed. messages: (rows,), written. log: written;
            of no rows: only the swarm is wanted. course: (rows, 2), written where a strategy steers, else of no rows.
        begins: from the prior. ends: also hear what is heard after the last sample. limit_s: no further than this.
    """
    robots = swarm.params.size
    told, words = reach.words.shape[1] > 0, unsigned(reach.words.shape[1])
    counts.ones_sent[0] = 0
    for w in range(words):
        counts.ones_reached[0, w] = 0
    for r in range(rows.runs.size):
        low, high, run, first = rows.bounds[r], rows.bounds[r + 1], rows.runs[r], r * robots
        if begins:
            taken[r] = 0
            for i in range(robots):
                e = first + i
                begin_agent(swarm.agents[e])
                begin(swarm.states[e], views(swarm.arrays, e), of_beginning(seed, run, i), swarm.params[i],
                      world_for(world, i))  # fmt: skip
        for m in range(unsigned(taken[r]), unsigned(high - low)):
            k, after = unsigned(low) + m, m + unsigned(1)
            if rows.time_s[k] > limit_s:
                break
            i = signed(rows.robot[k])
            e = first + i
            others = signed(reach.others[k]) if told else 0
            hear_before(
                swarm, e, i, rows.heard[k], told, others, rows, low, messages, counts, world, seed, run, loss
            )
            if not take(swarm, e, i, k, rows, readings, messages, log, course, world, seed, run):
                return DOES_NOT_SEND
            bit = bit_of(messages[k])
            counts.ones_sent[after] = counts.ones_sent[m] + bit
            swarm.agents[e].own_ones += bit
            counts.own_ones[m] = swarm.agents[e].own_ones
            for w in range(words):
                more = reach.words[k, w] if bit == 1 else np.uint64(0)
                counts.ones_reached[after, w] = counts.ones_reached[m, w] + more
            taken[r] += 1
        if ends:
            for i in range(robots):
                e = first + i
                row = swarm.agents[e]
                if row.samples > 0:
                    row.belief = belief(
                        swarm.states[e], views(swarm.arrays, e), swarm.params[i], world_for(world, i)
                    )
                others = signed(reach.others_at_end[e]) if told else 0
                hear_before(
                    swarm,
                    e,
                    i,
                    rows.heard_at_end[e],
                    told,
                    others,
                    rows,
                    low,
                    messages,
                    counts,
                    world,
                    seed,
                    run,
                    loss,
                )
    return DONE


@inlined
def take(
    swarm: Swarm, e: int, i: int, k: int, rows: Rows, readings: Readings, messages: NDArray[np.void], log: Log,
    course: NDArray[np.float64], world: World, seed: int, run: int,
) -> bool:  # fmt: skip
    """Robot ``i`` takes the sample of row ``k``; gives whether it sends."""
    row, s, p, w = swarm.agents[e], swarm.states[e], swarm.params[i], world_for(world, i)
    a, number = views(swarm.arrays, e), signed(rows.sample[k])
    x = Reading(
        signed(readings.observation[k]),
        rows.time_s[k],
        number,
        readings.x_m[k] if readings.x_m.size > 0 else np.nan,
        readings.y_m[k] if readings.y_m.size > 0 else np.nan,
        readings.heading_rad[k] if readings.heading_rad.size > 0 else np.nan,
        0.0,
    )
    first = readings.numbers[k] if readings.numbers.size > 0 else -1.0
    sends = on_sample(s, a, x, messages[k], of_sample(seed, run, i, number, first), p, w)
    row.samples += 1
    row.sent += 1
    new = decision(s, a, p, w)
    if new != row.decision:
        if row.decision == -1:
            row.first_decided_s = rows.time_s[k]
        row.decision, row.decided_s = new, rows.time_s[k]
        row.belief_at_decision = belief(s, a, p, w)
    if HAS_STEER:
        course[k, 0], course[k, 1] = steer(s, a, x, of_steering(seed, run, i, number), p, w)
    if log.belief.size > 0:
        log.states[k], log.decision[k], log.received[k] = s, new, row.received
        log.belief[k] = belief(s, a, p, w)
    return sends
