"""Replay where it is known how many messages each robot received between its samples, not which; a kernel's source.

A robot's log counts the messages it has received. So in each draw as many of the messages that others sent since its
last sample are heard, chosen at random. Times in a log are a little late: where more were received than were sent in
that time, the rest is taken from those left over from the time before, and then from those sent up to ``slack`` later.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vibroswarm.compiled import kernel, signed
from vibroswarm.draws import LOSS, uniform
from vibroswarm.inference.agents import Swarm, begin_agent, of_beginning, of_sample, world_for
from vibroswarm.inference.hooks import begin, belief, bit_of, decision, on_counts, on_sample, views
from vibroswarm.inference.rows import Log, Marks, Session
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
    """Robot ``i`` hears up to ``wanted`` of the others' messages of rows [first, last) that it has not heard.

    Each set of so many is equally likely. Gives how many ones and zeros.
    """
    there = 0
    for k in range(first, last):
        there += session.robot[k] != i and heard[k] == 0
    left, ones, zeros = min(wanted, there), 0, 0
    for k in range(first, last):
        if left == 0:
            break
        if session.robot[k] == i or heard[k] != 0:
            continue
        if uniform(seed, run, i, LOSS, index, k) * there < left:
            heard[k] = 1
            left -= 1
            bit = bit_of(messages[k])
            ones += bit
            zeros += 1 - bit
        there -= 1
    return ones, zeros


# It allocates nothing: a kernel that counts references would drop those of arrays in tuples that its parts give.
@kernel
def replay_from_counts(
    session: Session, swarm: Swarm, messages: NDArray[np.void], marks: Marks, log: Log, world: World, slack_s: float,
    seed: int, run: int,
) -> int:  # fmt: skip
    """One run from the prior to its end; gives how many messages that were received nobody can have sent.

    Args:
        swarm: of one run, messages: (rows,), marks, log: (rows,); overwritten. seed: of which messages are lost,
            and of what the strategy draws.
    """
    rows, robots = session.robot.size, swarm.params.size
    heard, before, since = marks
    unsent = 0
    for i in range(robots):
        begin_agent(swarm.agents[i])
        begin(
            swarm.states[i],
            views(swarm.arrays, i),
            of_beginning(seed, run, i),
            swarm.params[i],
            world_for(world, i),
        )
    for k in range(rows):
        i, index = session.robot[k], session.sample[k]
        until = since[i]
        while until < k and session.time_s[until] < session.hears_until_s[k]:
            until += 1
        later = until
        while later < k and session.time_s[later] < session.hears_until_s[k] + slack_s:
            later += 1
        wanted = session.received[k]
        ones, zeros = choose(session, heard[i], messages, i, since[i], until, wanted, seed, run, index)
        more_ones, more_zeros = choose(
            session, heard[i], messages, i, before[i], since[i], wanted - ones - zeros, seed, run, index
        )
        ones, zeros = ones + more_ones, zeros + more_zeros
        more_ones, more_zeros = choose(
            session, heard[i], messages, i, until, later, wanted - ones - zeros, seed, run, index
        )
        ones, zeros = ones + more_ones, zeros + more_zeros
        unsent += wanted - ones - zeros
        before[i], since[i] = since[i], until
        row, s, p, w, a = (
            swarm.agents[i],
            swarm.states[i],
            swarm.params[i],
            world_for(world, i),
            views(swarm.arrays, i),
        )
        row.received += ones + zeros
        on_counts(s, ones, zeros, p, w)
        bit = signed(session.observation[k])
        x = Reading(bit, session.time_s[k], index, np.nan, np.nan, np.nan, 0.0)
        on_sample(s, a, x, messages[k], of_sample(seed, run, i, index, -1.0), p, w)
        row.samples += 1
        row.sent += 1
        row.belief = belief(s, a, p, w)
        new = decision(s, a, p, w)
        if new != row.decision:
            row.decision, row.decided_s, row.belief_at_decision = new, session.time_s[k], row.belief
        log.states[k], log.received[k], log.belief[k], log.decision[k] = s, row.received, row.belief, new
    return unsent
