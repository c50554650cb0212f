"""Positive feedback, u+: a robot sends its decision or, before it has one, its reading (Algorithm 3 of the paper).

``s`` is the robot's state, ``a`` its arrays (none), ``x`` its reading, ``out`` the message to fill in, ``d`` random
numbers, ``p`` the parameters (none), ``w`` what the robot knows.
"""

from __future__ import annotations

from vibroswarm.strategies.base import Strategy, register
from vibroswarm.strategies.bayes import Row, State, begin, belief, decide_once, decision, observe, on_counts
from vibroswarm.strategies.world import Draws, Reading, World


def on_sample(s: Row, a: Row, x: Reading, out: Row, d: Draws, p: Row, w: World) -> bool:
    """Add the reading to the posterior, decide, and send the decision d_f, or the reading O while undecided.

    Return True: a message is always sent.
    """
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
