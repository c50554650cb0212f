"""Variant of ``places`` whose messages hold the sender's own map in place of single samples.

A robot adds its own samples to its own map, and stores the newest map of each other robot, so the next message makes
up for a lost one. ``place_evidence`` defines the evidence and the score.

| name | symbol | unit | equation |
|---|---|---|---|
| own map of robot i | l_it | - | log odds of tile t by own samples; R_t of ``places`` is by the maps of all robots |
| own map as sent | - | - | l_it in steps of 1/16, from -7.9 to 7.9: one byte per tile |
| weight of robot i | w_i | - | as of ``places``, but the robot computes it itself: own readings against others' maps |

- Message: sender (1 byte), number (1), own samples in the map (2), weight in steps of 1/255 (1), one byte per tile: 30
  bytes for 25 tiles, sent after every ``map_every`` own samples whose place is known.
- ``min_samples`` counts own samples and the samples in the newest map of each other robot.
- The opposite of a message (``faults.opposite``) has log odds of the opposite sign.

Arguments of the functions that the simulator calls (``base``): ``s`` is the robot's state and ``a`` its arrays, both
changed in place; ``x`` is its reading, ``m`` a message heard, ``out`` the message to fill, ``d`` random numbers, ``p``
the parameters, ``w`` what the robot knows. ``on_sample`` returns whether ``out`` is sent.
"""

from __future__ import annotations

import math
from typing import Final

from vibroswarm.strategies.base import Array, array
from vibroswarm.strategies.bayes import Row, decision
from vibroswarm.strategies.place_evidence import (
    RATIO_STEP,
    RATIO_STEPS,
    add_evidence,
    chance_of_bit,
    decide,
    ratio_of_bit,
    rounded_ratio,
    score_of_maps,
)
from vibroswarm.strategies.place_kinds import begin
from vibroswarm.strategies.place_map import TileArrays, share_place
from vibroswarm.strategies.place_samples import belief
from vibroswarm.strategies.place_trust import State, TrustArrays, judge
from vibroswarm.strategies.world import DetailedReading, Draws, World

__all__ = ["State", "begin", "belief", "decision"]

HEADER_BYTES: Final = 5
"""Size of a message without its map."""
MOST_TILES: Final = 139
"""Most tiles of a map that fits into a message (``MAX_BYTES`` less the header); ``place_options`` refuses more."""
KEPT: Final = 25
"""Length of the ring of log ratios that wait until their place is known: ``localisation.lag`` is at most 24."""


class Message:
    """A map: number of samples in it, the sender's weight, and log odds of its tiles in steps of ``RATIO_STEP``."""

    number: int
    samples: int
    weight: float
    steps = array("int16", "139")


class Arrays(TileArrays, TrustArrays):
    """As of ``places``, with one map, the number of samples in each robot's map, and the own log ratios that wait."""

    odds: Array
    samples = array("int64", "robots")
    waiting = array("float64", "25")


def on_message(s: Row, a: Row, m: Row, sender: int, t_s: float, d: Draws, p: Row, w: World) -> None:
    """Replace what is stored of the sender by the map, the weight and the number of samples in the message.

    A message of the sender that is older than the stored one is ignored: a network may let messages overtake each
    other. A map of more samples is newer. ``s.heard``, the number of samples in all maps, grows by the difference.
    """
    if m.samples < a.samples[sender]:
        return
    tiles = w.rows * w.columns
    for t in range(tiles):
        a.odds[sender * tiles + t] = RATIO_STEP * m.steps[t]
    a.weight[sender] = m.weight
    s.heard += m.samples - a.samples[sender]
    a.samples[sender] = m.samples


def on_sample(s: Row, a: Row, x: DetailedReading, out: Row, d: Draws, p: Row, w: World) -> bool:
    """Store the reading, add the sample taken ``localisation.lag`` samples ago to the own map, and decide.

    A sample waits that long because its place is known well only by then; ``x.lagged_number`` is -1 while there is no
    sample so old. ``s.bits`` holds the last 28 readings, the newest in the lowest bit. ``a.waiting`` is a ring of the
    log ratios of the last ``KEPT`` readings. The own map is sent each time ``map_every`` more samples have been added.
    """
    s.bits = ((s.bits << 1) | x.reading) & 0xFFFFFFF  # 28 bits are enough: ``localisation.lag`` is at most 24
    a.waiting[x.number % KEPT] = rounded_ratio(x.log_ratio) if p.energies else ratio_of_bit(x.reading, w)
    sends = False
    if x.lagged_number >= 0:
        # The lagged sample was taken (number - lagged_number) samples ago, so its bit is that far from the lowest bit.
        add_own(s, a, x, (s.bits >> (x.number - x.lagged_number)) & 1, p, w)
        sends = a.samples[w.robot] % p.map_every == 0
        if sends:
            fill_map(a, out, x.lagged_number, w)
    if s.decision == -1 and s.heard >= p.min_samples:
        # 1: the number of maps K of ``place_evidence``. Only ``draws`` needs more; the maps of all senders, weighted
        # and summed, are one.
        decide(s, score_of_maps(a, 1, p.variance_factor, w), x.t_s, p.falls_from, w)
    return sends


def opposite(m: Row) -> None:
    """Change the sign of all log odds of a map: vibrating and still tiles swap."""
    for t in range(MOST_TILES):
        m.steps[t] = -m.steps[t]


def add_own(s: Row, a: Row, x: DetailedReading, bit: int, p: Row, w: World) -> None:
    """Add the own sample of ``localisation.lag`` samples ago to the own map, and update the robot's own weight.

    A sample whose place is off the floor is counted, but is no evidence.

    Args:
        x: the present reading; its ``lagged_`` fields describe the sample to add. bit: the reading, 0 or 1, of that
            sample.
    """
    s.heard += 1
    a.samples[w.robot] += 1
    left, right, upper, lower = share_place(
        a, x.lagged_x_m, x.lagged_y_m, x.lagged_spread_x_m, x.lagged_spread_y_m, p, w
    )
    if right < left:
        return  # the place is off the floor
    log_ratio = a.waiting[x.lagged_number % KEPT]
    # Map 0 is the only map.
    vibration = add_evidence(a, 0, w.robot, log_ratio, left, right, upper, lower, w)
    judge(a, w.robot, bit, chance_of_bit(bit, vibration, w), p)


def fill_map(a: Row, out: Row, number: int, w: World) -> None:
    """Fill in the message ``out``: the own weight and the log odds of each tile, rounded to what one byte holds.

    Args:
        number: index of the latest own sample in the map.
    """
    tiles = w.rows * w.columns
    out.number, out.samples = number, a.samples[w.robot]
    # floor(... + 0.5) rounds to the nearest whole step.
    out.weight = math.floor(a.weight[w.robot] * 255.0 + 0.5) / 255.0
    for t in range(tiles):
        steps = math.floor(a.odds[w.robot * tiles + t] / RATIO_STEP + 0.5)
        out.steps[t] = min(max(steps, -RATIO_STEPS), RATIO_STEPS)
