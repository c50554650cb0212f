"""Positive feedback, u+: a robot sends its decision or, before it has one, its reading (Algorithm 3 of the paper)."""

from __future__ import annotations

from vibroswarm.strategies.base import Strategy, register
from vibroswarm.strategies.bayes import Row, State, begin, belief, decide_once, decision, observe, on_counts
from vibroswarm.strategies.world import Draws, Reading, World


def on_sample(s: Row, a: Row, x: Reading, out: Row, d: Draws, p: Row, w: World) -> bool:
    """Add the reading, decide, and send d_f, or the reading while undecided."""
    observe(s, x.reading)
    decide_once(s, w)
    out.bit = s.decision if s.decision != -1 else x.reading
    return True


positive = register(
    Strategy(
        name="positive",
        state=State,
        begin=begin,
        on_counts=on_counts,
        on_sample=on_sample,
        decision=decision,
        belief=belief,
        about="positive feedback: a robot sends its decision once it has one",
    )
)
