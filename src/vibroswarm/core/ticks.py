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
    """Return whether motion simulated up to ``time_s`` has reached ``until_s``: then ``advance`` has nothing to do.

    The times are compared as ticks of ``tick_ms``. As floats, the sum 4.98 s + 0.02 s is a little more than the time of
    the 250th tick; a loop that compared floats, and advanced until the motion's time is at least that sum, would never
    end.
    """
    return tick_at(time_s, tick_ms) >= tick_at(until_s, tick_ms)
