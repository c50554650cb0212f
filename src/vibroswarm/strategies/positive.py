"""Positive feedback, u+: a robot says its decision, before it has one its reading (Algorithm 3)."""

from __future__ import annotations

from vibroswarm.compiled import inner


@inner
def message(observation: int, decision: int) -> int:
    """m = d_f if d_f is not -1, else O."""
    return decision if decision != -1 else observation
