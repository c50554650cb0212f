"""Allocate runs by optimal computing budget allocation (OCBA): where they best discriminate between candidates.

| name | symbol | equation |
|---|---|---|
| best | b | the smallest estimate |
| distance | d_i | estimate_i - estimate_b |
| noise | s_i | standard error times sqrt(runs): the noise of one run |
| runs | N_i, N_b | N_i proportional to (s_i / d_i)^2; N_b = s_b sqrt(sum over i of (N_i / s_i)^2) |

Chen, Lin, Yuecesan and Chick, "Simulation budget allocation for further enhancing the efficiency of ordinal
optimization", Discrete Event Dynamic Systems 10 (2000).

The last stage of a search is a race: the finalists, its best candidates, get fresh runs, which played no part in
choosing them. A candidate that looked good on the runs by which it was chosen was partly lucky, so each finalist starts
the race without runs. First all finalists get equally many runs, then OCBA allocates further runs in ``ROUNDS`` rounds.
The last share of the runs goes to the winner alone, so that its score is known precisely.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.search.archive import Archive
from vibroswarm.search.methods import Ask, Iteration


def allocate(
    estimates: Sequence[float], errors: Sequence[float], counts: Sequence[int], more: int
) -> NDArray[np.int64]:
    """Divide ``more`` runs among candidates by OCBA; return the number for each, (candidates,).

    Args:
        estimates, errors: score of each candidate, and its standard error. A candidate of which one of them is not
            finite gets no runs. If this is so for all candidates, no runs are allocated.
        counts: runs of each candidate so far. more: runs to divide; with 0 or fewer, none are allocated.
    """
    value, n = np.asarray(estimates, dtype=np.float64), np.asarray(counts, dtype=np.float64)
    error = np.asarray(errors, dtype=np.float64)
    shares = np.zeros(value.size, dtype=np.int64)
    valid = np.flatnonzero(np.isfinite(value) & np.isfinite(error))
    if valid.size == 0 or more <= 0:
        return shares
    if valid.size == 1:  # the formulas below compare the best candidate with others
        shares[valid[0]] = more
        return shares
    value, n = value[valid], n[valid]
    # Above 0, since it is a divisor. So is sqrt(n) below: a candidate with a finite error has two runs or more.
    noise = np.maximum(error[valid] * np.sqrt(n), 1e-12)
    best = int(np.argmin(value))
    # A distance of nearly 0 would give one candidate nearly all runs. Each distance is therefore at least half of the
    # candidate's standard error (below that it is not resolved anyway), so that nearly equal candidates share the runs.
    distance = np.maximum(value - value[best], 0.5 * noise / np.sqrt(n) + 1e-12)
    # N_i, Chen et al. 2000; that of the best candidate is replaced by N_b below
    weight = (noise / distance) ** 2
    others = np.arange(value.size) != best
    weight[best] = noise[best] * np.sqrt(float(((weight[others] / noise[others]) ** 2).sum()))  # N_b
    shares[valid] = _share_out(weight, n, more)
    return shares


def allocate_runs(archive: Archive, keys: Sequence[int], more: int) -> list[Ask]:
    """Divide ``more`` runs among the candidates ``keys`` by ``allocate``; return a request for each that gets runs."""
    scores = [archive.estimate(key) for key in keys]
    shares = allocate(
        estimates=[estimate for estimate, _ in scores],
        errors=[error for _, error in scores],
        counts=[archive.count(key) for key in keys],
        more=more,
    )
    return [Ask(key, int(count)) for key, count in zip(keys, shares, strict=True) if count]


def _share_out(weight: NDArray[np.float64], present: NDArray[np.float64], more: int) -> NDArray[np.int64]:
    """Divide ``more`` runs so that the totals of the candidates become proportional to their weights, if possible.

    Args:
        weight: of each candidate, above 0, (candidates,). present: runs of each candidate so far, (candidates,).
        more: runs to divide, at least one.
    Returns:
        The further runs of each candidate, (candidates,), which sum to ``more``.
    """
    # A candidate that has more runs than its share of the total gets none, and the runs are divided among the others.
    # This lowers the shares of the others, so that a further candidate may have too many: hence the loop.
    active = np.ones(weight.size, dtype=np.bool_)
    while True:
        total = present[active].sum() + more
        ideal = np.where(active, weight / weight[active].sum() * total - present, 0.0)
        if (ideal[active] >= 0).all():
            break
        active &= ideal >= 0
    counts = np.floor(ideal).astype(np.int64)
    left = more - int(counts.sum())
    rounded_up = np.argsort(-(ideal - counts), kind="stable")[:left]  # the largest fractions
    counts[rounded_up] += 1
    return counts


FIRST_SHARE: Final = 0.3
"""Share of the runs divided equally."""
LAST_SHARE: Final = 0.3
"""Share of the runs for the winner."""
ROUNDS: Final = 5
"""Rounds of allocation between the first and the last share."""


class Race:
    """The race of the finalists of a search; a ``methods.Method``."""

    name = "race"

    def __init__(self, archive: Archive, finalists: list[int], runs: int) -> None:
        """Prepare a race of ``runs`` runs, in all, among the candidates with the keys ``finalists``, at least one.

        For a finalist that already has runs, a new candidate at the same point, without runs, is added to the archive
        and takes part in its place.
        """
        self.archive, self.runs = archive, runs
        self.iterations, self.iteration = ROUNDS + 2, 0  # the first step, the rounds, and the last step
        self.history: list[Iteration] = []
        self.came_from = {
            archive.new(archive[key].point, f"finalist {key}") if archive[key].count else key: key
            for key in finalists
        }
        """For the key of each candidate of the race, the key of the finalist for which it stands."""
        self.keys = list(self.came_from)
        """Keys of the candidates of the race."""
        self.winner: int | None = None
        """Key of the winner; None until the winner's last share is requested."""

    def ask(self) -> list[Ask]:
        """Request the runs of the next step; the list is empty at the end of the race.

        The first step requests equally many runs of each finalist. Then ``ROUNDS`` rounds are allocated by OCBA. The
        last step requests all remaining runs of the winner; it follows early if OCBA allocates no runs to a round. A
        single finalist gets all runs at once.
        """
        if self.iteration == self.iterations:
            return []
        alone = len(self.keys) == 1
        if self.iteration <= ROUNDS and not alone:
            last = int(LAST_SHARE * self.runs)  # reserved for the winner
            # Runs of each finalist. The minimum of 1 could exceed a small budget, but not in a search: its races have
            # at least 20 runs per finalist, or a single finalist.
            first = max(int(FIRST_SHARE * self.runs) // len(self.keys), 1)
            if self.iteration == 0:
                return [Ask(key, first) for key in self.keys]
            of_rounds = max(self.runs - first * len(self.keys) - last, 0)  # runs of all rounds together
            per_round = of_rounds // ROUNDS
            last_round = of_rounds - per_round * (ROUNDS - 1)  # takes the remainder of the division
            asks = allocate_runs(
                self.archive, self.keys, per_round if self.iteration < ROUNDS else last_round
            )
            if asks:
                return asks
        # After the last round, or earlier if a round allocates no runs, the winner gets all that are left.
        self.winner = self.archive.best(self.keys) if not alone else self.keys[0]
        self.iteration = self.iterations - 1  # ``tell`` counts this last step, which ends the race
        left = self.runs - sum(self.archive[key].count for key in self.keys)
        return [Ask(self.winner, left)] if left > 0 else []

    def tell(self) -> None:
        """Count a finished step of the race, and add it to the history."""
        self.iteration += 1
        best = self.best()
        scores = [self.archive.estimate(key)[0] for key in self.keys]
        finite = [s for s in scores if math.isfinite(s)]
        self.history.append(
            Iteration(
                number=self.iteration,
                runs=self.archive.runs,
                best_key=best,
                best=self.archive.estimate(best)[0],
                mean=sum(finite) / len(finite) if finite else math.inf,
                # the mean of the finalists would say little; this is the point of the best one
                mean_point=tuple(float(u) for u in self.archive[best].point),
            )
        )

    def best(self) -> int:
        """Return the winner, or the best candidate so far."""
        return self.archive.best(self.keys) if self.winner is None else self.winner

    def finalists(self, count: int) -> list[int]:
        """Return the keys of up to ``count`` candidates of the race, the lowest estimate first.

        It completes the protocol ``methods.Method``; no program calls it, since a race is the last stage of a search.
        """
        return sorted(self.keys, key=lambda k: (self.archive.estimate(k)[0], k))[:count]
