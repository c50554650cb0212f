"""Localisation of one run from sample to sample, while its moves become known.

It computes exactly the numbers that ``locate.estimate`` computes from the tables of a whole run.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import read_only, zero_rows
from vibroswarm.localisation.locate import empty_memory, locate_robots, program_of, ray_forward_m
from vibroswarm.localisation.odometry import gyro_errors, gyro_readings, measured_rays, merged_moves
from vibroswarm.motion.geometry import wrapped_rad
from vibroswarm.motion.motion_tables import MOVE_ROW, joined
from vibroswarm.scenario.scenario import Scenario


class OnlineLocalisation:
    """The localisation filters of a swarm's robots, each continued at the robot's next sample.

    Call ``begin`` for each run, then ``add_moves`` and ``locate`` as the run advances.
    """

    def __init__(self, scenario: Scenario, seed: int) -> None:
        """Allocate the filters' memory; ``begin`` must be called before the first run.

        Args:
            seed: seed of the runs.
        """
        self.scenario, self.seed, self.robots = scenario, seed, scenario.swarm.robots
        self.tick_ms, self.errors = scenario.run.control_period_ms, gyro_errors(scenario)
        self.memory = [empty_memory(scenario) for _ in range(self.robots)]
        program, forward_m = program_of(scenario), ray_forward_m(scenario)
        self.programs = [program._replace(ray_forward_m=float(each_m)) for each_m in forward_m]

    def begin(self, run: int) -> None:
        """Set the state to the start of a run.

        State of each robot: ``sampled_s``, (robots, 1), time of its last sample, of which ``locate_robots`` takes a
        row; ``begun``, whether its filter has started; ``zeroing``, (robots, 2), mean and number of the gyro biases
        that it has measured; ``numbers``, number of its moves, merged by ``merged_moves``, that the filter has read;
        ``stop_tick``, tick at which it stopped for its last sample, -1 before. ``given`` is a list of arrays of moves
        (``MOVE_ROW``) that were added, and that the filters have not read yet.

        Args:
            run: number of the run.
        """
        self.run, self.given = run, list[NDArray[np.void]]()
        self.sampled_s, self.begun = np.zeros((self.robots, 1)), [False] * self.robots
        self.zeroing = np.zeros((self.robots, 2))
        self.numbers, self.stop_tick = [0] * self.robots, [-1] * self.robots

    def add_moves(self, rows: NDArray[np.void]) -> None:
        """Append moves (``MOVE_ROW``), which are copied.

        A move may be added again when more of it is known: the row that was added last then replaces earlier rows of
        the same robot and start tick.
        """
        self.given.append(rows.copy())

    def locate(
        self,
        robot: NDArray[np.uint16],
        stop_tick: NDArray[np.int64],
        time_s: NDArray[np.float64],
        out: NDArray[np.float64],
    ) -> None:
        """Write the estimates at new samples.

        Args:
            robot, stop_tick, time_s: (samples,), in order of time: the robot, the tick at which it stopped, the time of
                the sample. All moves up to and including that stop must have been added.
            out: (samples, 9), overwritten: the columns of ``pose_mixture.ESTIMATE``.
        """
        # With the empty array, ``joined`` works also if ``given`` is empty.
        moves = joined([zero_rows(0, MOVE_ROW), *self.given])
        stop_s = stop_tick * self.tick_ms / 1000.0
        later = np.ones(moves.size, dtype=np.bool_)  # moves to save for later calls
        for i in np.unique(robot).tolist():
            # of: rows of the robot's new samples. mine: rows of its moves. known: rows of the moves that its filter
            # reads now, which are those after its previous stop, up to the stop of its last new sample.
            of, mine = np.flatnonzero(robot == i), np.flatnonzero(moves["robot"] == i)
            last, tick = int(stop_tick[of[-1]]), moves["tick"][mine]
            later[mine[tick <= last]] = False
            known = mine[(tick > self.stop_tick[i]) & (tick <= last)]
            known = known[np.argsort(moves["tick"][known], kind="stable")]
            tick = moves["tick"][known]
            # Of several rows of one move, use the row that was added last, which is last in the stable order too.
            known = known[np.append(tick[1:] != tick[:-1], True)]
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
        """Continue the filter of robot ``i`` over its new moves, and write its estimates at its new samples.

        Args:
            rows: the moves (``MOVE_ROW``), in order of time; the last one is the stop for the robot's last new sample.
            of: indices of the robot's new samples in ``stop_s``, ``time_s`` and ``out``. stop_s, time_s: (samples,):
                when the robot stopped for each sample, and when it took it. out: (samples, 9): estimates, written.
        """
        # Columns of the records ``rows``; the kernels take ``kind`` as int64.
        kind, ray_m = rows["kind"].astype(np.int64), rows["ray_m"].copy()
        first, turned_rad = merged_moves(np.zeros(rows.size, dtype=np.int64), kind, ray_m, rows["turned_rad"])
        start_s = rows["tick"][first] * self.tick_ms / 1000.0
        duration_s = np.append(np.diff(start_s), 0.0)  # the duration of the last stop is not used
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
        rays_m = measured_rays(
            self.scenario,
            self.seed,
            np.full(count, self.run),
            np.full(count, i),
            ray_m[first],
            self.numbers[i],
        )
        self.numbers[i] += count
        # Pose at the first new move: at the robot's first call the true pose at time 0, and not used later. The heading
        # is wrapped as in the table of moves, from which ``locate.estimate`` takes it.
        pose = (float(rows["x_m"][0]), float(rows["y_m"][0]), wrapped_rad(float(rows["heading_rad"][0])))
        locate_robots(
            self.memory[i],
            self.programs[i],
            self.seed,
            self.robots,
            read_only(np.array([self.run * self.robots + i])),
            read_only(np.array([pose])),
            read_only(np.array([[0, count, 0, of.size]])),  # all these moves, and all samples of ``of``
            not self.begun[i],  # from_start
            self.sampled_s[i],
            self.scenario.tick_s,
            out,
            *(read_only(column) for column in (kind[first], start_s, duration_s, gyro_rad, rays_m)),
            *(read_only(column) for column in (of, stop_s, time_s)),
        )
        self.begun[i] = True
