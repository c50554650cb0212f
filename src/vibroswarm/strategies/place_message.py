"""The message of strategies that send samples with their places: 8 bytes, sent once the place is known.

Sender and reading (1 byte), number (1), place to 1 mm (2 each), standard deviations to 1 mm (1 each).
"""

from __future__ import annotations

import math
from typing import Final

from vibroswarm.core.jit import inlined
from vibroswarm.strategies.bayes import Row
from vibroswarm.strategies.world import Reading

STEP_M: Final = 0.001
"""Resolution of places in messages."""


class Message:
    """A sample: its reading, and its place with standard deviations, m."""

    bit: int
    number: int
    at_x_m: float
    at_y_m: float
    spread_x_m: float
    spread_y_m: float


@inlined
def fill_message(s: Row, x: Reading, out: Row) -> bool:
    """Fill in the message of the sample whose place is known by now; return False if there is none yet.

    Args:
        s: its ``bits`` are the own readings not sent yet, the latest is the lowest; ``x`` is added.
    """
    s.bits = ((s.bits << 1) | x.reading) & 0xFFFFFFF
    if x.lagged_number < 0:
        return False
    out.bit = (s.bits >> (x.number - x.lagged_number)) & 1
    out.number = x.lagged_number
    out.at_x_m, out.at_y_m = rounded(x.lagged_x_m), rounded(x.lagged_y_m)
    out.spread_x_m, out.spread_y_m = rounded(x.lagged_spread_x_m), rounded(x.lagged_spread_y_m)
    return True


@inlined
def rounded(length_m: float) -> float:
    """Return a length as messages hold it."""
    return STEP_M * math.floor(length_m / STEP_M + 0.5)
