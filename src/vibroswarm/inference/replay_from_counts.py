"""Replay of recordings that count received messages without saying which ones: template of a kernel.

A robot's log counts the messages it has received. In each draw, that many of the messages the others sent since
its last sample are heard, chosen at random. Times in a log are a little late: if a robot received more messages
than were sent in that time, the rest is taken from messages left over from earlier, then from those sent up to
``slack_s`` later.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import inner, kernel, signed
from vibroswarm.core.rng import LOSS, uniform
from vibroswarm.inference.agents import Swarm, begin_agent, begin_draws, sample_draws, world_of_robot
from vibroswarm.inference.default_hooks import begin, belief, bit_of, decision, on_counts, on_sample, views
from vibroswarm.inference.replay_arrays import HeardMessages, Log, Session
from vibroswarm.strategies.world import Reading, World


@kernel
def choose(
    session: Session,
    heard: NDArray[np.uint8],
    messages: NDArray[np.void],
    i: int,
    first: int,
    last: int,
    wanted: int,
    seed: int,
    run: int,
    index: int,
) -> tuple[int, int]:
    """Choose ``wanted`` of the others' messages in rows [first, last) that robot ``i`` has not heard, and mark them as
    heard; all of them if there are fewer.

    All subsets of this size are equally likely. Returns the numbers of ones and zeros chosen.
    """
    remaining = 0
    for k in range(first, last):
        remaining += session.robot[k] != i and heard[k] == 0
    left, ones, zeros = min(wanted, remaining), 0, 0
    for k in range(first, last):
        if left == 0:
            break
        if session.robot[k] == i or heard[k] != 0:
            continue
        if uniform(seed, run, i, LOSS, index, k) * remaining < left:
            heard[k] = 1
            left -= 1
            bit = bit_of(messages[k])
            ones += bit
            zeros += 1 - bit
        remaining -= 1
    return ones, zeros


@inner
def hear(
    session: Session, heard_messages: HeardMessages, messages: NDArray[np.void], i: int, k: int, slack_s: float,
    seed: int, run: int,
) -> tuple[int, int]:  # fmt: skip
    """Choose the messages that robot ``i`` has received by its sample in row ``k``.

    Those sent since its last sample come first, then what was left over from before, then what was sent up to
    ``slack_s`` later. Returns the numbers of ones and zeros.
    """
    heard, leftover_from, new_from = heard_messages
    until = new_from[i]
    while until < k and session.time_s[until] < session.hears_until_s[k]:
        until += 1
    later = until
    while later < k and session.time_s[later] < session.hears_until_s[k] + slack_s:
        later += 1
    received, ones, zeros = session.received[k], 0, 0
    for first, last in ((new_from[i], until), (leftover_from[i], new_from[i]), (until, later)):
        more_ones, more_zeros = choose(
            session, heard[i], messages, i, first, last, received - ones - zeros, seed, run, session.sample[k]
        )
        ones, zeros = ones + more_ones, zeros + more_zeros
    leftover_from[i], new_from[i] = new_from[i], until
    return ones, zeros


# Without allocation: a kernel that counts references would drop those of arrays in tuples that its hooks return.
@kernel
def replay_from_counts(
    session: Session, swarm: Swarm, messages: NDArray[np.void], heard_messages: HeardMessages, log: Log,
    world: World, slack_s: float, seed: int, run: int,
) -> int:  # fmt: skip
    """Replay one run from the prior to its end.

    Args:
        swarm, heard_messages: of one run, overwritten.
        messages, log: (rows,), overwritten.
        seed: seed of the lost messages and of the strategy's random numbers.

    Returns: the number of received messages for which no sent message was left.
    """
    rows, robots = session.robot.size, swarm.params.size
    unsent = 0
    for i in range(robots):
        begin_agent(swarm.agents[i])
        begin(swarm.states[i], views(swarm.arrays, i), begin_draws(seed, run, i), swarm.params[i],
              world_of_robot(world, i))  # fmt: skip
    for k in range(rows):
        i, index = session.robot[k], session.sample[k]
        ones, zeros = hear(session, heard_messages, messages, i, k, slack_s, seed, run)
        unsent += session.received[k] - ones - zeros
        row, s, p, w = swarm.agents[i], swarm.states[i], swarm.params[i], world_of_robot(world, i)
        a = views(swarm.arrays, i)
        row.received += ones + zeros
        on_counts(s, ones, zeros, p, w)
        bit = signed(session.observation[k])
        x = Reading(bit, session.time_s[k], index, np.nan, np.nan, np.nan, 0.0, -1, np.nan, np.nan, 0.0, 0.0)
        on_sample(s, a, x, messages[k], sample_draws(seed, run, i, index, -1.0), p, w)
        row.samples += 1
        row.sent += 1
        row.belief = belief(s, a, p, w)
        new = decision(s, a, p, w)
        if new != row.decision:
            row.decision, row.decided_s, row.belief_at_decision = new, session.time_s[k], row.belief
        log.states[k], log.received[k], log.belief[k], log.decision[k] = s, row.received, row.belief, new
    return unsent
