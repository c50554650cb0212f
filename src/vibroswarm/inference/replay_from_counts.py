"""Replay of recordings whose logs count received messages, but do not say which ones: template of a kernel.

A robot's log has the number n of messages that it received between two samples. A replay draws which messages these
are: n of the messages that other robots sent since its previous sample, chosen at random. Times in a log are a little
late, so n may be larger than the number of messages sent in that time. The rest is then drawn from messages that the
robot has not heard: those of the interval before, those sent up to ``slack_s`` later, and at last all older ones.

``Session`` holds the samples of one recorded run, one per row; the message of a row is the one that its robot sent at
that sample. ``seed`` and ``run`` are part of the address of all random numbers.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import inner, kernel, signed
from vibroswarm.core.rng import LOSS, uniform
from vibroswarm.inference.agents import Swarm, begin_agent, begin_draws, sample_draws, world_of_robot
from vibroswarm.inference.default_hooks import (
    begin,
    belief,
    bit_of,
    decision,
    is_message,
    on_counts,
    on_sample,
    views,
)
from vibroswarm.inference.replay_arrays import (
    DOES_NOT_SEND,
    DONE,
    INVALID_DECISION,
    INVALID_MESSAGE,
    HeardMessages,
    Log,
    Session,
    is_decision,
)
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
    """Choose ``wanted`` of the messages in rows [first, last) at random, and mark them as heard by robot ``i``.

    The messages of robot ``i`` itself, and those that it has heard already, are not chosen. If fewer than ``wanted``
    messages remain, all of them are chosen. All subsets of this size are equally probable.

    Args:
        heard: (rows,): 1 where robot ``i`` has heard the message, else 0; changed. messages: (rows,): messages sent at
            samples. index: number of the robot's sample, which is part of the address of the random numbers.
    Returns: numbers of ones and of zeros among the chosen messages.
    """
    remaining = 0  # number of messages that may be chosen, from row k on
    for k in range(first, last):
        remaining += session.robot[k] != i and heard[k] == 0
    left, ones, zeros = min(wanted, remaining), 0, 0
    for k in range(first, last):
        if left == 0:
            break
        if session.robot[k] == i or heard[k] != 0:
            continue
        # With ``left`` messages still to choose among ``remaining``, each is chosen with probability left / remaining.
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
    """Choose the messages that robot ``i`` has received between its previous sample and that in row ``k``.

    They are chosen from four ranges of rows, each used only if the ranges before it hold too few messages that the
    robot has not heard. The first range holds the messages that are new at this sample: by the times in the log, they
    were sent before its ``hears_until_s``, but too late to be new at the robot's previous sample. The second holds the
    messages that were new at that previous sample. The third holds those sent up to ``slack_s`` after
    ``hears_until_s``, the fourth those before the second.

    Args:
        heard_messages: changed: the chosen messages are marked as heard, and the ranges move on to the next sample.
    Returns: numbers of ones and of zeros among the chosen messages.
    """
    heard, leftover_from, new_from = heard_messages
    # By the times in the log, the messages of rows before ``until`` were sent in time. If these times are late by
    # ``slack_s``, the messages of rows before ``later`` were sent in time too. Neither is above k, since messages of
    # later rows have not been computed yet.
    until = new_from[i]
    while until < k and session.time_s[until] < session.hears_until_s[k]:
        until += 1
    later = until
    while later < k and session.time_s[later] < session.hears_until_s[k] + slack_s:
        later += 1
    received, ones, zeros = session.received[k], 0, 0
    leftover = leftover_from[i]
    for first, last in ((new_from[i], until), (leftover, new_from[i]), (until, later), (0, leftover)):
        if ones + zeros >= received:
            break
        more_ones, more_zeros = choose(
            session, heard[i], messages, i, first, last, received - ones - zeros, seed, run, session.sample[k]
        )
        ones, zeros = ones + more_ones, zeros + more_zeros
    leftover_from[i], new_from[i] = new_from[i], until
    return ones, zeros


# A ``kernel``, not an ``allocating_kernel``: one that allocates counts references to arrays, and would drop references
# to the arrays in tuples that its hooks return.
@kernel
def replay_from_counts(
    session: Session, swarm: Swarm, messages: NDArray[np.void], heard_messages: HeardMessages, log: Log,
    world: World, slack_s: float, seed: int, run: int,
) -> tuple[int, int]:  # fmt: skip
    """Replay one recorded run from its start to its end, or to the first error of the strategy.

    ``first_decided_s`` of the robots is not set, since only closed loops read it.

    Args:
        session: the samples of the run. swarm, heard_messages: state of the run's robots, zeroed; changed.
        messages, log: (rows,), written: message sent at each sample, and state after it. world: as robot 0 knows it.
        slack_s: by how much times in the log may be late, s.
        seed, run: address of the random numbers, which choose the messages that are heard and serve the strategy.

    Returns: ``DONE`` or an error code; and the number of messages that robots received according to their logs, but for
        which no sent message was left to choose.
    """
    rows, robots = session.robot.size, swarm.params.size
    unsent = 0  # the number that is returned
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
        # Recorded readings have no places: pose and lagged place are nan, and the number of the lagged sample is -1.
        bit = signed(session.observation[k])
        x = Reading(bit, session.time_s[k], index, np.nan, np.nan, np.nan, 0.0, -1, np.nan, np.nan, 0.0, 0.0)
        if not on_sample(s, a, x, messages[k], sample_draws(seed, run, i, index, -1.0), p, w):
            return DOES_NOT_SEND, unsent
        if not is_message(messages[k]):
            return INVALID_MESSAGE, unsent
        row.samples += 1
        row.sent += 1
        row.belief = belief(s, a, p, w)
        new = decision(s, a, p, w)
        if not is_decision(new, w.kinds):
            return INVALID_DECISION, unsent
        if new != row.decision:
            row.decision, row.decided_s, row.belief_at_decision = new, session.time_s[k], row.belief
        log.states[k], log.received[k], log.belief[k], log.decision[k] = s, row.received, row.belief, new
    return DONE, unsent
