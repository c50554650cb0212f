"""Define the protocol of a search's method, and the methods that propose points in batches.

A method requests runs of candidates (``ask``). Once the runs are finished and in the archive, ``tell`` is called, so
that the method can use their scores for its next requests. A method reads all figures from the archive. Its random
numbers depend only on the seed, their purpose and the iteration, so that it requests the same runs after the same
history; this is how a search is resumed.

All methods but the particle swarm propose points in batches. The methods of Optuna and cmaes use the scores of the
batches before; these two do not:

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
    """Key of the candidate in the archive."""
    runs: int
    """Number of further runs."""


@dataclass(frozen=True)
class Iteration:
    """The state of a method after an iteration; lower scores are better."""

    number: int
    """The iteration, from 1."""
    runs: int
    """Runs of the search so far."""
    best_key: int
    """Key of the best candidate so far."""
    best: float
    """Score of the best candidate so far, as the method estimates it."""
    mean: float
    """Mean of the finite scores of the candidates of this iteration; infinite if there are none."""
    mean_point: tuple[float, ...]
    """Mean of the points of all candidates of this iteration in the unit cube; in a race, the point of the best one."""
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
    """Make the record of an iteration.

    Args:
        archive: has the runs of the iteration. number: of the iteration, from 1.
        keys: keys of the candidates of the iteration.
        points: positions of these candidates in the unit cube, (candidates, dimensions).
        best: key and score of the best candidate so far.
        personal: of a particle swarm, the scores of the personal bests.
    Returns:
        The record. Its mean score is over candidates with a finite score, and infinite if there are none; its mean
        point is over all candidates.
    """
    # An infinite score, such as that of a candidate with a failed run, would make the mean infinite. These are scores
    # without the correction for small-sample bias that ``Archive.estimate`` makes.
    finite = [score for score in map(archive.score, keys) if math.isfinite(score)]
    best_key, best_score = best
    return Iteration(
        number=number,
        runs=archive.runs,
        best_key=best_key,
        best=best_score,
        mean=float(np.mean(finite)) if finite else math.inf,
        mean_point=tuple(float(u) for u in points.mean(axis=0)),
        personal=tuple(float(score) for score in personal),
    )


class Method(Protocol):
    """The protocol of a method, see the head of this module."""

    name: str
    archive: Archive
    history: list[Iteration]
    """The finished iterations."""
    iterations: int
    """Number of iterations if the budget is used up."""

    def ask(self) -> list[Ask]:
        """Request runs, at most once for each candidate; an empty list ends the method."""

    def tell(self) -> None:
        """Take the results of the requested runs, which are in the archive by now."""

    def best(self) -> int:
        """Return the key of the candidate that the method ranks first, by the first objective if there are several."""

    def finalists(self, count: int) -> list[int]:
        """Return the keys of up to ``count`` good candidates, the best first.

        With several objectives, these are the candidates on the Pareto front, by the score of the first objective.
        """


def chance(seed: int, purpose: str) -> np.random.Generator:
    """Create the random generator for one purpose, such as "pso 17"."""
    return generator(seed, f"optimizer: {purpose}")


@dataclass
class SearchProgress:
    """Progress of a search, as it is reported while runs finish."""

    method: str
    """Name of the method, or "race"."""
    iteration: int
    """Number of finished iterations."""
    iterations: int
    """Number of iterations if the budget is used up."""
    runs: int
    """Number of finished runs."""
    wanted: int
    """Number of runs of the search up to the end of this stage."""
    best: float
    """The best score so far; infinite before the first iteration ends."""
    failed: int = 0
    """Number of runs that failed."""
    stage: str = "search"
    """Either "search" or "race"."""


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
        """Prepare a search without candidates.

        Args:
            archive: gets the candidates. seed: of the search. budget: runs in all. evaluations: runs of each candidate.
            starts: points to propose first. batch: largest number of points in a batch.
        """
        self.archive, self.seed, self.evaluations, self.starts = archive, seed, evaluations, list(starts)
        self.points = max(budget // evaluations, 1)
        """Number of points that are proposed in all: as many as the budget allows, but at least one."""
        self.batch = min(batch, self.points)
        self.iterations, self.iteration = math.ceil(self.points / self.batch), 0
        """Number of batches in all, and number of finished batches."""
        self.history: list[Iteration] = []
        self.current: list[int] = []
        """Keys of the candidates in the batch that was requested last."""
        self.keys: list[int] = []
        """Keys of all candidates so far."""

    @abstractmethod
    def propose(self, count: int) -> list[Point]:
        """Propose the next ``count`` points in the unit cube."""

    def learn(self, keys: Sequence[int]) -> None:  # noqa: B027  (some methods do not learn)
        """Update the method with the scores of a batch, which are in the archive."""

    def ask(self) -> list[Ask]:
        """Propose the next batch, add its points to the archive, and request runs of each.

        The list is empty once all ``points`` have been proposed.
        """
        left = self.points - len(self.keys)
        if left <= 0:
            return []
        points = self.propose(min(self.batch, left))
        origin = f"{self.name} {self.iteration + 1}"
        self.current = [self.archive.new(point, origin) for point in points]
        self.keys += self.current
        return [Ask(key, self.evaluations) for key in self.current]

    def tell(self) -> None:
        """Update the method with the scores of the finished batch, and add the batch to the history."""
        self.learn(self.current)
        self.iteration += 1
        best = self.best()
        points = np.array([self.archive[key].point for key in self.current])
        believed = self.archive.estimate(best)[0]
        self.history.append(
            iteration_of(self.archive, self.iteration, self.current, (best, believed), points)
        )

    def best(self) -> int:
        """Return the key of the candidate whose score has the lowest upper bound, see ``Archive.cautious``."""
        return self.archive.in_order(self.keys)[0]

    def finalists(self, count: int) -> list[int]:
        """Return the keys of up to ``count`` candidates, sorted by the upper bound of the score, the lowest first."""
        return self.archive.in_order(self.keys)[:count]

    def next_starts(self, count: int) -> list[Point]:
        """Take up to ``count`` starts out of those that have not been proposed yet."""
        taken, self.starts = self.starts[:count], self.starts[count:]
        return taken


class Random(BatchSampler):
    """Random search with uniform points."""

    name = "random"

    def propose(self, count: int) -> list[Point]:
        """Return ``count`` points: first the starts that have not been proposed yet, then uniformly random points."""
        starts = self.next_starts(count)
        random = chance(self.seed, f"random {self.iteration}")
        return [*starts, *random.random((count - len(starts), self.archive.space.size))]


class Sobol(BatchSampler):
    """Search along a scrambled Sobol sequence."""

    name = "sobol"

    def propose(self, count: int) -> list[Point]:
        """Return ``count`` points: first the starts that have not been proposed yet, then points of the sequence.

        The sequence is drawn in the first call, and ``self.sequence`` keeps the points that are left.
        """
        from scipy.stats import qmc

        starts = self.next_starts(count)
        if not hasattr(self, "sequence"):
            # A Sobol sequence is evenly spread only if its length is a power of two, and SciPy warns of other lengths.
            # The smallest power of two that is at least ``points`` is drawn; surplus points stay unused.
            size = 1 << max(self.points - 1, 0).bit_length()
            # SciPy spawns a generator of its own from the one that it gets. A generator of ``chance`` cannot spawn, so
            # it only draws the seed of one that can.
            sobol_seed = int(chance(self.seed, "sobol").integers(2**63))
            sampler = qmc.Sobol(self.archive.space.size, scramble=True, rng=np.random.default_rng(sobol_seed))
            self.sequence = list(sampler.random(size))
        missing = count - len(starts)
        taken, self.sequence = self.sequence[:missing], self.sequence[missing:]
        return [*starts, *taken]
