"""Define the protocol of a search: methods that request runs, and the two methods that learn nothing.

A search runs in stages: its method, then possibly a race of the best candidates (``race``). A stage requests runs of
candidates (``ask``). Once the runs are finished and in the archive, ``tell`` is called, so that the stage can use their
scores for its next requests. A stage reads all figures from the archive. Its random numbers depend only on the seed,
their purpose and the iteration, so that it requests the same runs after the same history; this is how a search is
resumed.

## Your own method

A method is a name and a function that begins its stage. Most methods propose points in batches: derive a class from
``Sampler``, which leaves one function to write.

    class Near(Sampler):
        name = "near"

        def propose(self, count):
            best = self.archive[self.best()].point if self.keys else 0.5
            return list(best + 0.2 * self.random().normal(size=(count, self.archive.space.size)))

    near = Method("near", Near.begin)

The method of a file is named ``FILE.py:near``; ``register`` makes one known to a program by its name. Of this package:

| method | how points are proposed |
|---|---|
| pso | the paper's particle swarm (``pso``) |
| tpe, gp, cmaes, nsga2 | from the scores so far, by Optuna (``optuna_samplers``) |
| random | uniform |
| sobol | evenly spread (scrambled Sobol sequence) |
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.registry import Registry
from vibroswarm.errors import InputError, shown
from vibroswarm.scenario import plugins
from vibroswarm.search.archive import Archive
from vibroswarm.search.space import Point
from vibroswarm.statistics.intervals import generator
from vibroswarm.study.factors import sobol_points

if TYPE_CHECKING:
    from vibroswarm.search.spec import Search


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


class Stage(Protocol):
    """A stage of a search, see the head of this module."""

    @property
    def name(self) -> str:
        """What progress calls it."""

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


@dataclass(frozen=True)
class Method:
    """A method of search, as it is registered."""

    name: str
    """Name by which searches select it."""
    begin: Callable[[Archive, Search], Stage]
    """Begins it: gets the archive of a search, without candidates, and the search."""
    several: bool = False
    """Whether it can minimise several objectives at once."""
    source: str = field(default="", compare=False)
    """Text of the file that defines the method, if the file is not part of this package."""
    code: str = field(default="", compare=False)
    """Name of that file, name of the method in it, and the file's hash."""


_registry = Registry[Method]("method", "search.method")
register, forget, known = _registry.register, _registry.forget, _registry.known
plugins.KINDS["method"] = plugins.Kind(Method, register, known, "vibroswarm.methods")


def method(name: str) -> Method:
    """Return the method of that name, or of a file that is already loaded (``FILE.py:NAME`` with the file's hash).

    Raises:
        InputError: there is no such method, or its file is not loaded.
    """
    return plugins.found("method", name)  # type: ignore[no-any-return]


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

    @property
    def share(self) -> float:
        """Share of the wanted runs that is done."""
        return self.runs / max(self.wanted, 1)


BATCH: Final = 10
"""Default batch size: enough points to keep workers busy, few enough to learn from each batch."""


class Sampler(ABC):
    """A stage that proposes batches of points, with ``evaluations`` runs each, until the budget is spent.

    Args:
        archive: gets the candidates. seed: of the search. budget: runs in all. evaluations: runs of each candidate.
        starts: points to propose first. batch: largest number of points in a batch.
    """

    name = "sampler"

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
        """Number of points that are proposed in all: as many as the budget allows, but at least one."""
        self.batch = min(batch, self.points)
        self.iterations, self.iteration = math.ceil(self.points / self.batch), 0
        """Number of batches in all, and number of finished batches."""
        self.history: list[Iteration] = []
        self.current: list[int] = []
        """Keys of the candidates in the batch that was requested last."""
        self.keys: list[int] = []
        """Keys of all candidates so far."""

    @classmethod
    def begin(cls, archive: Archive, search: Search) -> Self:
        """Begin the method of ``search``, whose ``archive`` has no candidates yet (``Method.begin``)."""
        return cls(archive, search.seed, search.search_budget, search.settings.evaluations, search.starts)

    @abstractmethod
    def propose(self, count: int) -> Sequence[Point]:
        """Propose the next ``count`` points, at least one; they are clipped to the unit cube."""

    def learn(self, keys: Sequence[int]) -> None:  # noqa: B027 - nothing, for methods that do not learn
        """Update the method with the scores of the candidates ``keys`` of a batch, in the order of the proposals."""

    def random(self) -> np.random.Generator:
        """Return the random generator of this batch; the same at each call."""
        return chance(self.seed, f"{self.name} {self.iteration}")

    def ask(self) -> list[Ask]:
        """Propose the next batch, add its points to the archive, and request runs of each.

        The starts come first. The list is empty once all ``points`` have been proposed.

        Raises:
            InputError: ``propose`` gives something else than so many points.
        """
        count = min(self.batch, self.points - len(self.keys))
        if count <= 0:
            return []
        points, self.starts = self.starts[:count], self.starts[count:]
        if missing := count - len(points):
            proposed = np.asarray(self.propose(missing), dtype=np.float64)
            if proposed.shape != (missing, self.archive.space.size) or not np.isfinite(proposed).all():
                raise InputError(
                    f"gives {shown(proposed.tolist())}; return {missing} points of {self.archive.space.size} numbers",
                    field=f"{self.name}.propose",
                )
            points = [*points, *proposed]
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
        """Return the keys of up to ``count`` candidates, sorted by the upper bound of the score, the lowest first.

        With several objectives, these are the candidates on the Pareto front, by the score of the first objective.
        """
        one = len(self.archive.objectives) == 1
        return (self.archive.in_order(self.keys) if one else self.archive.front(self.keys))[:count]


class Random(Sampler):
    """Random search with uniform points."""

    name = "random"

    def propose(self, count: int) -> Sequence[Point]:
        """Return ``count`` uniformly random points."""
        return list(self.random().random((count, self.archive.space.size)))


class Sobol(Sampler):
    """Search along a scrambled Sobol sequence."""

    name = "sobol"

    def propose(self, count: int) -> Sequence[Point]:
        """Return the next ``count`` points of the sequence; the first call draws it."""
        if not hasattr(self, "sequence"):
            # SciPy spawns a generator of its own from the one that it gets. A generator of ``chance`` cannot spawn, so
            # it only draws the seed of one that can.
            rng = np.random.default_rng(int(chance(self.seed, "sobol").integers(2**63)))
            self.sequence = iter(sobol_points(rng, self.points, self.archive.space.size))
        return [next(self.sequence) for _ in range(count)]


RANDOM = register(Method("random", Random.begin))
SOBOL = register(Method("sobol", Sobol.begin))
