"""Positive feedback for several kinds of tile: a robot sends its decision or, before it has one, its reading.

As ``dirichlet`` otherwise. With two kinds it is ``positive``, bit by bit.
"""

from __future__ import annotations

from vibroswarm.strategies.base import register, strategy_in
from vibroswarm.strategies.bayes import Row, decision
from vibroswarm.strategies.dirichlet import (
    Arrays,
    Message,
    State,
    begin,
    belief,
    observe_and_decide,
    on_message,
)
from vibroswarm.strategies.world import Draws, Reading, World

__all__ = ["Arrays", "Message", "State", "begin", "belief", "decision", "dirichlet_positive", "on_message"]


def on_sample(s: Row, a: Row, x: Reading, out: Row, d: Draws, p: Row, w: World) -> bool:
    """Count the reading, decide, and send the decision, or the reading while undecided."""
    observe_and_decide(s, a, x, w)
    out.kind = s.decision if s.decision != -1 else x.reading
    return s.decision != -1 or x.reading < w.kinds


dirichlet_positive = register(
    strategy_in(
        __name__,
        "dirichlet_positive",
        answers_kinds=True,
        shares="counts",
        about="positive feedback, several kinds of tile: a robot sends its decision once it has one",
    )
)
