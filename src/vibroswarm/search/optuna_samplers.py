"""Put Optuna's samplers behind the protocol of ``methods``.

| method | needs | what |
|---|---|---|
| tpe | optuna | tree of Parzen estimators, multivariate (Bergstra et al. 2011) |
| gp | optuna, torch | Gaussian process with expected improvement |
| nsga2 | optuna | non-dominated sorting genetic algorithm for several objectives (Deb et al. 2002) |
| cmaes | optuna, cmaes | covariance matrix adaptation (Hansen 2016), bounded |

Samplers are kept in memory only, and are rebuilt from the steps when a search is resumed.
"""

from __future__ import annotations

import math
import warnings
from abc import abstractmethod
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Final

import numpy as np

from vibroswarm.core.optional_library import needed
from vibroswarm.errors import InputError
from vibroswarm.search.archive import Archive
from vibroswarm.search.methods import BATCH, Method, Sampler, chance, register
from vibroswarm.search.space import Dimension, Point

STARTUP_TRIALS: Final = 25
"""Random candidates before tpe and gp use their model."""


@contextmanager
def quiet(optuna: Any) -> Iterator[None]:
    """Suppress Optuna's log messages, and warnings such as those about experimental features."""
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


class OptunaSampler(Sampler):
    """A search with one of Optuna's samplers.

    Optuna does not get the values of the fields: for a range it gets the coordinate in the unit cube, for a list the
    index of the choice.
    """

    orders_choices = False
    """Whether the sampler gets the coordinate of a choice too, since it knows ranges only."""

    def __init__(
        self, archive: Archive, seed: int, budget: int, evaluations: int, starts: Sequence[Point] = ()
    ) -> None:
        """Create the sampler; the arguments are those of ``Sampler``.

        Raises:
            InputError: a library is not installed, or the method cannot search over these fields.
        """
        super().__init__(archive, seed, budget, evaluations, batch=self.population(archive.space.size))
        self.optuna = needed("optuna", "optimize", "search.method")
        # Optuna gives the seed to NumPy's ``RandomState``, which takes at most 32 bits.
        sampler_seed = int(chance(seed, self.name).integers(2**31))
        with quiet(self.optuna):
            sampler = self.sampler(self.optuna.samplers, sampler_seed, starts)
            directions = ["minimize"] * len(archive.objectives)
            self.study = self.optuna.create_study(directions=directions, sampler=sampler)
            for start in starts:  # Optuna proposes them first
                self.study.enqueue_trial(self.parameters(start))
        self.trials: list[Any] = []
        """Optuna's trials of the batch that was proposed last."""

    def population(self, dimensions: int) -> int:
        """Return the number of points in a batch."""
        return BATCH

    @abstractmethod
    def sampler(self, samplers: Any, seed: int, starts: Sequence[Point]) -> Any:
        """Return Optuna's sampler; ``samplers`` is the module ``optuna.samplers``."""

    def propose(self, count: int) -> Sequence[Point]:
        """Return the next ``count`` points of the sampler."""
        with quiet(self.optuna):
            self.trials = [self.study.ask() for _ in range(count)]
            return [np.array([self._coordinate(t, d) for d in self.archive.space]) for t in self.trials]

    def learn(self, keys: Sequence[int]) -> None:
        """Pass the scores of a batch to the sampler; a candidate of which a run failed is a failed trial."""
        failed = self.optuna.trial.TrialState.FAIL
        with quiet(self.optuna):
            for trial, key in zip(self.trials, keys, strict=True):
                scores = self.archive.scores(key)
                is_good = all(map(math.isfinite, scores))
                self.study.tell(trial, scores if is_good else None, None if is_good else failed)

    def parameters(self, point: Point) -> dict[str, Any]:
        """Convert a point to the sampler's parameters by field: the index of a choice, else the coordinate."""
        return {
            d.name: float(u) if self._is_range(d) else d.choice_at(float(u))
            for d, u in zip(self.archive.space, point, strict=True)
        }

    def _coordinate(self, trial: Any, dimension: Dimension) -> float:
        """Return the coordinate in [0, 1] that a trial suggests for a field; for a choice the middle of its part."""
        if self._is_range(dimension):
            return float(trial.suggest_float(dimension.name, 0.0, 1.0))
        count = len(dimension.choices)
        return (int(trial.suggest_categorical(dimension.name, list(range(count)))) + 0.5) / count

    def _is_range(self, dimension: Dimension) -> bool:
        return self.orders_choices or not dimension.choices


class Tpe(OptunaSampler):
    """Tree of Parzen estimators."""

    name = "tpe"

    def sampler(self, samplers: Any, seed: int, starts: Sequence[Point]) -> Any:
        """Return the sampler; ``constant_liar`` keeps the points of a batch apart, which have no scores yet."""
        return samplers.TPESampler(
            seed=seed, multivariate=True, constant_liar=True, n_startup_trials=STARTUP_TRIALS
        )


class Gp(OptunaSampler):
    """Gaussian process."""

    name = "gp"

    def sampler(self, samplers: Any, seed: int, starts: Sequence[Point]) -> Any:
        """Return the sampler; scores are noisy, so that the model must not pass through them exactly."""
        needed("torch", "gp", "search.method")
        return samplers.GPSampler(seed=seed, deterministic_objective=False, n_startup_trials=STARTUP_TRIALS)


class Nsga2(OptunaSampler):
    """Genetic algorithm for several objectives."""

    name = "nsga2"

    def population(self, dimensions: int) -> int:
        """Return the size of a generation."""
        return 24

    def sampler(self, samplers: Any, seed: int, starts: Sequence[Point]) -> Any:
        """Return the sampler."""
        return samplers.NSGAIISampler(seed=seed, population_size=self.batch)


class Cmaes(OptunaSampler):
    """Covariance matrix adaptation in the unit cube, around its centre or the first start; choices count as ordered.

    Optuna draws the first generation uniformly, since it does not know the space yet, and does not learn from it.
    """

    name, orders_choices = "cmaes", True

    def population(self, dimensions: int) -> int:
        """Return the size of a generation (Hansen 2016, Eq. 48)."""
        return 4 + int(3 * math.log(dimensions))

    def sampler(self, samplers: Any, seed: int, starts: Sequence[Point]) -> Any:
        """Return the sampler, wide enough to reach most of the cube.

        Raises:
            InputError: cmaes is not installed, or the space has one field only.
        """
        needed("cmaes", "optimize", "search.method")
        size = self.archive.space.size
        if size < 2:
            raise InputError("needs at least two fields", field="search.method")
        # The mean is kept away from the bounds: at a bound, half of the points would lie outside.
        mean = np.clip(starts[0], 0.05, 0.95) if starts else np.full(size, 0.5)
        return samplers.CmaEsSampler(
            self.parameters(mean), 0.3, n_startup_trials=0, seed=seed, popsize=self.batch
        )


TPE = register(Method("tpe", Tpe.begin))
GP = register(Method("gp", Gp.begin))
NSGA2 = register(Method("nsga2", Nsga2.begin, several=True))
CMAES = register(Method("cmaes", Cmaes.begin))
