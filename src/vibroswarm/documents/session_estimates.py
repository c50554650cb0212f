"""Estimates with intervals over sessions, as columns of a table and as words."""

from __future__ import annotations

import math

from vibroswarm.analysis.intervals import Interval
from vibroswarm.core.numbers import Estimate


def estimate_of(interval: Interval | None, scale: float = 1.0) -> Estimate:
    """Return an estimate with its limits; a single session has no limits, and None becomes nan."""
    if interval is None:
        return Estimate(math.nan, math.nan, math.nan)
    low, high = (math.nan, math.nan) if interval.n == 1 else (interval.low, interval.high)
    return Estimate(scale * interval.estimate, scale * low, scale * high)


def columns_of(name: str, interval: Interval | None) -> dict[str, float]:
    """Return an estimate and its limits as the columns NAME, NAME_low and NAME_high."""
    return dict(zip((name, f"{name}_low", f"{name}_high"), estimate_of(interval), strict=True))
