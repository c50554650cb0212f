"""Estimate which fields matter: Sobol indices of the cost, corrected for the noise of runs.

| name | symbol | equation |
|---|---|---|
| first order | S_i | Var(E(Y given u_i)) / Var(Y): the effect of the field alone |
| total | S_Ti | 1 - Var(E(Y given all but u_i)) / Var(Y): with all its interactions |
| noise | - | mean over points of s^2 / R: the variance that remains in the mean of R replicates (runs) of a point |
| corrected | - | S_i V / (V - noise), (S_Ti V - noise) / (V - noise) |

Saltelli's design has (d + 2) N points with R independent runs each, averaged before the indices are computed. It
consists of N blocks of d + 2 points: a point A, for each field i the point A with coordinate i of B, and a point B,
where A and B are independent. The noise of a point's mean is independent of the noise of all other points: it adds to
Var(Y), adds nothing to the covariances in S_i, and adds to the squared differences in S_Ti. Y is the mean of the cost,
since a standard deviation of few runs would be noise. With several cases, Y is the mean over the cases as well.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.core.numbers import count
from vibroswarm.core.optional_library import needed
from vibroswarm.errors import InputError, RunError
from vibroswarm.inference.outcomes import Array
from vibroswarm.search.evaluate import derived_seed, evaluator_for
from vibroswarm.search.spec import Search
from vibroswarm.statistics.intervals import columns_of, generator
from vibroswarm.statistics.paired import drawn_interval

PIECE: Final = 10
"""Runs of each point of a design."""
DRAWS: Final = 1000
"""Resamples of the bootstrap."""
LEAST: Final = 8
"""Fewest blocks of a design: fewer are too few for the indices."""


@dataclass(frozen=True)
class Sensitivity:
    """The indices of all fields."""

    table: pl.DataFrame
    """A row for each field, the largest total first: name, total and first order with 95 % limits. All are nan if the
    noise hides all effects, or if the cost does not vary."""
    points: int
    """Points of the design."""
    replicates: int
    """Runs of each point."""
    noise_share: float
    """Share of the variance of the points' means that is noise of the runs; 0 with a single run per point."""


def sobol_indices(
    search: Search,
    budget: int = 20_000,
    *,
    progress: Callable[[int], None] = lambda done: None,
    **where: Any,
) -> Sensitivity:
    """Estimate Sobol indices of the mean cost over the space of a search.

    Args:
        budget: largest number of runs. progress: called with the number of finished runs.
        where: ``executor``, ``workers``, see ``run_search``.
    """
    # No two runs have the same number, so that the noise of all runs is independent.
    requests = [
        (search.space.values(point), range(k * PIECE, (k + 1) * PIECE))
        for k, point in enumerate(saltelli(len(search.space.names), budget // PIECE, search.study.seed))
    ]
    with evaluator_for(replace(search, objectives=search.objectives[:1]), **where) as evaluator:
        found = evaluator.figures("sensitivity", requests, progress)
    if failed := sum(one.failed for one in found):
        why = next(one.why for one in found if one.failed)
        raise RunError(f"{count(failed, 'run')} failed, and every point is needed: {why}")
    costs = np.array([one.rows.mean(axis=1)[:, 0] for one in found])
    return indices(search.space.names, costs, search.study.seed)


def saltelli(dimensions: int, points: int, seed: int) -> Array:
    """Draw Saltelli's design in the unit cube, (N (d + 2), d), for d = ``dimensions`` fields.

    N is the largest power of two for which the design has at most ``points`` points: a Sobol sequence is evenly spread
    only at powers of two.
    """
    sobol = needed("SALib.sample.sobol", "optimize", "optimize sensitivity")
    # N: the bit length of a number, less 1, is the exponent of the largest power of two up to that number. If there are
    # no points, N is 1, and refused below.
    base = 1 << max((points // (dimensions + 2)).bit_length() - 1, 0)
    if base < LEAST:
        raise InputError(
            f"{points} points are too few for {dimensions} fields; at least {LEAST * (dimensions + 2)}",
            field="budget",
        )
    problem = {  # description of the space, in the form that SALib requires
        "num_vars": dimensions,
        "names": [str(k) for k in range(dimensions)],
        "bounds": [[0, 1]] * dimensions,
    }
    design_seed = derived_seed(seed, "sensitivity design") % 2**31  # a seed of 31 bits
    return np.asarray(sobol.sample(problem, base, calc_second_order=False, seed=design_seed))


def indices(names: list[str], costs: Array, seed: int = 0) -> Sensitivity:
    """Compute the indices of all fields, with bootstrap limits, from the costs of the runs of a design.

    The bootstrap draws whole blocks of d + 2 points, since the estimators combine the points of a block. ``costs`` is
    (N (d + 2), replicates), with points in the order of ``saltelli``.
    """
    dimensions, replicates = len(names), costs.shape[1]
    mean = costs.mean(axis=1)
    # variance of each mean; with one run per point it is unknown, and no correction is made
    noise = costs.var(axis=1, ddof=1) / replicates if replicates > 1 else np.zeros(mean.size)
    mean_by_block = mean.reshape(-1, dimensions + 2)
    noise_by_block = noise.reshape(-1, dimensions + 2)
    estimate = _shares(mean_by_block, noise_by_block)  # (2, d): first-order and total indices
    random, blocks = generator(seed, "bootstrap of Sobol indices"), mean_by_block.shape[0]
    resamples = random.integers(0, blocks, (DRAWS, blocks))
    drawn = [_shares(mean_by_block[chosen], noise_by_block[chosen]) for chosen in resamples]
    values = np.array([estimate, *drawn])  # (1 + draws, 2, d); nan where the noise hides all effects
    rows = [
        {"field": name}
        | columns_of("total", drawn_interval(values[:, 1, k], blocks, "bootstrap"))
        | columns_of("first", drawn_interval(values[:, 0, k], blocks, "bootstrap"))
        for k, name in enumerate(names)
    ]
    pooled = np.concatenate([mean_by_block[:, 0], mean_by_block[:, -1]])  # of all points A and B
    return Sensitivity(
        table=pl.DataFrame(rows, infer_schema_length=None).sort("total", descending=True, nulls_last=True),
        points=mean.size,
        replicates=replicates,
        noise_share=float(noise.mean() / pooled.var()) if pooled.var() > 0 else 0.0,
    )


def _shares(mean: Array, noise: Array) -> Array:
    """Compute first-order and total indices, (2, d), with the estimators of Saltelli (2010).

    ``mean`` is (blocks, d + 2): A, A with coordinate i of B for each field i, B; ``noise`` its variances. If the noise
    is all of the variance, the indices are nan.
    """
    a, b = mean[:, 0], mean[:, -1]
    pooled = np.concatenate([a, b])
    centre, variance = pooled.mean(), pooled.var() - float(noise.mean())
    if variance <= 0:
        return np.full((2, mean.shape[1] - 2), np.nan)
    a_with_b = mean[:, 1:-1]
    # Var(E(Y given u_i)). To subtract the centre leaves its expectation as it is, since a and a_with_b have the same
    # mean, but lowers the variance of the estimate.
    first = ((b - centre)[:, None] * (a_with_b - a[:, None])).mean(axis=0)
    # On average, a squared difference of two means is too large by the noise of both.
    total = 0.5 * ((a[:, None] - a_with_b) ** 2 - noise[:, :1] - noise[:, 1:-1]).mean(axis=0)
    return np.asarray(np.vstack([first, total]) / variance)
