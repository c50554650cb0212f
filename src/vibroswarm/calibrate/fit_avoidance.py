"""Fit avoidance and turning, which have no closed form, by simulation (approximate Bayesian computation).

Candidates (parameter vectors) are drawn from a uniform prior, one run is simulated with each, and the run is summarised
by statistics of avoidance and of sample positions, each divided by its noise. The tenth of the candidates whose
statistics are nearest to the recorded ones is accepted and weighted (Epanechnikov). A weighted linear regression moves
them to the recorded statistics (Beaumont, Zhang and Balding 2002). The mean of this posterior sample goes into the
scenario; new runs with its draws give the posterior prediction of the statistics.

| parameter | field |
|---|---|
| turn_deg_s | robot.turn_track_m = 2 v / (turn_deg_s in rad/s): a robot turns on the spot at this rate |
| gain | walk.turn_gain_percent_per_deg: the smaller, the longer a turn takes to end |
| blind_ms | walk.blind_after_turn_ms: time after a turn during which rays are ignored |
| leg_max_s | walk.leg_max_ms: longest leg |
| radius_m | robot.body_radius_m: how close robots come to walls and each other |
| seen_m | rays.disc_radius_m: size of other robots for the sensors |
| threshold_mm, ray_deg | walk.avoidance_threshold_mm, rays.angle_deg, where ``fit_rays`` cannot fit the rays |
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

import numpy as np
import polars as pl

from vibroswarm.calibrate.dataset import Dataset
from vibroswarm.calibrate.fit_rays import scaled_angles
from vibroswarm.calibrate.samples import ROUNDING_S, wall_distance
from vibroswarm.core.arrays import Floats
from vibroswarm.core.rng import Purpose, uniforms
from vibroswarm.motion.event.event_run import EventRun
from vibroswarm.motion.motion_tables import Collected
from vibroswarm.scenario.scenario import Scenario

PRIOR: Final[dict[str, tuple[float, float]]] = {
    "turn_deg_s": (80.0, 240.0),
    "gain": (1.5, 40.0),
    "blind_ms": (1.0, 400.0),
    "leg_max_s": (20.0, 200.0),
    "radius_m": (0.004, 0.025),
    "seen_m": (0.003, 0.04),
}
"""Bounds of each parameter, in the unit of its name; the prior is uniform between them."""
UNSEEN: Final[dict[str, tuple[float, float]]] = {"threshold_mm": (20.0, 80.0), "ray_deg": (10.0, 70.0)}
"""Prior of the parameters that are fitted here only if ``fit_rays`` could not fit the rays."""
SUMMARIES: Final = (
    "avoidance none", "avoidance mean, s", "avoidance q10, s", "avoidance q25, s", "avoidance q50, s",
    "avoidance q75, s", "avoidance q90, s", "avoidance q97.5, s", "below 25 mm of a wall", "25 to 50 mm",
    "50 to 75 mm", "75 to 100 mm", "corner tiles", "off the rim", "spacing, s", "steps below 5 mm",
    "steps below 50 mm", "step mean, m", "leg ends",
)  # fmt: skip
"""Names of the statistics of a session (``summary``), in order."""
CANDIDATES: Final = 4000
"""Parameter vectors that are tried, one simulated run each."""
_SEED: Final = 33
"""Seed of the simulated runs and of the drawn parameters."""


def fields_of(values: Mapping[str, float], base: Scenario, speed_m_s: float) -> dict[str, object]:
    """Return the scenario's fields for these parameters, with wheels of this speed; rays keep their ratio."""
    fields: dict[str, object] = {
        "robot.turn_track_m": round(float(2.0 * speed_m_s / np.radians(values["turn_deg_s"])), 5),
        "walk.turn_gain_percent_per_deg": round(values["gain"], 2),
        "walk.blind_after_turn_ms": round(values["blind_ms"], 1),
        "walk.leg_max_ms": round(1000.0 * values["leg_max_s"], -2),
        "robot.body_radius_m": round(values["radius_m"], 4),
        "rays.disc_radius_m": round(values["seen_m"], 4),
    }
    if "threshold_mm" in values:
        fields["walk.avoidance_threshold_mm"] = round(values["threshold_mm"], 2)
        fields["rays.angle_deg"] = scaled_angles(base, values["ray_deg"])
    return fields


def summary(samples: pl.DataFrame, arena_m: tuple[float, float]) -> Floats:
    """Return the statistics of one session, (statistics,), in the order of ``SUMMARIES``; NaN where undefined.

    The samples are ordered by robot and time. The rim is the outermost fifth of the arena on each side: the paper's
    floor has 5 x 5 tiles.
    """
    robot, time, x, y, avoid_s = (
        samples[name].to_numpy() for name in ("robot", "time_s", "x_m", "y_m", "avoid_s")
    )
    same_robot = robot[1:] == robot[:-1]  # whether a sample has a previous sample of the same robot
    avoid_s = avoid_s.astype(float)[1:][same_robot]
    known_s = avoid_s[np.isfinite(avoid_s)]
    positive_s = known_s[known_s > ROUNDING_S]
    quantiles_s = (
        np.quantile(positive_s, [0.1, 0.25, 0.5, 0.75, 0.9, 0.975]) if positive_s.size else np.zeros(6)
    )
    # Shares of the samples by distance (m) from the nearest wall.
    rings = np.histogram(wall_distance(x, y, arena_m), [0.0, 0.025, 0.05, 0.075, 0.1])[0] / x.size
    # Fifth of the arena, 0 to 4, along x and along y; a sample on the right or upper wall is in the last fifth.
    fifths = [np.minimum((at / size * 5).astype(int), 4) for at, size in zip((x, y), arena_m, strict=True)]
    rim_x, rim_y = ((fifth == 0) | (fifth == 4) for fifth in fifths)
    step = np.hypot(np.diff(x)[same_robot], np.diff(y)[same_robot])
    spacing = np.diff(time)[same_robot]
    calm_s = spacing[avoid_s <= ROUNDING_S]
    # An interval without avoidance that exceeds the usual one by 0.43 s contains the end of a leg.
    leg_ends = (calm_s > np.median(calm_s) + 0.43).mean() if calm_s.size else 0.0
    return np.array([
        (known_s <= ROUNDING_S).mean(), known_s.mean(), *quantiles_s, *rings, (rim_x & rim_y).mean(),
        (~rim_x & ~rim_y).mean(), spacing.mean(), (step < 0.005).mean(), (step < 0.05).mean(), step.mean(), leg_ends,
    ])  # fmt: skip


def fit_avoidance(
    found: Dataset,
    scenario: Scenario,
    speed_m_s: float,
    candidates: int = CANDIDATES,
    progress: Callable[[float], None] | None = None,
) -> tuple[dict[str, Floats], Floats, dict[str, tuple[float, float, float]]]:
    """Fit the parameters of avoidance and turning, with all other fields of the scenario fitted already.

    Sessions whose log does not hold the time spent avoiding are left out. ``speed_m_s`` is that of robots at the start.

    Returns:
        The posterior sample by parameter, (accepted,) each; its weights, (accepted,), of sum 1; and by statistic its
        recorded value, and the 2.5 and 97.5 % quantiles of runs with posterior draws.
    """
    sessions = [session.sort("robot", "time_s") for session in found.samples.partition_by("run")]
    real = np.array(
        [summary(session, found.arena_m) for session in sessions if session["avoid_s"].is_finite().any()]
    )
    # ``fit_rays`` sets this field together with the angles; ``fit`` resets it where the rays are not fitted.
    prior = PRIOR | (UNSEEN if scenario.rays.forward_each_m is None else {})
    # Candidates use the random numbers of "run" 0; the prediction uses those of "run" 1.
    u = uniforms(_SEED, run=0, robot=0, purpose=Purpose.OPTIMIZER, count=candidates * len(prior))
    low, high = np.array(list(prior.values())).T
    tried = low + (high - low) * u.reshape(candidates, -1)

    def simulated(parameters: Floats, first_run: int) -> Floats:
        """Return the statistics of one run with each of some parameters, (runs, statistics); of motion alone."""
        statistics = np.empty((len(parameters), len(SUMMARIES)))
        for k, own in enumerate(parameters):
            by_parameter = dict(zip(prior, own.tolist(), strict=True))
            own_scenario = scenario.with_values(fields_of(by_parameter, scenario, speed_m_s))
            state, taken = EventRun(own_scenario), Collected(own_scenario.run.control_period_ms)
            state.begin(_SEED, first_run + k)
            state.advance(own_scenario.ticks, taken.sink)
            table = taken.samples_frame().sort("robot", maintain_order=True)
            statistics[k] = summary(table, scenario.arena.size_m)
            if progress is not None:
                progress(min((first_run + k + 1) / candidates, 1.0))
        return statistics

    draws, weights = posterior(tried, simulated(tried, first_run=0), real, bounds=(low, high))
    # Draw k is picked with the probability weights[k]; the clip is for a sum of weights slightly below 1.
    u = uniforms(_SEED, run=1, robot=0, purpose=Purpose.OPTIMIZER, count=40)
    picked = draws[np.searchsorted(np.cumsum(weights), u).clip(max=weights.size - 1)]
    # Run numbers beyond those of the candidates, so that the runs are fresh.
    bands = np.quantile(simulated(picked, first_run=10**6), [0.025, 0.975], axis=0)
    table = np.vstack([real.mean(axis=0), bands]).T.tolist()
    predicted = {
        name: (mean, least, most) for name, (mean, least, most) in zip(SUMMARIES, table, strict=True)
    }
    return {name: draws[:, k] for k, name in enumerate(prior)}, weights, predicted


def posterior(
    tried: Floats, seen: Floats, real: Floats, bounds: tuple[Floats, Floats]
) -> tuple[Floats, Floats]:
    """Accept the candidates nearest to the recorded sessions, and adjust them by regression.

    Nearest means the smallest Euclidean distance of the statistics from their mean over the recorded sessions, each
    divided by its noise. ``tried`` has parameters, ``seen`` and ``real`` statistics in columns; ``bounds`` are those of
    the prior. Returns the accepted draws, clipped to the prior, (accepted, parameters), and their weights, of sum 1.
    """
    # Noise of each statistic: the variance between runs of the same parameters, estimated by the residuals of a
    # quadratic in the parameters (1, each, and their products), plus the variance between real sessions.
    unit = (tried - bounds[0]) / (bounds[1] - bounds[0])
    products = [unit[:, i] * unit[:, j] for i in range(unit.shape[1]) for j in range(i + 1)]
    design = np.column_stack([np.ones(len(unit)), unit, *products])
    residuals = seen - design @ np.linalg.lstsq(design, seen, rcond=None)[0]
    noise = residuals.var(axis=0)
    if len(real) > 1:
        noise = noise + real.var(axis=0, ddof=1)
    scaled = (seen - real.mean(axis=0)) / np.sqrt(noise + 1e-12)  # 1e-12: not 0 for a constant statistic
    distance = np.sqrt((scaled**2).sum(axis=1))
    kept = np.argsort(distance)[: max(int(0.1 * len(tried)), 20)]  # at least 20, for the regression
    reach = float(distance[kept].max()) * (1 + 1e-9)  # slightly farther than the farthest accepted candidate
    weights = 1.0 - (distance[kept] / reach) ** 2 + 1e-6  # Epanechnikov; 1e-6 keeps all weights above 0
    # Regress parameters on statistics; the ridge keeps the equations solvable where statistics depend on each other.
    columns = np.column_stack([np.ones(kept.size), scaled[kept]])
    root = np.sqrt(weights)[:, None]  # rows times the roots of their weights give weighted least squares
    ridge = np.diag(np.r_[0.0, np.full(scaled.shape[1], 0.5)])  # the intercept, first, is not penalised
    slope = np.linalg.solve(
        (columns * root).T @ (columns * root) + ridge, (columns * root).T @ (tried[kept] * root)
    )
    # ``scaled`` is 0 at the recorded statistics, to which each draw moves.
    moved = tried[kept] - scaled[kept] @ slope[1:]
    return np.clip(moved, *bounds), weights / weights.sum()
