"""Variant of ``places`` whose messages hold energies in place of bits, or draws of the place along one path, or both.

``place_evidence`` has the maps and the score. Message: as that of ``places``, and

- with ``energies``: the log likelihood ratio of the energy in steps of 1/16, up to 7.9 either way (1 byte). A place
  then has 12 bits for x and 12 for y (3 bytes), so that the message still has 8 bytes; 9 in arenas longer than 4.095 m.
  Trust goes by the bit, which stays beside the sender's number.
- with ``draws``: in place of a mean the places of as many draws (4 bytes each), and the spread that is left: 4 + 4
  draws bytes, one more with ``energies``.

A robot with a sensor that is stuck sends what its bit says.
"""

from __future__ import annotations

import math
from typing import Final

from vibroswarm.strategies.base import Array, array
from vibroswarm.strategies.bayes import Row
from vibroswarm.strategies.place_evidence import (
    add_evidence,
    begin,
    chance_of_bit,
    decide,
    ratio_of_bit,
    rounded_ratio,
    score_of_maps,
)
from vibroswarm.strategies.place_map import share_place
from vibroswarm.strategies.places import State, decision, judge, rounded
from vibroswarm.strategies.world import DetailedReading, Draws, World

__all__ = ["State", "begin", "decision"]

MOST_DRAWS: Final = 4
KEPT: Final = 25
"""Log ratios kept until the place is known: ``localisation.lag`` is at most 24."""


class Message:
    """A sample: its reading, log ratio, and its place on each path, with what is left of its standard deviations, m."""

    bit: int
    number: int
    log_ratio: float
    spread_x_m: float
    spread_y_m: float
    x_0_m: float
    y_0_m: float
    x_1_m: float
    y_1_m: float
    x_2_m: float
    y_2_m: float
    x_3_m: float
    y_3_m: float


class Arrays:
    """As of ``places``, with a map for each draw and sender, and the own log ratios that are not sent yet."""

    odds: Array
    surprise = array("float64", "robots")
    variance = array("float64", "robots")
    suspicion = array("float64", "robots")
    ones = array("float64", "robots")
    readings = array("float64", "robots")
    weight = array("float64", "robots")
    waiting = array("float64", "25")
    of_column = array("float64", "2*columns")
    of_row = array("float64", "2*rows")
    of_all = array("float64", "1")
    p = array("float64", "tiles")
    p_without = array("float64", "tiles")


def on_message(s: Row, a: Row, m: Row, sender: int, t_s: float, d: Draws, p: Row, w: World) -> None:
    """Add another robot's sample to the maps."""
    add_sample(s, a, sender, m, p, w)


def on_sample(s: Row, a: Row, x: DetailedReading, out: Row, d: Draws, p: Row, w: World) -> bool:
    """Add and send the sample whose place is known by now, and decide."""
    s.bits = ((s.bits << 1) | x.reading) & 0xFFFFFFF
    a.waiting[x.number % KEPT] = rounded_ratio(x.log_ratio) if p.energies else ratio_of_bit(x.reading, w)
    sends = x.lagged_number >= 0
    if sends:
        out.bit = (s.bits >> (x.number - x.lagged_number)) & 1
        out.number = x.lagged_number
        out.log_ratio = a.waiting[x.lagged_number % KEPT]
        put_places(x, out, maps_of(p))
        add_sample(s, a, w.robot, out, p, w)
    if s.decision == -1 and s.heard >= p.min_samples:
        decide(s, score_of_maps(a, maps_of(p), p.variance_factor, w), x.t_s, p.falls_from, w)
    return sends


def belief(s: Row, a: Row, p: Row, w: World) -> float:
    """Return the belief that less than the boundary's share of the tiles vibrates."""
    return 0.5 * math.erfc(-score_of_maps(a, maps_of(p), p.variance_factor, w) * math.sqrt(0.5))


def opposite(m: Row) -> None:
    """Turn a reading into its opposite."""
    m.bit, m.log_ratio = 1 - m.bit, -m.log_ratio


def maps_of(p: Row) -> int:
    """Return the number of maps of a sender."""
    maps: int = max(p.draws, 1)
    return maps


def put_places(x: DetailedReading, out: Row, maps: int) -> None:
    """Put the places of the lagged sample into a message: mean and spread, or a place on each path."""
    if maps == 1 or x.draws_m.size < 2 * maps:
        out.x_0_m, out.y_0_m = rounded(x.lagged_x_m), rounded(x.lagged_y_m)
        out.x_1_m, out.y_1_m, out.x_2_m, out.y_2_m = out.x_0_m, out.y_0_m, out.x_0_m, out.y_0_m
        out.x_3_m, out.y_3_m = out.x_0_m, out.y_0_m
        out.spread_x_m, out.spread_y_m = rounded(x.lagged_spread_x_m), rounded(x.lagged_spread_y_m)
        return
    out.spread_x_m, out.spread_y_m = rounded(x.draws_m[2 * maps]), rounded(x.draws_m[2 * maps + 1])
    out.x_0_m, out.y_0_m = rounded(x.draws_m[0]), rounded(x.draws_m[1])
    out.x_1_m, out.y_1_m = rounded(x.draws_m[2]), rounded(x.draws_m[3])
    if maps > 2:
        out.x_2_m, out.y_2_m = rounded(x.draws_m[4]), rounded(x.draws_m[5])
    if maps > 3:
        out.x_3_m, out.y_3_m = rounded(x.draws_m[6]), rounded(x.draws_m[7])


def x_m_of(m: Row, k: int) -> float:
    """Return x of the place on path ``k``."""
    x_m: float = m.x_0_m if k == 0 else (m.x_1_m if k == 1 else (m.x_2_m if k == 2 else m.x_3_m))
    return x_m


def y_m_of(m: Row, k: int) -> float:
    """Return y of the place on path ``k``."""
    y_m: float = m.y_0_m if k == 0 else (m.y_1_m if k == 1 else (m.y_2_m if k == 2 else m.y_3_m))
    return y_m


def add_sample(s: Row, a: Row, j: int, m: Row, p: Row, w: World) -> None:
    """Add a sample of sender ``j`` to its maps."""
    s.heard += 1
    vibration, inside = 0.0, 0
    for k in range(maps_of(p)):
        left, right, upper, lower = share_place(
            a, x_m_of(m, k), y_m_of(m, k), m.spread_x_m, m.spread_y_m, p, w
        )
        if right < left:
            continue  # beyond the floor
        vibration += add_evidence(a, k, j, m.log_ratio, left, right, upper, lower, w)
        inside += 1
    if inside > 0:
        judge(a, j, m.bit, chance_of_bit(m.bit, vibration / inside, w), p)
