"""Wrap the methods of Optuna and cmaes in the protocol of ``methods``.

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
from vibroswarm.optimize.methods import BATCH, BatchSampler, chance
from vibroswarm.optimize.space import Dimension, Point


def distribution_of(library: Any, dimension: Dimension) -> Any:
    """Return the Optuna distribution that describes a field: its choices, or its range and scale."""
    distributions = library.distributions
    if dimension.choices:
        return distributions.CategoricalDistribution(dimension.choices)
    log = dimension.scale == "log"
    if dimension.whole:
        return distributions.IntDistribution(int(dimension.low), int(dimension.high), log=log)
    return distributions.FloatDistribution(dimension.low, dimension.high, log=log)


POPULATION: Final = 24
"""Population of nsga2."""
STARTUP_TRIALS: Final = 25
"""Random candidates before tpe and gp use their model."""


def optuna() -> Any:
    """Import Optuna and turn off its log messages.

    Raises:
        InputError: Optuna is not installed.
    """
    try:
        import optuna as library
    except ImportError:
        raise InputError("needs Optuna: pip install 'vibroswarm[optimize]'", field="search.method") from None
    library.logging.set_verbosity(library.logging.ERROR)
    return library


@contextmanager
def ignore_warnings() -> Iterator[None]:
    """Suppress a library's warnings, such as those about experimental features."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


class OptunaSampler(BatchSampler):
    """A search with one of Optuna's samplers.

    Optuna does not get the values of the fields: for a range it gets the coordinate in the unit cube, from 0 to 1, for
    a list the index of the choice.
    """

    def __init__(
        self, archive: Archive, seed: int, budget: int, evaluations: int, starts: Sequence[Point], name: str
    ) -> None:
        """Create the sampler ``name`` ("tpe", "gp" or "nsga2").

        Args:
            archive: gets the candidates. seed: of the search. budget: runs in all. evaluations: runs of each candidate.
            starts: points to propose first. name: of the method.
        Raises:
            InputError: Optuna is not installed; or the method is "gp" and torch is not installed.
        """
        self.name = name
        batch = POPULATION if name == "nsga2" else BATCH  # a batch of nsga2 is a generation
        super().__init__(archive, seed, budget, evaluations, starts, batch)
        library = optuna()
        # Optuna and cmaes give their seed to NumPy's ``RandomState``, which takes at most 32 bits.
        sampler_seed = int(chance(seed, name).integers(2**31))
        with ignore_warnings():
            sampler = self._sampler(library, sampler_seed)
            self.study = library.create_study(
                directions=["minimize"] * len(archive.objectives), sampler=sampler
            )
        self.trials: list[Any] = []
        """Optuna's trials of the batch that was proposed last."""

    def propose(self, count: int) -> list[Point]:
        """Return ``count`` points: first the starts that have not been proposed yet, then points of the sampler."""
        with ignore_warnings():
            for start in self.next_starts(count):
                self.study.enqueue_trial(self._parameters(start))
            self.trials = [self.study.ask() for _ in range(count)]  # Optuna returns the enqueued starts first
            return [
                np.array([self._coordinate(trial, dimension) for dimension in self.archive.space])
                for trial in self.trials
            ]

    def learn(self, keys: Sequence[int]) -> None:
        """Pass the scores of the candidates ``keys`` to the sampler.

        These are the candidates of the last batch, in the order in which they were proposed. A candidate with an
        infinite score, since a run failed, is passed as a failed trial.
        """
        state = optuna().trial.TrialState
        with ignore_warnings():
            for trial, key in zip(self.trials, keys, strict=True):
                scores = self.archive.scores(key)
                if all(math.isfinite(score) for score in scores):
                    self.study.tell(trial, scores)
                else:
                    self.study.tell(trial, state=state.FAIL)

    def finalists(self, count: int) -> list[int]:
        """Return the keys of up to ``count`` candidates: the best ones or, with several objectives, the Pareto front.

        The front is sorted by the score of the first objective.
        """
        if len(self.archive.objectives) == 1:
            return super().finalists(count)
        return front(self.archive, self.keys)[:count]

    def _sampler(self, library: Any, sampler_seed: int) -> Any:
        """Create Optuna's sampler of the method ``self.name`` ("tpe", "gp" or "nsga2").

        Args:
            library: the module ``optuna``. sampler_seed: the seed of the sampler.
        """
        samplers = library.samplers
        if self.name == "tpe":
            # ``constant_liar`` keeps the points of a batch apart: they are proposed before any of them has a score, and
            # could otherwise be nearly the same.
            return samplers.TPESampler(
                seed=sampler_seed, multivariate=True, constant_liar=True, n_startup_trials=STARTUP_TRIALS
            )
        if self.name == "nsga2":
            return samplers.NSGAIISampler(seed=sampler_seed, population_size=self.batch)
        try:
            import torch  # noqa: F401
        except ImportError:
            raise InputError("gp needs torch: pip install 'vibroswarm[gp]'", field="search.method") from None
        # scores are noisy, so that the model must not pass through them exactly
        return samplers.GPSampler(
            seed=sampler_seed, deterministic_objective=False, n_startup_trials=STARTUP_TRIALS
        )

    def _coordinate(self, trial: Any, dimension: Dimension) -> float:
        """Return the coordinate in [0, 1] that the sampler suggests for a field.

        With n choices, the interval [0, 1] is divided into n equal parts. The coordinate of a choice is the middle of
        its part.
        """
        if dimension.choices:
            count = len(dimension.choices)
            index = int(trial.suggest_categorical(dimension.name, list(range(count))))
            return (index + 0.5) / count
        return float(trial.suggest_float(dimension.name, 0.0, 1.0))

    def _parameters(self, point: Point) -> dict[str, Any]:
        """Convert a point to the sampler's parameters by field: the index of a choice, else the coordinate."""
        return {  # u = 1 belongs to the last choice
            d.name: min(int(u * len(d.choices)), len(d.choices) - 1) if d.choices else float(u)
            for d, u in zip(self.archive.space, point, strict=True)
        }


class Cmaes(BatchSampler):
    """Covariance matrix adaptation in the unit cube, starting at its centre or at the first start."""

    name = "cmaes"

    def __init__(
        self, archive: Archive, seed: int, budget: int, evaluations: int, starts: Sequence[Point]
    ) -> None:
        """Create the optimizer of the library cmaes; each batch is one of its generations.

        Args:
            archive: gets the candidates. seed: of the search. budget: runs in all. evaluations: runs of each candidate.
            starts: points to propose first; the first of them is also the mean of the first generation.
        Raises:
            InputError: cmaes is not installed, or the space has one field only.
        """
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
            # The mean is kept away from the bounds: at a bound, half of the first generation would lie outside.
            mean=np.full(size, 0.5) if not starts else np.clip(starts[0], 0.05, 0.95),
            sigma=0.3,  # wide: the first generation reaches most of the unit cube
            bounds=np.column_stack([np.zeros(size), np.ones(size)]),
            seed=int(chance(seed, "cmaes").integers(2**31)),  # NumPy's ``RandomState`` takes at most 32 bits
        )
        super().__init__(archive, seed, budget, evaluations, starts, self.optimizer.population_size)
        self.proposed: list[Point] = []
        """Points of the generation that was proposed last."""

    def propose(self, count: int) -> list[Point]:
        """Return a generation of ``count`` points: the starts that have not been proposed yet, then the optimizer's."""
        # The optimizer always proposes ``count`` points, however many starts there are, so that the number of starts
        # does not change its random numbers. Points for which no place is left are dropped.
        points = [self.optimizer.ask() for _ in range(count)]
        self.proposed = [*self.next_starts(count), *points][:count]
        return self.proposed

    def learn(self, keys: Sequence[int]) -> None:
        """Pass the scores of the generation ``keys`` to the optimizer.

        The last generation may be incomplete, if the budget ends. It is not passed, since the optimizer takes only
        complete generations.
        """
        if len(keys) < self.optimizer.population_size:
            return
        scores = [self.archive.score(key) for key in keys]
        # The default can be any number: if no score is finite, all losses are equal.
        worst = max((s for s in scores if math.isfinite(s)), default=1.0)
        # The optimizer needs finite numbers. An infinite score (a run failed) becomes one that is above all others.
        losses = [s if math.isfinite(s) else worst + abs(worst) + 1.0 for s in scores]
        self.optimizer.tell(list(zip(self.proposed, losses, strict=True)))


def front(archive: Archive, keys: Sequence[int]) -> list[int]:
    """Return which of the candidates ``keys`` are on the Pareto front, sorted by the score of the first objective.

    Candidates with an infinite score are left out. If no candidate remains, the front is empty.
    """
    scores = {key: archive.scores(key) for key in keys}
    finite = [key for key in keys if np.isfinite(scores[key]).all()]
    if not finite:
        return []
    on_front = pareto_front(*zip(*(scores[key] for key in finite), strict=True))
    return sorted(itertools.compress(finite, on_front), key=lambda k: (scores[k], k))
