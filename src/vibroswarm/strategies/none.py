"""No feedback, u-: a robot sends its latest reading (Algorithm 3 of the paper)."""

from __future__ import annotations

from vibroswarm.strategies.base import Strategy, register
from vibroswarm.strategies.bayes import Row, State, begin, belief, decide_once, decision, observe, on_counts
from vibroswarm.strategies.world import Draws, Reading, World


def on_sample(s: Row, a: Row, x: Reading, out: Row, d: Draws, p: Row, w: World) -> bool:
    """Add the reading to the posterior, decide, and send the reading, whatever the decision is."""
    observe(s, x.reading)
    decide_once(s, w)
    out.bit = x.reading
    return True


none = register(
    Strategy(
        name="none",
        state=State,
        begin=begin,
        on_counts=on_counts,
        on_sample=on_sample,
        decision=decision,
        belief=belief,
        about="no feedback: a robot sends its reading",
    )
)
