"""Functions with a known optimum, put under a method in place of the simulation."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from vibroswarm.search.methods import Archive, Stage
from vibroswarm.search.objective import Objective
from vibroswarm.search.space import Space

Function = Callable[[NDArray[np.float64]], float]

BOWL = {
    "walk.walk_duration_location_ms": {"from": 0, "to": 10000},
    "walk.walk_duration_scale_ms": {"from": 0, "to": 10000},
    "sample.sample_interval_ms": {"from": 0, "to": 10000},
}
OPTIMUM = np.array([0.3, 0.8, 0.55])


def sphere(u: NDArray[np.float64]) -> float:
    return float(((u - OPTIMUM) ** 2).sum())


def rosenbrock(u: NDArray[np.float64]) -> float:
    """Its optimum, 0, lies at ``OPTIMUM``."""
    x = 1.0 + 2.0 * (u - OPTIMUM)
    return float((100.0 * (x[1:] - x[:-1] ** 2) ** 2 + (1.0 - x[:-1]) ** 2).sum())


def rastrigin(u: NDArray[np.float64]) -> float:
    z = 4.0 * (u - OPTIMUM)
    return float((z**2 - 4.0 * np.cos(2.0 * np.pi * z) + 4.0).sum())


def archive_for(statistic: str = "mean", objectives: int = 1) -> Archive:
    return Archive(Space.of(BOWL), [Objective("decision_time", statistic)] * objectives)


def drive(
    method: Stage,
    archive: Archive,
    function: Callable[[NDArray[np.float64]], float | NDArray[np.float64]],
    noise: float = 0.0,
    seed: int = 0,
    heavy: bool = False,
) -> int:
    """Let the method run to its end; gives the runs it took."""
    random, runs = np.random.Generator(np.random.Philox(seed)), 0
    while asks := method.ask():
        for ask in asks:
            candidate = archive[ask.key]
            value = np.atleast_1d(function(candidate.point))
            shape = (ask.runs, 1, value.size)
            spread = random.exponential(1.0, shape) - 1.0 if heavy else random.normal(0.0, 1.0, shape)
            candidate.rows.append(value + noise * spread)
            candidate.count += ask.runs
            runs += ask.runs
        method.tell()
    return runs
