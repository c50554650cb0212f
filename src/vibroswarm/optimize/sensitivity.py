"""Which fields matter: shares of the variance of the cost over the space, the noise of the runs taken out.

| name | symbol | equation |
|---|---|---|
| first order | S_i | Var(E(Y given u_i)) / Var(Y): what the field does alone |
| total | S_Ti | 1 - Var(E(Y given all but u_i)) / Var(Y): with all its interactions |
| noise | - | mean over points of s^2 / R: the variance that R replicates leave in a point's mean |
| freed of noise | - | the noise taken off: S_i V / (V - noise), (S_Ti V - noise) / (V - noise) |

Saltelli's design: (d + 2) N points, R runs each with numbers of their own, averaged before the indices are
computed. The noise of a point's mean is independent of that of all others: it adds to Var(Y), adds nothing to the
covariances in S_i, and adds to the squared differences in S_Ti. Y is the mean of the cost; a standard deviation of few
runs would be noise. With several cases it is the mean over them.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.analysis.intervals import generator
from vibroswarm.csv_text import csv_bytes
from vibroswarm.errors import InputError, RunError
from vibroswarm.files import whole_file
from vibroswarm.optimize.evaluate import PIECE, Piece, derived_seed, do_pieces
from vibroswarm.optimize.spec import Search
from vibroswarm.study.executors import workers_for

DRAWS: Final = 1000
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Field:
    """The shares of one field, with their 95 % limits."""

    name: str
    first: float
    first_low: float
    first_high: float
    total: float
    total_low: float
    total_high: float


@dataclass(frozen=True)
class Sensitivity:
    """The shares of all fields, the largest total first."""

    fields: tuple[Field, ...]
    points: int
    replicates: int
    runs: int
    failed: int
    noise_share: float
    """Of the variance of the points' means, what is noise of the runs."""

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {**vars(self), "fields": [vars(one) for one in self.fields]}


def sobol_indices(
    search: Search,
    budget: int = 20_000,
    *,
    replicates: int = PIECE,
    executor: str | Executor = "threads",
    workers: int | None = None,
    tell: Callable[[int], None] = lambda done: None,
) -> Sensitivity:
    """Sobol indices of the mean cost over the space of a search.

    Args:
        search: its space, scenario and first objective count. budget: runs. replicates: of each point.
        executor, workers: see ``study.executors``. tell: called as runs come back.
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
    with workers_for(executor, workers) as hands:
        found = do_pieces(pieces, search.objectives[:1], hands, tell)
    bad = [rows for rows in found if isinstance(rows, str)]
    if bad:
        raise RunError(f"{len(bad) * replicates} runs failed, and every point is needed: {bad[0]}")
    costs = np.array([np.mean(rows, axis=1)[:, 0] for rows in found if not isinstance(rows, str)])
    return indices(search.space.names, costs, search.seed)


def saltelli(dimensions: int, points: int, seed: int) -> Array:
    """The design, (N (d + 2), d), in the unit cube.

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
    """The shares from the costs of a design's runs, (N (d + 2), replicates)."""
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
    whole = np.concatenate([by_row[:, 0], by_row[:, -1]])
    return Sensitivity(
        fields=tuple(sorted(fields, key=lambda one: -one.total)),
        points=mean.size,
        replicates=replicates,
        runs=costs.size,
        failed=0,
        noise_share=float(noise.mean() / whole.var()) if whole.var() > 0 else 0.0,
    )


def _shares(rows: Array, noise: Array) -> Array:
    """First-order and total shares, (2, d). Columns of a row: A, A with column i of B for each i, B (Saltelli 2010)."""
    a, b = rows[:, 0], rows[:, -1]
    whole = np.concatenate([a, b])
    centre, variance = whole.mean(), whole.var() - float(noise.mean())
    if variance <= 0:
        return np.full((2, rows.shape[1] - 2), np.nan)
    mixed = rows[:, 1:-1]
    first = ((b - centre)[:, None] * (mixed - a[:, None])).mean(axis=0)
    off = 0.5 * ((a[:, None] - mixed) ** 2 - noise[:, :1] - noise[:, 1:-1]).mean(axis=0)
    return np.asarray(np.vstack([first, off]) / variance)


def write_sensitivity(found: Sensitivity, folder: str | Path) -> None:
    """Keep the shares as ``sensitivity.csv``.

    Raises:
        RunError: it cannot be written.
    """
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with whole_file(folder / "sensitivity.csv") as part:
            part.write_bytes(csv_bytes(pl.DataFrame([vars(one) for one in found.fields])))
    except OSError as error:
        raise RunError(f"could not write '{folder}': {error.strerror or error}") from error
