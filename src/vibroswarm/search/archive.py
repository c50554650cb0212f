"""Store all candidates of a search with the figures of their runs; every method reads them here.

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
from vibroswarm.statistics.fronts import pareto_front


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
    """Why the first failed runs failed; empty if no run failed."""
    count: int = 0
    """Runs requested, including failed ones."""
    iteration: int = 0
    """The iteration of a particle swarm that proposed it, from 0."""

    def all_rows(self) -> Rows:
        """Return the figures of all runs that did not fail, (runs, cases, columns).

        Without such runs the array is empty, with shape (0, 1, 1).
        """
        # The joined array replaces its parts, so that the next call need not join them again.
        if len(self.rows) > 1:
            self.rows = [np.concatenate(self.rows)]
        return self.rows[0] if self.rows else np.empty((0, 1, 1))


class Archive:
    """Candidates by key (0, 1, ...), and their scores under the objectives."""

    def __init__(self, space: Space, objectives: Sequence[Objective], *, drops_failed: bool = False) -> None:
        """Make an archive without candidates.

        Args:
            space: the space in whose unit cube the points of the candidates lie. objectives: score the candidates.
            drops_failed: whether a candidate with failed runs is scored by its other runs, as in the paper's program.
                By default its score is infinite, so that it cannot win.
        """
        self.space, self.objectives = space, tuple(objectives)
        self.drops_failed = drops_failed
        """Whether failed runs are left out of a candidate's score, as in the paper's program."""
        self.candidates: list[Candidate] = []
        """All candidates; the key of a candidate is its index."""
        bounds = [0, *accumulate(objective.width for objective in self.objectives)]
        self.columns = [slice(first, end) for first, end in pairwise(bounds)]
        """The columns of each objective in the figures, which stand side by side."""
        self.runs = 0
        """Runs requested so far."""
        self.failed = 0
        """Runs that failed."""
        # Caches of ``score`` by candidate, objective and number of runs, and of ``estimate`` by the first and the last.
        self._scores: dict[tuple[int, int, int], float] = {}
        self._estimates: dict[tuple[int, int], tuple[float, float]] = {}

    def __getitem__(self, key: int) -> Candidate:
        return self.candidates[key]

    def __len__(self) -> int:
        return len(self.candidates)

    def new(self, point: Point, origin: str, iteration: int = 0) -> int:
        """Add a candidate at ``point``, clipped to the unit cube, and return its key.

        Args:
            point: in the unit cube of the space. origin: names the step that proposed it, such as "pso 3".
            iteration: the iteration of a particle swarm that proposed it, from 0; other methods leave it at 0.
        """
        point = np.clip(np.asarray(point, dtype=np.float64), 0.0, 1.0)
        point.flags.writeable = False  # a method of a user's own is given it
        key = len(self.candidates)
        self.candidates.append(Candidate(key, point, self.space.values(point), origin, iteration=iteration))
        return key

    def count(self, key: int) -> int:
        """Count the runs of a candidate that did not fail; ``Candidate.count`` includes failed runs."""
        return sum(rows.shape[0] for rows in self[key].rows)

    def add_runs(self, key: int, rows: Rows | str, count: int) -> None:
        """Add ``count`` runs to the candidate ``key``.

        ``rows`` has the figures of these runs, (runs, cases, columns); or it is a text, the reason why all of them
        failed.
        """
        candidate = self[key]
        candidate.count += count
        self.runs += count
        if isinstance(rows, str):
            candidate.failed += count
            candidate.why = candidate.why or rows  # only the first reason is saved
            self.failed += count
            return
        candidate.rows.append(rows)

    def score(self, key: int, objective: int = 0) -> float:
        """Compute the score of the candidate ``key`` under one objective, given by its index ``objective``.

        The score is infinite if no run has succeeded, or if a run failed and the archive does not drop failed runs. It
        is computed again only if the candidate got further runs since the last call.
        """
        if self._has_no_score(self[key]):
            return math.inf
        place = key, objective, self.count(key)
        if place not in self._scores:
            rows = self[key].all_rows()[:, :, self.columns[objective]]
            self._scores[place] = self.objectives[objective].score(rows)
        return self._scores[place]

    def _has_no_score(self, candidate: Candidate) -> bool:
        """Return whether no run of a candidate has succeeded, or a run failed and failed runs are not dropped."""
        return not candidate.rows or (candidate.failed > 0 and not self.drops_failed)

    def scores(self, key: int) -> list[float]:
        """Compute the scores of a candidate under all objectives, in their order; see ``score``."""
        return [self.score(key, k) for k in range(len(self.objectives))]

    def estimate(self, key: int) -> tuple[float, float]:
        """Estimate the score of a candidate under the first objective, and the standard error of the estimate.

        The estimate is corrected for small-sample bias (see ``Objective.estimate``). Both numbers are infinite if no
        run has succeeded, or if a run failed and the archive does not drop failed runs; after a single run, only the
        standard error is infinite. They are computed again only if the candidate got further runs since the last call.
        """
        if self._has_no_score(self[key]):
            return math.inf, math.inf
        place = key, self.count(key)
        if place not in self._estimates:
            rows = self[key].all_rows()[:, :, self.columns[0]]
            self._estimates[place] = self.objectives[0].estimate(rows)
        return self._estimates[place]

    def cautious(self, key: int, caution: float = 1.0) -> float:
        """Return an approximate upper bound of the score: the estimate plus ``caution`` standard errors.

        After a single run the standard error is unknown, and the estimate alone is returned.
        """
        estimate, error = self.estimate(key)
        return estimate + caution * error if math.isfinite(error) else estimate

    def in_order(self, keys: Sequence[int] | None = None) -> list[int]:
        """Sort candidates (by default all) by the upper bound that ``cautious`` returns, the lowest first."""
        return sorted(range(len(self)) if keys is None else keys, key=lambda k: (self.cautious(k), k))

    def best(self, keys: Sequence[int] | None = None) -> int:
        """Return which of the candidates ``keys`` (by default all) has the lowest estimate, of equals the lowest key.

        There must be at least one candidate. A race uses this: its estimates come from runs that played no part in
        choosing the finalists, so it does not need the caution of ``in_order``.
        """
        among = range(len(self)) if keys is None else keys
        return min(among, key=lambda k: (self.estimate(k)[0], k))

    def front(self, keys: Sequence[int]) -> list[int]:
        """Return which of the candidates ``keys`` are on the Pareto front, sorted by the score of the first objective.

        Candidates with an infinite score are left out. If no candidate remains, the front is empty.
        """
        scores = {key: self.scores(key) for key in keys}
        finite = [key for key in keys if np.isfinite(scores[key]).all()]
        if not finite:
            return []
        on_front = pareto_front(*zip(*(scores[key] for key in finite), strict=True))
        return sorted(compress(finite, on_front), key=lambda key: (scores[key], key))
