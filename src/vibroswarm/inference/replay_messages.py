"""Replay of a strategy, with timers, over the samples of runs: template of the kernel for every strategy and network.

A strategy that counts bits (``COUNTS``) is given the numbers of ones and zeros that it has not read yet; over the ideal
network they are differences of sums over all messages. All others read message by message. Events (samples and timers)
are processed in the order of tick and robot. Before each of its events, a robot reads the messages that have arrived at
it.

Robot ``i`` of the r-th run is in row ``e`` = r * robots + i of the swarm's arrays; ``first`` is the row of its run's
robot 0. ``low`` is the first row of the run's samples. ``s``, ``a``, ``p``, ``w`` are the robot's state, arrays and
parameters and the world as it knows it. ``swarm`` is the state of all robots, ``buffer`` holds the messages of the
current run; both are changed in place. ``seed`` and ``run`` are part of the address of all random numbers.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import inlined, inner, kernel, signed
from vibroswarm.core.rng import ALONE, LOSS, NETWORK, STEERING
from vibroswarm.inference.agents import (
    Swarm,
    begin_agent,
    begin_draws,
    message_draws,
    sample_draws,
    timer_draws,
    world_of_robot,
)
from vibroswarm.inference.default_hooks import (
    COUNTS,
    HAS_SEND,
    HAS_STEER,
    HAS_TIMER,
    HEARS_ALL,
    IS_OPINION,
    READS_POSITIONS,
    begin,
    belief,
    bit_of,
    clear_network,
    decision,
    is_message,
    lost,
    next_s,
    on_counts,
    on_message,
    on_sample,
    on_timer,
    opposite_of,
    send,
    steer,
    views,
)
from vibroswarm.inference.deliveries import positions_at
from vibroswarm.inference.replay_arrays import (
    AGREED_SINCE,
    BUFFER_FULL,
    DONE,
    INVALID_DECISION,
    INVALID_MESSAGE,
    SETTLED,
    Log,
    MessageBuffer,
    Readings,
    Rows,
    Stops,
    clear_inbox,
    is_decision,
    own_reading,
    put_message,
    take_first,
)
from vibroswarm.strategies.world import Draws, World

NEVER = 2**62
"""A tick that no run reaches."""


@inner
def read_arrived(
    swarm: Swarm, e: int, i: int, walked: int, buffer: MessageBuffer, world: World, seed: int, run: int,
    network_params: Any,
) -> None:  # fmt: skip
    """Let robot ``i``, in row ``e``, read the messages that have arrived by tick ``walked``, at which it last walked.

    Shapes: ``network_params`` (1,).

    A robot reads only while it walks, and never again from the tick on at which its radio is dead. A message that
    arrives while the robot stands is read at the first tick at which it walks again. One that stands from sample to
    sample, as robots of a user's source may, reads just before each sample.
    """
    row, s, p, w = swarm.agents[e], swarm.states[e], swarm.params[i], world_of_robot(world, i)
    a = views(swarm.arrays, e)
    # since: the first tick after its last sample, at which it walks again. last: the last tick before its radio is
    # dead.
    count, since, last = buffer.filled[0], row.sample_tick + 1, swarm.failures[e].silent_tick - 1
    if last < since:
        return
    walked = min(walked, last)
    if COUNTS and HEARS_ALL and walked >= since:  # all messages sent before it last walked, less its own
        heard = count
        while heard > 0 and buffer.tick[heard - 1] >= walked:
            heard -= 1
        got, ones = heard - row.sent - row.received, buffer.ones[heard] - row.own_ones - row.ones
        row.heard, row.received, row.ones = heard, row.received + got, row.ones + ones
        on_counts(s, ones, got - ones, p, w)
        return
    got = ones = 0
    if HAS_SEND:
        inbox = buffer.inbox
        while inbox.first[i] >= 0 and inbox.arrival_tick[inbox.first[i]] <= walked:
            m, arrival_tick = inbox.message[inbox.first[i]], inbox.arrival_tick[inbox.first[i]]
            take_first(inbox, i)
            got += 1
            if COUNTS:
                ones += bit_of(buffer.messages[m])
            else:
                read_message(s, a, buffer, m, max(arrival_tick, since), seed, run, i, p, w)
    else:  # a message arrives at the next tick or is lost
        while row.heard < count and buffer.tick[row.heard] < walked:
            m = row.heard
            row.heard += 1
            sender, number = buffer.sender[m], buffer.number[m]
            if sender == i or lost(
                sender, i, Draws(seed, run, i, LOSS, number, sender, 16, -1.0), network_params[0], w
            ):
                continue
            got += 1
            if COUNTS:
                ones += bit_of(buffer.messages[m])
            else:
                read_message(s, a, buffer, m, max(buffer.tick[m] + 1, since), seed, run, i, p, w)
    row.received += got
    if COUNTS and got > 0:
        row.ones += ones
        on_counts(s, ones, got - ones, p, w)


@inlined
def read_message(
    s: Any, a: Any, buffer: MessageBuffer, m: int, tick: int, seed: int, run: int, i: int, p: Any, w: World
) -> None:
    """Let robot ``i`` read message ``m`` of the buffer at tick ``tick``; its state ``s`` and arrays ``a`` change."""
    sender, t_s = buffer.sender[m], time_of(tick, w)
    on_message(
        s, a, buffer.messages[m], sender, t_s, message_draws(seed, run, i, sender, buffer.number[m]), p, w
    )


@inlined
def send_message(
    swarm: Swarm, e: int, i: int, tick: int, buffer: MessageBuffer, world: World, seed: int, run: int,
    network_params: Any, network_state: Any, network_arrays: Any, bytes_on_air: int,
) -> bool:  # fmt: skip
    """Send the message that the strategy of robot ``i``, in row ``e``, has written to the end of ``buffer``."""
    row, m = swarm.agents[e], buffer.filled[0]
    buffer.sender[m], buffer.tick[m], buffer.number[m] = i, tick, row.sent
    if HAS_SEND:
        d = Draws(seed, run, i, NETWORK, row.sent, ALONE, 0, -1.0)
        buffer.arrival[:] = -1  # robots that the network leaves out hear nothing
        send(
            network_state[0], network_arrays, i, tick, row.sent, bytes_on_air, buffer.x_m, buffer.y_m,
            buffer.arrival, d, network_params[0], world_of_robot(world, i),
        )  # fmt: skip
        # max: a network may not deliver a message in the control period in which it was sent.
        for j in range(buffer.arrival.size):
            arrives = j != i and buffer.arrival[j] >= 0
            if arrives and not put_message(buffer.inbox, j, m, max(buffer.arrival[j], tick + 1)):
                return False
    if COUNTS and HEARS_ALL:
        bit = bit_of(buffer.messages[m])
        buffer.ones[m + 1] = buffer.ones[m] + bit
        row.own_ones += bit
    for j in range(buffer.arrivals.shape[1]):  # none, unless they are to be listed
        if HAS_SEND:
            at = buffer.arrival[j]
        else:
            d = Draws(seed, run, j, LOSS, row.sent, i, 16, -1.0)
            at = -1 if lost(i, j, d, network_params[0], world_of_robot(world, j)) else tick
        buffer.arrivals[m, j] = -1 if j == i or at < 0 else max(at, tick + 1)
    row.sent += 1
    buffer.filled[0] += 1
    return True


@inlined
def time_of(tick: int, w: World) -> float:
    """Return the time of a tick, s; this order of operations gives the float nearest to the exact decimal."""
    return tick * w.tick_ms / 1000.0


@inlined
def due_tick(swarm: Swarm, e: int, w: World) -> int:
    """Return the tick of the timer, after the robot's last event; ``NEVER`` if none is set."""
    at_s, row = next_s(swarm.states[e]), swarm.agents[e]
    if not at_s < 1e12:  # nan or inf: no timer; larger times would not fit into an integer
        return NEVER
    # Without the 1e-9, rounding could give n + 1 for a time of exactly n ticks.
    at_tick: int = max(signed(np.ceil(at_s * 1000.0 / w.tick_ms - 1e-9)), row.tick + 1)
    return at_tick


@inlined
def update_decision(
    swarm: Swarm, first: int, e: int, i: int, tick: int, t_s: float, agreement: NDArray[np.int64], world: World,
    is_logged: bool,
) -> int:  # fmt: skip
    """Update belief, timer and decision after a sample or timer; of opinions, the tick since which all that count
    agree.
    """
    row, s, p, w = swarm.agents[e], swarm.states[e], swarm.params[i], world_of_robot(world, i)
    a = views(swarm.arrays, e)
    row.tick = tick
    new = decision(s, a, p, w)
    if is_logged or IS_OPINION or HAS_STEER or new != row.opinion:  # else it is computed once, at the end
        row.belief = belief(s, a, p, w)
    if not is_decision(new, w.kinds):
        return INVALID_DECISION
    if HAS_TIMER:
        row.due_tick = due_tick(swarm, e, w)
    if new != row.opinion:
        row.opinion = new
        if IS_OPINION:
            agreed = new != -1  # whether all robots that count have this opinion now
            for j in range(first, first + w.robots):
                agreed = agreed and (swarm.agents[j].opinion == new or swarm.failures[j].works == 0)
            # The opinion of a robot that does not count changes nothing, nor does any opinion after decisions are made.
            if agreement[SETTLED] == 0 and swarm.failures[e].works == 1:
                agreement[AGREED_SINCE] = tick if agreed else -1
        else:
            if row.decision == -1:
                row.first_decided_s = t_s
            row.decision, row.decided_s, row.belief_at_decision = new, t_s, row.belief
    return DONE


@inlined
def settle_opinions(swarm: Swarm, first: int, tick: int, agreement: NDArray[np.int64], world: World) -> None:
    """Turn the opinions of a run's robots into decisions if, at this tick, they have agreed for ``world.hold_s``.

    The time of the decisions is that since which the opinions agree. ``first_decided_s``, the time at which this was
    known, is ``hold_s`` later. A robot that does not count (``update_decision``) gets its own opinion as its decision,
    even if the others do not agree with it.
    """
    since = agreement[AGREED_SINCE]
    long_enough = time_of(tick - since, world) >= world.hold_s
    if IS_OPINION and since >= 0 and agreement[SETTLED] == 0 and long_enough:
        agreement[SETTLED] = 1
        for e in range(first, first + world.robots):
            row = swarm.agents[e]
            if row.opinion == -1:
                continue  # a robot that failed before it had an opinion
            row.decision, row.decided_s, row.belief_at_decision = (
                row.opinion,
                time_of(since, world),
                row.belief,
            )
            row.first_decided_s = row.decided_s + world.hold_s


@inlined
def note_decided(swarm: Swarm, first: int, decided_s: NDArray[np.float64], r: int) -> None:
    """Write when all robots of the r-th run had decided, if they have and it is not written; arguments as elsewhere."""
    latest_s = 0.0
    for e in range(first, first + swarm.params.size):
        if decided_s[r] < np.inf or swarm.agents[e].decision == -1:
            return
        latest_s = max(latest_s, swarm.agents[e].first_decided_s)
    decided_s[r] = latest_s


@inner
def begin_run(
    swarm: Swarm, first: int, buffer: MessageBuffer, tracks: Any, world: World, network_state: NDArray[np.void],
    network_arrays: Any, seed: int, run: int,
) -> None:  # fmt: skip
    """Set a run to time 0: its robots, in rows from ``first`` on, their messages and the network."""
    buffer.filled[0], buffer.ones[0] = 0, 0
    buffer.agreement[AGREED_SINCE], buffer.agreement[SETTLED] = -1, 0
    network_state[0] = buffer.zero_network_state[0]
    clear_network(network_arrays)
    if HAS_SEND:
        clear_inbox(buffer.inbox)
    for i in range(swarm.params.size):
        e = first + i
        if READS_POSITIONS:
            tracks.at[e] = tracks.bounds[e]  # the robot's first move
        begin_agent(swarm.agents[e])
        swarm.states[e] = buffer.zero_state[0]
        begin(swarm.states[e], views(swarm.arrays, e), begin_draws(seed, run, i), swarm.params[i],
              world_of_robot(world, i))  # fmt: skip
        if HAS_TIMER:
            swarm.agents[e].due_tick = due_tick(swarm, e, world)


@inlined
def next_event(stops: Stops, swarm: Swarm, first: int, low: int, tick: int, i: int) -> tuple[int, int, bool]:
    """Return tick and robot of a run's next event, and whether it is a timer; ``NEVER``: none is left.

    A timer that is due while its robot stands waits until the robot has sampled.
    """
    is_timer = False
    for j in range(swarm.params.size):
        e = first + j
        due, stop = swarm.agents[e].due_tick, stop_of(stops, swarm.agents[e].row, e, low)
        if due < stop and (due < tick or (due == tick and j < i)):
            tick, i, is_timer = due, j, True
    return tick, i, is_timer


@inlined
def take_timer(swarm: Swarm, e: int, i: int, t_s: float, out: Any, w: World, seed: int, run: int) -> bool:
    """Let the strategy of robot ``i``, in row ``e``, handle its timer; return whether it sends the message ``out``."""
    row = swarm.agents[e]
    draws = timer_draws(seed, run, i, row.timers)
    sends = on_timer(swarm.states[e], views(swarm.arrays, e), t_s, out, draws, swarm.params[i], w)
    row.timers += 1
    return sends


@inlined
def take_sample(
    swarm: Swarm, e: int, i: int, k: int, rows: Rows, readings: Readings, out: Any, w: World, seed: int, run: int
) -> bool:  # fmt: skip
    """Let the strategy of robot ``i``, in row ``e``, handle the sample in row ``k``; return whether it sends."""
    number = signed(rows.sample[k])
    x = own_reading(readings, k, rows.time_s[k], number)
    # The first random number of ``on_sample``, or below 0 if it is not computed yet.
    known_uniform = readings.uniforms[k] if readings.uniforms.size > 0 else -1.0
    draws = sample_draws(seed, run, i, number, known_uniform)
    sends = on_sample(swarm.states[e], views(swarm.arrays, e), x, out, draws, swarm.params[i], w)
    swarm.agents[e].samples += 1
    return sends


@inlined
def log_sample(
    swarm: Swarm, e: int, k: int, out: Any, sends: bool, messages: NDArray[np.void], log: Log
) -> None:
    """Write a robot's state after a sample (its opinion as decision) to ``log``, and its message to ``messages``."""
    row = swarm.agents[e]
    log.states[k], log.decision[k], log.received[k] = swarm.states[e], row.opinion, row.received
    log.belief[k] = row.belief
    messages[k] = out
    log.sends[k] = sends


@kernel
def replay(
    rows: Rows, stops: Stops, readings: Readings, replayed: NDArray[np.int64], swarm: Swarm,
    messages: NDArray[np.void], buffer: MessageBuffer, tracks: Any, log: Log, steering: Any,
    world: World, network_params: NDArray[np.void], network_state: NDArray[np.void], network_arrays: Any,
    bytes_on_air: int, seed: int, decided_s: NDArray[np.float64], from_start: bool, to_end: bool,
    limits_s: NDArray[np.float64],
) -> int:  # fmt: skip
    """Replay the runs from where the last call stopped (a single run only, as ``buffer`` holds one run's messages)."""
    robots = swarm.params.size
    for r in range(rows.runs.size):
        low, high, run, first = rows.bounds[r], rows.bounds[r + 1], rows.runs[r], r * robots
        limit_s = limits_s[r]
        if from_start:
            replayed[r], decided_s[r] = 0, np.inf
            begin_run(swarm, first, buffer, tracks, world, network_state, network_arrays, seed, run)
        while True:
            # The next event: the next sample of the run, or a timer that is due before it.
            k = low + replayed[r]
            tick = signed(stops.tick[k]) if k < high else NEVER
            i = signed(rows.robot[k]) if k < high else robots
            is_timer = False
            if HAS_TIMER:
                tick, i, is_timer = next_event(stops, swarm, first, low, tick, i)
            if tick == NEVER or time_of(tick, world) > limit_s:
                break
            if buffer.filled[0] >= buffer.sender.size:
                return BUFFER_FULL
            settle_opinions(swarm, first, tick, buffer.agreement, world)
            e, m = first + i, buffer.filled[0]
            w, out = world_of_robot(world, i), buffer.messages[m]
            # The strategy writes its message to a zeroed row, which counts as sent only if ``send_message`` is called.
            buffer.messages[m] = buffer.zero_message[0]
            if is_timer:
                t_s = time_of(tick, w)
                read_arrived(swarm, e, i, tick, buffer, world, seed, run, network_params)
                sends = take_timer(swarm, e, i, t_s, out, w, seed, run)
            else:
                t_s = rows.time_s[k]
                read_arrived(swarm, e, i, stops.stop_tick[k] - 1, buffer, world, seed, run, network_params)
                sends = take_sample(swarm, e, i, k, rows, readings, out, w, seed, run)
                swarm.agents[e].sample_tick, swarm.agents[e].row = tick, k - low
            wrong = update_decision(
                swarm,
                first,
                e,
                i,
                tick,
                t_s,
                buffer.agreement,
                world,
                log.belief.size > 0,
            )
            if wrong != DONE:
                return wrong
            note_decided(swarm, first, decided_s, r)
            if t_s >= swarm.failures[e].opposite_from_s:
                opposite_of(out, w)
            sends = sends and tick < swarm.failures[e].silent_tick
            if sends:
                if not is_message(out):
                    return INVALID_MESSAGE
                if READS_POSITIONS:
                    positions_at(tracks, first, tick, world.tick_ms, buffer.x_m, buffer.y_m)
                if not send_message(
                    swarm, e, i, tick, buffer, world, seed, run, network_params, network_state, network_arrays,
                    bytes_on_air,
                ):  # fmt: skip
                    return BUFFER_FULL
            if not is_timer:
                replayed[r] += 1
                if HAS_STEER:
                    number = signed(rows.sample[k])
                    x = own_reading(readings, k, t_s, number)
                    d = Draws(seed, run, i, STEERING, number, ALONE, 0, -1.0)
                    steering[k, 0], steering[k, 1] = steer(
                        swarm.states[e], views(swarm.arrays, e), x, d, swarm.params[i], w
                    )
                if log.belief.size > 0:
                    log_sample(swarm, e, k, out, sends, messages, log)
        # Opinions may also settle between the last event and the end of what is known, or the limit.
        limit = signed(min(limit_s * 1000.0 / world.tick_ms, 1e15))  # 1e15: inf does not fit into an integer
        settle_opinions(swarm, first, min(stops.known_tick[r], limit), buffer.agreement, world)
        note_decided(swarm, first, decided_s, r)
        if to_end:
            for i in range(robots):
                e = first + i
                row = swarm.agents[e]
                if row.samples + row.timers > 0:
                    row.belief = belief(
                        swarm.states[e], views(swarm.arrays, e), swarm.params[i], world_of_robot(world, i)
                    )
                read_arrived(swarm, e, i, stops.walked_tick[e], buffer, world, seed, run, network_params)
    return DONE


@inlined
def stop_of(stops: Stops, own: int, e: int, low: int) -> int:
    """Return the first tick of the next stop of the robot in row ``e``; until then it walks."""
    following = stops.first[e] if own < 0 else stops.following[low + own]
    if following < 0:
        return signed(stops.walked_tick[e]) + 1
    return signed(stops.stop_tick[low + following])
