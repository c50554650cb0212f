"""The last stage of a search: those that may be the best run again, on fresh runs that no choice was made by.

A candidate that looked good on the runs by which it was chosen was partly lucky. So each finalist begins anew, gets a
first share of the runs, and more goes where it tells most about which is best (see ``allocation``). The last share is
the winner's alone: no choice follows it.
"""

from __future__ import annotations

import math
from typing import Final

from vibroswarm.optimize.allocation import ask_for
from vibroswarm.optimize.archive import Archive
from vibroswarm.optimize.method import Ask, Iteration

FIRST_SHARE: Final = 0.3
"""Of the runs, given to all alike."""
LAST_SHARE: Final = 0.3
"""Of the runs, given to the winner."""
ROUNDS: Final = 5
"""Of what lies between."""


class Race:
    """Finalists of a search against each other."""

    name = "race"

    def __init__(self, archive: Archive, finalists: list[int], runs: int) -> None:
        self.archive, self.runs = archive, runs
        self.iterations, self.iteration = ROUNDS + 2, 0
        self.history: list[Iteration] = []
        self.came_from = {
            archive.new(archive[key].point, f"finalist {key}") if archive[key].count else key: key
            for key in finalists
        }
        self.keys = list(self.came_from)
        self.winner: int | None = None

    def ask(self) -> list[Ask]:
        """All alike first, then in rounds, then the winner."""
        if self.iteration == self.iterations:
            return []
        alone = len(self.keys) == 1
        last = self.runs if alone else int(LAST_SHARE * self.runs)
        first = 0 if alone else max(int(FIRST_SHARE * self.runs) // len(self.keys), 1)
        between = max(self.runs - first * len(self.keys) - last, 0)
        if self.iteration == 0 and not alone:
            return [Ask(key, first) for key in self.keys]
        if 0 < self.iteration <= ROUNDS and not alone:
            each = between // ROUNDS
            asks = ask_for(
                self.archive, self.keys, each if self.iteration < ROUNDS else between - each * (ROUNDS - 1)
            )
            if asks:
                return asks
        self.winner = self.archive.best(self.keys) if not alone else self.keys[0]
        self.iteration = self.iterations - 1
        left = self.runs - sum(self.archive[key].count for key in self.keys)
        return [Ask(self.winner, left)] if left > 0 else []

    def tell(self) -> None:
        """A round is done."""
        self.iteration += 1
        best = self.best()
        scores = [self.archive.estimate(key)[0] for key in self.keys]
        there = [s for s in scores if math.isfinite(s)]
        self.history.append(
            Iteration(
                number=self.iteration,
                runs=self.archive.runs,
                best_key=best,
                best=self.archive.estimate(best)[0],
                mean=sum(there) / len(there) if there else math.inf,
                mean_point=tuple(float(u) for u in self.archive[best].point),
            )
        )

    def best(self) -> int:
        """The winner so far."""
        return self.archive.best(self.keys) if self.winner is None else self.winner

    def finalists(self, count: int) -> list[int]:
        """The best, in order."""
        return sorted(self.keys, key=lambda k: (self.archive.estimate(k)[0], k))[:count]
