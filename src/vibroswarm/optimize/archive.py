"""Store all candidates of a search with the figures of their runs; every method reads them here.

Figures accumulate: a candidate that is requested again gets further runs, never the same ones.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.optimize.objective import Objective, Rows
from vibroswarm.optimize.space import Point, Space, Values


@dataclass
class Candidate(NotebookView):
    """One point of the space with the figures of its runs."""

    key: int
    point: Point
    values: Values
    origin: str
    """The step that proposed it: "start", "pso 3", ..."""
    rows: list[Rows] = field(default_factory=list)
    failed: int = 0
    """Runs that failed; a candidate with a failed run cannot win, unless the archive ``drops_failed``."""
    why: str = ""
    count: int = 0
    """Runs requested, including failed ones."""
    iteration: int = 0
    """The iteration of a particle swarm that proposed it, from 0."""

    def all_rows(self) -> Rows:
        """Return the figures of all runs, (runs, cases, columns)."""
        if len(self.rows) > 1:
            self.rows = [np.concatenate(self.rows)]
        return self.rows[0] if self.rows else np.empty((0, 1, 1))


class Archive(NotebookView):
    """Candidates by key (0, 1, ...), and their scores under the objectives."""

    def __init__(self, space: Space, objectives: Sequence[Objective], *, drops_failed: bool = False) -> None:
        self.space, self.objectives = space, tuple(objectives)
        self.drops_failed = drops_failed
        """Whether failed runs are left out of a candidate's score, as in the paper's program."""
        self.candidates: list[Candidate] = []
        self.columns: list[slice] = []
        """The columns of each objective; set when the first rows are added."""
        self.runs = 0
        """Runs requested so far."""
        self.failed = 0
        """Runs that failed."""
        self._scores: dict[tuple[int, int], tuple[int, float]] = {}
        self._corrected: dict[int, tuple[int, float, float]] = {}

    def __getitem__(self, key: int) -> Candidate:
        return self.candidates[key]

    def __len__(self) -> int:
        return len(self.candidates)

    def new(self, point: Point, origin: str, iteration: int = 0) -> int:
        """Add a candidate and return its key."""
        point = np.clip(np.asarray(point, dtype=np.float64), 0.0, 1.0)
        key = len(self.candidates)
        self.candidates.append(Candidate(key, point, self.space.values(point), origin, iteration=iteration))
        return key

    def count(self, key: int) -> int:
        """Count the runs of a candidate that did not fail."""
        return sum(rows.shape[0] for rows in self[key].rows)

    def add_runs(self, key: int, rows: Rows | str, count: int) -> None:
        """Add the figures of ``count`` runs to a candidate, or the reason why they failed."""
        candidate = self[key]
        candidate.count += count
        self.runs += count
        if isinstance(rows, str):
            candidate.failed += count
            candidate.why = candidate.why or rows
            self.failed += count
            return
        candidate.rows.append(rows)

    def score(self, key: int, objective: int = 0) -> float:
        """Compute the score of a candidate; infinite without runs or if one failed."""
        candidate = self[key]
        if self._is_out(candidate):
            return math.inf
        count, known = self.count(key), self._scores.get((key, objective))
        if known is None or known[0] != count:
            rows = candidate.all_rows()[:, :, self.columns[objective]]
            known = (count, self.objectives[objective].score(rows))
            self._scores[key, objective] = known
        return known[1]

    def _is_out(self, candidate: Candidate) -> bool:
        """Tell whether a candidate has no score: it has no runs, or one failed that is not dropped."""
        return not candidate.rows or (candidate.failed > 0 and not self.drops_failed)

    def scores(self, key: int) -> list[float]:
        """Compute the score under each objective."""
        return [self.score(key, k) for k in range(len(self.objectives))]

    def estimate(self, key: int) -> tuple[float, float]:
        """Estimate the score under the first objective, corrected for its small-sample bias, and its standard error.

        Both are infinite without runs, or if a run failed that is not dropped.
        """
        candidate, count = self[key], self.count(key)
        if self._is_out(candidate):
            return math.inf, math.inf
        known = self._corrected.get(key)
        if known is None or known[0] != count:
            rows = candidate.all_rows()[:, :, self.columns[0]]
            known = (count, *self.objectives[0].estimate(rows))
            self._corrected[key] = known
        return known[1], known[2]

    def cautious(self, key: int, caution: float = 1.0) -> float:
        """Return an upper bound of the score: the estimate plus ``caution`` standard errors."""
        estimate, error = self.estimate(key)
        return estimate + caution * error if math.isfinite(error) else estimate

    def in_order(self, keys: Sequence[int] | None = None) -> list[int]:
        """Sort candidates by that upper bound, the best first."""
        return sorted(range(len(self)) if keys is None else keys, key=lambda k: (self.cautious(k), k))

    def best(self, keys: Sequence[int] | None = None) -> int:
        """Return the candidate with the smallest estimate, or the first of equals."""
        among = range(len(self)) if keys is None else keys
        return min(among, key=lambda k: (self.estimate(k)[0], k))
