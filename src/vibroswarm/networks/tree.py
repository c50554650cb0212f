"""The study's radio: robots and a base station form a tree; messages pass from node to node, and busy nodes lose them.

| name | symbol | unit | equation |
|---|---|---|---|
| message_bytes | B | bytes | length of each message, 144 in the study |
| frames of a message | k | - | ceil(B / 24) |
| frame_ms | t | ms | one frame over one hop, with its acknowledgement |
| time of a hop | s | ms | k t |
| retry_ms | T | ms | a message is lost if a hop cannot begin within T |

The study (section Experimental Results) names the radio (nRF24L01+), its library (RF24Network), messages of up to 144
bytes, a hierarchy in which nodes are busy with relaying, and the extraction of data by radio. The library's
documentation and code add: a node has one parent and up to five children; a message to another node goes up to the
common ancestor and down again; a message has at most 144 bytes, in frames of 24; a node tries for 25 ms to hand over a
frame.

No source states the following, which is assumed. The root of the tree is a base station, not a robot. Robots fill the
tree level by level, and the robots of a level are spread evenly over the nodes above. A robot sends its message to each
other robot in turn; it waits until the message has arrived or is lost. It then sends its log to the base. A node does
one thing at a time, and a hop occupies both of its nodes. A lost message is not sent again. A message reserves the
nodes of its path when it is sent, so that the hops of two messages do not interleave. Robots also hear the radio while
they sample. They share no clock: a message is sent at a random time within the control period of its sample.

By the radio's data sheet, a frame of 32 bytes at 1 Mbit/s with its acknowledgement takes 0.7 ms on air, so ``frame_ms``
cannot be less. The default, 2.1 ms, is a compromise: with the library's 25 ms it is nearest to the published shares of
lost packets of all six swarm sizes (root mean square 1.5 points), but loses 2.1 % with five robots and 11.6 % with ten,
where 0.9 and 9.0 % are published. ``loss_by_size`` has the published shares.
"""

from __future__ import annotations

from typing import Annotated, Any, Final

from pydantic import Field

from vibroswarm.errors import InputError
from vibroswarm.networks.base import Network, register
from vibroswarm.strategies.base import array
from vibroswarm.strategies.world import Draws, World, u

BASE: Final = -1
"""Number of the base station, the root of the tree, among the nodes; robots have the numbers from 0."""
CHILDREN: Final = 5
"""Largest number of children of a node: the radio listens to six others, one of which is the parent."""
FRAME_BYTES: Final = 24
"""Length of a frame; a longer message is divided into frames."""
MOST: Final = 780
"""Number of robots in four levels, 5 + 25 + 125 + 625: the radio's addresses have no more levels."""


class Params:
    """The tree, and how fast it is."""

    message_bytes: Annotated[
        int,
        Field(
            ge=0,
            le=144,
            description="Bytes of a message; 0: those that the strategy states.",
        ),
    ] = 144
    log_bytes: Annotated[
        int,
        Field(
            ge=0,
            le=144,
            description="Bytes that a robot sends the base after each message; 0: none.",
        ),
    ] = 144
    frame_ms: Annotated[
        float,
        Field(
            ge=0,
            le=1e6,
            description="Time of a frame of 24 bytes from node to node, ms; 0: no load. With 2.1, 2.1 % are lost with "
            "five robots and 11.6 % with ten (published: 0.9 and 9.0 %).",
        ),
    ] = 2.1
    retry_ms: Annotated[
        float,
        Field(ge=0, le=1e9, description="A message is lost at a node that is busy for longer than this, ms."),
    ] = 25.0


class Arrays:
    """The times until which the nodes of the tree are busy."""

    free_ms = array("float64", "robots")
    """Time until which each robot's radio is busy."""
    base_free_ms = array("float64", "1")
    """Time until which the base's radio is busy."""


def parent_of(robot: int) -> int:
    """Return the parent of a robot in a tree that is filled level by level; BASE for the first five robots."""
    # first, size: first robot and number of robots of a level. above: first robot of the level above it, which has
    # size // CHILDREN nodes.
    first, size, above = 0, CHILDREN, 0
    while robot >= first + size:
        above = first
        first += size
        size *= CHILDREN
    return BASE if first == 0 else above + (robot - first) % (size // CHILDREN)


def next_node(node: int, goal: int) -> int:
    """Return the node after ``node`` on the path from ``node`` to ``goal``."""
    below = goal  # go up from the goal until a child of ``node`` or the base is reached
    while below != BASE and parent_of(below) != node:
        below = parent_of(below)
    return below if below != BASE else parent_of(node)


def free_at(a: Any, node: int) -> float:
    """Return the time until which a node (a robot or BASE) is busy, ms."""
    return float(a.base_free_ms[0] if node == BASE else a.free_ms[node])


def occupy(a: Any, node: int, until_ms: float) -> None:
    """Set the time until which a node (a robot or BASE) is busy, ms."""
    if node == BASE:
        a.base_free_ms[0] = until_ms
    else:
        a.free_ms[node] = until_ms


def pass_on(a: Any, sender: int, goal: int, begin_ms: float, hop_ms: float, retry_ms: float) -> float:
    """Send a message along its path, and set the times until which the nodes of the path are busy with it."""
    time_ms, node = begin_ms, sender
    while node != goal:
        following = next_node(node, goal)
        start_ms = max(time_ms, free_at(a, node), free_at(a, following))
        if start_ms - time_ms > retry_ms:  # lost; ``node`` was busy with trying
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
    """Send the message to one robot after another, then the robot's log to the base."""
    size = p.message_bytes if p.message_bytes > 0 else bytes_on_air
    hop_ms = p.frame_ms * ((size + FRAME_BYTES - 1) // FRAME_BYTES)  # frames are rounded up
    log_ms = p.frame_ms * ((p.log_bytes + FRAME_BYTES - 1) // FRAME_BYTES)
    # Real robots do not share a clock: the message begins anywhere in its control period.
    begin_ms = (tick + u(d, 0)) * w.tick_ms
    for j in range(arrival_tick.size):
        if hop_ms <= 0.0:  # the radio takes no time, so nothing is lost
            arrival_tick[j] = tick + 1
        elif j != sender:
            # A sender that is still busy, with relaying or an earlier message, begins later.
            end_ms = pass_on(a, sender, j, max(begin_ms, a.free_ms[sender]), hop_ms, p.retry_ms)
            if end_ms > 0.0:
                arrival_tick[j] = int(end_ms // w.tick_ms) + 1
            begin_ms = abs(end_ms)  # The message has arrived or is lost; now it is sent to the next robot.
    if log_ms > 0.0:
        pass_on(a, sender, BASE, max(begin_ms, a.free_ms[sender]), log_ms, p.retry_ms)


def check(params: Any, robots: int) -> None:
    """Refuse more robots than the tree has nodes."""
    if robots > MOST:
        raise InputError(f"{robots} robots do not fit into four levels; at most {MOST}", field="swarm.robots")


tree = register(
    Network(
        name="tree", params=Params, arrays=Arrays, send=send, positions=False, check=check,
        about="the study's radio: relayed in a tree, lost at busy nodes",
    )
)  # fmt: skip
