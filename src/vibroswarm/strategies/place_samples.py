"""Variant of ``places`` whose messages hold energies in place of bits, or draws of the place, or both.

A draw is a random path that the robot may have taken; a message holds the sample's place on each draw. Maps and score
are those of ``place_evidence``. A message is as that of ``places``, with these changes:

- With ``energies`` it also holds the log likelihood ratio of the energy in steps of 1/16, from -7.9 to 7.9 (1 byte). A
  place then has 12 bits for x and 12 for y (3 bytes), so that the message still has 8 bytes, or 9 in arenas longer
  than 4.095 m. Trust in a sender is still computed from the bit, which is sent along with the sender's number.
- With ``draws`` it holds the place on each draw (4 bytes each) instead of one mean place, and the standard deviations
  of the sample about its place on the draw: 4 + 4 ``draws`` bytes, and one more with ``energies``.

With ``energies``, a robot whose sensor is stuck sends the log ratio of the bit where it contradicts the energy.

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
    add_evidence,
    chance_of_bit,
    decide,
    ratio_of_bit,
    rounded_ratio,
    score_of_maps,
)
from vibroswarm.strategies.place_kinds import begin
from vibroswarm.strategies.place_map import TileArrays, share_place
from vibroswarm.strategies.place_trust import State, TrustArrays, judge, rounded
from vibroswarm.strategies.world import DetailedReading, Draws, World

__all__ = ["State", "begin", "decision"]

KEPT: Final = 25
"""Length of the ring of log ratios that wait until their place is known: ``localisation.lag`` is at most 24."""


class Message:
    """A sample: its reading, log ratio, its place on each draw, and its standard deviations about that place, m."""

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


class Arrays(TileArrays, TrustArrays):
    """As of ``places``, with one map for each draw, and the own log ratios that are not sent yet (a ring)."""

    odds: Array
    waiting = array("float64", "25")


def on_message(s: Row, a: Row, m: Row, sender: int, t_s: float, d: Draws, p: Row, w: World) -> None:
    """Add another robot's sample to the maps."""
    add_sample(s, a, sender, m, p, w)


def on_sample(s: Row, a: Row, x: DetailedReading, out: Row, d: Draws, p: Row, w: World) -> bool:
    """Store the reading, add the sample taken ``localisation.lag`` samples ago to the maps and send it, and decide.

    A sample waits that long because its place is known well only by then. While there is no sample so old
    (``x.lagged_number`` is -1), nothing is added or sent. ``s.bits`` holds the last 28 readings, the newest in the
    lowest bit. ``a.waiting`` is a ring of the log ratios of the last ``KEPT`` readings: without ``energies`` the log
    ratio follows from the reading, 0 or 1, and the error rates. An undecided robot that has at least ``min_samples``
    samples (``s.heard``), own and received, decides if its score is past the score needed, which falls after the share
    ``falls_from`` of the run.
    """
    s.bits = ((s.bits << 1) | x.reading) & 0xFFFFFFF  # 28 bits are enough: ``localisation.lag`` is at most 24
    a.waiting[x.number % KEPT] = rounded_ratio(x.log_ratio) if p.energies else ratio_of_bit(x.reading, w)
    sends = x.lagged_number >= 0
    if sends:
        # The lagged sample was taken (number - lagged_number) samples ago, so its bit is that far from the lowest bit.
        out.bit = (s.bits >> (x.number - x.lagged_number)) & 1
        out.number = x.lagged_number
        out.log_ratio = a.waiting[x.lagged_number % KEPT]
        put_places(x, out, maps_of(p))
        add_sample(s, a, w.robot, out, p, w)
    if s.decision == -1 and s.heard >= p.min_samples:
        decide(s, score_of_maps(a, maps_of(p), p.variance_factor, w), x.t_s, p.falls_from, w)
    return sends


def belief(s: Row, a: Row, p: Row, w: World) -> float:
    """Return the belief that the share of vibrating tiles is below the boundary."""
    return 0.5 * math.erfc(-score_of_maps(a, maps_of(p), p.variance_factor, w) * math.sqrt(0.5))


def opposite(m: Row) -> None:
    """Turn the reading of a message into its opposite, and the sign of its log ratio with it."""
    m.bit, m.log_ratio = 1 - m.bit, -m.log_ratio


def maps_of(p: Row) -> int:
    """Return the number of maps: one for each draw, or one for mean places."""
    maps: int = max(p.draws, 1)
    return maps


def put_places(x: DetailedReading, out: Row, maps: int) -> None:
    """Write the places of the lagged sample, and its spreads, into the message ``out``.

    With one map, or if there are no draws because robots know their true positions, all places of the message are the
    mean place, and the spreads are the standard deviations about the mean. Otherwise ``x.draws_m`` holds x and y on
    each of ``maps`` draws, followed by the spreads in x and y about a draw. In that case places of the message beyond
    the number of maps are not written, because no receiver reads them.
    """
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
    """Return x of the sample's place on draw ``k``."""
    x_m: float = m.x_0_m if k == 0 else (m.x_1_m if k == 1 else (m.x_2_m if k == 2 else m.x_3_m))
    return x_m


def y_m_of(m: Row, k: int) -> float:
    """Return y of the sample's place on draw ``k``."""
    y_m: float = m.y_0_m if k == 0 else (m.y_1_m if k == 1 else (m.y_2_m if k == 2 else m.y_3_m))
    return y_m


def add_sample(s: Row, a: Row, j: int, m: Row, p: Row, w: World) -> None:
    """Add a sample of sender ``j`` to all maps, at its place on each draw, and update the trust in the sender.

    ``m`` is the message with the sample; it is the robot's own message if ``j`` is the robot itself. ``s.heard`` counts
    the samples. Maps where the place is off the floor are left out.
    """
    s.heard += 1
    vibration, inside = 0.0, 0
    for k in range(maps_of(p)):
        left, right, upper, lower = share_place(
            a, x_m_of(m, k), y_m_of(m, k), m.spread_x_m, m.spread_y_m, p, w
        )
        if right < left:
            continue  # off the floor
        vibration += add_evidence(a, k, j, m.log_ratio, left, right, upper, lower, w)
        inside += 1
    # Trust uses the mean probability of vibration over the ``inside`` maps that have the place on the floor.
    if inside > 0:
        judge(a, j, m.bit, chance_of_bit(m.bit, vibration / inside, w), p)
