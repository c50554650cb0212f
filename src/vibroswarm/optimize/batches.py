"""Methods that propose points a batch at a time, from what came of those before; all but the swarm are such.

| method | how points are proposed |
|---|---|
| random | uniform |
| sobol | evenly spread (scrambled Sobol sequence) |
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Final

import numpy as np

from vibroswarm.optimize.archive import Archive
from vibroswarm.optimize.method import Ask, Iteration, chance
from vibroswarm.optimize.space import Point

BATCH: Final = 10
"""Points at a time, where the method does not say: enough for the workers, few enough to learn from."""


class Batches(ABC):
    """A method that proposes so many points, ``evaluations`` runs each, until the budget is spent."""

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
        """The next points."""

    def learn(self, keys: Sequence[int]) -> None:  # noqa: B027  (not all do)
        """What came of them is in the archive."""

    def ask(self) -> list[Ask]:
        """A batch."""
        left = self.points - len(self.keys)
        if left <= 0:
            return []
        points = self.propose(min(self.batch, left))
        origin = f"{self.name} {self.iteration + 1}"
        self.current = [self.archive.new(point, origin) for point in points]
        self.keys += self.current
        return [Ask(key, self.evaluations) for key in self.current]

    def tell(self) -> None:
        """Learn from the batch."""
        self.learn(self.current)
        self.iteration += 1
        best = self.best()
        there = [s for s in (self.archive.score(key) for key in self.current) if math.isfinite(s)]
        points = np.array([self.archive[key].point for key in self.current])
        self.history.append(
            Iteration(
                number=self.iteration,
                runs=self.archive.runs,
                best_key=best,
                best=self.archive.estimate(best)[0],
                mean=float(np.mean(there)) if there else math.inf,
                mean_point=tuple(float(u) for u in points.mean(axis=0)),
            )
        )

    def best(self) -> int:
        """The best so far, with caution."""
        return self.archive.in_order(self.keys)[0]

    def finalists(self, count: int) -> list[int]:
        """The best, in order."""
        return self.archive.in_order(self.keys)[:count]

    def next_starts(self, count: int) -> list[Point]:
        """Starts that were not proposed yet."""
        found, self.starts = self.starts[:count], self.starts[count:]
        return found


class Random(Batches):
    """Uniform points."""

    name = "random"

    def propose(self, count: int) -> list[Point]:
        """The starts, then chance."""
        points = self.next_starts(count)
        random = chance(self.seed, f"random {self.iteration}")
        return [*points, *random.random((count - len(points), self.archive.space.size))]


class Sobol(Batches):
    """Points that fill the space evenly."""

    name = "sobol"

    def propose(self, count: int) -> list[Point]:
        """The starts, then the sequence."""
        from scipy.stats import qmc

        points = self.next_starts(count)
        if not hasattr(self, "sequence"):
            whole = 1 << max(self.points - 1, 0).bit_length()  # balanced at powers of two
            number = int(chance(self.seed, "sobol").integers(2**63))  # scipy wants a generator that can spawn
            sampler = qmc.Sobol(self.archive.space.size, scramble=True, rng=np.random.default_rng(number))
            self.sequence = list(sampler.random(whole))
        more = count - len(points)
        taken, self.sequence = self.sequence[:more], self.sequence[more:]
        return [*points, *taken]
