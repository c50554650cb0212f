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

from vibroswarm.core.jit import kernel, read_only, zero_rows
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
from vibroswarm.localisation.odometry import OwnMoves, measure, noticed, odometer_of
from vibroswarm.motion.geometry import wrapped_rad
from vibroswarm.motion.motion_tables import MOVE_ROW, joined
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


def place_frame(samples: pl.DataFrame, estimates: NDArray[np.float64]) -> pl.DataFrame:
    """Convert estimates, (samples, 9), to the table ``PLACES``, null in the lagged columns of first samples."""
    # ``lagged_sample`` is -1 in a robot's first samples, when there is no sample ``lag`` ago yet.
    lagged = pl.when(pl.col("lagged_sample") >= 0.0).then(pl.col("^lagged_.*$"))
    frame = pl.DataFrame(estimates, schema=list(ESTIMATE)).with_columns(lagged)
    return samples.select("run", "robot", "sample").hstack(frame.fill_nan(None)).cast(PLACES)


def is_estimated(scenario: Scenario) -> bool:
    """Return whether robots estimate their places; if not, they know their true places."""
    return scenario.place_method != "true"


def estimates_key(scenario: Scenario, seed: int) -> Hashable:
    """Return a key of all fields but those of motion: equal keys mean equal estimates of one motion."""
    return scenario.odometry, scenario.localisation, scenario.rays.noise_m, seed


def estimate(
    scenario: Scenario,
    seed: int,
    samples: pl.DataFrame,
    stop_start_s: NDArray[np.float64],
    time_s: NDArray[np.float64],
    moves: pl.DataFrame | None,
) -> NDArray[np.float64]:
    """Return the estimates of all robots at all samples. Shapes: ``stop_start_s``, ``time_s`` (samples,)."""
    if moves is None:
        raise InputError(
            "robots that estimate their places need the moves, which this motion lacks; "
            "simulate with moves, or set it to 'true' (true places: an upper bound)",
            field="localisation.method",
        )
    robots, filters = scenario.swarm.robots, PlaceFilters(scenario, seed)
    out = np.full((samples.height, len(ESTIMATE)), np.nan)
    whose, moved = (
        table["run"].to_numpy().astype(np.int64) * robots + table["robot"].to_numpy()
        for table in (samples, moves)
    )
    # samples and moves by agent and, for each agent, in order of time
    rows, order = np.argsort(whose, kind="stable"), np.argsort(moved, kind="stable")
    kind = moves["kind"].to_physical().to_numpy().astype(np.int64)[order]  # indices into walk.KINDS
    start_s, turned_rad, ray_m = (
        moves[name].to_numpy()[order] for name in ("start_s", "turned_rad", "ray_m")
    )
    poses = moves.select("x_m", "y_m", "heading_rad").to_numpy()[order]
    times = read_only(stop_start_s), read_only(time_s)
    agents = np.unique(moved)
    ends = [np.searchsorted(of, (agents, agents + 1)).T for of in (moved[order], whose[rows])]
    for agent, (first, end), of in zip(agents.tolist(), *(each.tolist() for each in ends), strict=True):
        if agent // robots != filters.run:
            filters.begin(agent // robots)
        a, own = slice(first, end), rows[slice(*of)]
        found = noticed(kind[a], start_s[a], turned_rad[a], ray_m[a])
        filters.follow(agent % robots, found, poses[first], own, *times, out)
    return out


class PlaceFilters:
    """The localisation filters of a swarm's robots, each continued at the robot's next sample."""

    def __init__(self, scenario: Scenario, seed: int) -> None:
        """Allocate the filters' memory."""
        self.scenario, self.seed, self.robots, self.run = scenario, seed, scenario.swarm.robots, -1
        # The methods other than "mixture" have a single Gaussian.
        components = scenario.localisation.components if scenario.place_method == "mixture" else 1
        self.memory = [empty_mixture(components, scenario.localisation.lag) for _ in range(self.robots)]
        # The entries of ``rays.forward_each_m`` are repeated if there are fewer than robots, cut if there are more.
        forward_m = np.resize(scenario.rays.forward_each_m or scenario.rays.forward_m, self.robots)
        program, self.odometer = program_of(scenario), odometer_of(scenario)
        self.programs = [program._replace(ray_forward_m=float(each_m)) for each_m in forward_m]

    def begin(self, run: int) -> None:
        """Set the state to the start of a run; ``known`` is that of ``measure`` and the time of the last sample."""
        self.run, self.given = run, [zero_rows(0, MOVE_ROW)]
        self.known, self.stop_tick = np.zeros((self.robots, 4)), [-1] * self.robots

    def add_moves(self, rows: NDArray[np.void]) -> None:
        """Append copies of moves (``MOVE_ROW``); the row added last replaces earlier ones of its robot and tick."""
        self.given.append(rows.copy())

    def locate(
        self,
        robot: NDArray[np.uint16],
        stop_tick: NDArray[np.int64],
        time_s: NDArray[np.float64],
        out: NDArray[np.float64],
    ) -> None:
        """Write the estimates at new samples to ``out``, (samples, 9)."""
        moves, tick_ms = joined(self.given), self.scenario.run.control_period_ms
        times = read_only(stop_tick * tick_ms / 1000.0), read_only(time_s)
        later = np.ones(moves.size, dtype=np.bool_)  # moves to save for later calls
        for i in np.unique(robot).tolist():
            # The filter reads the moves after the robot's previous stop, up to the stop of its last new sample.
            of, mine = np.flatnonzero(robot == i), np.flatnonzero(moves["robot"] == i)
            last, tick = int(stop_tick[of[-1]]), moves["tick"][mine]
            later[mine[tick <= last]] = False
            new = mine[(tick > self.stop_tick[i]) & (tick <= last)]
            new = new[np.argsort(moves["tick"][new], kind="stable")]
            tick = moves["tick"][new]
            # Of several rows of one move, use the row that was added last, which is last in the stable order too.
            rows = moves[new[np.append(tick[1:] != tick[:-1], True)]]
            own = (rows[name].copy() for name in ("turned_rad", "ray_m"))
            found = noticed(rows["kind"].astype(np.int64), rows["tick"] * tick_ms / 1000.0, *own)
            # The heading is wrapped as in the table of moves.
            pose = rows["x_m"][0], rows["y_m"][0], wrapped_rad(float(rows["heading_rad"][0]))
            self.follow(i, found, np.array(pose), of, *times, out)
            self.stop_tick[i] = last
        self.given = [moves[later]]

    def follow(
        self,
        i: int,
        moves: OwnMoves,
        pose: NDArray[np.float64],
        rows: NDArray[np.int64],
        stop_s: NDArray[np.float64],
        time_s: NDArray[np.float64],
        out: NDArray[np.float64],
    ) -> None:
        """Continue the filter of robot ``i`` over new moves, and write its estimates to ``out``, (samples, 9)."""
        memory, program, known, run = self.memory[i], self.programs[i], self.known[i], self.run
        if known[2] == 0.0:
            begin_robot(memory, program, self.seed, run, i, pose)
        measure(self.odometer, moves, known, self.seed, run, i)
        follow_moves(
            memory, program, moves, known, self.scenario.tick_s, read_only(rows), stop_s, time_s, out
        )


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
    """Return what the filters of all robots assume about robot and arena."""
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
def follow_moves(
    f: Mixture,
    program: LocalisationProgram,
    moves: OwnMoves,
    known: NDArray[np.float64],
    tick_s: float,
    rows: NDArray[np.int64],
    stop_start_s: NDArray[np.float64],
    time_s: NDArray[np.float64],
    out: NDArray[np.float64],
) -> None:
    """Run a robot's filter over its moves, and write its estimates at samples to ``out``, (samples, 9)."""
    kind, start_s, duration_s, gyro_rad, ray_m = moves
    k = 0
    for m in range(kind.size):
        if kind[m] == DRIVE:
            at_obstacle = m + 1 < kind.size and kind[m + 1] == AVOID
            drive(f, program, duration_s[m], gyro_rad[m], known[3], at_obstacle)
        elif kind[m] != STOP:  # a turn or an avoidance
            if not math.isnan(ray_m[m]):
                # A drive of a single tick before the avoidance does not count: the robot has hardly moved in it.
                after_drive = m > 0 and kind[m - 1] == DRIVE and duration_s[m - 1] > 1.5 * tick_s
                obstacle(f, program, ray_m[m], after_drive)
            turn(f, program, duration_s[m], gyro_rad[m])
        # A stop. It belongs to the next sample if it began at the time that the sample states; robots also stop for
        # other reasons, and at the end.
        elif k < rows.size and abs(stop_start_s[rows[k]] - start_s[m]) < 0.5 * tick_s:
            sampled(f, program, out[rows[k]])
            known[3] = time_s[rows[k]]
            k += 1


@kernel
def begin_robot(
    f: Mixture, program: LocalisationProgram, seed: int, run: int, i: int, pose: NDArray[np.float64]
) -> None:
    """Start the filter of robot ``i`` at its true pose at time 0 plus normal errors."""
    x_m = pose[0] + program.start_spread_m * normal(seed, run, i, LOCALISATION, FIRST, OF_TOLD_X)
    y_m = pose[1] + program.start_spread_m * normal(seed, run, i, LOCALISATION, FIRST, OF_TOLD_Y)
    heading_rad = pose[2] + program.start_heading_spread_rad * normal(
        seed, run, i, LOCALISATION, FIRST, OF_TOLD_HEADING
    )
    # The state of the robot's random numbers is other than 0; the limit is for uniform numbers that round to 1.
    u = uniform(seed, run, i, LOCALISATION, FIRST, ALONE)
    begin(f, program, min(1 + int(u * 4294967295.0), 4294967295), x_m, y_m, heading_rad)
