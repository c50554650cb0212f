"""What a method of search is: it requests runs of candidates, and reads their scores in the archive; those of Optuna.

| method | needs | what |
|---|---|---|
| random | optuna | uniform |
| sobol | optuna | scrambled Sobol sequence |
| tpe | optuna | tree of Parzen estimators, multivariate (Bergstra et al. 2011) |
| gp | optuna, torch | Gaussian process with expected improvement |
| nsga2 | optuna | non-dominated sorting genetic algorithm for several objectives (Deb et al. 2002) |
| cmaes | optuna, cmaes | covariance matrix adaptation (Hansen 2016), choices count as ordered |

Random numbers of a method depend on the seed, their purpose and the iteration alone, so that it requests the same runs
after the same history: this is how a search is continued.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import accumulate, compress, pairwise
from typing import TYPE_CHECKING, Any, Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.optional_library import needed
from vibroswarm.core.registry import Registry
from vibroswarm.scenario import plugins
from vibroswarm.search.objective import Objective, Rows
from vibroswarm.search.space import Dimension, Point, Space, Values
from vibroswarm.statistics.best_group import pareto_front
from vibroswarm.statistics.intervals import generator

if TYPE_CHECKING:
    from vibroswarm.search.spec import Search

BATCH: Final = 10
"""Points in a batch: enough to keep workers busy, few enough to learn from each batch."""
BATCH_OF_FRONT: Final = 24
"""The same of nsga2, whose population it is."""
STARTUP_TRIALS: Final = 25
"""Random candidates before tpe and gp use their model."""
Sampler = Callable[[Any, int], Any]
"""(module ``optuna.samplers``, seed) -> sampler."""


@dataclass
class Candidate:
    """One point of the space with the figures of its runs."""

    key: int
    point: Point
    values: Values
    origin: str
    """The step that proposed it: "start", "pso 3", ..."""
    rows: list[Rows] = field(default_factory=list)
    """Figures of the runs that did not fail: arrays (runs, cases, columns), to be joined along the runs."""
    failed: int = 0
    why: str = ""
    """Why the first failed run failed."""
    count: int = 0
    """Runs requested, including failed ones."""
    iteration: int = 0
    """The iteration of a particle swarm that proposed it, from 0."""


class Archive:
    """Candidates by key (0, 1, ...) with the figures of their runs, and their scores under the objectives.

    A candidate with failed runs has an infinite score, so that it cannot win; if the archive ``drops_failed``, as the
    paper's program does, it is scored by its other runs.
    """

    def __init__(self, space: Space, objectives: Sequence[Objective], *, drops_failed: bool = False) -> None:
        self.space, self.objectives, self.drops_failed = space, tuple(objectives), drops_failed
        self.candidates: list[Candidate] = []
        bounds = [0, *accumulate(objective.width for objective in self.objectives)]
        self.columns = [slice(first, end) for first, end in pairwise(bounds)]
        """The columns of each objective in the figures, which stand side by side."""
        self.runs, self.failed = 0, 0
        """Runs requested so far, and those of them that failed."""
        self._computed: dict[Any, Any] = {}

    def __getitem__(self, key: int) -> Candidate:
        return self.candidates[key]

    def __len__(self) -> int:
        return len(self.candidates)

    def new(self, point: Point, origin: str, iteration: int = 0) -> int:
        """Add a candidate at ``point``, clipped to the unit cube, and return its key."""
        point = np.clip(point, 0.0, 1.0)
        key = len(self.candidates)
        self.candidates.append(Candidate(key, point, self.space.values(point), origin, iteration=iteration))
        return key

    def add(self, key: int, rows: Rows, failed: int = 0, why: str = "") -> None:
        """Add the figures of runs, (runs, cases, columns), and failed runs to a candidate."""
        candidate = self[key]
        candidate.count += rows.shape[0] + failed
        candidate.failed += failed
        self.runs, self.failed = self.runs + rows.shape[0] + failed, self.failed + failed
        candidate.why = candidate.why or why
        if rows.shape[0]:
            candidate.rows.append(rows)

    def score(self, key: int, objective: int = 0) -> float:
        """Compute the score of a candidate under an objective."""
        return float(self._of_rows(Objective.score, key, objective, math.inf))

    def scores(self, key: int) -> list[float]:
        """Compute the scores of a candidate under all objectives."""
        return [self.score(key, k) for k in range(len(self.objectives))]

    def estimate(self, key: int) -> tuple[float, float]:
        """Estimate the score under the first objective, corrected for small-sample bias, and its standard error."""
        score, error = self._of_rows(Objective.estimate, key, 0, (math.inf, math.inf))
        return score, error

    def _of_rows(
        self, compute: Callable[[Objective, Rows], Any], key: int, objective: int, without: Any
    ) -> Any:
        candidate = self[key]
        if not candidate.rows or (candidate.failed and not self.drops_failed):
            return without
        place = compute, key, objective, len(candidate.rows)
        if place not in self._computed:
            rows = np.concatenate(candidate.rows)[:, :, self.columns[objective]]
            self._computed[place] = compute(self.objectives[objective], rows)
        return self._computed[place]

    def cautious(self, key: int, caution: float = 1.0) -> float:
        """Return the estimate plus ``caution`` standard errors; after a single run, which has none, the estimate."""
        estimate, error = self.estimate(key)
        return estimate + caution * error if math.isfinite(error) else estimate

    def in_order(self, keys: Iterable[int]) -> list[int]:
        """Sort candidates by the upper bound that ``cautious`` returns, the lowest first."""
        return sorted(keys, key=lambda k: (self.cautious(k), k))

    def front(self) -> list[int]:
        """Return which candidates are on the Pareto front, by the score of the first objective."""
        scores = {key: found for key in range(len(self)) if np.isfinite(found := self.scores(key)).all()}
        if not scores:
            return []
        on_front = pareto_front(*zip(*scores.values(), strict=True))
        return sorted(compress(scores, on_front), key=lambda key: (scores[key], key))


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
    """Return the record of an iteration from its candidates, and from key and score of the best so far."""
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
        """Return the keys of good candidates, the best first."""


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
    """Return the method of that name, or of a file that is loaded."""
    return plugins.found("method", name)  # type: ignore[no-any-return]


def chance(seed: int, purpose: str) -> np.random.Generator:
    """Create the random generator for one purpose, such as "pso 17"."""
    return generator(seed, f"optimizer: {purpose}")


def optuna_method(
    name: str, sampler: Sampler, *, batch: int = BATCH, orders_choices: bool = False, several: bool = False
) -> Method:
    """Return a method that proposes points by a sampler of Optuna.

    Args:
        sampler: returns one, given the module ``optuna.samplers`` and a seed. batch: points that are proposed at once.
        orders_choices: whether the sampler knows ranges only. several: whether it takes several objectives.
    """

    return Method(name, partial(OptunaStage, name, sampler, batch, orders_choices), several)


class OptunaStage:
    """A search with a sampler, which sees the coordinate of a range and the index of a choice, not values."""

    def __init__(
        self, name: str, sampler: Sampler, batch: int, orders_choices: bool, archive: Archive, search: Search
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
            made = sampler(self.optuna.samplers, int(chance(search.study.seed, name).integers(2**31)))
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
        """Return the key of the first ``in_order``."""
        return self.finalists(1)[0]

    def finalists(self, count: int) -> list[int]:
        """Return the keys of the best candidates."""
        return self.archive.in_order(range(len(self.archive)))[:count]

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


RANDOM = register(optuna_method("random", lambda samplers, seed: samplers.RandomSampler(seed)))
SOBOL = register(optuna_method("sobol", lambda samplers, seed: samplers.QMCSampler(scramble=True, seed=seed)))
TPE = register(optuna_method("tpe", _tpe))
GP = register(optuna_method("gp", _gp))
NSGA2 = register(
    optuna_method(
        "nsga2",
        lambda samplers, seed: samplers.NSGAIISampler(seed=seed, population_size=BATCH_OF_FRONT),
        batch=BATCH_OF_FRONT,
        several=True,
    )
)
CMAES = register(
    optuna_method(
        "cmaes",
        lambda samplers, seed: samplers.CmaEsSampler(sigma0=0.3, n_startup_trials=0, seed=seed),
        orders_choices=True,
    )
)
