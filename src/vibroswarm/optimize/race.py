"""Allocate runs by optimal computing budget allocation (OCBA): where they best discriminate between candidates.

| name | symbol | equation |
|---|---|---|
| best | b | the smallest estimate |
| distance | d_i | estimate_i - estimate_b |
| noise | s_i | standard error times sqrt(runs): the noise of one run |
| runs | N_i, N_b | N_i proportional to (s_i / d_i)^2; N_b = s_b sqrt(sum over i of (N_i / s_i)^2) |

Chen, Lin, Yuecesan and Chick, "Simulation budget allocation for further enhancing the efficiency of ordinal
optimization", Discrete Event Dynamic Systems 10 (2000).

The last stage of a search is a race: finalists run again on fresh runs, which played no part in choosing them.

A candidate that looked good on the runs by which it was chosen was partly lucky. So each finalist starts without runs
and gets an equal first share; OCBA allocates further runs. The last share goes to the winner alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.optimize.archive import Archive
from vibroswarm.optimize.methods import Ask, Iteration


def allocate(
    estimates: Sequence[float], errors: Sequence[float], counts: Sequence[int], more: int
) -> NDArray[np.int64]:
    """Divide ``more`` runs among candidates, shape as the inputs.

    Args:
        estimates, errors: score and its standard error; candidates without finite values get none.
        counts: runs so far.
    """
    value, n = np.asarray(estimates, dtype=np.float64), np.asarray(counts, dtype=np.float64)
    error = np.asarray(errors, dtype=np.float64)
    shares = np.zeros(value.size, dtype=np.int64)
    valid = np.flatnonzero(np.isfinite(value) & np.isfinite(error))
    if valid.size == 0 or more <= 0:
        return shares
    if valid.size == 1:
        shares[valid[0]] = more
        return shares
    value, n = value[valid], n[valid]
    noise = np.maximum(error[valid] * np.sqrt(n), 1e-12)
    best = int(np.argmin(value))
    # Differences below their own error are not resolved, so near-equal candidates share runs instead of one taking all.
    distance = np.maximum(value - value[best], 0.5 * noise / np.sqrt(n) + 1e-12)
    weight = (noise / distance) ** 2  # N_i, Chen et al. 2000
    others = np.arange(value.size) != best
    weight[best] = noise[best] * np.sqrt(float(((weight[others] / noise[others]) ** 2).sum()))  # N_b
    shares[valid] = _share_out(weight, n, more)
    return shares


def allocate_runs(archive: Archive, keys: Sequence[int], more: int) -> list[Ask]:
    """Request further runs of candidates as ``allocate`` divides them."""
    scores = [archive.estimate(key) for key in keys]
    shares = allocate(
        [e[0] for e in scores],
        [e[1] for e in scores],
        [archive.count(k) for k in keys],
        more,
    )
    return [Ask(key, int(count)) for key, count in zip(keys, shares, strict=True) if count]


def _share_out(weight: NDArray[np.float64], present: NDArray[np.float64], more: int) -> NDArray[np.int64]:
    """Divide ``more`` runs so that the totals approach the proportions of the weights."""
    active = np.ones(weight.size, dtype=np.bool_)
    while True:  # those above their share get none; the others share the rest
        total = present[active].sum() + more
        ideal = np.where(active, weight / weight[active].sum() * total - present, 0.0)
        if (ideal[active] >= 0).all():
            break
        active &= ideal >= 0
    counts = np.floor(ideal).astype(np.int64)
    left = more - int(counts.sum())
    rest = np.argsort(-(ideal - counts), kind="stable")[:left]
    counts[rest] += 1
    return counts


FIRST_SHARE: Final = 0.3
"""Share of the runs divided equally."""
LAST_SHARE: Final = 0.3
"""Share of the runs for the winner."""
ROUNDS: Final = 5
"""Rounds of allocation between the first and the last share."""


class Race:
    """The race of the finalists of a search."""

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
        """Request equal runs first, then rounds of allocation, then the winner's runs."""
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
            asks = allocate_runs(
                self.archive, self.keys, each if self.iteration < ROUNDS else between - each * (ROUNDS - 1)
            )
            if asks:
                return asks
        self.winner = self.archive.best(self.keys) if not alone else self.keys[0]
        self.iteration = self.iterations - 1
        left = self.runs - sum(self.archive[key].count for key in self.keys)
        return [Ask(self.winner, left)] if left > 0 else []

    def tell(self) -> None:
        """Record a finished round."""
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
                mean_point=tuple(float(u) for u in self.archive[best].point),
            )
        )

    def best(self) -> int:
        """Return the winner so far."""
        return self.archive.best(self.keys) if self.winner is None else self.winner

    def finalists(self, count: int) -> list[int]:
        """Return the best candidates in order."""
        return sorted(self.keys, key=lambda k: (self.archive.estimate(k)[0], k))[:count]
