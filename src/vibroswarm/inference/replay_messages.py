"""Replay of a strategy message by message, with timers, over the samples of runs: a kernel's source.

It is for every strategy and network; what sends one bit at every sample over a plain network goes by ``replay_counts``,
which comes to the same. Events (own samples and timers) are taken in the order of tick and robot; before each the robot
reads what it has not read yet and could have, so that no message is read before or after its time.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vibroswarm.compiled import inlined, inner, kernel, signed
from vibroswarm.inference.agents import (
    Swarm,
    begin_agent,
    of_beginning,
    of_message,
    of_network,
    of_sample,
    of_sending,
    of_steering,
    of_timer,
    world_for,
)
from vibroswarm.inference.hooks import (
    ASKS_PLACES,
    HAS_SEND,
    HAS_STEER,
    HAS_TIMER,
    IS_OPINION,
    begin,
    belief,
    decision,
    lost,
    next_s,
    on_message,
    on_sample,
    on_timer,
    send,
    steer,
    views,
)
from vibroswarm.inference.rows import (
    AGREED_SINCE,
    DONE,
    NO_KIND,
    NO_ROOM,
    SETTLED,
    Log,
    Mail,
    Readings,
    Rows,
    Stops,
)
from vibroswarm.inference.tracks import Tracks, places_at
from vibroswarm.strategies.world import Reading, World

NEVER = 2**62


@inner
def hear_until(
    swarm: Swarm, e: int, i: int, walked: int, mail: Mail, world: World, seed: int, run: int, links: Any
) -> None:
    """Robot ``i``, in row ``e``, reads what had arrived when it last walked, at this tick."""
    row, s, p, w, a = (
        swarm.agents[e],
        swarm.states[e],
        swarm.params[i],
        world_for(world, i),
        views(swarm.arrays, e),
    )
    count, since = mail.filled[0], row.sample_tick + 1
    if HAS_SEND:
        while True:
            first, best = -1, NEVER
            for m in range(row.heard, count):
                at = mail.arrival[m, i]
                if 0 <= at <= walked and at < best:
                    first, best = m, at
            if first < 0:
                break
            mail.arrival[first, i] = -1
            read(s, a, mail, first, max(best, since), seed, run, i, p, w)
            row.received += 1
        while row.heard < count and mail.arrival[row.heard, i] < 0:
            row.heard += 1
        return
    while row.heard < count and mail.tick[row.heard] < walked:
        m = row.heard
        row.heard += 1
        sender, number = mail.sender[m], mail.number[m]
        if sender != i and not lost(sender, i, of_network(seed, run, i, sender, number), links[0], w):
            read(s, a, mail, m, max(mail.tick[m] + 1, since), seed, run, i, p, w)
            row.received += 1


@inlined
def read(
    s: Any, a: Any, mail: Mail, m: int, tick: int, seed: int, run: int, i: int, p: Any, w: World
) -> None:
    """Message ``m`` is read at a tick."""
    sender, t_s = mail.sender[m], time_of(tick, w)
    on_message(s, a, mail.messages[m], sender, t_s, of_message(seed, run, i, sender, mail.number[m]), p, w)


@inlined
def post(
    swarm: Swarm, e: int, i: int, tick: int, mail: Mail, world: World, seed: int, run: int, links: Any, radio: Any,
    bytes_on_air: int,
) -> None:  # fmt: skip
    """Robot ``i`` sends what stands last in ``mail``."""
    row, m = swarm.agents[e], mail.filled[0]
    mail.sender[m], mail.tick[m], mail.number[m] = i, tick, row.sent
    if HAS_SEND:
        d = of_sending(seed, run, i, row.sent)
        mail.arrival[m, :] = -1  # whom a network leaves out hears nothing
        send(
            radio[0],
            i,
            tick,
            row.sent,
            bytes_on_air,
            mail.x_m,
            mail.y_m,
            mail.arrival[m],
            d,
            links[0],
            world_for(world, i),
        )
        mail.arrival[m, i] = -1
        for j in range(mail.arrival.shape[1]):
            if mail.arrival[m, j] >= 0:
                mail.arrival[m, j] = max(mail.arrival[m, j], tick + 1)
    row.sent += 1
    mail.filled[0] += 1


@inlined
def time_of(tick: int, w: World) -> float:
    """The time of a tick, s: the float nearest to the exact decimal."""
    return tick * w.tick_ms / 1000.0


@inlined
def due_tick(swarm: Swarm, e: int, w: World) -> int:
    """The first tick at or after the time of a robot's timer, and after its last event; a time without end: never."""
    at_s, row = next_s(swarm.states[e]), swarm.agents[e]
    if not at_s < 1e12:
        return NEVER
    at_tick: int = max(signed(np.ceil(at_s * 1000.0 / w.tick_ms - 1e-9)), row.tick + 1)
    return at_tick


@inlined
def conclude(
    swarm: Swarm, first: int, e: int, i: int, tick: int, t_s: float, mail: Mail, world: World
) -> int:
    """After an own event of robot ``i``: its decision, and when it came to stand; gives ``DONE`` or what is wrong."""
    row, s, p, w, a = (
        swarm.agents[e],
        swarm.states[e],
        swarm.params[i],
        world_for(world, i),
        views(swarm.arrays, e),
    )
    row.tick = tick
    row.belief = belief(s, a, p, w)
    new = decision(s, a, p, w)
    if new < -1 or new > 1:
        return NO_KIND
    if HAS_TIMER:
        row.due_tick = due_tick(swarm, e, w)
    if new != row.opinion:
        row.opinion = new
        if IS_OPINION:
            agreed = new != -1
            for j in range(first, first + w.robots):
                agreed = agreed and swarm.agents[j].opinion == new
            if mail.agreement[SETTLED] == 0:
                mail.agreement[AGREED_SINCE] = tick if agreed else -1
        else:
            if row.decision == -1:
                row.first_decided_s = t_s
            row.decision, row.decided_s, row.belief_at_decision = new, t_s, row.belief
    return DONE


@inlined
def settle(swarm: Swarm, first: int, tick: int, mail: Mail, world: World) -> None:
    """Opinions that have agreed for long enough by this tick are the swarm's decision."""
    since = mail.agreement[AGREED_SINCE]
    long_enough = time_of(tick - since, world) >= world.hold_s
    if IS_OPINION and since >= 0 and mail.agreement[SETTLED] == 0 and long_enough:
        mail.agreement[SETTLED] = 1
        for e in range(first, first + world.robots):
            row = swarm.agents[e]
            row.decision, row.decided_s, row.belief_at_decision = (
                row.opinion,
                time_of(since, world),
                row.belief,
            )
            row.first_decided_s = row.decided_s + world.hold_s


@kernel
def replay(
    rows: Rows, stops: Stops, readings: Readings, taken: NDArray[np.int64], swarm: Swarm, messages: NDArray[np.void],
    mail: Mail, tracks: Tracks, log: Log, course: NDArray[np.float64], world: World, links: NDArray[np.void],
    radio: NDArray[np.void], bytes_on_air: int, seed: int, begins: bool, ends: bool, limit_s: float,
) -> int:  # fmt: skip
    """The runs, one after the other, from where they stopped; gives ``DONE``, or what is wrong.

    Args:
        taken: (runs,): how many samples of each have been replayed, changed. messages: (rows,), written, of no rows
            where nobody asks: what was sent at each sample. mail: of the run under way. tracks: of all runs, where the
            network asks where robots are, else of no rows. log: written; of no rows: only
            the swarm is wanted. course: (rows, 2), written where a strategy steers, else of no rows. links: (1,)
            parameters, radio: (1,) state of the network. begins: from time 0. ends: to the end: also hear what is heard
            after the last event. limit_s: no event after this.
    """
    robots = swarm.params.size
    for r in range(rows.runs.size):
        low, high, run, first = rows.bounds[r], rows.bounds[r + 1], rows.runs[r], r * robots
        if begins:
            taken[r], mail.filled[0] = 0, 0
            if ASKS_PLACES:
                for e in range(first, first + robots):
                    tracks.at[e] = tracks.bounds[e]
            mail.agreement[AGREED_SINCE], mail.agreement[SETTLED] = -1, 0
            radio[0] = mail.silent[0]
            for i in range(robots):
                e = first + i
                begin_agent(swarm.agents[e])
                swarm.states[e] = mail.blank[0]
                begin(swarm.states[e], views(swarm.arrays, e), of_beginning(seed, run, i), swarm.params[i],
                      world_for(world, i))  # fmt: skip
                if HAS_TIMER:
                    swarm.agents[e].due_tick = due_tick(swarm, e, world)
        while True:
            k = low + taken[r]
            tick = signed(stops.tick[k]) if k < high else NEVER
            i = signed(rows.robot[k]) if k < high else robots
            is_timer = False
            if HAS_TIMER:
                for j in range(robots):
                    e = first + j
                    due, stop = swarm.agents[e].due_tick, stop_of(rows, stops, swarm.agents[e].row, e, low)
                    if due < stop and (due < tick or (due == tick and j < i)):
                        tick, i, is_timer = due, j, True
            if tick == NEVER or time_of(tick, world) > limit_s:
                break
            if mail.filled[0] >= mail.sender.size:
                return NO_ROOM
            settle(swarm, first, tick, mail, world)
            e, m = first + i, mail.filled[0]
            row, s, p, w, a = (
                swarm.agents[e],
                swarm.states[e],
                swarm.params[i],
                world_for(world, i),
                views(swarm.arrays, e),
            )
            out = mail.messages[m]
            mail.messages[m] = mail.empty[0]
            if is_timer:
                t_s = time_of(tick, w)
                hear_until(swarm, e, i, tick, mail, world, seed, run, links)
                sends = on_timer(s, a, t_s, out, of_timer(seed, run, i, row.timers), p, w)
                row.timers += 1
            else:
                t_s, number = rows.time_s[k], signed(rows.sample[k])
                hear_until(swarm, e, i, stops.stop_tick[k] - 1, mail, world, seed, run, links)
                x = Reading(
                    signed(readings.observation[k]),
                    t_s, number, readings.x_m[k], readings.y_m[k], readings.heading_rad[k], 0.0,
                )  # fmt: skip
                beforehand = readings.numbers[k] if readings.numbers.size > 0 else -1.0
                sends = on_sample(s, a, x, out, of_sample(seed, run, i, number, beforehand), p, w)
                row.samples += 1
                row.sample_tick, row.row = tick, k - low
            wrong = conclude(swarm, first, e, i, tick, t_s, mail, world)
            if wrong != DONE:
                return wrong
            if sends:
                if ASKS_PLACES:
                    places_at(tracks, first, tick, world.tick_ms, mail.x_m, mail.y_m)
                post(swarm, e, i, tick, mail, world, seed, run, links, radio, bytes_on_air)
            if not is_timer:
                taken[r] += 1
                if HAS_STEER:
                    course[k, 0], course[k, 1] = steer(s, a, x, of_steering(seed, run, i, number), p, w)
                if log.belief.size > 0:
                    log.states[k], log.decision[k], log.received[k] = s, row.opinion, row.received
                    log.belief[k] = row.belief
                    messages[k] = out
                    log.sends[k] = sends
        limit = signed(min(limit_s * 1000.0 / world.tick_ms, 1e15))
        settle(swarm, first, min(stops.known_tick[r], limit), mail, world)
        if ends:
            for i in range(robots):
                hear_until(swarm, first + i, i, stops.walked_tick[first + i], mail, world, seed, run, links)
    return DONE


@inlined
def stop_of(rows: Rows, stops: Stops, own: int, e: int, low: int) -> int:
    """From which tick on the robot in row ``e`` stands, or may stand, next: it has taken its sample in row ``own``."""
    following = stops.first[e] if own < 0 else stops.following[low + own]
    if following < 0:
        return signed(stops.walked_tick[e]) + 1
    return signed(stops.stop_tick[low + following])
