"""What a method is: it asks for runs of candidates, is told when they are done, and asks again.

A method keeps its own small state and reads figures from the archive. Chance comes by purpose and iteration, so that
asking again after the same history asks for the same: that is how a search is resumed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from vibroswarm.analysis.intervals import generator
from vibroswarm.optimize.archive import Archive


class Ask(NamedTuple):
    """So many further runs of a candidate."""

    key: int
    runs: int


@dataclass(frozen=True)
class Iteration:
    """What a method believed after an iteration; scores are smaller the better."""

    number: int
    runs: int
    best_key: int
    best: float
    mean: float
    """Mean score of the candidates that were tried in it."""
    mean_point: tuple[float, ...]
    """Mean of their places in the unit cube."""
    personal: tuple[float, ...] = ()
    """Scores of the personal bests, for a swarm."""


class Method(Protocol):
    """See the head of this module."""

    name: str
    archive: Archive
    history: list[Iteration]
    iterations: int

    def ask(self) -> list[Ask]:
        """Runs that are wanted now; none: the method is done."""

    def tell(self) -> None:
        """The runs asked for are in the archive."""

    def best(self) -> int:
        """The candidate that the method takes for the best."""

    def finalists(self, count: int) -> list[int]:
        """So many candidates that may be the best, or fewer."""


def chance(seed: int, purpose: str) -> np.random.Generator:
    """Chance of an optimiser for one purpose, such as "pso 17"."""
    return generator(seed, f"optimizer: {purpose}")


@dataclass
class Told:
    """How far a search is."""

    method: str
    iteration: int
    iterations: int
    runs: int
    wanted: int
    best: float
    failed: int = 0
    stage: str = "search"
