"""No feedback, u-: a robot says what it has just read (Algorithm 3)."""

from __future__ import annotations

from vibroswarm.compiled import inner


@inner
def message(observation: int) -> int:
    """m = O."""
    return observation
