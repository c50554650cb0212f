"""Times in control periods (ticks), where rounding of a time in seconds must not add or lose one."""

from __future__ import annotations

import math
from typing import Final

ROUNDING: Final = 1e-6
"""Share of a tick by which a time may be rounded; over the 2^31 ticks of the longest run, doubles err by 5e-7."""


def tick_at(time_s: float, tick_ms: int) -> int:
    """Return the first tick at or after a time; one up to ``ROUNDING`` ticks before it counts as at the time."""
    return math.ceil(time_s * 1000.0 / tick_ms - ROUNDING)
