"""Estimate which fields matter: Sobol indices of the cost, corrected for the noise of runs, and PED-ANOVA.

| name | symbol | equation |
|---|---|---|
| first order | S_i | Var(E(Y given u_i)) / Var(Y): the effect of the field alone |
| total | S_Ti | 1 - Var(E(Y given all but u_i)) / Var(Y): with all its interactions |
| noise | - | mean over points of s^2 / R: the variance that R replicates leave in a point's mean |
| corrected | - | S_i V / (V - noise), (S_Ti V - noise) / (V - noise) |

Saltelli's design has (d + 2) N points with R independent runs each, averaged before the indices are computed. The noise
of a point's mean is independent of that of all others: it adds to Var(Y), adds nothing to the covariances in S_i, and
adds to the squared differences in S_Ti. Y is the mean of the cost, since a standard deviation of few runs would be
noise. With several cases it is the mean over them.

PED-ANOVA needs no further runs. Field by field it compares the distribution of the best candidates of a search with
that of all (Watanabe, Bansal and Hutter, "PED-ANOVA", IJCAI 2023; through Optuna). It is robust to noise, but describes
only the region that the search explored; Sobol indices describe the whole space.
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
from numpy.typing import NDArray

from vibroswarm.analysis.intervals import generator
from vibroswarm.core.atomic_io import write_files
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.core.tables import csv_bytes
from vibroswarm.errors import InputError, RunError
from vibroswarm.optimize.evaluate import PIECE, Piece, derived_seed, do_pieces
from vibroswarm.optimize.loop import Found
from vibroswarm.optimize.optuna_samplers import distribution_of, ignore_warnings, optuna
from vibroswarm.optimize.spec import Search
from vibroswarm.study.executors import workers_for

DRAWS: Final = 1000
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Field(NotebookView):
    """The indices of one field, with 95 % limits."""

    name: str
    first: float
    first_low: float
    first_high: float
    total: float
    total_low: float
    total_high: float


@dataclass(frozen=True)
class Sensitivity(NotebookView):
    """The indices of all fields, the largest total first."""

    fields: tuple[Field, ...]
    points: int
    replicates: int
    runs: int
    failed: int
    noise_share: float
    """Share of the variance of the points' means that is noise of the runs."""

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {**vars(self), "fields": [vars(index) for index in self.fields]}


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
        search: defines space, scenario and first objective. budget: runs. replicates: of each point.
        executor, workers: see ``study.executors``. progress: called as runs come back.
    Raises:
        InputError: SALib is not there, or the budget is too small. RunError: a run failed.
    """
    design = saltelli(search.space.size, budget // replicates, search.seed)
    cases = tuple(cell.scenario.to_toml() for cell in search.cases)
    seed = derived_seed(search.seed, "sensitivity")
    pieces = [
        Piece(cases, tuple(search.space.values(point).items()), seed, search.study.motion,
              k * replicates, (k + 1) * replicates)
        for k, point in enumerate(design)
    ]  # fmt: skip
    with workers_for(executor, workers) as pool:
        results = do_pieces(pieces, search.objectives[:1], pool, progress)
    bad = [rows for rows in results if isinstance(rows, str)]
    if bad:
        raise RunError(f"{len(bad) * replicates} runs failed, and every point is needed: {bad[0]}")
    costs = np.array([np.mean(rows, axis=1)[:, 0] for rows in results if not isinstance(rows, str)])
    return indices(search.space.names, costs, search.seed)


def saltelli(dimensions: int, points: int, seed: int) -> Array:
    """Draw Saltelli's design in the unit cube, (N (d + 2), d).

    N is the largest power of two for which the design has at most ``points`` points.

    Raises:
        InputError: SALib is not there, or too few points.
    """
    try:
        from SALib.sample import sobol
    except ImportError:
        raise InputError("needs SALib: pip install 'vibroswarm[optimize]'", field="--sensitivity") from None
    base = 1 << max((points // (dimensions + 2)).bit_length() - 1, 0)
    if base < 8:
        raise InputError(
            f"{points} points are too few for {dimensions} fields; at least {8 * (dimensions + 2)}",
            field="budget",
        )
    problem = {
        "num_vars": dimensions,
        "names": [str(k) for k in range(dimensions)],
        "bounds": [[0, 1]] * dimensions,
    }
    number = derived_seed(seed, "sensitivity design") % 2**31
    return np.asarray(sobol.sample(problem, base, calc_second_order=False, seed=number))


def indices(names: list[str], costs: Array, seed: int = 0) -> Sensitivity:
    """Compute the indices from the costs of a design's runs, (N (d + 2), replicates)."""
    dimensions, replicates = len(names), costs.shape[1]
    mean = costs.mean(axis=1)
    noise = costs.var(axis=1, ddof=1) / replicates if replicates > 1 else np.zeros(mean.size)
    by_row = mean.reshape(-1, dimensions + 2)
    noise_by_row = noise.reshape(-1, dimensions + 2)
    estimate = _shares(by_row, noise_by_row)
    random, rows = generator(seed, "bootstrap of Sobol indices"), by_row.shape[0]
    drawn = []
    for _ in range(DRAWS):
        chosen = random.integers(0, rows, rows)
        drawn.append(_shares(by_row[chosen], noise_by_row[chosen]))
    low, high = np.nanquantile(np.array(drawn), [0.025, 0.975], axis=0)
    fields = [
        Field(name, *(float(v) for v in (
            estimate[0, k], low[0, k], high[0, k], estimate[1, k], low[1, k], high[1, k]
        )))
        for k, name in enumerate(names)
    ]  # fmt: skip
    pooled = np.concatenate([by_row[:, 0], by_row[:, -1]])
    return Sensitivity(
        fields=tuple(sorted(fields, key=lambda one: -one.total)),
        points=mean.size,
        replicates=replicates,
        runs=costs.size,
        failed=0,
        noise_share=float(noise.mean() / pooled.var()) if pooled.var() > 0 else 0.0,
    )


def _shares(rows: Array, noise: Array) -> Array:
    """Compute first-order and total indices, (2, d), from rows A, A with column i of B, B (Saltelli 2010).

    The noise of the runs is subtracted from the variance; if nothing is left, all indices are nan.
    """
    a, b = rows[:, 0], rows[:, -1]
    pooled = np.concatenate([a, b])
    centre, variance = pooled.mean(), pooled.var() - float(noise.mean())
    if variance <= 0:
        return np.full((2, rows.shape[1] - 2), np.nan)
    mixed = rows[:, 1:-1]
    first = ((b - centre)[:, None] * (mixed - a[:, None])).mean(axis=0)
    off = 0.5 * ((a[:, None] - mixed) ** 2 - noise[:, :1] - noise[:, 1:-1]).mean(axis=0)
    return np.asarray(np.vstack([first, off]) / variance)


def write_sensitivity(found: Sensitivity, folder: str | Path) -> None:
    """Write the indices as ``sensitivity.csv``.

    Raises:
        RunError: it cannot be written.
    """
    table = pl.DataFrame([vars(index) for index in found.fields])
    write_files(Path(folder), {"sensitivity.csv": csv_bytes(table)})


MIN_CANDIDATES: Final = 20
"""Candidates."""


def ped_anova(found: Found, best_share: float = 0.1) -> dict[str, float]:
    """Compute the importance of each field, the largest first; the sum is 1.

    Args:
        found: a finished search. best_share: share of the candidates that count as good.
    Raises:
        InputError: Optuna is not there, too few candidates, or a share outside (0, 1).
    """
    if not 0 < best_share < 1:
        raise InputError(f"{best_share!r} is not a share", field="best_share")
    library, archive = optuna(), found.archive
    distributions = {d.name: distribution_of(library, d) for d in archive.space}
    scored = [(c, archive.score(c.key)) for c in archive.candidates]
    finite = [(c, score) for c, score in scored if math.isfinite(score)]
    if len(finite) < MIN_CANDIDATES:
        raise InputError(f"{len(finite)} candidates are too few; at least {MIN_CANDIDATES}", field="found")
    with ignore_warnings():
        study = library.create_study()
        for candidate, score in finite:
            study.add_trial(
                library.trial.create_trial(
                    params=dict(candidate.values), distributions=distributions, value=score
                )
            )
        evaluator = library.importance.PedAnovaImportanceEvaluator(target_quantile=best_share)
        importances = library.importance.get_param_importances(study, evaluator=evaluator)
    return {str(name): float(share) for name, share in importances.items()}
