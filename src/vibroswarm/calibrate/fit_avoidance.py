"""Fit avoidance and turning, which have no closed form, by simulation (approximate Bayesian computation).

Parameters are drawn from a uniform prior, each is simulated in one run, and runs are summarised by statistics of
avoidance
and of sample positions. Each statistic is scaled by its own spread, over runs of one parameter and over real
sessions; the
nearest tenth is accepted, weighted (Epanechnikov) and adjusted by a weighted linear regression of parameters on
statistics
to the recorded values (Beaumont, Zhang and Balding 2002). The result is a posterior sample; its mean goes into the
scenario, and new runs with its draws give the posterior prediction of the statistics.

| parameter | field |
|---|---|
| turn_deg_s | robot.turn_track_m = 2 v / rate |
| gain | walk.turn_gain_percent_per_deg: the smaller, the longer a turn takes to end |
| blind_ms | walk.blind_after_turn_ms: time after a turn during which rays are ignored |
| leg_max_s | walk.leg_max_ms: longest leg |
| radius_m | robot.body_radius_m: how close robots come to walls and each other |
| seen_m | rays.disc_radius_m: size of other robots for the sensors |
| threshold_mm, ray_deg | walk.avoidance_threshold_mm, rays.angle_deg, where ``fit_rays`` cannot fit the rays |
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.calibrate.dataset import Dataset
from vibroswarm.core.rng import Purpose, uniforms
from vibroswarm.motion.event import engine as _event  # noqa: F401 - makes the engine known
from vibroswarm.motion.source import source
from vibroswarm.scenario.scenario import Scenario

Floats = NDArray[np.float64]
Progress = Callable[[float], None]

PRIOR: Final[dict[str, tuple[float, float]]] = {
    "turn_deg_s": (80.0, 240.0),
    "gain": (1.5, 40.0),
    "blind_ms": (1.0, 400.0),
    "leg_max_s": (20.0, 200.0),
    "radius_m": (0.004, 0.025),
    "seen_m": (0.003, 0.04),
}
UNSEEN: Final[dict[str, tuple[float, float]]] = {"threshold_mm": (20.0, 80.0), "ray_deg": (10.0, 70.0)}
LEG_END_S: Final = 0.43
"""An interval without avoidance that exceeds the usual one by this contains the end of a leg."""
SUMMARIES: Final = (
    "avoidance none", "avoidance mean, s", "avoidance q10, s", "avoidance q25, s", "avoidance q50, s",
    "avoidance q75, s", "avoidance q90, s", "avoidance q97.5, s", "below 25 mm of a wall", "25 to 50 mm",
    "50 to 75 mm", "75 to 100 mm", "corner tiles", "off the rim", "spacing, s", "steps below 5 mm",
    "steps below 50 mm", "step mean, m", "leg ends",
)  # fmt: skip
CANDIDATES: Final = 4000
KEPT: Final = 0.1
CHECKS: Final = 40
_SEED: Final = 33


@dataclass(frozen=True)
class AvoidanceFit:
    """The posterior sample and its prediction."""

    draws: dict[str, Floats]
    """By parameter, (accepted,)."""
    weights: Floats
    predicted: dict[str, tuple[float, float, float]]
    """By statistic: recorded value, and 2.5 and 97.5 % quantiles of runs with posterior draws."""
    runs: int

    @property
    def values(self) -> dict[str, float]:
        """Posterior means."""
        return {name: float(self.weights @ draws) for name, draws in self.draws.items()}

    def fields(self, base: Scenario, speed_m_s: float) -> dict[str, object]:
        """Return the fields of the scenario."""
        return fields_of(self.values, base, speed_m_s)


def fields_of(values: dict[str, float], base: Scenario, speed_m_s: float) -> dict[str, object]:
    """Return the fields for these parameters; all rays are turned in proportion to the outermost."""
    rays = base.rays
    fields: dict[str, object] = {
        "robot.turn_track_m": round(float(2.0 * speed_m_s / np.radians(values["turn_deg_s"])), 5),
        "walk.turn_gain_percent_per_deg": round(values["gain"], 2),
        "walk.blind_after_turn_ms": round(values["blind_ms"], 1),
        "walk.leg_max_ms": round(1000.0 * values["leg_max_s"], -2),
        "robot.body_radius_m": round(values["radius_m"], 4),
        "rays.disc_radius_m": round(values["seen_m"], 4),
    }
    if "threshold_mm" in values:
        most = max(abs(angle) for angle in rays.angle_deg) or 1.0
        fields["walk.avoidance_threshold_mm"] = round(values["threshold_mm"], 2)
        fields["rays.angle_deg"] = [round(angle / most * values["ray_deg"], 2) for angle in rays.angle_deg]
    return fields


def summary(samples: pl.DataFrame, arena_m: tuple[float, float]) -> Floats:
    """Return the statistics of one session, (``SUMMARIES``,); samples ordered by run, robot and time."""
    width, height = arena_m
    x, y = samples["x_m"].to_numpy(), samples["y_m"].to_numpy()
    robot, time = samples["robot"].to_numpy(), samples["time_s"].to_numpy()
    same = robot[1:] == robot[:-1]
    avoid = samples["avoid_s"].to_numpy().astype(float)[1:][same]
    avoid = avoid[np.isfinite(avoid)]
    some = avoid[avoid > 1e-9]
    quantiles = np.quantile(some, [0.1, 0.25, 0.5, 0.75, 0.9, 0.975]) if some.size else np.zeros(6)
    wall = np.minimum(np.minimum(x, width - x), np.minimum(y, height - y))
    rings = np.histogram(wall, [0.0, 0.025, 0.05, 0.075, 0.1])[0] / x.size
    fifth_x = np.minimum((x / width * 5).astype(int), 4)
    fifth_y = np.minimum((y / height * 5).astype(int), 4)
    rim_x, rim_y = (fifth_x == 0) | (fifth_x == 4), (fifth_y == 0) | (fifth_y == 4)
    step = np.hypot(np.diff(x)[same], np.diff(y)[same])
    spacing = np.diff(time)[same]
    calm = spacing[samples["avoid_s"].to_numpy().astype(float)[1:][same] <= 1e-9]
    ends = (calm > np.median(calm) + LEG_END_S).mean() if calm.size else 0.0
    return np.array([
        (avoid <= 1e-9).mean(), avoid.mean(), *quantiles, *rings, (rim_x & rim_y).mean(), (~rim_x & ~rim_y).mean(),
        spacing.mean(), (step < 0.005).mean(), (step < 0.05).mean(), step.mean(), ends,
    ])  # fmt: skip


def fit_avoidance(
    found: Dataset,
    scenario: Scenario,
    speed_m_s: float,
    candidates: int = CANDIDATES,
    progress: Progress | None = None,
) -> AvoidanceFit:
    """Fit the parameters of avoidance and turning; return their posterior sample and what it predicts.

    Args:
        scenario: all other fields as fitted. speed_m_s: at the start, mean over robots (for turning rates).
        candidates: number of parameter vectors tried, one run each.
    """
    real = np.array([summary(session.sort("robot", "time_s"), found.arena_m) for session in found.by_session])
    prior = PRIOR | ({} if scenario.rays.forward_each_m is not None else UNSEEN)
    u = uniforms(_SEED, 0, 0, Purpose.OPTIMIZER, candidates * len(prior)).reshape(candidates, -1)
    low, high = np.array(list(prior.values())).T
    tried = low + (high - low) * u
    seen = np.empty((candidates, len(SUMMARIES)))
    for k, parameters in enumerate(tried):
        seen[k] = _simulated(scenario, dict(zip(prior, parameters.tolist(), strict=True)), speed_m_s, k)
        if progress is not None:
            progress((k + 1) / (candidates + CHECKS))
    draws, weights = posterior(tried, seen, real, (low, high))
    by_name = {name: draws[:, k] for k, name in enumerate(prior)}
    check = _predicted(by_name, weights, scenario, speed_m_s)
    bands = np.quantile(check, [0.025, 0.975], axis=0).T
    predicted = {
        name: (float(mean), float(band[0]), float(band[1]))
        for name, mean, band in zip(SUMMARIES, real.mean(axis=0), bands, strict=True)
    }
    return AvoidanceFit(by_name, weights, predicted, candidates + CHECKS)


def posterior(
    tried: Floats, seen: Floats, real: Floats, bounds: tuple[Floats, Floats]
) -> tuple[Floats, Floats]:
    """Return accepted draws (accepted, parameters), adjusted by regression and clipped to the prior, and their weights.

    Args:
        tried: (candidates, parameters). seen: (candidates, statistics). real: (sessions, statistics).
    """
    # Noise of each statistic: residuals of a quadratic in the parameters, plus variance between real sessions.
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


def _simulated(scenario: Scenario, values: dict[str, float], speed_m_s: float, run: int) -> Floats:
    tried = scenario.with_values(fields_of(values, scenario, speed_m_s))
    moved = source("event").batch(tried, _SEED, [run], False).samples
    return summary(moved.sort("robot", "time_s"), (scenario.arena.width_m, scenario.arena.height_m))


def _predicted(draws: dict[str, Floats], weights: Floats, scenario: Scenario, speed_m_s: float) -> Floats:
    """Simulate sessions with parameters drawn from the posterior; return their statistics, (``CHECKS``, statistics)."""
    u = uniforms(_SEED, 1, 0, Purpose.OPTIMIZER, CHECKS)
    picked = np.searchsorted(np.cumsum(weights), u).clip(max=weights.size - 1)
    return np.array(
        [
            _simulated(
                scenario,
                {name: float(values_of[k]) for name, values_of in draws.items()},
                speed_m_s,
                10**6 + i,
            )
            for i, k in enumerate(picked.tolist())
        ]
    )
