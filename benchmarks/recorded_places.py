"""Measure how well robots would have found their places in the recorded sessions: settings of two, errors on the third.

    VIBROSWARM_RUGBOT=folder python benchmarks/recorded_places.py --noises 10

The logs hold marker positions at 4.5 Hz, times of samples, and the time spent avoiding between samples; no headings, no
gyro, no rays. Rebuilt are, from the corrected positions (``calibrate.fit_camera``):

- drives: steps faster than 0.62 of the robot's median; the steps at both ends count in proportion to their length, so
  that times are finer than 0.22 s. Courses at both ends: a line through the courses of the steps.
- turns: what is between drives, but for samples. Avoidance: in an interval whose counter of avoidance has grown, the
  gaps after drives with the nearest wall along a ray, or robot, until the time avoided is used up.
- the ray: theta_c, since avoidance begins when a ray falls below it.

Then the gyro is simulated (its errors drawn anew ``--noises`` times, by seed), and the filter runs as in a simulation.
Speed law, battery, rays and camera are those of the two other sessions, each session in turn; so are the two settings
that the filter needs more (``GRID``), by the median error in these two. Truth is where the camera saw the robot stand,
corrected. "As simulated": with the settings of simulations (rays of 4 mm).
"""

from __future__ import annotations

import argparse
import os
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from vibroswarm.calibrate.camera import Camera, corrected
from vibroswarm.calibrate.dataset import dataset_of
from vibroswarm.calibrate.fit_camera import fit_camera
from vibroswarm.calibrate.fit_drive import fit_drive
from vibroswarm.calibrate.fit_rays import fit_rays
from vibroswarm.localisation.locate import estimate
from vibroswarm.motion.source import MOVES
from vibroswarm.paper.real_data import REAL, read_recordings
from vibroswarm.recordings.recording import Recording
from vibroswarm.scenario.scenario import Scenario, preset

DRIVES = 0.62
"""Share of the usual speed above which a step is driving (as in ``calibrate.wall_approach``)."""
LEAST_S = 0.02
BASE = preset("paper-empirical")


@dataclass
class Drive:
    """One drive: from when to when, courses at both ends, rad, and places at both ends, m."""

    start_s: float
    end_s: float
    first_rad: float
    last_rad: float
    first_m: tuple[float, float]
    last_m: tuple[float, float]


@dataclass
class Moves:
    """Rows of the table of moves of one robot, and its samples: stop_start_s, time_s, x, y where it stood."""

    rows: list[dict[str, Any]] = field(default_factory=list)
    samples: list[tuple[float, float, float, float]] = field(default_factory=list)


def drives_of(track: np.ndarray) -> list[Drive]:
    """Return the drives of a robot's path, (positions, 3): s, m, m."""
    time, x, y = track.T
    dt, dx, dy = np.diff(time), np.diff(x), np.diff(y)
    length = np.hypot(dx, dy)
    speed = length / np.maximum(dt, 1e-6)
    usual = float(np.median(speed[speed > 0.02]))
    driving = (speed > DRIVES * usual) & (dt < 0.5)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], driving.astype(int), [0]])))
    found: list[Drive] = []
    for a, b in zip(edges[::2], edges[1::2], strict=True):  # steps a to b - 1
        course = np.unwrap(np.arctan2(dy[a:b], dx[a:b]))
        middle = (time[a:b] + time[a + 1 : b + 1]) / 2
        inner = speed[a + 1 : b - 1] if b - a > 2 else speed[a:b]
        cruise = float(np.median(inner))
        start, end = time[a], time[b]
        if b - a > 2:  # the first and last step may be partly driven
            start, end = time[a + 1] - length[a] / cruise, time[b - 1] + length[b - 1] / cruise
        if a > 0 and not driving[a - 1] and length[a - 1] > 0.003:
            start -= min(length[a - 1] / cruise, dt[a - 1])
        if b < dt.size and length[b] > 0.003:
            end += min(length[b] / cruise, dt[b])
        slope, at = (np.polyfit(middle, course, 1)) if b - a >= 4 else (0.0, float(course.mean()))
        first, last = slope * start + at, slope * end + at
        if found and start <= found[-1].end_s:
            start = found[-1].end_s + LEAST_S
        if end - start > 0.1:
            found.append(
                Drive(float(start), float(end), float(first), float(last), (x[a], y[a]), (x[b], y[b]))
            )
    return found


def wrapped(angle: float) -> float:
    """Return an angle in [-pi, pi)."""
    return (angle + np.pi) % (2 * np.pi) - np.pi


def clearance(drive: Drive, others: list[np.ndarray], scenario: Scenario, forward_m: float) -> float:
    """Return how far the next wall along a ray, or robot, is at the end of a drive, m."""
    (x, y), heading = drive.last_m, drive.last_rad
    near = []
    for side_m, angle_deg in zip(scenario.rays.side_m, scenario.rays.angle_deg, strict=True):
        of_x = x + forward_m * np.cos(heading) - side_m * np.sin(heading)
        of_y = y + forward_m * np.sin(heading) + side_m * np.cos(heading)
        dx, dy = np.cos(heading + np.radians(angle_deg)), np.sin(heading + np.radians(angle_deg))
        near += [((d > 0) - of) / d for d, of in ((dx, of_x), (dy, of_y)) if abs(d) > 1e-9]
    reach_m = forward_m + scenario.rays.disc_radius_m
    for other in others:
        at = (np.interp(drive.end_s, other[:, 0], other[:, k]) for k in (1, 2))
        near.append(float(np.hypot(*(a - b for a, b in zip(at, (x, y), strict=True)))) - reach_m)
    return min(near)


def moves_of(
    track: np.ndarray, samples: np.ndarray, others: list[np.ndarray], scenario: Scenario, robot: int
) -> Moves:
    """Rebuild a robot's moves.

    Args:
        samples: (samples, 3): stop_start_s, time_s, avoid_s since the sample before.
    """
    drives, out = drives_of(track), Moves()
    ray_m = scenario.walk.avoidance_threshold_mm / 1000.0
    forward_m = (scenario.rays.forward_each_m or (scenario.rays.forward_m,))[robot]
    gaps = [(one.end_s, next_one.start_s, k) for k, (one, next_one) in enumerate(pairwise(drives))]
    avoided: dict[int, bool] = {}  # gap: whether avoidance began after a stop in it
    before_s = 0.0
    for stop_s, time_s, avoid_s in samples:
        left_s = avoid_s
        inside = []
        for start_s, end_s, k in gaps:
            if before_s <= start_s < stop_s - 0.1:
                inside.append((k, min(end_s, stop_s) - start_s, False))
            elif start_s < before_s and before_s + 0.1 < end_s < stop_s:
                inside.append((k, end_s - before_s, True))
        for k, lasting_s, after_stop in sorted(
            inside, key=lambda gap: clearance(drives[gap[0]], others, scenario, forward_m)
        ):
            if left_s < 0.1:
                break
            if lasting_s > 0.1 and k not in avoided:
                avoided[k] = after_stop
                left_s -= lasting_s
        before_s = time_s

    def add(start_s: float, kind: str, turned: float, ray: float | None = None) -> None:
        out.rows.append({"start_s": start_s, "kind": kind, "turned_rad": turned, "ray_m": ray})

    begins = drives[0].start_s
    for k, one in enumerate(drives):
        add(one.start_s, "drive", one.last_rad - one.first_rad)
        if k + 1 == len(drives):
            break
        following = drives[k + 1]
        turned = wrapped(following.first_rad - one.last_rad)
        at = one.end_s
        stood = [
            s
            for s in samples
            if one.end_s - 0.3 < (s[0] + s[1]) / 2 < following.start_s + 0.1 and s[0] > begins
        ]
        is_avoiding = k in avoided
        if not stood:
            add(at, "avoid" if is_avoiding else "turn", turned, ray_m if is_avoiding else None)
            continue
        late = avoided.get(k, False)
        stop_s, time_s, _ = stood[0]
        stop_s = max(at, min(stop_s, following.start_s - 2 * LEAST_S))
        time_s = min(max(time_s, stop_s + LEAST_S), following.start_s - LEAST_S)
        before = stop_s - at > following.start_s - time_s
        if is_avoiding and not late:
            stop_s = max(stop_s, at + LEAST_S)
            time_s = max(time_s, stop_s + LEAST_S)
            add(at, "avoid", turned if before else 0.0, ray_m)
        elif stop_s - at > LEAST_S:
            add(at, "turn", turned if before else 0.0)
        else:
            stop_s, before = at, False
        add(stop_s, "stop", 0.0)
        seen = (track[:, 0] > stop_s + 0.1) & (track[:, 0] < time_s + 0.1)
        place = np.median(track[seen, 1:], axis=0) if seen.any() else np.array(one.last_m)
        out.samples.append((stop_s, time_s, float(place[0]), float(place[1])))
        add(time_s, "avoid" if late else "turn", 0.0 if before else turned, ray_m if late else None)
    first = drives[0]
    out.rows[0] |= {"x_m": first.first_m[0], "y_m": first.first_m[1], "heading_rad": first.first_rad}
    return out


def motion_of(session: Recording, scenario: Scenario) -> tuple[pl.DataFrame, pl.DataFrame, pl.DataFrame]:
    """Return samples (with the times and places rebuilt), moves and ends of one session, run 0."""
    run = session.runs["run"][0]
    robots = session.scenario.swarm.robots
    tracks = [
        session.tracks.filter((pl.col("run") == run) & (pl.col("robot") == i))
        .select("time_s", "x_m", "y_m")
        .to_numpy()
        for i in range(robots)
    ]
    rows, samples, ends = [], [], []
    for i in range(robots):
        own = session.motion.filter((pl.col("run") == run) & (pl.col("robot") == i)).sort("time_s")
        table = own.select("stop_start_s", "time_s", pl.col("avoid_s").fill_null(0.0)).to_numpy()
        moves = moves_of(tracks[i], table, tracks[:i] + tracks[i + 1 :], scenario, i)
        blank = {"x_m": 0.0, "y_m": 0.0, "heading_rad": 0.0, "speed_m_s": 0.0, "turn_rate_rad_s": 0.0}
        rows += [{"run": 0, "robot": i, **blank, **row} for row in moves.rows]
        samples += [
            {"run": 0, "robot": i, "sample": n, "stop_start_s": a, "time_s": b, "x_m": x, "y_m": y}
            for n, (a, b, x, y) in enumerate(moves.samples)
        ]
        ends.append({"run": 0, "robot": i, "end_s": moves.rows[-1]["start_s"] + 1.0})
    kinds = {"run": pl.UInt32, "robot": pl.UInt16, "sample": pl.UInt32}
    return (
        pl.DataFrame(samples)
        .cast({k: v for k, v in kinds.items() if k in samples[0]})
        .sort("time_s", "robot"),  # type: ignore[arg-type]
        pl.DataFrame(rows)
        .select(pl.col(n).cast(k) for n, k in MOVES.items())
        .sort("run", "start_s", "robot"),
        pl.DataFrame(ends).cast({"run": pl.UInt32, "robot": pl.UInt16}),
    )


def fitted(folder: Path, names: tuple[str, ...]) -> tuple[Camera, dict[str, Any]]:
    """Return camera and settings of some sessions."""
    found = dataset_of([read_recordings(folder, names)])
    camera = fit_camera(found, draws=2).camera
    found = found.corrected(camera)
    drive, sight = fit_drive(found, BASE), fit_rays(found, BASE, draws=2)
    changed = {name: value for name, value in drive.fields(BASE).items() if value is not None}
    for name in ("robot.speed_factors", "robot.misalignments"):
        changed.pop(name, None)
    changed |= sight.fields(BASE)
    # Rebuilt drives last as long as the path is driven at speed: no loss at starts and stops.
    full = BASE.robot.full_speed_m_s
    changed["localisation.assumed_speed_factor"] = drive.values["start_speed_m_s"] / full
    changed["localisation.assumed_speed_spread"] = drive.values["between_m_s"] / full
    return camera, changed


def errors_of(
    scenario: Scenario, seed: int, samples: pl.DataFrame, moves: pl.DataFrame, ends: pl.DataFrame
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return, for each smoothed place, its error, m, the errors in x and y in units of their spread, and the robot."""
    columns = [samples[name].to_numpy() for name in ("stop_start_s", "time_s")]
    found = estimate(scenario, seed, samples, *columns, moves, ends)
    late = np.isfinite(found[:, 4]) & (found[:, 4] >= 0)
    robot, number = samples["robot"].to_numpy(), samples["sample"].to_numpy()
    x, y = samples["x_m"].to_numpy(), samples["y_m"].to_numpy()
    row = {(int(i), int(n)): k for k, (i, n) in enumerate(zip(robot, number, strict=True))}
    source = np.array([row[int(i), int(n)] for i, n in zip(robot[late], found[late, 4], strict=True)])
    dx, dy = found[late, 5] - x[source], found[late, 6] - y[source]
    z = np.concatenate([dx / np.hypot(found[late, 7], 0.002), dy / np.hypot(found[late, 8], 0.002)])
    return np.hypot(dx, dy), z, robot[late]


GRID: tuple[dict[str, Any], ...] = tuple(
    {"localisation.ray_noise_m": noise_m, "localisation.robots_factor": factor}
    for noise_m in (0.01, 0.015, 0.02, 0.03)
    for factor in (6.0, 2.0, 1.0, 0.5)
)
OF_SIMULATIONS: dict[str, Any] = {"localisation.ray_noise_m": 0.004, "localisation.robots_factor": 6.0}
BOUGHT = {"odometry.level": "bought"}
CASES: tuple[tuple[str, dict[str, Any]], ...] = (
    ("mixture, good gyro", {}),
    ("as simulated, good gyro", OF_SIMULATIONS),
    ("mixture of 64, good gyro", {"localisation.components": 64}),
    ("mixture, poor gyro", {"odometry.level": "poor"}),
    ("Kalman filter, good gyro", {"localisation.method": "kalman"}),
    ("dead reckoning, good gyro", {"localisation.method": "dead_reckoning"}),
    ("as bought, re-zeroed to 0.1 deg/s", BOUGHT | {"odometry.rezero_noise_deg_s": 0.1}),
    ("as bought, re-zeroed to 1 deg/s", BOUGHT | {"odometry.rezero_noise_deg_s": 1.0}),
    ("as bought, never re-zeroed", BOUGHT),
)


def trained(settings: dict[str, Any], others: list[tuple[pl.DataFrame, pl.DataFrame, pl.DataFrame]]) -> float:
    """Return the median place error of some sessions at these settings, m."""
    scenario = BASE.with_values({"localisation.method": "mixture"} | settings)
    return float(np.median(np.concatenate([errors_of(scenario, 101, *tables)[0] for tables in others])))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--noises", type=int, default=10, help="draws of the gyro's errors")
    given = parser.parse_args()
    folder = Path(os.environ["VIBROSWARM_RUGBOT"])
    print("| session held out | case | median cm | 90 % below cm | over 20 cm | robots lost | rms z (all) |")
    pooled: dict[str, list[np.ndarray]] = {}
    for held in REAL:
        camera, settings = fitted(folder, tuple(name for name in REAL if name != held))
        session = corrected(read_recordings(folder, (held,)), camera)
        samples, moves, ends = motion_of(session, BASE.with_values(settings))
        others = [
            motion_of(corrected(read_recordings(folder, (name,)), camera), BASE.with_values(settings))
            for name in REAL
            if name != held
        ]
        settings |= min(GRID, key=lambda tried: trained(settings | tried, others))
        avoiding = moves.filter(pl.col("ray_m").is_not_null()).height
        print(
            f"# {held}: magnification {camera.magnification:.3f}, {samples.height} samples, {avoiding} obstacles"
        )
        print("#", {k: v for k, v in settings.items() if "localis" in k or "rays" in k})
        for name, values in CASES:
            scenario = BASE.with_values({"localisation.method": "mixture"} | settings | values)
            error, z, lost = [], [], []
            for seed in range(1, given.noises + 1):
                e, units, robot = errors_of(scenario, seed, samples, moves, ends)
                error.append(e)
                z.append(units)
                lost += [np.median(e[robot == i][-40:]) > 0.2 for i in np.unique(robot)]
            every, units = np.concatenate(error), np.concatenate(z) ** 2
            pooled.setdefault(name, []).append(every)
            trimmed = np.sqrt(np.sort(units)[: int(0.99 * units.size)].mean())
            print(
                f"| {held} | {name} | {100 * np.median(every):.1f} | {100 * np.quantile(every, 0.9):.1f} | "
                f"{100 * (every > 0.2).mean():.0f} % | {100 * np.mean(lost):.0f} % | "
                f"{trimmed:.1f} ({np.sqrt(units.mean()):.1f}) |",
                flush=True,
            )
    for name, parts in pooled.items():
        print(f"all sessions, {name}: median {100 * np.median(np.concatenate(parts)):.1f} cm")


if __name__ == "__main__":
    main()
