"""Replay of a strategy that counts bits, over the samples of runs: template of a kernel.

Such a strategy sends one bit at each sample, and only needs the numbers of ones and zeros that it has received. There
are four ways to get these numbers:

* Without losses every robot hears every message. The number of ones that a robot has received is the number that all
  robots have sent, less its own.
* With losses, ``Reach`` says which robots each message reaches, and the ones that reach each robot are counted.
* With losses (``loss`` > 0) but without ``Reach``, messages are read one by one, and the loss of each is drawn. There
  is no ``Reach`` in a closed loop, and none for large swarms and very long runs (``Timeline.reach``).
* For other networks, ``Deliveries`` lists the messages that each robot reads before each sample.

Robot ``i`` of the r-th run is in row ``e`` = r * robots + i of the swarm's arrays. ``low`` is the first row of the
run's samples, and message m of the run, at ``counts.messages[m]``, is that of row ``low`` + m. ``swarm`` is the state
of all robots, changed in place; ``world`` is what robot 0 knows; ``seed`` and ``run`` are part of the address of all
random numbers.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import branching_kernel, inlined, inner, signed, unsigned
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
    is_message,
    on_counts,
    on_sample,
    opposite_of,
    steer,
    views,
)
from vibroswarm.inference.deliveries import HEARD_ROWS, LAST_OWN, OTHERS, Reach, in_lane
from vibroswarm.inference.replay_arrays import (
    DOES_NOT_SEND,
    DONE,
    INVALID_DECISION,
    INVALID_MESSAGE,
    Counts,
    Deliveries,
    Log,
    Readings,
    Rows,
    is_decision,
    own_reading,
)
from vibroswarm.strategies.world import World


@inlined
def update_counts(swarm: Swarm, e: int, i: int, ones: int, others: int, world: World) -> None:
    """Give robot ``i``, in row ``e``, the messages that it has received since the last update.

    Args:
        ones: number of ones among all messages that it has received since the run began. others: number of all messages
            that it has received (from other robots) since the run began.
    """
    row = swarm.agents[e]
    new, new_ones = others - row.received, ones - row.ones
    row.received, row.ones = others, ones
    on_counts(swarm.states[e], new_ones, new - new_ones, swarm.params[i], world_of_robot(world, i))


@inner
def read_one_by_one(
    swarm: Swarm, e: int, i: int, until: int, rows: Rows, low: int, counts: Counts, world: World, seed: int, run: int,
    loss: float,
) -> None:  # fmt: skip
    """Let robot ``i``, in row ``e``, read the run's messages from its next unread one up to ``until`` - 1.

    The robot's own messages are skipped, and so are messages that are lost on the way to it.

    Args:
        until: index, in the run, of the first message that is not read now. ``heard``, the robot's index of its next
            unread message, is the first index that is read now, and is then set to ``until``.
        rows: samples. low: first row of the run. counts: with the messages. world: as robot 0 knows it.
        loss: probability that a message is lost.
    """
    ones = count = 0  # of the messages that are read now
    for m in range(swarm.agents[e].heard, until):
        sender = signed(rows.robot[low + m])
        if sender != i and not is_lost(seed, run, i, sender, signed(rows.sample[low + m]), loss):
            ones += bit_of(counts.messages[m])
            count += 1
    row = swarm.agents[e]
    row.heard = until
    if count > 0:  # ``update_counts`` takes the totals since the run began
        update_counts(swarm, e, i, row.ones + ones, row.received + count, world)


@inlined
def read_before_sample(
    swarm: Swarm, e: int, i: int, heard: Any, lossy: bool, others: int, rows: Rows, low: int,
    counts: Counts, deliveries: Deliveries, start: int, end: int, world: World, seed: int, run: int, loss: float,
) -> None:  # fmt: skip
    """Let robot ``i``, in row ``e``, read the messages that have reached it before a sample or the end of the run.

    Args:
        heard: the sample's row of ``Rows.heard`` or, at the end of the run, the robot's row of ``heard_at_end``;
            not used if there are deliveries.
        lossy: whether messages are lost and ``counts.ones_reached`` counts the ones that reach each robot. others:
            number of messages received since the run began; used only if ``lossy``.
        counts: the run's messages so far, and numbers of ones among them.
        deliveries: lists of messages, or empty. start, end: range of the new messages in ``deliveries.which``; used
            only if there are deliveries. loss: probability that a message is lost.
    """
    # ``until_at_end`` is empty only without deliveries; ``until`` is also empty if there are no samples.
    if deliveries.until_at_end.size > 0:
        ones, row = 0, swarm.agents[e]
        for place in range(start, end):
            ones += bit_of(counts.messages[deliveries.which[place]])
        if end > start:
            update_counts(swarm, e, i, row.ones + ones, row.received + end - start, world)
    elif lossy:
        ones = in_lane(counts.ones_reached[unsigned(heard[HEARD_ROWS])], signed(i))
        update_counts(swarm, e, i, ones, others, world)
    elif loss > 0.0:  # with losses, but without ``Reach``
        read_one_by_one(swarm, e, i, signed(heard[HEARD_ROWS]), rows, low, counts, world, seed, run, loss)
    else:  # without losses: all ones that were sent, less the robot's own
        ones = counts.ones_sent[unsigned(heard[HEARD_ROWS])]
        if heard[LAST_OWN] >= 0:
            ones -= counts.own_ones[unsigned(heard[LAST_OWN])]
        update_counts(swarm, e, i, ones, signed(heard[OTHERS]), world)


@branching_kernel
def replay(
    rows: Rows, readings: Readings, replayed: NDArray[np.int64], swarm: Swarm, messages: NDArray[np.void],
    counts: Counts, log: Log, steering: Any, world: World, seed: int, loss: float, reach: Reach,
    deliveries: Deliveries, from_start: bool, to_end: bool, limit_s: float,
) -> int:  # fmt: skip
    """Replay the runs, one after the other, from where the last call stopped; return ``DONE`` or an error code.

    Only a single run without ``deliveries`` can be continued by a later call: ``counts`` holds the counts of one run,
    and deliveries are read from their first one at each call.

    Args:
        rows, readings: samples and what robots read at them. replayed: (runs,): number of samples replayed so far,
            changed. swarm: state of all robots, changed. messages: (rows,): message sent at each sample, written
            unless it is empty.
        counts: state between calls, changed. log: state after each sample, written unless it is empty.
        steering: (rows, 2): turn (deg) and leg (ms) that the strategy chooses at each sample; written if it steers,
            else 0. world: as robot 0 knows it.
        loss: probability that a message is lost. reach: receivers of messages, or empty. deliveries: those of whole
            runs for networks other than ideal and loss, else empty.
        from_start: begin at time 0, not where the last call stopped. to_end: also read the messages that arrive after
            the last sample. limit_s: do not replay samples after this time.
    """
    robots = swarm.params.size
    lossy = reach.words.shape[1] > 0  # whether ``reach`` says which robots each message reaches
    # start: index of the first delivery that is not read yet. The deliveries are listed in the order in which they are
    # read here: by run and, in each run, sample by sample and then, at its end, robot by robot.
    start = 0
    counts.ones_sent[0] = 0  # before the first message of a run there are no ones
    for w in range(unsigned(reach.words.shape[1])):
        counts.ones_reached[0, w] = 0
    for r in range(rows.runs.size):
        low, high, run, first = rows.bounds[r], rows.bounds[r + 1], rows.runs[r], r * robots
        if from_start:
            replayed[r] = 0
            begin_robots(swarm, first, world, seed, run)
        until = high - low
        while until > replayed[r] and rows.time_s[low + until - 1] > limit_s:
            until -= 1
        # m: row of the sample, and number of its message, from the run's first; unsigned indices are faster.
        for m in range(unsigned(replayed[r]), unsigned(until)):
            k = unsigned(low) + m
            i = signed(rows.robot[k])
            e = unsigned(first + i)
            # Number of messages heard so far, and end of the deliveries before this sample, where these are used.
            others = signed(reach.others[k]) if lossy else 0
            end = deliveries.until[k] if deliveries.until.size > 0 else 0
            read_before_sample(
                swarm, e, i, rows.heard[k], lossy, others, rows, low, counts, deliveries, start, end, world, seed, run,
                loss,
            )  # fmt: skip
            start = end
            status = take(swarm, e, i, m, k, rows, readings, counts, log, steering, world, seed, run)
            if status != DONE:
                return status
            if not is_message(counts.messages[m]):
                return INVALID_MESSAGE
            count_bit(swarm, e, m, k, bit_of(counts.messages[m]), counts, reach)
            if messages.size > 0:
                messages[k] = counts.messages[m]
        replayed[r] = until
        if to_end:
            start = read_to_end(
                swarm, first, rows, low, counts, reach, deliveries, start, world, seed, run, loss
            )
    return DONE


@inlined
def begin_robots(swarm: Swarm, first: int, world: World, seed: int, run: int) -> None:
    """Set the robots of a run, in rows from ``first`` on, to time 0."""
    for i in range(swarm.params.size):
        e = unsigned(first + i)
        begin_agent(swarm.agents[e])
        begin(swarm.states[e], views(swarm.arrays, e), begin_draws(seed, run, i), swarm.params[i],
              world_of_robot(world, i))  # fmt: skip


@inlined
def count_bit(swarm: Swarm, e: int, m: Any, k: Any, bit: int, counts: Counts, reach: Reach) -> None:
    """Count the bit of a message: among all that were sent, the robot's own, and those that reach each robot.

    Args:
        e: row of the robot. m, k: number of the message in its run, and row of its sample; both are unsigned.
    """
    after = m + unsigned(1)
    counts.ones_sent[after] = counts.ones_sent[m] + bit
    swarm.agents[e].own_ones += bit
    counts.own_ones[m] = swarm.agents[e].own_ones
    # Add 1 in the lane of each robot that a message of 1 reaches.
    for w in range(unsigned(reach.words.shape[1])):
        more = reach.words[k, w] if bit == 1 else np.uint64(0)
        counts.ones_reached[after, w] = counts.ones_reached[m, w] + more


@inlined
def read_to_end(
    swarm: Swarm, first: int, rows: Rows, low: int, counts: Counts, reach: Reach, deliveries: Deliveries, start: int,
    world: World, seed: int, run: int, loss: float,
) -> int:  # fmt: skip
    """Let the robots of a run read the messages that arrive after their last samples, and compute their beliefs.

    Returns: index of the first delivery that is not read yet; ``start`` is that before the call.
    """
    lossy = reach.words.shape[1] > 0
    for i in range(swarm.params.size):
        e = unsigned(first + i)
        row = swarm.agents[e]
        # The final belief is that after the last sample, before later messages are read.
        if row.samples > 0:
            row.belief = belief(
                swarm.states[e], views(swarm.arrays, e), swarm.params[i], world_of_robot(world, i)
            )
        others = signed(reach.others_at_end[e]) if lossy else 0
        end = deliveries.until_at_end[e] if deliveries.until_at_end.size > 0 else 0
        read_before_sample(
            swarm, e, i, rows.heard_at_end[e], lossy, others, rows, low, counts, deliveries, start, end, world, seed,
            run, loss,
        )  # fmt: skip
        start = end
    return start


@inlined
def take(
    swarm: Swarm, e: int, i: int, m: Any, k: Any, rows: Rows, readings: Readings, counts: Counts, log: Log,
    steering: Any, world: World, seed: int, run: int,
) -> int:  # fmt: skip
    """Let the strategy handle a sample: update state, decision, steering and log, and write the message to send.

    The robot's ``belief`` is not updated here; ``replay`` computes it once, at the end of the run.

    Args:
        e, i: row and number of the robot. m, k: number of the message in its run, and row of its sample; both are
            unsigned. counts: its message ``m`` is written. log, steering: their row ``k`` is written, if they are
            requested.
    Returns: ``DONE`` or an error code, which ends the replay.
    """
    row, s, p, w = swarm.agents[e], swarm.states[e], swarm.params[i], world_of_robot(world, i)
    a, number = views(swarm.arrays, e), signed(rows.sample[k])
    x = own_reading(readings, k, rows.time_s[k], number)
    known_uniform = readings.uniforms[k] if readings.uniforms.size > 0 else -1.0  # below 0: not computed yet
    # The strategy writes its message to a zeroed row.
    counts.messages[m] = counts.zero_message[0]
    sends = on_sample(s, a, x, counts.messages[m], sample_draws(seed, run, i, number, known_uniform), p, w)
    # A faulty robot sends the opposite of its message. The time is read again: kept in ``x`` while ``on_sample`` runs,
    # it makes the replay of soft feedback a third slower.
    if rows.time_s[k] >= swarm.failures[e].opposite_from_s:
        opposite_of(counts.messages[m], w)
    row.samples += 1
    row.sent += 1
    new = decision(s, a, p, w)
    if new != row.decision:
        if not is_decision(new, w.kinds):
            return INVALID_DECISION
        if row.decision == -1:
            row.first_decided_s = rows.time_s[k]
        row.decision, row.decided_s = new, rows.time_s[k]
        row.belief_at_decision = belief(s, a, p, w)
    if HAS_STEER:
        steering[k, 0], steering[k, 1] = steer(s, a, x, steering_draws(seed, run, i, number), p, w)
    if log.belief.size > 0:
        log.states[k], log.decision[k], log.received[k] = s, new, row.received
        log.belief[k] = belief(s, a, p, w)
    return DONE if sends else DOES_NOT_SEND
