"""Functions with a known optimum, put under a method in place of the simulation."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vibroswarm.search.methods import Archive, Ask, Stage
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


class Answers:
    """Gives each request values of a function, with noise, and counts the runs."""

    def __init__(
        self,
        archive: Archive,
        function: Callable[[NDArray[np.float64]], float | NDArray[np.float64]],
        noise: float = 0.0,
        seed: int = 0,
        heavy: bool = False,
    ) -> None:
        self.archive, self.function, self.noise, self.heavy = archive, function, noise, heavy
        self.random, self.runs = np.random.Generator(np.random.Philox(seed)), 0

    def __call__(self, asks: list[Ask], history: object = None) -> None:
        for ask in asks:
            candidate = self.archive[ask.key]
            value = np.atleast_1d(self.function(candidate.point))
            shape, random = (ask.runs, 1, value.size), self.random
            spread = random.exponential(1.0, shape) - 1.0 if self.heavy else random.normal(0.0, 1.0, shape)
            candidate.rows.append(value + self.noise * spread)
            candidate.count += ask.runs
            self.runs += ask.runs


def drive(method: Stage, archive: Archive, *how: Any, **settings: Any) -> int:
    """Let the method run to its end; gives the runs it took."""
    answer = Answers(archive, *how, **settings)
    while asks := method.ask():
        answer(asks)
        method.tell()
    return answer.runs
