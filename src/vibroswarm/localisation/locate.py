"""Where each robot believes it is when it samples: ``robot.localisation`` applied to what the robot measured of its
moves.

The estimates depend on motion and odometry only, so they are computed once for all floors, sensors, strategies and
networks. A row is what the robot believes when it takes a sample; later moves do not change it. An "agent" is a robot
in one run; its number is run * robots + robot.

| name | equation |
|---|---|
| mean, standard deviation of s_d as assumed | those of the clipped Gamma law, or ``localisation.assumed_speed_*`` |
| density of meeting robots, 1/m | 6 (n - 1) / area * 2 half-width * 4 / pi |

A robot that drives straight among n - 1 robots of the same speed meets (n - 1) / area * 2 half-width * 4 / pi of them
per m. The half-width is that of the robot's rays at their threshold, plus that of a robot as rays see it. The factor
of 6, ``ROBOTS_FACTOR``, allows for repeated meetings, as robots turn away from each other: the filter is careful.
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
    OF_TOLD_HEADING,
    OF_TOLD_X,
    OF_TOLD_Y,
    normal,
    uniform,
)
from vibroswarm.errors import InputError
from vibroswarm.localisation.odometry import measure_moves
from vibroswarm.motion.motion_tables import Motion
from vibroswarm.robot.localisation import drive, obstacle, sampled, turn
from vibroswarm.robot.pose_mixture import ESTIMATE, LocalisationProgram, Mixture, begin, empty_mixture
from vibroswarm.robot.walk import AVOID, DRIVE, STOP
from vibroswarm.scenario.fields import Robot
from vibroswarm.scenario.localisation_fields import GYRO_LEVELS
from vibroswarm.scenario.scenario import Scenario

ROBOTS_FACTOR: Final = 6.0
"""Factor by which robots assume to meet more robots than chords of straight drives would."""
PLACES: Final[Any] = {
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
"""Columns of the table of places: where a robot believes it is when it takes a sample, with the standard deviation. The
columns ``lagged_*`` are the number, place and standard deviations of the sample ``localisation.lag`` ago, corrected by
what the robot met since; they are null for the robot's first samples, before which there are not so many."""


def locate(scenario: Scenario, seed: int, motion: Motion) -> pl.DataFrame:
    """Return the table of where each robot believes it is at each sample (``PLACES``).

    Args:
        seed: seed of the runs. motion: tables of samples, moves and ends; the rows of the result are in the order of
            its samples.

    Raises:
        InputError: the motion has no table of moves.
    """
    samples = motion.samples
    stop_start_s, time_s = (samples[name].to_numpy() for name in ("stop_start_s", "time_s"))
    estimates = estimate(scenario, seed, samples, stop_start_s, time_s, motion.moves, motion.ends)
    return place_frame(samples, estimates)


def place_frame(samples: pl.DataFrame, estimates: NDArray[np.float64]) -> pl.DataFrame:
    """Convert estimates to a table (``PLACES``), with null in the lagged columns of a robot's first samples.

    Args:
        samples: run, robot and sample of each row. estimates: (samples, 9): columns of ``ESTIMATE``.
    """
    # ``lagged_sample`` is -1 in a robot's first samples, when there is no sample ``lag`` ago yet.
    lagged = pl.when(pl.col("lagged_sample") >= 0.0).then(pl.col("^lagged_.*$"))
    frame = pl.DataFrame(estimates, schema=list(ESTIMATE)).with_columns(lagged)
    return samples.select("run", "robot", "sample").hstack(frame.fill_nan(None)).cast(PLACES)


def is_estimated(scenario: Scenario) -> bool:
    """Return whether robots estimate their places; if not, they know their true places."""
    return scenario.place_method != "true"


def estimates_key(scenario: Scenario, seed: int) -> Hashable:
    """Return a key under which the estimates for one motion can be cached: equal keys mean equal estimates.

    It leaves out the motion, and all fields that determine the motion.
    """
    return scenario.odometry, scenario.localisation, scenario.rays.noise_m, seed


def estimate(
    scenario: Scenario,
    seed: int,
    samples: pl.DataFrame,
    stop_start_s: NDArray[np.float64],
    time_s: NDArray[np.float64],
    moves: pl.DataFrame | None,
    ends: pl.DataFrame,
) -> NDArray[np.float64]:
    """Return the estimates of all robots at all samples.

    Args:
        samples: table with run and robot of each sample; each robot's samples are in order of time.
        stop_start_s, time_s: (samples,): when the robot stopped for the sample, and when it took it. moves, ends:
            tables of the motion; ``moves`` is sorted by run and start.
    Returns: (samples, 9): the columns of ``ESTIMATE``; the number of the lagged sample is -1 where there is none. A
        robot's rows are nan from the first sample on whose stop is not among the moves.
    Raises:
        InputError: the motion has no table of moves.
    """
    if moves is None:
        raise InputError(
            "robots that estimate their places need the moves, which this motion lacks; "
            "simulate with moves, or set it to 'true' (true places: an upper bound)",
            field="localisation.method",
        )
    robots = scenario.swarm.robots
    odometer = measure_moves(scenario, seed, moves, ends)
    # Each robot's first move begins at its pose at time 0.
    starts = moves.group_by("run", "robot", maintain_order=True).first().sort("run", "robot")
    out = np.full((samples.height, len(ESTIMATE)), np.nan)
    # Agent of each sample (``whose``), of each row of the odometer (``moved``), and all agents in order.
    whose = samples["run"].to_numpy().astype(np.int64) * robots + samples["robot"].to_numpy()
    rows = np.argsort(whose, kind="stable")  # samples by agent and, for each agent, in order of time
    moved = odometer["run"].to_numpy().astype(np.int64) * robots + odometer["robot"].to_numpy()
    agents = starts["run"].to_numpy().astype(np.int64) * robots + starts["robot"].to_numpy()
    kind = odometer["kind"].to_physical().to_numpy().astype(np.int64)  # indices into walk.KINDS
    # The last arguments of ``locate_robots``, in its order.
    columns = [kind, *(odometer[name].to_numpy() for name in ("start_s", "duration_s", "gyro_rad", "ray_m"))]
    columns += [rows, stop_start_s, time_s]
    poses = starts.select("x_m", "y_m", "heading_rad").to_numpy(order="c")
    sampled_s = np.zeros(agents.size)
    # Columns of bounds: first and end of the agent's moves in the odometer, first and end of its samples in ``rows``.
    # The agents are sorted in both, so each range begins where the agent and ends where agent + 1 would be inserted.
    bounds = np.stack(
        [np.searchsorted(of, agents + after) for of in (moved, whose[rows]) for after in (0, 1)], axis=1
    )
    memory, program, forward_m = empty_memory(scenario), program_of(scenario), ray_forward_m(scenario)
    # Robots whose rays begin equally far ahead have the same program, so they are one call. of: indices of their agents
    # in ``agents``.
    for each_m in np.unique(forward_m):
        of = np.flatnonzero(forward_m[agents % robots] == each_m)
        locate_robots(
            memory,
            program._replace(ray_forward_m=float(each_m)),
            seed,
            robots,
            read_only(agents[of]),
            read_only(poses[of]),
            read_only(bounds[of]),
            True,  # from the start of each agent
            sampled_s[: of.size],  # overwritten from the start of each agent, and not used here
            scenario.tick_s,
            out,
            *(read_only(column) for column in columns),
        )
    return out


def empty_memory(scenario: Scenario) -> Mixture:
    """Allocate the memory of one robot's filter."""
    # The methods other than "mixture" have a single Gaussian.
    components = scenario.localisation.components if scenario.place_method == "mixture" else 1
    return empty_mixture(components, scenario.localisation.lag)


def ray_forward_m(scenario: Scenario) -> NDArray[np.float64]:
    """Return how far ahead of its centre each robot's rays begin, m, (robots,).

    They are the entries of ``rays.forward_each_m``, repeated if there are fewer than robots, cut if there are more.
    Without that list, each is ``rays.forward_m``.
    """
    return np.resize(np.array(scenario.rays.forward_each_m or scenario.rays.forward_m), scenario.swarm.robots)


@lru_cache(maxsize=32)
def speed_law(robot: Robot) -> tuple[float, float]:
    """Return the mean and the standard deviation of the clipped Gamma law of speed factors.

    If the scenario lists each robot's factor, the law is used all the same, as robots do not know their own factors.
    Nor do they know how much faster or slower they are in this run: ``robot.speed_run_spread`` widens the law.
    """
    # Imported here, because the import takes a third of a second and only this function needs it.
    from scipy.special import gammaincinv

    # The moments are computed from 4096 quantiles of the law, at the midpoints of equal shares.
    factor = robot.speed_factor_scale * gammaincinv(robot.speed_factor_shape, (np.arange(4096) + 0.5) / 4096)
    factor = np.clip(factor + robot.speed_factor_location, robot.speed_factor_min, robot.speed_factor_max)
    if robot.speed_run_spread:
        # Each quantile times 65 quantiles of the triangular factor of mean 1: those below its middle, and by symmetry
        # those above it. The sum of two uniform numbers is below x < 1 with probability x^2 / 2.
        below = np.sqrt(2.0 * (np.arange(32) + 0.5) / 65) - 1.0
        of_run = 1.0 + robot.speed_run_spread * np.sqrt(6.0) * np.concatenate((below, [0.0], -below))
        factor = np.clip(np.outer(of_run, factor), robot.speed_factor_min, robot.speed_factor_max)
    return float(factor.mean()), float(factor.std())


def program_of(scenario: Scenario) -> LocalisationProgram:
    """Return what the filters of all robots assume about robot and arena.

    Only ``ray_forward_m`` may differ between robots (``ray_forward_m`` of this module); here it is the scenario's
    common value.
    """
    # told: the scenario's settings of what the robots assume
    robot, rays, told = scenario.robot, scenario.rays, scenario.localisation
    errors = GYRO_LEVELS[told.assumed_level] if told.assumed_level else scenario.odometry.errors
    rezero_deg_s = scenario.odometry.rezero_noise_deg_s
    # A robot that measures its gyro's bias at stops subtracts it, so that only the error of the measurement remains.
    bias_deg_s = errors.bias_deg_s if rezero_deg_s is None else rezero_deg_s
    mean, spread = speed_law(robot)
    threshold_m = min(scenario.walk.avoidance_threshold_mm / 1000.0, rays.range_m)
    angles = [math.radians(angle) for angle in rays.angle_deg]
    # How far to the side of the robot's axis each ray is at the length at which the robot avoids.
    aside = [
        abs(side + threshold_m * math.sin(angle)) for side, angle in zip(rays.side_m, angles, strict=True)
    ]
    half_width_m = max(*aside, robot.body_radius_m) + rays.disc_radius_m  # see the module's docstring
    density = (scenario.swarm.robots - 1) / (scenario.arena.width_m * scenario.arena.height_m)
    return LocalisationProgram(
        width_m=scenario.arena.width_m,
        height_m=scenario.arena.height_m,
        radius_m=robot.body_radius_m,
        ray_forward_m=rays.forward_m,
        ray_side_m=read_only(np.array(rays.side_m, dtype=np.float64)),
        ray_cos=read_only(np.array([math.cos(angle) for angle in angles])),
        ray_sin=read_only(np.array([math.sin(angle) for angle in angles])),
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
        ray_noise_m=told.ray_noise_m,
        # Noise of the bounds "no ray saw a wall" and "inside the arena": 1 mm more than that of a measured ray, about
        # the way that a robot drives between two readings of its rays.
        seen_noise_m=told.ray_noise_m + 0.001,
        robots_per_m=ROBOTS_FACTOR * density * 2.0 * half_width_m * 4.0 / math.pi,
        corrects=scenario.place_method != "dead_reckoning",
        monitors=told.monitor,
    )


@kernel
def locate_robots(
    f: Mixture,
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
    """Run the filter of each agent over its moves, one agent after the other, and write its estimates at samples.

    Args:
        f: memory of one robot's filter, reused for each agent, changed. program: what the
            filters of all these agents assume. seed: seed of the runs. robots: number of robots of the swarm.
        agents: (agents,): run * robots + robot of each agent. starts: (agents, 3): true poses at time 0: x, y, heading.
        bounds: (agents, 4): first and end of each agent's moves, and first and end of its samples in ``rows``.
        from_start: whether the filters begin at ``starts``. If false, there is a single agent; ``f`` is its
            memory as an earlier call left it, after a stop, and are continued.
        sampled_s: (agents,): time of each agent's last sample so far, changed. tick_s: control period.
        out: (samples, 9), written: estimates (``estimate``).
        kind, start_s, duration_s, gyro_rad, ray_m: (moves,): columns of ``odometry.ODOMETER``, in which ``kind`` is an
            index into ``walk.KINDS`` and ``ray_m`` is nan where no avoidance began.
        rows: indices of samples, agent by agent, in order of time. Each sample's stop must be among its agent's moves:
            from the first sample on whose stop is missing, the agent's rows of ``out`` are not written.
        stop_start_s, time_s: (samples,): when the robot stopped for the sample, and when it took it.
    """
    for e in range(agents.size):
        run, i = agents[e] // robots, agents[e] % robots
        first, end, k, last = bounds[e]
        if from_start:
            begin_robot(f, program, seed, run, i, starts[e, 0], starts[e, 1], starts[e, 2])
            sampled_s[e] = 0.0
        for m in range(first, end):
            if kind[m] == DRIVE:
                at_obstacle = m + 1 < end and kind[m + 1] == AVOID
                drive(f, program, duration_s[m], gyro_rad[m], sampled_s[e], at_obstacle)
            elif kind[m] != STOP:  # a turn or an avoidance
                if not math.isnan(ray_m[m]):
                    # A drive of a single tick before the avoidance does not count: the robot has hardly moved in it.
                    after_drive = m > first and kind[m - 1] == DRIVE and duration_s[m - 1] > 1.5 * tick_s
                    obstacle(f, program, ray_m[m], after_drive)
                turn(f, program, duration_s[m], gyro_rad[m])
            # A stop. It belongs to the next sample if it began at the time that the sample states; robots also stop for
            # other reasons, and at the end.
            elif k < last and abs(stop_start_s[rows[k]] - start_s[m]) < 0.5 * tick_s:
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
    """Start the filter of robot ``i`` at the pose at which the robot assumes that it starts.

    That pose is its true pose at time 0 (``x_m``, ``y_m``, ``heading_rad``) plus normal errors.
    """
    x_m += program.start_spread_m * normal(seed, run, i, LOCALISATION, FIRST, OF_TOLD_X)
    y_m += program.start_spread_m * normal(seed, run, i, LOCALISATION, FIRST, OF_TOLD_Y)
    heading_rad += program.start_heading_spread_rad * normal(
        seed, run, i, LOCALISATION, FIRST, OF_TOLD_HEADING
    )
    begin(f, program, random_word(seed, run, i), x_m, y_m, heading_rad)


@inner
def random_word(seed: int, run: int, i: int) -> int:
    """Return the first state of the random number generator of robot ``i``, from 1 to 2^32 - 1."""
    # The generator needs a state other than 0; the limit is for uniform numbers that round to 1.
    return min(1 + int(uniform(seed, run, i, LOCALISATION, FIRST, ALONE) * 4294967295.0), 4294967295)
