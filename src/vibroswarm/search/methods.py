"""Define what a method of search is: it requests runs of candidates, and reads their scores in the archive.

| method | how points are proposed |
|---|---|
| pso | the paper's particle swarm (``pso``) |
| random, sobol, tpe, gp, cmaes, nsga2 | by a sampler of Optuna (``optuna_samplers``) |
| ``FILE.py:NAME`` | by a sampler of the user's own, an ``optuna_samplers.optuna_method`` |

Random numbers of a method depend on the seed, their purpose and the iteration alone, so that it requests the same runs
after the same history: this is how a search is continued.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.registry import Registry
from vibroswarm.scenario import plugins
from vibroswarm.search.archive import Archive
from vibroswarm.statistics.intervals import generator

if TYPE_CHECKING:
    from vibroswarm.search.spec import Search


class Ask(NamedTuple):
    """A request for further runs of a candidate, given by its key in the archive."""

    key: int
    runs: int


class Iteration(NamedTuple):
    """The state of a method after an iteration; lower scores are better."""

    number: int
    """The iteration, from 1."""
    runs: int
    """Runs of the search so far."""
    best_key: int
    best: float
    """Score of the best candidate so far, as the method estimates it."""
    mean: float
    """Mean of the finite scores of the candidates of this iteration."""
    mean_point: tuple[float, ...]
    """Mean of the points of all candidates of this iteration in the unit cube."""
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
    """Return the record of an iteration: keys and points of its candidates, key and score of the best so far."""
    finite = [score for score in map(archive.score, keys) if math.isfinite(score)]
    mean = float(np.mean(finite)) if finite else math.inf
    mean_point = tuple(float(u) for u in points.mean(axis=0))
    return Iteration(number, archive.runs, *best, mean, mean_point, tuple(map(float, personal)))


class Stage(Protocol):
    """A running method."""

    name: str
    history: list[Iteration]
    """The finished iterations."""

    def ask(self) -> list[Ask]:
        """Request runs, at most once for each candidate; an empty list ends the method."""

    def tell(self) -> None:
        """Take the results of the requested runs, which are in the archive by now."""

    def best(self) -> int:
        """Return the key of the candidate that the method ranks first, by the first objective."""

    def finalists(self, count: int) -> list[int]:
        """Return the keys of good candidates, the best first; with several objectives, of the Pareto front."""


@dataclass(frozen=True)
class Method:
    """A method of search, as it is registered."""

    name: str
    begin: Callable[[Archive, Search], Stage]
    """Begins it, with an archive without candidates."""
    several: bool = False
    """Whether it can minimise several objectives at once."""
    source: str = field(default="", compare=False)
    code: str = field(default="", compare=False)


_registry = Registry[Method]("method", "search.method")
register, forget, known = _registry.register, _registry.forget, _registry.known
plugins.KINDS["method"] = plugins.Kind(Method, register, known, "vibroswarm.methods")


def method(name: str) -> Method:
    """Return the method of that name, or of a file that is loaded.

    Raises:
        InputError: there is no such method, or its file is not loaded.
    """
    return plugins.found("method", name)  # type: ignore[no-any-return]


def chance(seed: int, purpose: str) -> np.random.Generator:
    """Create the random generator for one purpose, such as "pso 17"."""
    return generator(seed, f"optimizer: {purpose}")


class SearchProgress(NamedTuple):
    """Progress of a search, as it is reported while runs finish."""

    method: str
    iteration: int
    """Number of finished iterations."""
    runs: int
    """Number of finished runs."""
    wanted: int
    """Number of runs of the search."""
    best: float
    """The best score so far; infinite before the first iteration ends."""
    failed: int = 0

    @property
    def share(self) -> float:
        """Share of the wanted runs that is done."""
        return self.runs / max(self.wanted, 1)
