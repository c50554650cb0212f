"""Wrap the methods of Optuna and cmaes in the protocol of ``method``.

| method | library | what |
|---|---|---|
| tpe | Optuna | tree of Parzen estimators, multivariate (Bergstra et al. 2011) |
| gp | Optuna, torch | Gaussian process with expected improvement |
| nsga2 | Optuna | non-dominated sorting genetic algorithm for several objectives (Deb et al. 2002) |
| cmaes | cmaes | covariance matrix adaptation (Hansen 2016), bounded |

Samplers are kept in memory only and rebuilt from the history when a search is resumed.
"""

from __future__ import annotations

import itertools
import math
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Final

import numpy as np

from vibroswarm.analysis.tradeoff import pareto_front
from vibroswarm.errors import InputError
from vibroswarm.optimize.archive import Archive
from vibroswarm.optimize.batch_samplers import BATCH, BatchSampler
from vibroswarm.optimize.method import chance
from vibroswarm.optimize.space import Point

POPULATION: Final = 24
"""Population of nsga2."""


def optuna(wanted_by: str = "search.method") -> Any:
    """Import Optuna without its log messages.

    Raises:
        InputError: it is not installed.
    """
    try:
        import optuna as library
    except ImportError:
        raise InputError("needs Optuna: pip install 'vibroswarm[optimize]'", field=wanted_by) from None
    library.logging.set_verbosity(library.logging.ERROR)
    return library


@contextmanager
def ignore_warnings() -> Iterator[None]:
    """Suppress a library's warnings, such as those about experimental features."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


class OptunaSampler(BatchSampler):
    """A search with one of Optuna's samplers."""

    def __init__(
        self, archive: Archive, seed: int, budget: int, evaluations: int, starts: Sequence[Point], name: str
    ) -> None:
        self.name = name
        batch = POPULATION if name == "nsga2" else BATCH
        super().__init__(archive, seed, budget, evaluations, starts, batch)
        library = optuna()
        number = int(chance(seed, name).integers(2**31))
        with ignore_warnings():
            sampler = self._sampler(library, number)
            self.study = library.create_study(
                directions=["minimize"] * len(archive.objectives), sampler=sampler
            )
        self.trials: list[Any] = []

    def propose(self, count: int) -> list[Point]:
        """Propose the starts, then the sampler's points."""
        with ignore_warnings():
            for start in self.next_starts(count):
                self.study.enqueue_trial(self._parameters(start))
            self.trials = [self.study.ask() for _ in range(count)]
            return [np.array([self._share(trial, d) for d in self.archive.space]) for trial in self.trials]

    def learn(self, keys: Sequence[int]) -> None:
        """Pass the scores to the sampler; a candidate with a failed run is a failed trial."""
        state = optuna().trial.TrialState
        with ignore_warnings():
            for trial, key in zip(self.trials, keys, strict=True):
                scores = self.archive.scores(key)
                if all(math.isfinite(score) for score in scores):
                    self.study.tell(trial, scores)
                else:
                    self.study.tell(trial, state=state.FAIL)

    def finalists(self, count: int) -> list[int]:
        """Return the best candidates; with several objectives those on the Pareto front."""
        if len(self.archive.objectives) == 1:
            return super().finalists(count)
        return front(self.archive, self.keys)[:count]

    def _sampler(self, library: Any, number: int) -> Any:
        samplers = library.samplers
        if self.name == "tpe":
            return samplers.TPESampler(
                seed=number, multivariate=True, constant_liar=True, n_startup_trials=25
            )
        if self.name == "nsga2":
            return samplers.NSGAIISampler(seed=number, population_size=self.batch)
        try:
            import torch  # noqa: F401
        except ImportError:
            raise InputError("gp needs torch: pip install 'vibroswarm[gp]'", field="search.method") from None
        return samplers.GPSampler(seed=number, deterministic_objective=False, n_startup_trials=25)

    def _share(self, trial: Any, dimension: Any) -> float:
        if dimension.choices:
            count = len(dimension.choices)
            return (int(trial.suggest_categorical(dimension.name, list(range(count)))) + 0.5) / count
        return float(trial.suggest_float(dimension.name, 0.0, 1.0))

    def _parameters(self, point: Point) -> dict[str, Any]:
        return {
            d.name: min(int(u * len(d.choices)), len(d.choices) - 1) if d.choices else float(u)
            for d, u in zip(self.archive.space, point, strict=True)
        }


class Cmaes(BatchSampler):
    """Covariance matrix adaptation in the unit cube, starting at its centre or at the first start."""

    name = "cmaes"

    def __init__(
        self, archive: Archive, seed: int, budget: int, evaluations: int, starts: Sequence[Point]
    ) -> None:
        try:
            import cmaes
        except ImportError:
            raise InputError(
                "needs cmaes: pip install 'vibroswarm[optimize]'", field="search.method"
            ) from None
        size = archive.space.size
        if size < 2:
            raise InputError("needs at least two fields", field="search.method")
        self.optimizer = cmaes.CMA(
            mean=np.full(size, 0.5) if not starts else np.clip(starts[0], 0.05, 0.95),
            sigma=0.3,
            bounds=np.column_stack([np.zeros(size), np.ones(size)]),
            seed=int(chance(seed, "cmaes").integers(2**31)),
        )
        super().__init__(archive, seed, budget, evaluations, starts, self.optimizer.population_size)
        self.asked: list[Point] = []

    def propose(self, count: int) -> list[Point]:
        """Propose a generation; starts replace its first points."""
        asked = [self.optimizer.ask() for _ in range(count)]
        self.asked = [*self.next_starts(count), *asked][:count]
        return self.asked

    def learn(self, keys: Sequence[int]) -> None:
        """Learn from complete generations only; failed candidates rank below all others."""
        if len(keys) < self.optimizer.population_size:
            return
        scores = [self.archive.score(key) for key in keys]
        worst = max((s for s in scores if math.isfinite(s)), default=1.0)
        told = [s if math.isfinite(s) else worst + abs(worst) + 1.0 for s in scores]
        self.optimizer.tell(list(zip(self.asked, told, strict=True)))


def front(archive: Archive, keys: Sequence[int]) -> list[int]:
    """Return the candidates on the Pareto front of the objectives, in the order of the first objective."""
    scores = {key: archive.scores(key) for key in keys}
    finite = [key for key in keys if np.isfinite(scores[key]).all()]
    if not finite:
        return []
    on_front = pareto_front(*zip(*(scores[key] for key in finite), strict=True))
    return sorted(itertools.compress(finite, on_front), key=lambda k: (scores[k], k))
