"""The study's radio: robots and a base in a tree, in which a message passes from node to node and busy nodes lose it.

| name | symbol | unit | equation |
|---|---|---|---|
| message_bytes | B | bytes | of each message, 144 in the study |
| frames of a message | k | - | ceil(B / 24) |
| frame_ms | t | ms | one frame over one hop, with its acknowledgement |
| time of a hop | s | ms | k t |
| retry_ms | T | ms | a hop that cannot begin within T is lost |

The study (section Experimental Results) names the radio (nRF24L01+), its library (RF24Network), messages of up to 144
bytes, a hierarchy in which nodes are busy with relaying, and the extraction of data by radio. The library's
documentation and code add: a node has one parent and up to five children; a message for another node goes up to the
common ancestor and down again; 144 bytes are the most a message may have, in frames of 24; a node tries to hand over a
frame for 25 ms.

Assumed, for want of a source: robots fill the tree level by level, the children of a level spread evenly, below a base
that is no robot; a robot sends its message to each other robot in turn, waiting until it is there or lost, and then
its log to the base; a node does one thing at a time, and a hop occupies both of its nodes; what is lost on the way is
not sent again. A message reserves the nodes of its way when it is sent, so that two that are under way together do not
interleave. A robot hears the radio also while it samples.

By the radio's data sheet a frame of 32 bytes at 1 Mbit/s with its acknowledgement takes 0.7 ms on air, the least that
``frame_ms`` can be. The default is fitted to the published shares of lost packets (``benchmarks/radio_networks.py``).
"""

from __future__ import annotations

from typing import Annotated, Any, Final

from pydantic import Field

from vibroswarm.errors import InputError
from vibroswarm.networks.base import Network, register
from vibroswarm.strategies.base import array
from vibroswarm.strategies.world import Draws, World, u

BASE: Final = -1
CHILDREN: Final = 5
"""Most children of a node: the radio listens to six others, one of them its parent."""
FRAME_BYTES: Final = 24
MOST: Final = 780
"""Robots in four levels, the most that addresses have."""


class Params:
    """The tree, and how fast it is."""

    parents: Annotated[
        tuple[int, ...],
        Field(
            max_length=MOST,
            strict=False,
            description="Parent of each robot: a robot's number, or -1 for the base; empty: filled level by level.",
        ),
    ] = ()
    message_bytes: Annotated[
        int, Field(ge=0, le=144, description="Bytes of a message; 0: those that the strategy states.")
    ] = 144
    log_bytes: Annotated[
        int, Field(ge=0, le=144, description="Bytes that a robot sends the base after each message; 0: none.")
    ] = 144
    frame_ms: Annotated[
        float,
        Field(ge=0, le=1e6, description="Time of a frame of 24 bytes from node to node, ms; 0: no load."),
    ] = 2.1
    retry_ms: Annotated[
        float,
        Field(ge=0, le=1e9, description="A message is lost at a node that is busy for longer than this, ms."),
    ] = 25.0


class State:
    """The tree is laid out at the first message."""

    is_ready: bool


class Arrays:
    """Nodes: the robots, and last the base."""

    parent = array("int64", "robots")
    free_ms = array("float64", "robots")
    """Time from which a robot has nothing to do."""
    base_free_ms = array("float64", "1")


def parent_of(robot: int) -> int:
    """Return the parent of a robot, BASE for the first five, if the tree is filled level by level and the robots of a
    level are spread evenly over the nodes above."""
    first, size, above = 0, CHILDREN, 0
    while robot >= first + size:
        above = first
        first += size
        size *= CHILDREN
    return BASE if first == 0 else above + (robot - first) % (size // CHILDREN)


def next_node(a: Any, node: int, goal: int) -> int:
    """Return the node after ``node`` on the way to ``goal``: the child above the goal, else the parent."""
    below = goal
    while below != BASE and a.parent[below] != node:
        below = a.parent[below]
    return int(below if below != BASE else a.parent[node])


def free_at(a: Any, node: int) -> float:
    """Return the time from which a node has nothing to do, ms."""
    return float(a.base_free_ms[0] if node == BASE else a.free_ms[node])


def occupy(a: Any, node: int, until_ms: float) -> None:
    """Keep a node busy until this time."""
    if node == BASE:
        a.base_free_ms[0] = until_ms
    else:
        a.free_ms[node] = until_ms


def pass_on(a: Any, sender: int, goal: int, begin_ms: float, hop_ms: float, retry_ms: float) -> float:
    """Send a message from node to node; return when it arrives at the goal, ms, or minus the time at which a busy node
    loses it.

    The sign is unambiguous: times are above 0, as nothing is sent in the first control period.
    """
    time_ms, node = begin_ms, sender
    while node != goal:
        following = next_node(a, node, goal)
        start_ms = max(time_ms, free_at(a, node), free_at(a, following))
        if start_ms - time_ms > retry_ms:
            occupy(a, node, max(free_at(a, node), time_ms + retry_ms))
            return -(time_ms + retry_ms)
        time_ms = start_ms + hop_ms
        occupy(a, node, time_ms)
        occupy(a, following, time_ms)
        node = following
    return time_ms


def send(
    n: Any, a: Any, sender: int, tick: int, number: int, bytes_on_air: int, x_m: Any, y_m: Any,
    arrival_tick: Any, d: Draws, p: Any, w: World,
) -> None:  # fmt: skip
    """Send the message to each robot in turn, and the log to the base."""
    if not n.is_ready:
        n.is_ready = True
        for i in range(w.robots):
            a.parent[i] = a.parents[i] if a.parents.size > 0 else parent_of(i)
    size = p.message_bytes if p.message_bytes > 0 else bytes_on_air
    hop_ms = p.frame_ms * ((size + FRAME_BYTES - 1) // FRAME_BYTES)
    log_ms = p.frame_ms * ((p.log_bytes + FRAME_BYTES - 1) // FRAME_BYTES)
    # Real robots do not share a clock: the message begins anywhere in its control period.
    begin_ms = (tick + u(d, 0)) * w.tick_ms
    for j in range(arrival_tick.size):
        if hop_ms <= 0.0:
            arrival_tick[j] = tick + 1
        elif j != sender:
            end_ms = pass_on(a, sender, j, max(begin_ms, a.free_ms[sender]), hop_ms, p.retry_ms)
            if end_ms > 0.0:
                arrival_tick[j] = int(end_ms // w.tick_ms) + 1
            begin_ms = abs(end_ms)
    if log_ms > 0.0:
        pass_on(a, sender, BASE, max(begin_ms, a.free_ms[sender]), log_ms, p.retry_ms)


def check(params: Any, robots: int) -> None:
    """Refuse a list of parents that is not a tree of these robots; an empty list if there are too many robots.

    Raises:
        InputError: the list is of another length, or has an unknown parent, a circle or too many children; or there is
            no list for more than MOST robots.
    """
    parents, field = params.parents, "network.tree.parents"
    if not parents:
        if robots > MOST:
            raise InputError(
                f"{robots} robots do not fit into four levels; at most {MOST}", field="swarm.robots"
            )
        return
    if len(parents) != robots:
        raise InputError(
            f"{len(parents)} parents for {robots} robots (swarm.robots); give one each, -1 for the base",
            field=field,
        )
    for i, parent in enumerate(parents):
        if not BASE <= parent < robots:
            raise InputError(
                f"{parent} (of robot {i}) is not a node; give a robot from 0 to {robots - 1}, or -1 for the base",
                field=field,
            )
    for i in range(robots):
        way = [i]
        while parents[way[-1]] != BASE:
            way.append(parents[way[-1]])
            if way[-1] == i:
                circle = " -> ".join(map(str, way))
                raise InputError(
                    f"robots {circle} form a circle; one of them needs the base as its parent, -1",
                    field=field,
                )
            if len(way) > robots:
                break  # it leads into a circle that another robot is part of
    for node in (BASE, *range(robots)):
        children = parents.count(node)
        if children > CHILDREN:
            name = "the base" if node == BASE else f"robot {node}"
            raise InputError(f"{name} has {children} children; the radio allows {CHILDREN}", field=field)


tree = register(
    Network(
        name="tree", params=Params, state=State, arrays=Arrays, send=send, check=check,
        about="the study's radio: relayed in a tree, lost at busy nodes",
    )
)  # fmt: skip
