"""Replay over observations where it is known how many messages each robot received between its samples, not which.

A robot's log counts the messages it has received. So in each draw as many of the messages that others sent since its
last sample are heard, chosen at random. Times in a log are a little late: where more were received than were sent in
that time, the rest is taken from those left over from the time before, and then from those sent up to ``slack`` later.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.compiled import allocating_kernel, kernel, signed
from vibroswarm.draws import ALONE, LOSS, MESSAGE, uniform
from vibroswarm.inference.minds import begin_minds, load_mind, store_mind, take_sample
from vibroswarm.inference.replay import Columns, write_row
from vibroswarm.strategies.belief_table import Beliefs
from vibroswarm.strategies.program import SOFT, MindProgram, receive


class Session(NamedTuple):
    """One run's samples in the order of time, (rows,) each."""

    robot: NDArray[np.int64]
    sample: NDArray[np.int64]
    time_s: NDArray[np.float64]
    hears_until_s: NDArray[np.float64]
    """What was sent before this has arrived when the sample is taken."""
    received: NDArray[np.int64]
    """Messages received since the robot's row before."""
    observation: NDArray[np.uint8]


@kernel
def choose(
    session: Session,
    heard: NDArray[np.uint8],
    message: NDArray[np.uint8],
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
            ones += message[k]
            zeros += 1 - message[k]
        there -= 1
    return ones, zeros


@allocating_kernel
def replay_counted(
    session: Session,
    minds: NDArray[np.void],
    message: NDArray[np.uint8],
    columns: Columns,
    program: MindProgram,
    beliefs: Beliefs,
    slack_s: float,
    seed: int,
    run: int,
) -> int:
    """One run from the prior to its end; gives how many messages that were received nobody can have sent.

    Args:
        minds: (robots,), message: (rows,), columns: overwritten. seed: of which messages are lost, and of soft bits.
    """
    rows, robots = session.robot.size, minds.size
    heard = np.zeros((robots, rows), dtype=np.uint8)
    before = np.zeros(robots, dtype=np.int64)  # from here on messages may be left over
    since = np.zeros(robots, dtype=np.int64)  # from here on they are new
    unsent = 0
    begin_minds(minds, program)
    for k in range(rows):
        i, index = session.robot[k], session.sample[k]
        until = since[i]
        while until < k and session.time_s[until] < session.hears_until_s[k]:
            until += 1
        later = until
        while later < k and session.time_s[later] < session.hears_until_s[k] + slack_s:
            later += 1
        wanted = session.received[k]
        ones, zeros = choose(session, heard[i], message, i, since[i], until, wanted, seed, run, index)
        more_ones, more_zeros = choose(
            session, heard[i], message, i, before[i], since[i], wanted - ones - zeros, seed, run, index
        )
        ones, zeros = ones + more_ones, zeros + more_zeros
        more_ones, more_zeros = choose(
            session, heard[i], message, i, until, later, wanted - ones - zeros, seed, run, index
        )
        ones, zeros = ones + more_ones, zeros + more_zeros
        unsent += wanted - ones - zeros
        before[i], since[i] = since[i], until
        store_mind(minds, i, receive(load_mind(minds, i), ones, zeros))
        u = 0.5
        if program.strategy == SOFT:
            u = uniform(seed, run, i, MESSAGE, index, ALONE)
        message[k] = take_sample(minds, i, k, signed(session.observation[k]), u, program, beliefs, True)
        write_row(columns, k, minds, i)
    return unsent
