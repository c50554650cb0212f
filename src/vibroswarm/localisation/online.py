"""Localisation of one run from sample to sample: the same numbers as ``locate.estimate``, as the moves become known."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import read_only, zero_rows
from vibroswarm.localisation.locate import draws_read, locate_robots, program_of, ray_forward_m
from vibroswarm.localisation.odometry import gyro_errors, gyro_readings, merged_moves
from vibroswarm.motion.geometry import wrapped_rad
from vibroswarm.motion.moves import MOVE_ROW
from vibroswarm.motion.recorder import joined
from vibroswarm.robot.place_draws import empty_paths
from vibroswarm.robot.pose_mixture import empty_mixture
from vibroswarm.scenario.scenario import Scenario


class OnlineLocalisation:
    """The filters of a swarm, which go on as its robots move."""

    def __init__(self, scenario: Scenario, seed: int) -> None:
        robots, told = scenario.swarm.robots, scenario.localisation
        components = told.components if told.method == "mixture" else 1
        program, forward_m = program_of(scenario), ray_forward_m(scenario)
        self.programs = [program._replace(ray_forward_m=float(each_m)) for each_m in forward_m]
        draws = draws_read(scenario)
        self.filters = [empty_mixture(components, told.lag, draws > 0) for _ in range(robots)]
        self.paths = [empty_paths(draws, components) for _ in range(robots)]
        self.errors, self.tick_s = gyro_errors(scenario), scenario.tick_s
        self.tick_ms, self.robots, self.seed = scenario.run.control_period_ms, robots, seed

    def begin(self, run: int) -> None:
        """Reset to the start of a run."""
        self.run, self.given = run, list[NDArray[np.void]]()
        self.sampled_s, self.begun = np.zeros((self.robots, 1)), [False] * self.robots
        self.zeroing = np.zeros((self.robots, 2))
        self.numbers, self.stop_tick = [0] * self.robots, [-1] * self.robots

    def add_moves(self, rows: NDArray[np.void]) -> None:
        """Append moves (``MOVE_ROW``); a move that is given again replaces the earlier row."""
        self.given.append(rows.copy())

    def locate(
        self,
        robot: NDArray[np.uint16],
        stop_tick: NDArray[np.int64],
        time_s: NDArray[np.float64],
        out: NDArray[np.float64],
    ) -> None:
        """Write the estimates of new samples.

        Args:
            robot, stop_tick, time_s: (samples,), in order of time; the moves up to the stop of each have been added.
            out: (samples, 9 or more), written: ``pose_mixture.ESTIMATE``, and draws.
        """
        moves = joined([zero_rows(0, MOVE_ROW), *self.given])
        stop_s = stop_tick * self.tick_ms / 1000.0
        later = np.ones(moves.size, dtype=np.bool_)
        for i in np.unique(robot).tolist():
            of, mine = np.flatnonzero(robot == i), np.flatnonzero(moves["robot"] == i)
            last, tick = int(stop_tick[of[-1]]), moves["tick"][mine]
            later[mine[tick <= last]] = False
            known = mine[(tick > self.stop_tick[i]) & (tick <= last)]  # the last stop may be given again
            known = known[np.argsort(moves["tick"][known], kind="stable")]
            tick = moves["tick"][known]
            known = known[np.append(tick[1:] != tick[:-1], True)]  # what was given last of each move
            self._follow(i, moves[known], of, stop_s, time_s, out)
            self.stop_tick[i] = last
        self.given = [moves[later]]

    def _follow(
        self,
        i: int,
        rows: NDArray[np.void],
        of: NDArray[np.int64],
        stop_s: NDArray[np.float64],
        time_s: NDArray[np.float64],
        out: NDArray[np.float64],
    ) -> None:
        """Follow robot ``i`` over moves of which the last is the stop of its last sample."""
        kind, ray_m = rows["kind"].astype(np.int64), rows["ray_m"].copy()
        first, turned_rad = merged_moves(np.zeros(rows.size, dtype=np.int64), kind, ray_m, rows["turned_rad"])
        start_s = rows["tick"][first] * self.tick_ms / 1000.0
        duration_s = np.append(np.diff(start_s), 0.0)  # that of the stop is not read
        count = first.size
        gyro_rad = gyro_readings(
            self.seed,
            np.full(count, self.run, dtype=np.int64),
            np.full(count, i, dtype=np.int64),
            kind[first],
            duration_s,
            turned_rad,
            *self.errors,
            zeroing=self.zeroing[i],
            number=self.numbers[i],
        )
        self.numbers[i] += count
        pose = (float(rows["x_m"][0]), float(rows["y_m"][0]), wrapped_rad(float(rows["heading_rad"][0])))
        locate_robots(
            self.filters[i],
            self.paths[i],
            self.programs[i],
            self.seed,
            self.robots,
            read_only(np.array([self.run * self.robots + i])),
            read_only(np.array([pose])),
            read_only(np.array([[0, count, 0, of.size]])),
            not self.begun[i],
            self.sampled_s[i],
            self.tick_s,
            out,
            *(read_only(column) for column in (kind[first], start_s, duration_s, gyro_rad, ray_m[first])),
            *(read_only(column) for column in (of, stop_s, time_s)),
        )
        self.begun[i] = True
