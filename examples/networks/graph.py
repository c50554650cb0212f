"""A graph: robots hear the neighbours that they have for good, wherever they are, one control period later.

| layout | who hears whom |
|---|---|
| 0 | a ring, in which robots hear the ``degree`` nearest by number; at least all others: everybody |
| 1 | the same, cut open between the last robot and the first: a line |
| 2 | a scale-free tree: each robot in turn is linked to one before it, drawn in proportion to its links so far |
"""

from typing import Annotated

from pydantic import Field

from vibroswarm.networks import Network
from vibroswarm.strategies import array, u


class Params:
    layout: Annotated[int, Field(ge=0, le=2)] = 0
    degree: Annotated[int, Field(ge=0, le=10_000)] = 2  # neighbours in ring and line, half on each side


class State:
    is_drawn: bool


class Arrays:
    parent = array("int32", "robots")
    end = array("int32", "robots*2")  # both robots of each link


def send(n, a, sender, tick, number, bytes_on_air, x_m, y_m, arrival_tick, d, p, w):
    if p.layout == 2 and not n.is_drawn:
        n.is_drawn = True
        a.parent[0] = -1
        for j in range(1, w.robots):
            links = j - 1
            a.parent[j] = a.end[int(u(d, j) * 2 * links)] if links > 0 else 0
            a.end[2 * links], a.end[2 * links + 1] = a.parent[j], j
    for j in range(w.robots):
        apart = abs(j - sender)
        if p.layout == 0 and w.robots - apart < apart:
            apart = w.robots - apart
        hears = 2 * apart <= p.degree or p.degree >= w.robots - 1 > 0
        if p.layout == 2:
            hears = a.parent[j] == sender or a.parent[sender] == j
        arrival_tick[j] = tick + 1 if hears else -1


graph = Network(name="graph", params=Params, state=State, arrays=Arrays, send=send, positions=False)
