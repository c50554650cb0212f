"""Compare places and decisions of the exported robots in double, mixed and single precision, on the same measurements.

    PYTHONPATH=tests python benchmarks/single_precision.py --runs 100 --seed 9501

Moves, gyro and readings are those of the simulation (`paper`, good gyro, floors of 12 and 13 vibrating tiles of 25,
v = 1); each robot is the C program of ``vibroswarm export c``, compiled for this machine. Mixed: arrays of 4 bytes,
computed with 8. Messages are heard a control period after they are sent. A line: median error of the smoothed place
and share off by over 20 cm; decision time s/% wrong/% undecided; and beside double: median distance of the places, 90 %
below, share over 5 cm, and share of robots that decide otherwise.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from helpers.exported_robots import (
    HEAR,
    MOVED,
    SAMPLE,
    START,
    STOPPED,
    TICK,
    TOLD,
    built,
    message_fields,
    run_program,
)
from vibroswarm.localisation.odometry import known_moves, measure_moves
from vibroswarm.motion.source import source
from vibroswarm.observation.observe import observe
from vibroswarm.robot.walk import AVOID, DRIVE, STOP
from vibroswarm.scenario.scenario import Scenario, preset
from vibroswarm.simulation import floors_of

FLOORS = ((0.48, 0), (0.52, 1))
PRECISIONS = {"double": 3, "mixed": 2, "single": 1}
ESTIMATES, HEAD = 9, 6
Array = NDArray[np.float64]
Events = list[tuple[int, list[float]]]
"""What a robot is fed up to a tick."""


def fed(
    scenario: Scenario, seed: int, runs: int
) -> tuple[Any, dict[tuple[int, int], Events], dict[Any, Array]]:
    """Return the motion, what each robot is fed by its moves and samples (readings are 0), and true places."""
    motion = source("event").batch(scenario, seed, range(runs), False, True)
    moves = known_moves(motion.moves)
    odometer = measure_moves(scenario, seed, moves, motion.ends)
    starts = moves.group_by("run", "robot", maintain_order=True).first()
    poses = {
        (row[0], row[1]): row[2:] for row in starts.select("run", "robot", "x_m", "y_m", "heading_rad").rows()
    }
    samples = motion.samples.partition_by("run", "robot", as_dict=True)
    events: dict[tuple[int, int], Events] = {}
    true: dict[Any, Array] = {}
    for key, rows in odometer.partition_by("run", "robot", as_dict=True).items():
        run, robot = (int(each) for each in key)
        mine = samples[key].sort("sample")
        true[run, robot] = mine.select("x_m", "y_m").to_numpy()
        stops, ticks = mine["stop_start_s"].to_numpy(), np.rint(mine["time_s"].to_numpy() / scenario.tick_s)
        kind = rows["kind"].to_physical().to_numpy().astype(int)
        names = ("start_s", "duration_s", "gyro_rad", "ray_m")
        start_s, duration_s, gyro_rad, ray_m = (rows[name].to_numpy() for name in names)
        now: list[float] = [START, seed, run, robot, TOLD, *poses[run, robot]]
        found: Events = []
        for m in range(kind.size):
            if kind[m] != STOP:
                after = m > 0 and kind[m - 1] == DRIVE and duration_s[m - 1] > 1.5 * scenario.tick_s
                at = m + 1 < kind.size and kind[m + 1] == AVOID
                now += [MOVED, kind[m], duration_s[m], gyro_rad[m], ray_m[m], after, at]
            elif len(found) < stops.size and abs(stops[len(found)] - start_s[m]) < 0.5 * scenario.tick_s:
                tick = int(ticks[len(found)])
                found.append((tick, [*now, STOPPED, TICK, tick, SAMPLE, 0.0]))
                now = []
        events[run, robot] = found
    return motion, events, true


def rows_of(program: Path, numbers: list[float], width: int) -> Array:
    """Return a row per sample: the estimate, then kind, tick, sends, decision, belief, heard, message."""
    out = np.array(run_program(program, numbers))
    return out[: out.size // width * width].reshape(-1, width)


def inspected(program: Path, events: list[Events], readings: list[list[int]], fields: int) -> list[Array]:
    """Return the rows of a run's robots: alone first, to learn what they send, then with what they heard."""
    width = ESTIMATES + HEAD + fields
    own = [
        [(tick, [*numbers[:-1], float(bit)]) for (tick, numbers), bit in zip(each, bits, strict=False)]
        for each, bits in zip(events, readings, strict=True)
    ]
    alone = [rows_of(program, [x for _, part in each for x in part], width) for each in own]
    both = []
    for i, each in enumerate(own):
        parts = [(tick, 1, numbers) for tick, numbers in each]
        for j, rows in enumerate(alone):
            if j != i:
                parts += [
                    (int(row[10]) + 1, 0, [HEAR, row[10] + 1, j, n, *row[ESTIMATES + HEAD :]])
                    for n, row in enumerate(rows[rows[:, 11] != 0.0])
                ]
        first, *rest = sorted(parts, key=lambda part: part[:2])
        if first[1] == 0:  # start before anything is heard
            at = next(k for k, part in enumerate(rest) if part[1] == 1)
            own_first = rest.pop(at)
            begin, rest = (
                own_first[2][:8],
                [first, *rest[:at], (*own_first[:2], own_first[2][8:]), *rest[at:]],
            )
            first = (0, 0, begin)
        both.append(rows_of(program, [x for part in (first, *rest) for x in part[2]], width))
    return both


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--seed", type=int, default=9501)
    given = parser.parse_args()
    base = preset("paper").with_values(
        {"strategy.name": "places", "localisation.method": "mixture", "floor.source": "random:0.48"}
    )
    motion, events, true = fed(base, given.seed, given.runs)
    fields, robots = len(message_fields(base)), base.swarm.robots
    found: dict[str, list[Array]] = {name: [] for name in PRECISIONS}
    with tempfile.TemporaryDirectory() as folder:
        programs = {
            name: built(base, Path(folder) / name, precision=number, optimise="-O2")
            for name, number in PRECISIONS.items()
        }
        for fill, _ in FLOORS:
            floor = base.with_values({"floor.source": f"random:{fill}"})
            floors = floors_of(floor, given.seed, list(range(given.runs)))
            read = observe(floor, given.seed, motion.samples, floors, energies=False)
            bits = read.partition_by("run", "robot", as_dict=True)
            for run in range(given.runs):
                mine = [bits[run, i].sort("sample")["observation"].to_list() for i in range(robots)]
                for name, program in programs.items():
                    found[name] += inspected(program, [events[run, i] for i in range(robots)], mine, fields)
    keys = [(run, i) for _ in FLOORS for run in range(given.runs) for i in range(robots)]
    truth = np.repeat([side for _, side in FLOORS], given.runs * robots)
    decided: dict[str, NDArray[np.int64]] = {}
    for name, all_rows in found.items():
        errors, apart, times, sides = [], [], [], []
        for key, rows, exact in zip(keys, all_rows, found["double"], strict=True):
            late = rows[:, 4] >= 0
            errors.append(np.hypot(*(rows[late, 5:7] - true[key][rows[late, 4].astype(int)]).T))
            apart.append(np.hypot(*(rows[:, :2] - exact[: len(rows), :2]).T))
            at = np.flatnonzero(rows[:, 12] != -1)
            times.append(rows[at[0], 10] * base.tick_s if at.size else base.run.t_end_s)
            sides.append(int(rows[at[0], 12]) if at.size else -1)
        error, distance, decided[name] = np.concatenate(errors), np.concatenate(apart), np.array(sides)
        wrong, undecided, other = (
            100.0 * float(each.mean())
            for each in (decided[name] == 1 - truth, decided[name] == -1, decided[name] != decided["double"])
        )
        print(
            f"{name:7s} median {100 * np.median(error):.2f} cm, over 20 cm {100 * (error > 0.2).mean():.1f} %; "
            f"{np.mean(times):.0f}/{wrong:.1f}/{undecided:.0f}; "
            f"from double: median {100 * np.median(distance):.3f} cm, 90 % below "
            f"{100 * np.quantile(distance, 0.9):.1f} cm, over 5 cm {100 * (distance > 0.05).mean():.1f} %, "
            f"decide otherwise {other:.1f} %",
            flush=True,
        )


if __name__ == "__main__":
    main()
