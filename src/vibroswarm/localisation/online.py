"""Localisation of one run from sample to sample: the same numbers as ``locate.estimate``, as the moves become known."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import read_only, zero_rows
from vibroswarm.localisation.locate import locate_robots, program_of, ray_forward_m
from vibroswarm.localisation.odometry import gyro_errors, gyro_readings, merged_moves
from vibroswarm.motion.geometry import wrapped_rad
from vibroswarm.motion.moves import MOVE_ROW
from vibroswarm.robot.pose_mixture import empty_mixture
from vibroswarm.scenario.scenario import Scenario


class OnlineLocalisation:
    """The filters of a swarm, which go on as its robots move."""

    def __init__(self, scenario: Scenario, seed: int) -> None:
        robots, told = scenario.swarm.robots, scenario.localisation
        components = told.components if told.method == "mixture" else 1
        program, forward_m = program_of(scenario), ray_forward_m(scenario)
        self.programs = [program._replace(ray_forward_m=float(each_m)) for each_m in forward_m]
        self.filters = [empty_mixture(components, told.lag) for _ in range(robots)]
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
            out: (samples, 9), written: ``pose_mixture.ESTIMATE``.
        """
        moves = np.concatenate([zero_rows(0, MOVE_ROW), *self.given])
        moves = moves[
            np.lexsort((moves["tick"], moves["robot"]))
        ]  # stable: the last given of a move is its last
        again = (moves["robot"][1:] == moves["robot"][:-1]) & (moves["tick"][1:] == moves["tick"][:-1])
        moves = moves[np.append(~again, True)[: moves.size]]
        bounds, left = np.searchsorted(moves["robot"], np.arange(self.robots + 1)), []
        stop_s = stop_tick * self.tick_ms / 1000.0
        for i in range(self.robots):
            rows, of = moves[bounds[i] : bounds[i + 1]], np.flatnonzero(robot == i)
            rows = rows[rows["tick"] > self.stop_tick[i]]  # the last stop may have been given again
            if of.size > 0:
                self.stop_tick[i] = int(stop_tick[of[-1]])
                known = int(np.searchsorted(rows["tick"], self.stop_tick[i], side="right"))
                self._follow(i, rows[:known], of, stop_s, time_s, out)
                rows = rows[known:]
            left.append(rows)
        self.given = left

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
