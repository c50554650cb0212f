"""Define the protocol of a search's method, and the methods that propose points in batches.

A method requests runs of candidates, is told when they are finished, and continues. It has little state of its own and
reads figures from the archive. Its random numbers depend on purpose and iteration only, so that it requests the same
runs after the same history; this is how a search is resumed.

All methods but the particle swarm propose in batches, each from the scores of those before:

| method | how points are proposed |
|---|---|
| random | uniform |
| sobol | evenly spread (scrambled Sobol sequence) |
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from vibroswarm.analysis.intervals import generator
from vibroswarm.optimize.archive import Archive
from vibroswarm.optimize.space import Point


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


BATCH: Final = 10
"""Default batch size: enough points to keep workers busy, few enough to learn from each batch."""


class BatchSampler(ABC):
    """A method that proposes batches of points, with ``evaluations`` runs each, until the budget is spent."""

    name = "batches"

    def __init__(
        self,
        archive: Archive,
        seed: int,
        budget: int,
        evaluations: int,
        starts: Sequence[Point] = (),
        batch: int = BATCH,
    ) -> None:
        self.archive, self.seed, self.evaluations, self.starts = archive, seed, evaluations, list(starts)
        self.points = max(budget // evaluations, 1)
        self.batch = min(batch, self.points)
        self.iterations, self.iteration = math.ceil(self.points / self.batch), 0
        self.history: list[Iteration] = []
        self.current: list[int] = []
        self.keys: list[int] = []

    @abstractmethod
    def propose(self, count: int) -> list[Point]:
        """Propose the next points."""

    def learn(self, keys: Sequence[int]) -> None:  # noqa: B027  (not all do)
        """Update the method with the scores of a batch, which are in the archive."""

    def ask(self) -> list[Ask]:
        """Request the runs of the next batch."""
        left = self.points - len(self.keys)
        if left <= 0:
            return []
        points = self.propose(min(self.batch, left))
        origin = f"{self.name} {self.iteration + 1}"
        self.current = [self.archive.new(point, origin) for point in points]
        self.keys += self.current
        return [Ask(key, self.evaluations) for key in self.current]

    def tell(self) -> None:
        """Learn from the finished batch."""
        self.learn(self.current)
        self.iteration += 1
        best = self.best()
        points = np.array([self.archive[key].point for key in self.current])
        believed = self.archive.estimate(best)[0]
        self.history.append(
            iteration_of(self.archive, self.iteration, self.current, (best, believed), points)
        )

    def best(self) -> int:
        """Return the best candidate by upper bound of the score."""
        return self.archive.in_order(self.keys)[0]

    def finalists(self, count: int) -> list[int]:
        """Return the best candidates in order."""
        return self.archive.in_order(self.keys)[:count]

    def next_starts(self, count: int) -> list[Point]:
        """Take starts that have not been proposed yet."""
        taken, self.starts = self.starts[:count], self.starts[count:]
        return taken


class Random(BatchSampler):
    """Random search with uniform points."""

    name = "random"

    def propose(self, count: int) -> list[Point]:
        """Propose the starts, then uniform points."""
        points = self.next_starts(count)
        random = chance(self.seed, f"random {self.iteration}")
        return [*points, *random.random((count - len(points), self.archive.space.size))]


class Sobol(BatchSampler):
    """Search along a scrambled Sobol sequence."""

    name = "sobol"

    def propose(self, count: int) -> list[Point]:
        """Propose the starts, then the points of the sequence."""
        from scipy.stats import qmc

        points = self.next_starts(count)
        if not hasattr(self, "sequence"):
            size = 1 << max(self.points - 1, 0).bit_length()  # balanced at powers of two
            number = int(chance(self.seed, "sobol").integers(2**63))  # scipy wants a generator that can spawn
            sampler = qmc.Sobol(self.archive.space.size, scramble=True, rng=np.random.default_rng(number))
            self.sequence = list(sampler.random(size))
        more = count - len(points)
        taken, self.sequence = self.sequence[:more], self.sequence[more:]
        return [*points, *taken]
