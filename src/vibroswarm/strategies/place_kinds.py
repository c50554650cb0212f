"""The map of ``places`` for several kinds of tile, and the decision which kind is the most common.

It runs in the place of ``places`` where the sensor has more than two kinds or classes. ``places`` and ``place_map``
define the other symbols; with two kinds both are the same.

| name | symbol | unit | equation |
|---|---|---|---|
| rates | P(r, k) | - | probability that a sample on kind k reads as class r, as robots are told; at least 0.001 |
| map | p_tk | - | exp(sum over senders j of w_j l_jtk) / sum over kinds of the same |
| probability of reading r on tile t | m_t | - | sum over k of p_tk P(r, k) |
| evidence of sender j on tile t for kind k | l_jtk | - | \
each reading r adds ln((q_t P(r, k) + R_t) / (q_t P(r, 0) + R_t)), R_t = sum over u other than t of q_u m_u |
| surprise of sender j | s_j | - | (L - mean) / standard deviation, L the log probability of j's readings \
under the map without them |
| suspicion of sender j | b_j | - | log probability of j's readings if each class has j's own share of it everywhere, \
minus L |
| tiles of kind k | N_k | - | sum of independent tiles, of kind k with the probability p_tk |
| doubt in kind c | T_c | - | sum over k other than c of P(N_k >= N_c), each of which is exact |
| score | z | - | standard normal quantile of 1 - T_c, divided by sqrt(v) |
| decision | c | - | the kind with the largest mean of N_c, once z is above that of p_c, with ``min_samples`` readings |

1 - T_c is at most the probability that c is the most common kind (Boole's inequality), and equal to it with two kinds.
After the share ``falls_from`` of the run, the score needed falls linearly, to that of 1 / kinds at the end of the run.

- Message: as of ``places``, with a class of 4 bits for the bit: 9 bytes.
- A priori each tile is of each kind with the same probability, independently.

Arguments are those of ``places``. Functions here are compiled with each kernel and never cached alone, because
generated modules define the types of their arguments.
"""

from __future__ import annotations

import math
from typing import Any, Final

from vibroswarm.core.jit import inlined_uncached
from vibroswarm.errors import InputError
from vibroswarm.strategies.base import array
from vibroswarm.strategies.bayes import Row, decision
from vibroswarm.strategies.place_map import RATE, score_at, share_place
from vibroswarm.strategies.place_share import score_of_tails
from vibroswarm.strategies.place_trust import TRUST_MEMORY, rounded
from vibroswarm.strategies.world import Draws, Reading, World

__all__ = ["Arrays", "Message", "State", "begin", "check", "decision", "on_message", "on_sample"]

RECENT: Final = 32
"""Number of own readings that are kept until their place is known: ``localisation.lag`` is at most 24."""


class State:
    """Score needed, number of samples added, own and heard (those off the floor too), and decision."""

    needed: float
    heard: int
    decision: int


class Message:
    """A sample: its class, and its place with standard deviations, m."""

    kind: int
    number: int
    at_x_m: float
    at_y_m: float
    spread_x_m: float
    spread_y_m: float


class Arrays:
    """Log odds of each kind against kind 0 by sender and tile, the map (tile by tile), how surprising each sender is
    and how often it read each class, the last own readings, and scratch."""

    odds = array("float64", "robots*tiles*kinds")
    by_kind = array("float64", "tiles*kinds")
    surprise = array("float64", "robots")
    variance = array("float64", "robots")
    suspicion = array("float64", "robots")
    read = array("float64", "robots*readings")
    weight = array("float64", "robots")
    recent = array("int64", f"{RECENT}")
    of_column = array("float64", "2*columns")
    of_row = array("float64", "2*rows")
    of_all = array("float64", "1")
    likely = array("float64", "tiles")
    of_kind = array("float64", "kinds")
    without = array("float64", "kinds")
    apart = array("float64", "3*tiles")


def begin(s: Row, a: Row, d: Draws, p: Row, w: World) -> None:
    """Begin with an empty map, undecided, with equal weights of senders."""
    s.decision, s.needed = -1, score_at(w.credible_threshold)
    for j in range(w.robots):
        a.weight[j] = 1.0 - p.broken_prior


def on_message(s: Row, a: Row, m: Row, sender: int, t_s: float, d: Draws, p: Row, w: World) -> None:
    """Add another robot's sample to the map."""
    add_sample(s, a, sender, m.kind, m.at_x_m, m.at_y_m, m.spread_x_m, m.spread_y_m, p, w)


def on_sample(s: Row, a: Row, x: Reading, out: Row, d: Draws, p: Row, w: World) -> bool:
    """Store the reading, add the sample taken ``localisation.lag`` samples ago to the map and send it, and decide."""
    a.recent[x.number % RECENT] = x.reading
    sends = x.lagged_number >= 0
    if sends:
        out.kind, out.number = a.recent[x.lagged_number % RECENT], x.lagged_number
        out.at_x_m, out.at_y_m = rounded(x.lagged_x_m), rounded(x.lagged_y_m)
        out.spread_x_m, out.spread_y_m = rounded(x.lagged_spread_x_m), rounded(x.lagged_spread_y_m)
        add_sample(s, a, w.robot, out.kind, out.at_x_m, out.at_y_m, out.spread_x_m, out.spread_y_m, p, w)
    write_map(a, w)
    if s.decision == -1 and s.heard >= p.min_samples:
        kind = leader(a, w)
        doubt = min(doubt_in(a, kind, w), 1.0)
        part, needed = x.t_s / w.t_end_s, s.needed
        if part > p.falls_from:
            needed += (-score_at(1.0 - 1.0 / w.kinds) - needed) * (part - p.falls_from) / (1.0 - p.falls_from)
        if score_of_tails(1.0 - doubt, doubt, p) > needed:
            s.decision = kind
    return sends


def add_sample(
    s: Row,
    a: Row,
    j: int,
    reading: int,
    x_m: float,
    y_m: float,
    spread_x_m: float,
    spread_y_m: float,
    p: Row,
    w: World,
) -> None:
    """Add a sample of sender ``j`` to the map, and update the trust in the sender.

    A sample whose place is off the floor is counted in ``s.heard``, but is no evidence.
    """
    s.heard += 1
    left, right, upper, lower = share_place(a, x_m, y_m, spread_x_m, spread_y_m, p, w)
    if right < left:
        return
    add_reading_of_kinds(a, j, reading, left, right, upper, lower, w)
    judge_reading(a, j, reading, p, w)


@inlined_uncached
def rate_on(reading: int, kind: int, w: World) -> float:
    """Return P(r, k)."""
    told: float = w.rates[kind * (w.rates.size // w.kinds) + reading]
    return max(told, RATE)


@inlined_uncached
def write_kinds(a: Row, tile: int, but: int, w: World) -> None:
    """Write p_tk of a tile to ``a.of_kind``, without the evidence of sender ``but``; -1: of all senders."""
    tiles, most = w.rows * w.columns, 0.0
    a.of_kind[0] = 0.0  # evidence is against kind 0
    for k in range(1, w.kinds):
        total = 0.0
        for j in range(w.robots):
            if j != but:
                total += a.weight[j] * a.odds[(j * tiles + tile) * w.kinds + k]
        a.of_kind[k] = total
        most = max(most, total)
    whole = 0.0
    for k in range(w.kinds):
        a.of_kind[k] = math.exp(max(a.of_kind[k] - most, -500.0))
        whole += a.of_kind[k]
    for k in range(w.kinds):
        a.of_kind[k] /= whole


@inlined_uncached
def add_reading_of_kinds(
    a: Row, j: int, reading: int, left: int, right: int, upper: int, lower: int, w: World
) -> None:
    """Add the evidence of a reading of sender ``j``; write what the map without ``j`` has below it to ``a.without``.

    Call ``share_place`` first: it writes the shares of the sample's place to ``a``.

    Args:
        left, right, upper, lower: first and last column and row that have a share of the place.
    """
    tiles, expected = w.rows * w.columns, 0.0
    for k in range(w.kinds):
        a.without[k] = 0.0
    for row in range(upper, lower + 1):
        for column in range(left, right + 1):
            t = row * w.columns + column
            share = a.of_column[2 * column] * a.of_row[2 * row] / a.of_all[0]
            write_kinds(a, t, -1, w)
            likely = 0.0
            for k in range(w.kinds):
                likely += a.of_kind[k] * rate_on(reading, k, w)
            a.likely[t] = likely  # m_t
            expected += share * likely
            write_kinds(a, t, j, w)
            for k in range(w.kinds):
                a.without[k] += share * a.of_kind[k]
    for row in range(upper, lower + 1):
        for column in range(left, right + 1):
            t = row * w.columns + column
            share = a.of_column[2 * column] * a.of_row[2 * row] / a.of_all[0]
            rest = max(expected - share * a.likely[t], 0.0)  # R_t; rounding could make it negative
            if share + rest > 0.0:
                still = math.log(share * rate_on(reading, 0, w) + rest)
                for k in range(1, w.kinds):
                    found = math.log(share * rate_on(reading, k, w) + rest)
                    a.odds[(j * tiles + t) * w.kinds + k] += found - still


@inlined_uncached
def judge_reading(a: Row, j: int, reading: int, p: Row, w: World) -> None:
    """Update surprise, suspicion and weight of sender ``j``, as ``place_trust.judge`` does for bits."""
    classes, kept = w.rates.size // w.kinds, 1.0 - 1.0 / TRUST_MEMORY
    whole, mean, squares, own = 0.0, 0.0, 0.0, 0.0
    for r in range(classes):
        for k in range(w.kinds):
            whole += a.without[k] * rate_on(r, k, w)
    for r in range(classes):
        chance = 0.0
        for k in range(w.kinds):
            chance += a.without[k] * rate_on(r, k, w) / whole
        mean += chance * math.log(chance)
        squares += chance * math.log(chance) * math.log(chance)
        if r == reading:
            own = math.log(chance)
    a.surprise[j] = kept * a.surprise[j] + own - mean
    a.variance[j] = kept * kept * a.variance[j] + squares - mean * mean
    # Each class has one reading in all more than there were, shared by the classes, so that none has the share 0.
    readings = 1.0
    for r in range(classes):
        readings += a.read[j * classes + r]
    of_own = (a.read[j * classes + reading] + 1.0 / classes) / readings
    a.suspicion[j] = kept * a.suspicion[j] + math.log(of_own) - own
    for r in range(classes):
        a.read[j * classes + r] *= kept
    a.read[j * classes + reading] += 1.0
    broken = p.broken_prior / (1.0 - p.broken_prior) * math.exp(min(a.suspicion[j], 500.0))
    a.weight[j] = 1.0 / (1.0 + broken)
    if a.surprise[j] < -p.trust_limit * math.sqrt(a.variance[j]):
        a.weight[j] = 0.0


@inlined_uncached
def write_map(a: Row, w: World) -> None:
    """Write p_tk of all tiles to ``a.by_kind``."""
    for t in range(w.rows * w.columns):
        write_kinds(a, t, -1, w)
        for k in range(w.kinds):
            a.by_kind[t * w.kinds + k] = a.of_kind[k]


@inlined_uncached
def leader(a: Row, w: World) -> int:
    """Return the kind of which the map expects the most tiles, the first of several."""
    first, most = 0, -1.0
    for k in range(w.kinds):
        expected = 0.0
        for t in range(w.rows * w.columns):
            expected += a.by_kind[t * w.kinds + k]
        if expected > most:
            first, most = k, expected
    return first


@inlined_uncached
def doubt_in(a: Row, kind: int, w: World) -> float:
    """Return T_c of c = ``kind``, by the map in ``a.by_kind``."""
    total = 0.0
    for other in range(w.kinds):
        if other != kind:
            total += as_common(a, other, kind, w)
    return total


@inlined_uncached
def as_common(a: Row, kind: int, other: int, w: World) -> float:
    """Return P(N_k >= N_c) of k = ``kind`` and c = ``other``.

    Entry ``tiles + d`` of ``a.apart`` is the probability that N_k - N_c is d, after each tile by those before.
    """
    tiles = w.rows * w.columns
    for i in range(2 * tiles + 1):
        a.apart[i] = 0.0
    a.apart[tiles] = 1.0
    for t in range(tiles):
        up, down = a.by_kind[t * w.kinds + kind], a.by_kind[t * w.kinds + other]
        level, below = max(1.0 - up - down, 0.0), 0.0
        for i in range(tiles - t - 1, tiles + t + 2):
            here = a.apart[i]
            above = a.apart[i + 1] if i < 2 * tiles else 0.0
            a.apart[i] = level * here + up * below + down * above
            below = here
    total = 0.0
    for i in range(tiles, 2 * tiles + 1):
        total += a.apart[i]
    return total


def check(p: Any, boundary: float) -> None:
    """Refuse parameters of ``places`` that are defined for two kinds of tile only.

    Args:
        p: the parameters. boundary: ``decision.decision_boundary``: with several kinds, no share is compared with it.
    Raises:
        InputError: such a parameter is set, or the boundary is not 1/2.
    """
    of_two = ("rate_pairs", "energies", "draws", "share_map", "edge_reach_m")
    for name in of_two:
        if getattr(p, name):
            raise InputError(
                "is defined for two kinds of tile and two classes of readings only; leave it out",
                field=f"strategy.places.{name}",
            )
    if p.prior_median not in (0.0, 0.5) or boundary != 0.5:
        field = "decision.decision_boundary" if boundary != 0.5 else "strategy.places.prior_median"
        raise InputError(
            "is that of a share of two kinds of tile; with more kinds places decides which is the most common, "
            "so leave it out",
            field=field,
        )
