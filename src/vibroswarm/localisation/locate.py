"""Where each robot believed it was at its samples: ``robot.localisation`` run over what it measured of its moves.

It depends on motion and odometry alone, so it is computed once for all floors, sensors, strategies and networks. Rows
are in the order of the samples; a row is what the robot believes when it takes that sample, and never changes.

| name | equation |
|---|---|
| mean, standard deviation of s_d as assumed | those of the clipped Gamma law, or ``localisation.assumed_speed_*`` |
| density of meeting robots, 1/m | ``robots_factor`` (n - 1) / area * 2 half-width * 4 / pi: chords of swept rays |

Chord theory gives a robot that drives straight (n - 1) / area * 2 half-width * 4 / pi meetings per m with others that
move as fast (half-width: of the rays, plus that of the robots as rays see them); the factor 6 is for those that follow,
as the robots turn away from each other, and makes the filter careful.
"""

from __future__ import annotations

import math
from collections.abc import Hashable
from functools import lru_cache
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.jit import inner, kernel, read_only
from vibroswarm.core.rng import (
    ALONE,
    FIRST,
    LOCALISATION,
    OF_PATHS,
    OF_TOLD_HEADING,
    OF_TOLD_X,
    OF_TOLD_Y,
    uniform,
)
from vibroswarm.localisation.odometry import known_moves, measure_moves, normal
from vibroswarm.motion.motion_tables import Motion
from vibroswarm.robot.localisation import drive, obstacle, sampled, turn
from vibroswarm.robot.place_draws import Paths, begin_paths, draw_places, empty_paths, width_of
from vibroswarm.robot.pose_mixture import ESTIMATE, LocalisationProgram, Mixture, begin, empty_mixture
from vibroswarm.robot.walk import AVOID, DRIVE, STOP
from vibroswarm.scenario.fields import Robot
from vibroswarm.scenario.localisation_fields import GYRO_LEVELS
from vibroswarm.scenario.scenario import Scenario

PLACES: Final[dict[str, Any]] = {
    "run": pl.UInt32,
    "robot": pl.UInt16,
    "sample": pl.UInt32,
    "x_m": pl.Float64,
    "y_m": pl.Float64,
    "heading_rad": pl.Float64,
    "spread_m": pl.Float64,
    "lagged_sample": pl.UInt32,
    "lagged_x_m": pl.Float64,
    "lagged_y_m": pl.Float64,
    "lagged_spread_x_m": pl.Float64,
    "lagged_spread_y_m": pl.Float64,
}
"""Where robots believe they are when they sample, and, smoothed by what they met since, where they took the sample
``localisation.lag`` before (null for their first samples), with standard deviations."""


def locate(scenario: Scenario, seed: int, motion: Motion) -> pl.DataFrame:
    """Return where each robot believes it is at each sample (``PLACES``), in the order of the samples.

    Raises:
        InputError: the motion has no moves.
    """
    samples = motion.samples
    stop_start_s, time_s = (samples[name].to_numpy() for name in ("stop_start_s", "time_s"))
    estimates = estimate(scenario, seed, samples, stop_start_s, time_s, motion.moves, motion.ends)
    return place_frame(samples, estimates)


def place_frame(samples: pl.DataFrame, estimates: NDArray[np.float64]) -> pl.DataFrame:
    """Return estimates as a table (``PLACES``); ``samples`` has their run, robot and sample.

    Lagged columns are null for a robot's first samples, before which there is no sample to look back at.
    """
    columns = [samples[name] for name in ("run", "robot", "sample")]
    late = estimates[:, 4] < 0.0
    for k, name in enumerate(ESTIMATE):
        values = np.where(late, np.nan, estimates[:, k]) if name.startswith("lagged") else estimates[:, k]
        columns.append(pl.Series(name, values, nan_to_null=True).cast(PLACES[name]))
    return pl.DataFrame(columns)


def is_estimated(scenario: Scenario) -> bool:
    """Return whether robots estimate their places, rather than know them."""
    return scenario.localisation.method != "true"


def draws_read(scenario: Scenario) -> int:
    """Return how many draws of each place the strategy's parameters say that robots read."""
    return int(getattr(scenario.strategy.params, "draws", 0))


def estimates_key(scenario: Scenario, seed: int) -> Hashable:
    """Return a key that is equal for equal estimates over the same motion."""
    return scenario.odometry, scenario.localisation, draws_read(scenario), seed


def estimate(
    scenario: Scenario,
    seed: int,
    samples: pl.DataFrame,
    stop_start_s: NDArray[np.float64],
    time_s: NDArray[np.float64],
    moves: pl.DataFrame | None,
    ends: pl.DataFrame,
) -> NDArray[np.float64]:
    """Return the columns of ``ESTIMATE`` as one array, (samples, 9), and of draws if the strategy reads them: (samples,
    11 + 2 draws); the lagged sample is -1 where there is none.

    Args:
        samples: run and robot of each. stop_start_s, time_s: when it stopped for it, and when it was taken. moves,
            ends: tables of the motion.
    Raises:
        InputError: the motion has no moves.
    """
    moves, robots = known_moves(moves), scenario.swarm.robots
    odometer = measure_moves(scenario, seed, moves, ends)
    starts = moves.group_by("run", "robot", maintain_order=True).first().sort("run", "robot")
    draws = draws_read(scenario)
    out = np.full((samples.height, len(ESTIMATE) + width_of(draws)), np.nan)
    whose = samples["run"].to_numpy().astype(np.int64) * robots + samples["robot"].to_numpy()
    rows = np.argsort(whose, kind="stable")
    moved = odometer["run"].to_numpy().astype(np.int64) * robots + odometer["robot"].to_numpy()
    agents = starts["run"].to_numpy().astype(np.int64) * robots + starts["robot"].to_numpy()
    method = scenario.localisation.method
    components = scenario.localisation.components if method == "mixture" else 1
    kind = odometer["kind"].to_physical().to_numpy().astype(np.int64)  # as in KINDS
    columns = [kind, *(odometer[name].to_numpy() for name in ("start_s", "duration_s", "gyro_rad", "ray_m"))]
    columns += [rows, stop_start_s, time_s]
    poses = starts.select("x_m", "y_m", "heading_rad").to_numpy(order="c")
    sampled_s = np.zeros(agents.size)
    bounds = np.stack(
        [np.searchsorted(of, agents + after) for of in (moved, whose[rows]) for after in (0, 1)], axis=1
    )
    mixture, program = empty_mixture(components, scenario.localisation.lag, draws > 0), program_of(scenario)
    paths = empty_paths(draws, components)
    forward_m = ray_forward_m(scenario)
    for each_m in np.unique(forward_m):  # robots with the same rays together
        of = np.flatnonzero(forward_m[agents % robots] == each_m)
        locate_robots(
            mixture,
            paths,
            program._replace(ray_forward_m=float(each_m)),
            seed,
            robots,
            read_only(agents[of]),
            read_only(poses[of]),
            read_only(bounds[of]),
            True,
            sampled_s[: of.size],
            scenario.tick_s,
            out,
            *(read_only(column) for column in columns),
        )
    return out


def ray_forward_m(scenario: Scenario) -> NDArray[np.float64]:
    """Return how far ahead of its centre each robot's rays begin, m, (robots,)."""
    return np.resize(np.array(scenario.rays.forward_each_m or scenario.rays.forward_m), scenario.swarm.robots)


@lru_cache(maxsize=32)
def speed_law(robot: Robot) -> tuple[float, float]:
    """Return mean and standard deviation of the clipped law of speed factors; of the law, if each robot's is given."""
    from scipy.special import gammaincinv

    factor = robot.speed_factor_scale * gammaincinv(robot.speed_factor_shape, (np.arange(4096) + 0.5) / 4096)
    factor = np.clip(factor + robot.speed_factor_location, robot.speed_factor_min, robot.speed_factor_max)
    return float(factor.mean()), float(factor.std())


def program_of(scenario: Scenario) -> LocalisationProgram:
    """Return what robot 0 knows of itself and of the arena."""
    robot, rays, told = scenario.robot, scenario.rays, scenario.localisation
    errors = GYRO_LEVELS[told.assumed_level] if told.assumed_level else scenario.odometry.errors
    rezero_deg_s = scenario.odometry.rezero_noise_deg_s
    bias_deg_s = errors.bias_deg_s if rezero_deg_s is None else rezero_deg_s
    mean, spread = speed_law(robot)
    threshold_m = min(scenario.walk.avoidance_threshold_mm / 1000.0, rays.range_m)
    angles = np.radians(np.array(rays.angle_deg))
    aside = [
        abs(side + threshold_m * math.sin(angle)) for side, angle in zip(rays.side_m, angles, strict=True)
    ]
    half_width_m = max(*aside, robot.body_radius_m) + rays.disc_radius_m
    density = (scenario.swarm.robots - 1) / (scenario.arena.width_m * scenario.arena.height_m)
    return LocalisationProgram(
        width_m=scenario.arena.width_m,
        height_m=scenario.arena.height_m,
        radius_m=robot.body_radius_m,
        ray_forward_m=rays.forward_m,
        ray_side_m=read_only(np.array(rays.side_m, dtype=np.float64)),
        ray_cos=read_only(np.cos(angles)),
        ray_sin=read_only(np.sin(angles)),
        avoidance_threshold_m=threshold_m,
        blind_s=(scenario.walk.blind_after_turn_ms or 0.0) / 1000.0,
        full_speed_m_s=robot.full_speed_m_s,
        battery_life_s=robot.battery_life_s,
        speed_factor=told.assumed_speed_factor or mean,
        speed_spread=spread if told.assumed_speed_spread is None else told.assumed_speed_spread,
        speed_redrawn=robot.speed_redraw == "sample",
        speed_wander=robot.speed_wander or 0.0,
        gyro_scale_spread=errors.scale,
        gyro_bias_spread_rad_s=math.radians(bias_deg_s),
        turn_noise_rad=math.radians(errors.turn_deg),
        gyro_walk_rad_sqrt_s=math.radians(errors.walk_deg_sqrt_s),
        start_spread_m=told.start_spread_m,
        start_heading_spread_rad=math.radians(told.start_heading_spread_deg),
        start_unknown=told.start == "unknown",
        ray_noise_m=told.ray_noise_m,
        seen_noise_m=told.ray_noise_m + 0.001,
        robots_per_m=told.robots_factor * density * 2.0 * half_width_m * 4.0 / math.pi,
        corrects=told.method != "dead_reckoning",
        monitors=told.monitor,
    )


@kernel
def locate_robots(
    f: Mixture,
    paths: Paths,
    program: LocalisationProgram,
    seed: int,
    robots: int,
    agents: NDArray[np.int64],
    starts: NDArray[np.float64],
    bounds: NDArray[np.int64],
    from_start: bool,
    sampled_s: NDArray[np.float64],
    tick_s: float,
    out: NDArray[np.float64],
    kind: NDArray[np.int64],
    start_s: NDArray[np.float64],
    duration_s: NDArray[np.float64],
    gyro_rad: NDArray[np.float64],
    ray_m: NDArray[np.float64],
    rows: NDArray[np.int64],
    stop_start_s: NDArray[np.float64],
    time_s: NDArray[np.float64],
) -> None:
    """Run the filter of each robot over its moves.

    Args:
        agents: run * robots + robot of each. starts: (agents, 3): true poses at time 0. bounds: (agents, 4): the moves
            of an agent are the rows from the first to the second, its samples in ``rows`` those from the third to the
            fourth. from_start: begin at ``starts``, not where ``f`` is, just after a stop. sampled_s: (agents,): time
            of each one's last sample so far, changed. out: (samples, 9 or more), written. kind to ray_m: (moves,).
            rows: of the other columns, by agent. stop_start_s, time_s: (samples,).
    """
    for e in range(agents.size):
        run, i = agents[e] // robots, agents[e] % robots
        first, end, k, last = bounds[e]
        if from_start:
            begin_robot(f, program, seed, run, i, starts[e, 0], starts[e, 1], starts[e, 2])
            if paths.component.size > 0:
                begin_paths(f, paths, random_word(seed, run, i, OF_PATHS))
            sampled_s[e] = 0.0
        for m in range(first, end):
            if kind[m] == DRIVE:
                at_obstacle = m + 1 < end and kind[m + 1] == AVOID
                drive(f, program, duration_s[m], gyro_rad[m], sampled_s[e], at_obstacle)
            elif kind[m] != STOP:
                if not math.isnan(ray_m[m]):
                    after_drive = m > first and kind[m - 1] == DRIVE and duration_s[m - 1] > 1.5 * tick_s
                    obstacle(f, program, ray_m[m], after_drive)
                turn(f, program, duration_s[m], gyro_rad[m])
            elif k < last and abs(stop_start_s[rows[k]] - start_s[m]) < 0.5 * tick_s:
                if paths.component.size > 0:
                    draw_places(f, program, paths, out[rows[k], 9:])
                sampled(f, program, out[rows[k]])
                sampled_s[e] = time_s[rows[k]]
                k += 1


@inner
def begin_robot(
    f: Mixture,
    program: LocalisationProgram,
    seed: int,
    run: int,
    i: int,
    x_m: float,
    y_m: float,
    heading_rad: float,
) -> None:
    """Begin a robot's filter at its true start, plus the errors with which the robot is told it."""
    x_m += program.start_spread_m * normal(seed, run, i, LOCALISATION, FIRST, OF_TOLD_X)
    y_m += program.start_spread_m * normal(seed, run, i, LOCALISATION, FIRST, OF_TOLD_Y)
    heading_rad += program.start_heading_spread_rad * normal(
        seed, run, i, LOCALISATION, FIRST, OF_TOLD_HEADING
    )
    begin(f, program, random_word(seed, run, i, ALONE), x_m, y_m, heading_rad)


@inner
def random_word(seed: int, run: int, i: int, peer: int) -> int:
    """Return a word from which a robot's random numbers begin, from 1 to 2^32 - 1."""
    return min(1 + int(uniform(seed, run, i, LOCALISATION, FIRST, peer) * 4294967295.0), 4294967295)
