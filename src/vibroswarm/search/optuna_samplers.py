"""Search with a sampler of Optuna, of the package or of one's own.

| method | needs | what |
|---|---|---|
| random | optuna | uniform |
| sobol | optuna | scrambled Sobol sequence |
| tpe | optuna | tree of Parzen estimators, multivariate (Bergstra et al. 2011) |
| gp | optuna, torch | Gaussian process with expected improvement |
| nsga2 | optuna | non-dominated sorting genetic algorithm for several objectives (Deb et al. 2002) |
| cmaes | optuna, cmaes | covariance matrix adaptation (Hansen 2016), choices count as ordered |
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from vibroswarm.core.optional_library import needed
from vibroswarm.search.methods import Archive, Ask, Iteration, Method, Stage, chance, iteration_of, register
from vibroswarm.search.space import Dimension

if TYPE_CHECKING:
    from vibroswarm.search.spec import Search

BATCH: Final = 10
"""Points in a batch: enough to keep workers busy, few enough to learn from each batch."""
STARTUP_TRIALS: Final = 25
"""Random candidates before tpe and gp use their model."""
Sampler = Callable[[Any, int], Any]
"""(module ``optuna.samplers``, seed) -> sampler."""


def optuna_method(
    name: str, sampler: Sampler, *, batch: int = BATCH, orders_choices: bool = False, several: bool = False
) -> Method:
    """Return a method that proposes points by a sampler of Optuna.

    Args:
        sampler: returns one, given the module ``optuna.samplers`` and a seed. batch: points that are proposed at once.
        orders_choices: whether the sampler knows ranges only. several: whether it takes several objectives.
    """

    def begin(archive: Archive, search: Search) -> Stage:
        return OptunaStage(name, archive, search, sampler, batch, orders_choices)

    return Method(name, begin, several)


class OptunaStage:
    """A search with a sampler, which sees the coordinate of a range and the index of a choice, not values."""

    def __init__(
        self, name: str, archive: Archive, search: Search, sampler: Sampler, batch: int, orders_choices: bool
    ) -> None:
        self.name, self.archive, self.evaluations = name, archive, search.settings.evaluations
        self.batch, self.orders_choices = batch, orders_choices
        self.left = max(search.search_budget // self.evaluations, 1)
        self.history: list[Iteration] = []
        self.current: dict[int, Any] = {}
        """Optuna's trials of the batch that was requested last, by key."""
        self.optuna = needed("optuna", "optimize", "search.method")
        self.optuna.logging.set_verbosity(self.optuna.logging.ERROR)
        with warnings.catch_warnings(action="ignore"):  # about what is experimental, or shall change
            made = sampler(self.optuna.samplers, int(chance(search.seed, name).integers(2**31)))
        directions = ["minimize"] * len(archive.objectives)
        self.study = self.optuna.create_study(directions=directions, sampler=made)
        for start in search.starts:
            coordinates = zip(archive.space, start.tolist(), strict=True)
            self.study.enqueue_trial(
                {d.name: u if self._is_range(d) else d.choice_at(u) for d, u in coordinates}
            )

    def ask(self) -> list[Ask]:
        """Propose the next batch; the list is empty once the budget is spent."""
        count, self.current = min(self.batch, self.left), {}
        for _ in range(count):
            trial = self.study.ask()
            point = np.array([self._coordinate(trial, d) for d in self.archive.space])
            self.current[self.archive.new(point, f"{self.name} {len(self.history) + 1}")] = trial
        self.left -= count
        return [Ask(key, self.evaluations) for key in self.current]

    def tell(self) -> None:
        """Pass the scores of the batch to the sampler; a candidate of which a run failed is a failed trial."""
        for key, trial in self.current.items():
            scores = self.archive.scores(key)
            if all(map(math.isfinite, scores)):
                self.study.tell(trial, scores)
            else:
                self.study.tell(trial, state=self.optuna.trial.TrialState.FAIL)
        best, points = self.best(), np.array([self.archive[key].point for key in self.current])
        believed, _ = self.archive.estimate(best)
        number = len(self.history) + 1
        self.history.append(iteration_of(self.archive, number, [*self.current], (best, believed), points))

    def best(self) -> int:
        """Return the key of the candidate whose score has the lowest upper bound (``Archive.cautious``)."""
        return self.archive.in_order(range(len(self.archive)))[0]

    def finalists(self, count: int) -> list[int]:
        """Return the keys of the best candidates; with several objectives, of those on the Pareto front."""
        ranked = self.archive.in_order if len(self.archive.objectives) == 1 else self.archive.front
        return ranked(range(len(self.archive)))[:count]

    def _coordinate(self, trial: Any, dimension: Dimension) -> float:
        if self._is_range(dimension):
            return float(trial.suggest_float(dimension.name, 0.0, 1.0))
        count = len(dimension.choices)
        return (int(trial.suggest_categorical(dimension.name, list(range(count)))) + 0.5) / count

    def _is_range(self, dimension: Dimension) -> bool:
        return self.orders_choices or not dimension.choices


def _gp(samplers: Any, seed: int) -> Any:
    needed("torch", "gp", "search.method")
    # Scores are noisy, so that the model must not pass through them exactly.
    return samplers.GPSampler(seed=seed, deterministic_objective=False, n_startup_trials=STARTUP_TRIALS)


def _tpe(samplers: Any, seed: int) -> Any:
    # ``constant_liar`` keeps the points of a batch apart, which have no scores yet.
    return samplers.TPESampler(
        seed=seed, multivariate=True, constant_liar=True, n_startup_trials=STARTUP_TRIALS
    )


def _cmaes(samplers: Any, seed: int) -> Any:
    return samplers.CmaEsSampler(sigma0=0.3, n_startup_trials=0, seed=seed)


def _nsga2(samplers: Any, seed: int) -> Any:
    return samplers.NSGAIISampler(seed=seed, population_size=24)


RANDOM = register(optuna_method("random", lambda samplers, seed: samplers.RandomSampler(seed)))
SOBOL = register(optuna_method("sobol", lambda samplers, seed: samplers.QMCSampler(scramble=True, seed=seed)))
TPE = register(optuna_method("tpe", _tpe))
GP = register(optuna_method("gp", _gp))
NSGA2 = register(optuna_method("nsga2", _nsga2, batch=24, several=True))
CMAES = register(optuna_method("cmaes", _cmaes, orders_choices=True))
