"""Times in control periods (ticks), where rounding of a time in seconds must not add or lose one."""

from __future__ import annotations

import math
from typing import Final

ROUNDING: Final = 1e-6
"""Share of a tick by which a time may be rounded; over the 2^31 ticks of the longest run, doubles err by 5e-7."""


def tick_at(time_s: float, tick_ms: int) -> int:
    """Return the first tick at or after a time, which is the number of ticks that begin before that time.

    A tick up to ``ROUNDING`` ticks before the time counts as at the time.
    """
    return math.ceil(time_s * 1000.0 / tick_ms - ROUNDING)


def reached(time_s: float, until_s: float, tick_ms: int) -> bool:
    """Return whether motion simulated up to ``time_s`` is at the tick of ``until_s`` or later.

    If so, ``MotionState.advance(until_s)`` does nothing. The times are compared as ticks, of ``tick_ms`` each: as
    floats, 0.28 s + 0.02 s is a little more than 0.3 s, the time of tick 15 of 20 ms. ``advance`` to that sum stops at
    0.3 s, so a loop that advanced until the floats compare as equal or greater would never end.
    """
    return tick_at(time_s, tick_ms) >= tick_at(until_s, tick_ms)
