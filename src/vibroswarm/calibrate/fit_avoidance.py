"""How robots avoid and turn, for which there is no closed form: found by simulation (approximate Bayesian computation).

Parameters are drawn from a uniform prior, each is simulated, and runs are summed up by figures of avoidance and of where
samples fall. Each figure is measured in its own spread, over runs of one parameter and over real sessions; the nearest
tenth is kept, weighted (Epanechnikov) and moved by a weighted linear regression of parameters on figures to where the
recordings lie (Beaumont, Zhang and Balding 2002). What comes out is a posterior of draws; its middle goes into the
scenario, and new runs with its draws say whether the figures are within what it predicts.

| parameter | field |
|---|---|
| threshold_mm | walk.avoidance_threshold_mm: at which distance robots turn |
| ray_deg | rays.angle_deg: how far the outer rays look aside |
| radius_m | robot.body_radius_m: how near to walls and each other they come |
| turn_deg_s | robot.turn_track_m = 2 v / rate |
| seen_m | rays.disc_radius_m: how large other robots are to the sensors |
| gain | walk.turn_gain_percent_per_deg: the less, the longer a turn takes to end (the real robots' dead time) |
"""  # noqa: E501

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.calibrate.measured import Measured
from vibroswarm.draws import Purpose, uniforms
from vibroswarm.scenario import Scenario
from vibroswarm.simulation import simulate

Floats = NDArray[np.float64]
Progress = Callable[[float], None]

PRIOR: Final[dict[str, tuple[float, float]]] = {
    "threshold_mm": (20.0, 80.0),
    "ray_deg": (10.0, 70.0),
    "radius_m": (0.004, 0.02),
    "turn_deg_s": (110.0, 240.0),
    "gain": (1.5, 25.0),
    "seen_m": (0.003, 0.03),
}
SUMMARIES: Final = (
    "avoidance none", "avoidance mean, s", "avoidance q10, s", "avoidance q50, s", "avoidance q90, s",
    "avoidance q97.5, s", "below 25 mm of a wall", "25 to 50 mm", "50 to 75 mm", "75 to 100 mm", "corner tiles",
    "off the rim", "spacing, s", "steps below 5 mm", "steps below 50 mm", "step mean, m",
)  # fmt: skip
CANDIDATES: Final = 2400
KEPT: Final = 0.1
CHECKS: Final = 40
_SEED: Final = 33


@dataclass(frozen=True)
class AvoidanceFit:
    """The posterior, and what it predicts."""

    draws: dict[str, Floats]
    """By parameter, (kept,)."""
    weights: Floats
    predicted: dict[str, tuple[float, float, float]]
    """By figure: recorded, and 2.5 and 97.5 % of runs with draws of the posterior."""
    runs: int

    @property
    def values(self) -> dict[str, float]:
        """The weighted means."""
        return {name: float(self.weights @ one) for name, one in self.draws.items()}

    def fields(self, base: Scenario, speed_m_s: float) -> dict[str, object]:
        """The scenario's fields."""
        return fields_of(self.values, base, speed_m_s)


def fields_of(values: dict[str, float], base: Scenario, speed_m_s: float) -> dict[str, object]:
    """The fields of parameters; outer rays look aside by ``ray_deg``, the others in proportion."""
    most = max(abs(angle) for angle in base.rays.angle_deg) or 1.0
    return {
        "walk.avoidance_threshold_mm": round(values["threshold_mm"], 2),
        "rays.angle_deg": [round(angle / most * values["ray_deg"], 2) for angle in base.rays.angle_deg],
        "robot.body_radius_m": round(values["radius_m"], 5),
        "rays.disc_radius_m": round(values["seen_m"], 5),
        "robot.turn_track_m": round(float(2.0 * speed_m_s / np.radians(values["turn_deg_s"])), 5),
        "walk.turn_gain_percent_per_deg": round(values["gain"], 3),
    }


def summary(samples: pl.DataFrame, arena_m: tuple[float, float]) -> Floats:
    """The figures of one session, (``SUMMARIES``,); samples in the order of run, robot and time."""
    width, height = arena_m
    x, y = samples["x_m"].to_numpy(), samples["y_m"].to_numpy()
    robot, time = samples["robot"].to_numpy(), samples["time_s"].to_numpy()
    same = robot[1:] == robot[:-1]
    avoid = samples["avoid_s"].to_numpy().astype(float)[1:][same]
    avoid = avoid[np.isfinite(avoid)]
    some = avoid[avoid > 1e-9]
    quantiles = np.quantile(some, [0.1, 0.5, 0.9, 0.975]) if some.size else np.zeros(4)
    wall = np.minimum(np.minimum(x, width - x), np.minimum(y, height - y))
    rings = np.histogram(wall, [0.0, 0.025, 0.05, 0.075, 0.1])[0] / x.size
    fifth_x = np.minimum((x / width * 5).astype(int), 4)
    fifth_y = np.minimum((y / height * 5).astype(int), 4)
    rim_x, rim_y = (fifth_x == 0) | (fifth_x == 4), (fifth_y == 0) | (fifth_y == 4)
    step = np.hypot(np.diff(x)[same], np.diff(y)[same])
    return np.array([
        (avoid <= 1e-9).mean(), avoid.mean(), *quantiles, *rings, (rim_x & rim_y).mean(), (~rim_x & ~rim_y).mean(),
        np.diff(time)[same].mean(), (step < 0.005).mean(), (step < 0.05).mean(), step.mean(),
    ])  # fmt: skip


def fit_avoidance(
    found: Measured,
    scenario: Scenario,
    speed_m_s: float,
    candidates: int = CANDIDATES,
    progress: Progress | None = None,
) -> AvoidanceFit:
    """Fit.

    Args:
        scenario: all else as it is fitted. speed_m_s: at the start, mean over robots (for rates of turning).
        candidates: parameters that are tried, each in one run.
    """
    real = np.array([summary(one, found.arena_m) for one in _sessions(found)])
    u = uniforms(_SEED, 0, 0, Purpose.OPTIMIZER, candidates * len(PRIOR)).reshape(candidates, -1)
    low, high = np.array(list(PRIOR.values())).T
    tried = low + (high - low) * u
    seen = np.empty((candidates, len(SUMMARIES)))
    for k, parameters in enumerate(tried):
        seen[k] = _simulated(scenario, parameters, speed_m_s, k)
        if progress is not None:
            progress((k + 1) / (candidates + CHECKS))
    draws, weights = posterior(tried, seen, real, (low, high))
    check = _predicted(draws, weights, scenario, speed_m_s)
    bands = np.quantile(check, [0.025, 0.975], axis=0).T
    predicted = {
        name: (float(mean), float(band[0]), float(band[1]))
        for name, mean, band in zip(SUMMARIES, real.mean(axis=0), bands, strict=True)
    }
    by_name = {name: draws[:, k] for k, name in enumerate(PRIOR)}
    return AvoidanceFit(by_name, weights, predicted, candidates + CHECKS)


def posterior(
    tried: Floats, seen: Floats, real: Floats, bounds: tuple[Floats, Floats]
) -> tuple[Floats, Floats]:
    """Draws (kept, parameters) and weights: the nearest candidates, moved by regression; within the prior.

    Args:
        tried: (candidates, parameters). seen: (candidates, figures). real: (sessions, figures).
    """
    # A figure's own noise: what a quadratic in the parameters leaves, or real sessions differ by.
    design = _quadratic((tried - bounds[0]) / (bounds[1] - bounds[0]))
    rest = seen - design @ np.linalg.lstsq(design, seen, rcond=None)[0]
    noise = rest.var(axis=0)
    if len(real) > 1:
        noise = noise + real.var(axis=0, ddof=1)
    scaled = (seen - real.mean(axis=0)) / np.sqrt(noise + 1e-12)
    distance = np.sqrt((scaled**2).sum(axis=1))
    kept = np.argsort(distance)[: max(int(KEPT * len(tried)), 20)]
    reach = float(distance[kept].max()) * (1 + 1e-9)
    weights = 1.0 - (distance[kept] / reach) ** 2 + 1e-6
    columns = np.column_stack([np.ones(kept.size), scaled[kept]])
    root = np.sqrt(weights)[:, None]
    ridge = np.diag(np.r_[0.0, np.full(scaled.shape[1], 0.5)])
    slope = np.linalg.solve(
        (columns * root).T @ (columns * root) + ridge, (columns * root).T @ (tried[kept] * root)
    )
    moved = tried[kept] - scaled[kept] @ slope[1:]
    return np.clip(moved, *bounds), weights / weights.sum()


def _quadratic(unit: Floats) -> Floats:
    squares = [unit[:, i] * unit[:, j] for i in range(unit.shape[1]) for j in range(i + 1)]
    return np.column_stack([np.ones(len(unit)), unit, *squares])


def _simulated(
    scenario: Scenario, parameters: Sequence[float] | Floats, speed_m_s: float, run: int
) -> Floats:
    values = dict(zip(PRIOR, (float(one) for one in parameters), strict=True))
    tried = scenario.with_values(fields_of(values, scenario, speed_m_s))
    motion = simulate(tried, _SEED, [run], energies=False).motion.sort("robot", "time_s")
    return summary(motion, (scenario.arena.width_m, scenario.arena.height_m))


def _predicted(draws: Floats, weights: Floats, scenario: Scenario, speed_m_s: float) -> Floats:
    u = uniforms(_SEED, 1, 0, Purpose.OPTIMIZER, CHECKS)
    picked = np.searchsorted(np.cumsum(weights), u).clip(max=len(draws) - 1)
    return np.array(
        [_simulated(scenario, draws[k], speed_m_s, 10**6 + i) for i, k in enumerate(picked.tolist())]
    )


def _sessions(found: Measured) -> list[Any]:
    return [found.samples.filter(pl.col("run") == run).sort("robot", "time_s") for run in found.sessions]
