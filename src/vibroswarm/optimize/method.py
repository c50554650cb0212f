"""Define the protocol of a method: it requests runs of candidates, is told when they are finished, and continues.

A method has little state of its own and reads figures from the archive. Its random numbers depend on purpose and
iteration only, so that it requests the same runs after the same history; this is how a search is resumed.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from vibroswarm.analysis.intervals import generator
from vibroswarm.optimize.archive import Archive


class Ask(NamedTuple):
    """A request for further runs of a candidate."""

    key: int
    runs: int


@dataclass(frozen=True)
class Iteration:
    """The state of a method after an iteration; lower scores are better."""

    number: int
    runs: int
    best_key: int
    best: float
    mean: float
    """Mean score of the candidates of this iteration."""
    mean_point: tuple[float, ...]
    """Mean of their points in the unit cube."""
    personal: tuple[float, ...] = ()
    """Scores of the personal bests of a particle swarm."""


def iteration_of(
    archive: Archive,
    number: int,
    keys: Sequence[int],
    best: tuple[int, float],
    points: NDArray[np.float64],
    personal: Iterable[float] = (),
) -> Iteration:
    """Record an iteration in which the candidates ``keys`` were tried at ``points``; ``best`` is key and score."""
    finite = [score for score in map(archive.score, keys) if math.isfinite(score)]
    return Iteration(
        number=number,
        runs=archive.runs,
        best_key=best[0],
        best=best[1],
        mean=float(np.mean(finite)) if finite else math.inf,
        mean_point=tuple(float(u) for u in points.mean(axis=0)),
        personal=tuple(float(score) for score in personal),
    )


class Method(Protocol):
    """The protocol of a method, see the head of this module."""

    name: str
    archive: Archive
    history: list[Iteration]
    iterations: int

    def ask(self) -> list[Ask]:
        """Request runs; an empty list ends the method."""

    def tell(self) -> None:
        """Continue: the requested runs are in the archive."""

    def best(self) -> int:
        """Return the candidate with the best estimate."""

    def finalists(self, count: int) -> list[int]:
        """Return up to ``count`` candidates that may be the best."""


def chance(seed: int, purpose: str) -> np.random.Generator:
    """Create the random generator for one purpose, such as "pso 17"."""
    return generator(seed, f"optimizer: {purpose}")


@dataclass
class SearchProgress:
    """Progress of a search."""

    method: str
    iteration: int
    iterations: int
    runs: int
    wanted: int
    best: float
    failed: int = 0
    stage: str = "search"
