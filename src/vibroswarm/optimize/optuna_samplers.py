"""Wrap the methods of Optuna and cmaes in the protocol of ``methods``; copy a search for Optuna's dashboard.

| method | library | what |
|---|---|---|
| tpe | Optuna | tree of Parzen estimators, multivariate (Bergstra et al. 2011) |
| gp | Optuna, torch | Gaussian process with expected improvement |
| nsga2 | Optuna | non-dominated sorting genetic algorithm for several objectives (Deb et al. 2002) |
| cmaes | cmaes | covariance matrix adaptation (Hansen 2016), bounded |

Samplers are kept in memory only and rebuilt from the history when a search is resumed.

A search can be copied into Optuna's storage, for Optuna's dashboard:

    optuna-dashboard out/search/optuna.journal

The copy is a journal of JSON lines, safe on shared file systems. Only the keys of its candidates are read back, so a
damaged copy is set aside and written again. The lock of a killed process is taken over.
"""

from __future__ import annotations

import itertools
import math
import os
import time
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Final

import numpy as np

from vibroswarm.analysis.tradeoff import pareto_front
from vibroswarm.errors import InputError, RunError, warn_once
from vibroswarm.optimize.archive import Archive
from vibroswarm.optimize.methods import BATCH, BatchSampler, chance
from vibroswarm.optimize.space import Dimension, Point

FILE: Final = "optuna.journal"
DAMAGED: Final = "optuna.journal.damaged"
LOCK_S: Final = 5.0
"""A lock is held while a line is written; one that is older than this belongs to a killed process."""


class Lock:
    """The lock file of Optuna's journal, which is taken over if its process was killed.

    Optuna's own locks check the age of a link's target, so that they wait for ever on a dangling link.
    """

    def __init__(self, journal: Path) -> None:
        self.path = Path(f"{journal}.lock")

    def acquire(self) -> bool:
        """Wait for the lock and take it."""
        seen: int | None = None
        since_s = time.monotonic()
        while True:
            try:
                os.close(os.open(self.path, os.O_CREAT | os.O_EXCL | os.O_WRONLY))
                return True
            except FileExistsError:
                pass
            with suppress(FileNotFoundError):
                modified_ns = self.path.lstat().st_mtime_ns
                if modified_ns != seen:
                    seen, since_s = modified_ns, time.monotonic()
                elif time.monotonic() - since_s > LOCK_S:
                    self.path.unlink()
                    continue
            time.sleep(0.01)

    def release(self) -> None:
        """Release the lock."""
        self.path.unlink(missing_ok=True)


class Dashboard:
    """Optuna's journal in the folder of a search."""

    def __init__(self, folder: Path, archive: Archive, name: str) -> None:
        self.library, self.archive = optuna(), archive
        path = folder.absolute() / FILE
        try:
            _cut(path)
            self.study, self.shown = self._open(path, name)
        except OSError as error:
            raise RunError(f"could not write '{path}': {error.strerror or error}") from error
        except Exception as error:  # a library may raise anything for a damaged file
            path.replace(folder / DAMAGED)
            warn_once(
                f"{path} is damaged ({type(error).__name__}); it is renamed to {DAMAGED} and written again"
            )
            self.study, self.shown = self._open(path, name)
        self.distributions = {d.name: distribution_of(self.library, d) for d in archive.space}

    def _open(self, path: Path, name: str) -> tuple[Any, set[int]]:
        """Open Optuna's study in this file and list its candidates."""
        storages = self.library.storages
        with ignore_warnings():
            backend = storages.journal.JournalFileBackend(str(path), Lock(path))
            study = self.library.create_study(
                storage=storages.JournalStorage(backend),
                study_name=name or "vibroswarm",
                directions=["minimize"] * len(self.archive.objectives),
                load_if_exists=True,
            )
            return study, {int(t.user_attrs["key"]) for t in study.trials if "key" in t.user_attrs}

    def show(self) -> None:
        """Add the candidates with runs that the copy lacks; those without a finite score are failed trials."""
        for candidate in self.archive.candidates:
            if candidate.key in self.shown or not candidate.count:
                continue
            scores = self.archive.scores(candidate.key)
            complete = all(math.isfinite(score) for score in scores)
            state = self.library.trial.TrialState
            with ignore_warnings():
                trial = self.library.trial.create_trial(
                    params=dict(candidate.values),
                    distributions=self.distributions,
                    values=scores if complete else None,
                    state=state.COMPLETE if complete else state.FAIL,
                    user_attrs={
                        "key": candidate.key,
                        "origin": candidate.origin,
                        "runs": candidate.count,
                        "failed": candidate.failed,
                    },
                )
                self.study.add_trial(trial)
            self.shown.add(candidate.key)


def _cut(path: Path) -> None:
    """Drop an incomplete last line, whose writer was killed."""
    if not path.exists():
        return
    lock = Lock(path)
    lock.acquire()
    try:
        end = (data := path.read_bytes()).rfind(b"\n") + 1
        if end < len(data):
            os.truncate(path, end)
    finally:
        lock.release()


def distribution_of(library: Any, dimension: Dimension) -> Any:
    """Convert a field's bounds to an Optuna distribution."""
    distributions = library.distributions
    if dimension.choices:
        return distributions.CategoricalDistribution(dimension.choices)
    log = dimension.scale == "log"
    if dimension.whole:
        return distributions.IntDistribution(int(dimension.low), int(dimension.high), log=log)
    return distributions.FloatDistribution(dimension.low, dimension.high, log=log)


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
        """Create Optuna's sampler of this name."""
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
        points = [self.optimizer.ask() for _ in range(count)]
        self.asked = [*self.next_starts(count), *points][:count]
        return self.asked

    def learn(self, keys: Sequence[int]) -> None:
        """Learn from complete generations only; failed candidates rank below all others."""
        if len(keys) < self.optimizer.population_size:
            return
        scores = [self.archive.score(key) for key in keys]
        worst = max((s for s in scores if math.isfinite(s)), default=1.0)
        losses = [s if math.isfinite(s) else worst + abs(worst) + 1.0 for s in scores]
        self.optimizer.tell(list(zip(self.asked, losses, strict=True)))


def front(archive: Archive, keys: Sequence[int]) -> list[int]:
    """Return the candidates on the Pareto front, in the order of the first objective; empty if none has all scores."""
    scores = {key: archive.scores(key) for key in keys}
    finite = [key for key in keys if np.isfinite(scores[key]).all()]
    if not finite:
        return []
    on_front = pareto_front(*zip(*(scores[key] for key in finite), strict=True))
    return sorted(itertools.compress(finite, on_front), key=lambda k: (scores[k], k))
