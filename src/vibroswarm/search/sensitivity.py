"""Estimate which fields matter: Sobol indices of the cost, corrected for the noise of runs, and PED-ANOVA.

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

PED-ANOVA needs no further runs. Field by field it compares the distribution of the best candidates of a search with
that of all candidates (Watanabe, Bansal and Hutter, "PED-ANOVA", IJCAI 2023; through Optuna). It is robust to noise,
but describes only the region that the search explored; Sobol indices describe the whole space.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.core.atomic_io import write_files
from vibroswarm.core.numbers import count
from vibroswarm.core.optional_library import needed
from vibroswarm.core.tables import csv_bytes
from vibroswarm.errors import InputError, RunError, whole_number_of
from vibroswarm.inference.outcomes import Array
from vibroswarm.search.archive import Archive
from vibroswarm.search.evaluate import PIECE, RUN_LIMIT, Evaluator, derived_seed, do_asks
from vibroswarm.search.loop import Found
from vibroswarm.search.methods import Ask
from vibroswarm.search.optuna_samplers import quiet
from vibroswarm.search.space import Dimension
from vibroswarm.search.spec import Search
from vibroswarm.statistics.intervals import Interval, generator
from vibroswarm.statistics.paired import drawn_interval
from vibroswarm.study.run import pool_for

DRAWS: Final = 1000
"""Resamples of the bootstrap."""
LEAST: Final = 8
"""Fewest blocks of a design: fewer are too few for the indices."""


@dataclass(frozen=True)
class Field:
    """First-order and total index of one field, with 95 % limits.

    All are nan if the noise hides all effects, or if the cost does not vary; limits alone if it does so in more than
    5 % of the resamples.
    """

    name: str
    """Full name of the field."""
    first: float
    """First-order index S_i."""
    first_low: float
    """Lower limit of the first-order index."""
    first_high: float
    """Upper limit of the first-order index."""
    total: float
    """Total index S_Ti."""
    total_low: float
    """Lower limit of the total index."""
    total_high: float
    """Upper limit of the total index."""


@dataclass(frozen=True)
class Sensitivity:
    """The indices of all fields, the largest total first."""

    fields: tuple[Field, ...]
    points: int
    """Points of the design."""
    replicates: int
    """Runs of each point."""
    runs: int
    noise_share: float
    """Share of the variance of the points' means that is noise of the runs, both as estimated. If it is 1 or more, all
    indices are nan. It is 0 with a single run per point, where the noise is unknown, and if the cost does not vary."""


def sobol_indices(
    search: Search,
    budget: int = 20_000,
    *,
    replicates: int = PIECE,
    executor: str | Executor = "threads",
    workers: int | None = None,
    progress: Callable[[int], None] = lambda done: None,
) -> Sensitivity:
    """Estimate Sobol indices of the mean cost over the space of a search.

    Args:
        search: defines the space, the scenarios and the cost (the first column of its first objective).
        budget: largest number of runs; fewer are made, since the number of points is limited to certain values, see
            ``saltelli``.
        replicates: runs of each point of the design, at least 1. executor, workers: see ``study.run.pool_for``.
        progress: called as runs finish, with the number done so far.
    Raises:
        InputError: SALib is not installed, code is not loaded, the budget is too small, ``replicates`` is not a whole
            number from 1 on, or a cost gives no number for a run. RunError: a run failed, or the workers are gone.
    """
    replicates = whole_number_of(replicates, "replicates", 1, RUN_LIMIT - 1)
    archive = Archive(search.space, search.objectives[:1])
    scenarios = [cell.scenario for cell in search.cases]
    # No two runs have the same number, so that the noise of all runs is independent.
    evaluator = Evaluator(archive, scenarios, search.seed, motion=search.study.motion, purpose="sensitivity")
    design = design_of(search, budget, replicates)
    asks = [Ask(archive.new(point, "design"), replicates) for point in design]
    with pool_for(executor, workers) as pool:
        of_asks = [(ask, evaluator.pieces(ask)) for ask in asks]
        results = do_asks(of_asks, archive.objectives, pool, progress)
    bad = [(why, runs) for _, why, runs in results if isinstance(why, str)]
    if bad:
        runs = sum(of_piece for _, of_piece in bad)
        raise RunError(f"{count(runs, 'run')} failed, and every point is needed: {bad[0][0]}")
    # The first column of the figures of a piece, (runs, cases, columns), averaged over the cases, gives its costs.
    by_piece = [np.mean(rows, axis=1)[:, 0] for _, rows, _ in results if not isinstance(rows, str)]
    costs = np.concatenate(by_piece).reshape(len(asks), replicates)
    return indices(search.space.names, costs, search.seed)


def design_of(search: Search, budget: int, replicates: int = PIECE) -> Array:
    """Draw the design of an analysis, see ``saltelli``; ``budget`` and ``replicates`` as in ``sobol_indices``.

    Raises:
        InputError: as of ``saltelli``, or the budget is too small.
    """
    least = LEAST * (search.space.size + 2) * replicates
    if budget < least:
        fields = count(search.space.size, "field")
        raise InputError(f"{budget} runs are too few for {fields}; give at least {least}", field="budget")
    return saltelli(search.space.size, budget // replicates, search.seed)


def saltelli(dimensions: int, points: int, seed: int) -> Array:
    """Draw Saltelli's design in the unit cube, (N (d + 2), d), for d = ``dimensions`` fields.

    N is the largest power of two for which the design has at most ``points`` points: a Sobol sequence is evenly spread
    only at powers of two. ``seed`` is that of the search.

    Raises:
        InputError: SALib is not installed, or N would be below 8, which is too few for the indices.
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

    The bootstrap draws whole blocks of d + 2 points, since the estimators combine the points of a block. Limits are as
    much wider as few blocks need (``draw_limits``).

    Args:
        names: of the fields. costs: cost of each run, (N (d + 2), replicates), points in the order of ``saltelli``.
        seed: of the bootstrap.
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
    fields = [
        _field(name, *(drawn_interval(values[:, index, k], blocks, "bootstrap") for index in (0, 1)))
        for k, name in enumerate(names)
    ]
    pooled = np.concatenate([mean_by_block[:, 0], mean_by_block[:, -1]])  # of all points A and B
    return Sensitivity(
        fields=tuple(sorted(fields, key=lambda one: -one.total)),
        points=mean.size,
        replicates=replicates,
        runs=costs.size,
        noise_share=float(noise.mean() / pooled.var()) if pooled.var() > 0 else 0.0,
    )


def _field(name: str, first: Interval, total: Interval) -> Field:
    """Make the indices of one field."""
    return Field(name, *first[:3], *total[:3])


def _shares(mean: Array, noise: Array) -> Array:
    """Compute first-order and total indices, (2, d), with the estimators of Saltelli (2010).

    The variance of the noise is subtracted from the variance of the means. If nothing is left, all indices are nan.

    Args:
        mean: mean cost of each point, (blocks, d + 2): A, A with coordinate i of B for each field i, B.
        noise: the variance of each of these means, (blocks, d + 2).
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


def write_sensitivity(found: Sensitivity, folder: str | Path) -> None:
    """Write the indices of all fields as ``sensitivity.csv`` into ``folder``, one row per field.

    Raises:
        RunError: the file cannot be written.
    """
    table = pl.DataFrame([vars(index) for index in found.fields])
    write_files(Path(folder), {"sensitivity.csv": csv_bytes(table)})


MIN_CANDIDATES: Final = 20
"""Fewest candidates with a score for PED-ANOVA."""


def ped_anova(found: Found, best_share: float = 0.1) -> dict[str, float]:
    """Compute the importance of each field by PED-ANOVA, the largest first; the sum is 1.

    Only the scores under the first objective are used.

    Args:
        found: a finished search. best_share: share of the candidates that count as the best ones.
    Raises:
        InputError: Optuna is not installed, too few candidates have a score, or ``best_share`` is outside (0, 1).
    """
    if not 0 < best_share < 1:
        raise InputError(f"{best_share!r} is not a share; give one between 0 and 1", field="best_share")
    library, archive = needed("optuna", "optimize", "search.method"), found.archive
    distributions = {d.name: distribution_of(library, d) for d in archive.space}
    scored = [(c, archive.score(c.key)) for c in archive.candidates]
    finite = [(c, score) for c, score in scored if math.isfinite(score)]
    if len(finite) < MIN_CANDIDATES:
        raise InputError(f"{len(finite)} candidates are too few; at least {MIN_CANDIDATES}", field="found")
    with quiet(library):
        study = library.create_study()  # in memory: Optuna computes importances from a study only
        for candidate, score in finite:
            study.add_trial(
                library.trial.create_trial(
                    params=dict(candidate.values), distributions=distributions, value=score
                )
            )
        evaluator = library.importance.PedAnovaImportanceEvaluator(target_quantile=best_share)
        importances = library.importance.get_param_importances(study, evaluator=evaluator)
    return {str(name): float(share) for name, share in importances.items()}


def distribution_of(library: Any, dimension: Dimension) -> Any:
    """Return the Optuna distribution that describes a field: its choices, or its range and scale."""
    distributions = library.distributions
    if dimension.choices:
        return distributions.CategoricalDistribution(dimension.choices)
    log = dimension.scale == "log"
    if dimension.whole:
        return distributions.IntDistribution(int(dimension.low), int(dimension.high), log=log)
    return distributions.FloatDistribution(dimension.low, dimension.high, log=log)
