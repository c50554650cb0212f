"""Hold all candidates of a search with the figures of their runs; every method reads them here.

The figures of a run are the numbers from which the objectives compute a score (see ``costs``). They accumulate: a
candidate that is requested again gets further runs, never the same ones.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import accumulate, compress, pairwise

import numpy as np

from vibroswarm.search.objective import Objective, Rows
from vibroswarm.search.space import Point, Space, Values
from vibroswarm.statistics.best_group import pareto_front


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
    """Runs that failed; a candidate with a failed run cannot win, unless the archive ``drops_failed``."""
    why: str = ""
    """Why the first failed run failed."""
    count: int = 0
    """Runs requested, including failed ones."""
    iteration: int = 0
    """The iteration of a particle swarm that proposed it, from 0."""

    def all_rows(self) -> Rows:
        """Return the figures of all runs that did not fail, (runs, cases, columns)."""
        if len(self.rows) > 1:
            self.rows = [np.concatenate(self.rows)]
        return self.rows[0] if self.rows else np.empty((0, 1, 1))


class Archive:
    """Candidates by key (0, 1, ...), and their scores under the objectives.

    Args:
        drops_failed: whether a candidate with failed runs is scored by its other runs, as in the paper's program. By
            default its score is infinite, so that it cannot win.
    """

    def __init__(self, space: Space, objectives: Sequence[Objective], *, drops_failed: bool = False) -> None:
        self.space, self.objectives, self.drops_failed = space, tuple(objectives), drops_failed
        self.candidates: list[Candidate] = []
        """All candidates; the key of a candidate is its index."""
        bounds = [0, *accumulate(objective.width for objective in self.objectives)]
        self.columns = [slice(first, end) for first, end in pairwise(bounds)]
        """The columns of each objective in the figures, which stand side by side."""
        self.runs, self.failed = 0, 0
        """Runs requested so far, and those of them that failed."""
        self._scores: dict[tuple[int, int, int], float] = {}
        self._estimates: dict[tuple[int, int], tuple[float, float]] = {}

    def __getitem__(self, key: int) -> Candidate:
        return self.candidates[key]

    def __len__(self) -> int:
        return len(self.candidates)

    def new(self, point: Point, origin: str, iteration: int = 0) -> int:
        """Add a candidate at ``point``, clipped to the unit cube, and return its key."""
        point = np.clip(np.asarray(point, dtype=np.float64), 0.0, 1.0)
        key = len(self.candidates)
        self.candidates.append(Candidate(key, point, self.space.values(point), origin, iteration=iteration))
        return key

    def count(self, key: int) -> int:
        """Count the runs of a candidate that did not fail; ``Candidate.count`` includes failed runs."""
        return sum(rows.shape[0] for rows in self[key].rows)

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
        """Compute the score of a candidate under an objective; infinite where no run counts (``drops_failed``)."""
        if self._has_no_score(self[key]):
            return math.inf
        place = key, objective, self.count(key)
        if place not in self._scores:
            rows = self[key].all_rows()[:, :, self.columns[objective]]
            self._scores[place] = self.objectives[objective].score(rows)
        return self._scores[place]

    def _has_no_score(self, candidate: Candidate) -> bool:
        return not candidate.rows or (candidate.failed > 0 and not self.drops_failed)

    def scores(self, key: int) -> list[float]:
        """Compute the scores of a candidate under all objectives, in their order."""
        return [self.score(key, k) for k in range(len(self.objectives))]

    def estimate(self, key: int) -> tuple[float, float]:
        """Estimate the score under the first objective, corrected for small-sample bias, and its standard error."""
        if self._has_no_score(self[key]):
            return math.inf, math.inf
        place = key, self.count(key)
        if place not in self._estimates:
            rows = self[key].all_rows()[:, :, self.columns[0]]
            self._estimates[place] = self.objectives[0].estimate(rows)
        return self._estimates[place]

    def cautious(self, key: int, caution: float = 1.0) -> float:
        """Return the estimate plus ``caution`` standard errors; after a single run, which has none, the estimate."""
        estimate, error = self.estimate(key)
        return estimate + caution * error if math.isfinite(error) else estimate

    def in_order(self, keys: Sequence[int]) -> list[int]:
        """Sort candidates by the upper bound that ``cautious`` returns, the lowest first."""
        return sorted(keys, key=lambda k: (self.cautious(k), k))

    def front(self, keys: Sequence[int]) -> list[int]:
        """Return which candidates are on the Pareto front, by the score of the first objective."""
        scores = {key: self.scores(key) for key in keys}
        finite = [key for key in keys if np.isfinite(scores[key]).all()]
        if not finite:
            return []
        on_front = pareto_front(*zip(*(scores[key] for key in finite), strict=True))
        return sorted(compress(finite, on_front), key=lambda key: (scores[key], key))
