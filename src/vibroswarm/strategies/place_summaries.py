"""Variant of ``places`` whose messages hold the sender's own map in place of samples.

A robot adds its own samples to its own map, and keeps the newest map of each other robot: a lost message is made good
by the next. ``place_evidence`` has the evidence and the score.

| name | symbol | unit | equation |
|---|---|---|---|
| own map | l_it | - | log odds by own samples; other tiles near a place count as the maps of all have them |
| as sent | - | - | l_it in steps of 1/16, up to 7.9 either way: a byte a tile |
| weight | w_i | - | as of ``places``, but of a robot's own readings by the maps of all others: it judges itself |

- Message: sender (1 byte), number (1), own samples in the map (2), weight in steps of 1/255 (1), a byte a tile: 30
  bytes for 25 tiles, sent after each ``map_every`` own samples whose place is known.
- Readings heard are those in the newest maps.
- A robot that sends the opposite turns its map over.
"""

from __future__ import annotations

import math
from typing import Final

from vibroswarm.strategies.base import Array, array
from vibroswarm.strategies.bayes import Row
from vibroswarm.strategies.place_evidence import (
    RATIO_STEP,
    RATIO_STEPS,
    add_evidence,
    begin,
    chance_of_bit,
    decide,
    ratio_of_bit,
    rounded_ratio,
    score_of_maps,
)
from vibroswarm.strategies.place_map import share_place
from vibroswarm.strategies.places import State, decision, judge
from vibroswarm.strategies.world import DetailedReading, Draws, World

__all__ = ["State", "begin", "decision"]

HEADER_BYTES: Final = 5
MOST_TILES: Final = 139
KEPT: Final = 25
"""Readings kept until the place is known: ``localisation.lag`` is at most 24."""


class Message:
    """A map: samples in it, the sender's weight, and log odds of its tiles in steps."""

    number: int
    samples: int
    weight: float
    steps = array("int16", "139")


class Arrays:
    """As of ``places``, and the samples in each sender's map, and the own log ratios that are not added yet."""

    odds: Array
    surprise = array("float64", "robots")
    variance = array("float64", "robots")
    suspicion = array("float64", "robots")
    ones = array("float64", "robots")
    readings = array("float64", "robots")
    weight = array("float64", "robots")
    samples = array("int64", "robots")
    waiting = array("float64", "25")
    of_column = array("float64", "2*columns")
    of_row = array("float64", "2*rows")
    of_all = array("float64", "1")
    p = array("float64", "tiles")
    p_without = array("float64", "tiles")


def on_message(s: Row, a: Row, m: Row, sender: int, t_s: float, d: Draws, p: Row, w: World) -> None:
    """Put a map in the place of the sender's last one."""
    tiles = w.rows * w.columns
    for t in range(tiles):
        a.odds[sender * tiles + t] = RATIO_STEP * m.steps[t]
    a.weight[sender] = m.weight
    s.heard += m.samples - a.samples[sender]
    a.samples[sender] = m.samples


def on_sample(s: Row, a: Row, x: DetailedReading, out: Row, d: Draws, p: Row, w: World) -> bool:
    """Add the sample whose place is known by now, send the own map if it is its turn, and decide."""
    s.bits = ((s.bits << 1) | x.reading) & 0xFFFFFFF
    a.waiting[x.number % KEPT] = rounded_ratio(x.log_ratio) if p.energies else ratio_of_bit(x.reading, w)
    sends = False
    if x.lagged_number >= 0:
        add_own(s, a, x, (s.bits >> (x.number - x.lagged_number)) & 1, p, w)
        sends = a.samples[w.robot] % p.map_every == 0
        if sends:
            fill_map(a, out, x.lagged_number, w)
    if s.decision == -1 and s.heard >= p.min_samples:
        decide(s, score_of_maps(a, 1, p.variance_factor, w), x.t_s, p.falls_from, w)
    return sends


def belief(s: Row, a: Row, p: Row, w: World) -> float:
    """Return the belief that less than the boundary's share of the tiles vibrates."""
    return 0.5 * math.erfc(-score_of_maps(a, 1, p.variance_factor, w) * math.sqrt(0.5))


def opposite(m: Row) -> None:
    """Turn the map over."""
    for t in range(MOST_TILES):
        m.steps[t] = -m.steps[t]


def add_own(s: Row, a: Row, x: DetailedReading, bit: int, p: Row, w: World) -> None:
    """Add the own sample whose place is known by now to the own map."""
    s.heard += 1
    a.samples[w.robot] += 1
    left, right, upper, lower = share_place(
        a, x.lagged_x_m, x.lagged_y_m, x.lagged_spread_x_m, x.lagged_spread_y_m, p, w
    )
    if right < left:
        return  # beyond the floor
    log_ratio = a.waiting[x.lagged_number % KEPT]
    vibration = add_evidence(a, 0, w.robot, log_ratio, left, right, upper, lower, w)
    judge(a, w.robot, bit, chance_of_bit(bit, vibration, w), p)


def fill_map(a: Row, out: Row, number: int, w: World) -> None:
    """Fill in a message: the own map and weight as messages hold them."""
    tiles = w.rows * w.columns
    out.number, out.samples = number, a.samples[w.robot]
    out.weight = math.floor(a.weight[w.robot] * 255.0 + 0.5) / 255.0
    for t in range(tiles):
        steps = math.floor(a.odds[w.robot * tiles + t] / RATIO_STEP + 0.5)
        out.steps[t] = min(max(steps, -RATIO_STEPS), RATIO_STEPS)
