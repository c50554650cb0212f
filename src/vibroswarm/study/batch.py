"""Simulate some runs of cells that share their motion, which is simulated once.

Readings are taken once for each floor, sensor and end of the runs, and each strategy is replayed on them. The result is
one frame with a row for each scenario and run: the run's outcome, how its robots sampled, its figures
(``statistics.figures``), and columns ``robot.*`` with a list of one value for each robot.

If cells differ only in ``run.t_end_s``, the longest motion is simulated, and the others use its beginning. If runs end
when all robots have decided, or a strategy steers, the motion depends on decisions, and only equal scenarios share it.

A run fails if its source of motion gives it up; MuJoCo does so when a number is no longer finite. Its robots stand from
then on, and count as undecided; the columns ``failed_s`` and ``failed`` say since when, and why.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Any, Final, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.errors import CodeError, RunError
from vibroswarm.floors.floor import Floor
from vibroswarm.inference.agents import arrays_fit, final_columns, strategy_used
from vibroswarm.inference.deliveries import needs_moves, timeline_of
from vibroswarm.inference.outcomes import (
    ROBOTS,
    RUNS,
    Array,
    Columns,
    as_series,
    costs_of,
    fills_and_truth,
    robot_columns,
    run_columns,
)
from vibroswarm.inference.replay import replay_followed, replay_to_end
from vibroswarm.inference.reports import REPORTED, reported_at_end
from vibroswarm.motion.motion_tables import ENDS, Motion
from vibroswarm.motion.source import moved
from vibroswarm.observation.observe import energies_read, read_samples, reads_energies
from vibroswarm.scenario import plugins
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import (
    OF_MOTION,
    OF_OBSERVATION,
    check_scenario,
    floors_of,
    motion_by_decisions,
    steers,
    versions,
)
from vibroswarm.statistics.answers_over_time import JUDGED, agreements_of, answers_table, may_change
from vibroswarm.statistics.figures import FOLLOWED, Swarms, figures_of
from vibroswarm.statistics.map_figures import MAPPED, keeps_map, map_figures
from vibroswarm.statistics.sampling import WALK as OF_WALK
from vibroswarm.statistics.sampling import Walk

WALK: Final = {name: kind for name, kind in OF_WALK.items() if name not in ("run", "samples")}
"""Columns of the run about how its robots sampled, see ``statistics.sampling``."""
OF_ROBOTS: Final = {name: kind for name, kind in ROBOTS.items() if name not in ("run", "robot")}
"""Columns with a value for each robot."""
REPORT: Final = pl.List(pl.Struct({name: kind for name, kind in REPORTED.items() if name != "run"}))
"""Type of the column of what robots reported at the end of a run."""


class Task(NamedTuple):
    """Successive runs of scenarios with the same motion, in plain values, to be sent to a worker."""

    scenarios: tuple[tuple[str, str], ...]
    """Key (``store.key_of``) and TOML of each."""
    first: int
    last: int
    """One past the last run."""
    seed: int
    motion: str
    made_by: str
    """Version of the code that the worker must have."""
    code: tuple[tuple[str, str], ...] = ()
    """Users' files that the scenarios need."""

    @property
    def keys(self) -> tuple[str, ...]:
        """The keys of its scenarios."""
        return tuple(key for key, _ in self.scenarios)


@lru_cache(4096)
def scenario_of(text: str) -> Scenario:
    """Return the scenario that a TOML text describes."""
    return Scenario.from_toml(text)


def motion_key(scenario: Scenario) -> str:
    """Return a key that is equal for scenarios with the same motion, until the shorter one ends."""
    if scenario.run.stop == "all_decided" or steers(scenario):
        return scenario.hash
    others = _key(scenario, [section for section in OF_MOTION if section != "run"])
    return f"{others}\n{scenario.run.model_dump_json(exclude={'t_end_s'})}"


def _key(scenario: Scenario, sections: Iterable[str]) -> str:
    return "\n".join(getattr(scenario, section).model_dump_json() for section in sections)


SAMPLES: Final = 100_000
"""Most samples of the runs of a block, and most rows of robots, which limits memory."""
STANDING_MS: Final = 1000.0
"""Typical time that a robot stands for a sample, ms; added to the sample interval, which alone may be 0."""
LEAST: Final = 10
"""Runs of a block of a short study, so that many workers are busy."""
MOST: Final = 1000
"""Most runs of a block."""


def samples_of_run(scenario: Scenario) -> float:
    """Return about how many samples all robots of a run take, at least 1."""
    sample_ms = scenario.sample.sample_interval_ms + STANDING_MS
    return max(scenario.swarm.robots * scenario.run.t_end_s * 1000.0 / sample_ms, 1.0)


def block_size(scenarios: Sequence[Scenario], motion: str, runs: int) -> int:
    """Return how many of ``runs`` runs of scenarios that share motion a worker simulates at once."""
    if motion == "mujoco":  # far slower than the other sources: minutes a run
        return 1
    fits = min(
        SAMPLES / max(map(samples_of_run, scenarios)),
        SAMPLES / (len(scenarios) * scenarios[0].swarm.robots),
        max(runs / 32, LEAST),
        MOST,
        *map(arrays_fit, scenarios),
    )
    return max(int(fits), 1)


def simulate_runs(task: Task) -> pl.DataFrame:
    """Simulate the runs of a task; the frame has a row for each scenario and run.

    Raises:
        CodeError: user code failed. RunError: this worker has another version of the code.
    """
    if (here := versions()["code"]) != task.made_by:
        raise RunError(
            f"a worker has other code ({here}, not {task.made_by}); install the same version there"
        )
    plugins.install_all(task.code)
    try:
        return pl.concat(_simulated({key: scenario_of(text) for key, text in task.scenarios}, task))
    except CodeError as error:
        runs = f"run {task.first}" + (f" to {task.last - 1}" if task.last - task.first > 1 else "")
        raise CodeError(f"{error} ({runs}, seed {task.seed})") from None


def _simulated(scenarios: Mapping[str, Scenario], task: Task) -> Iterator[pl.DataFrame]:
    """Yield the rows of the scenarios, by key, that share floor, sensor and end, the longest runs first."""
    runs = range(task.first, task.last)
    by_readings: dict[str, dict[str, Scenario]] = {}
    for key, scenario in sorted(scenarios.items(), key=lambda item: -item[1].run.t_end_s):
        check_scenario(scenario)
        by_readings.setdefault(_key(scenario, OF_OBSERVATION), {})[key] = scenario
    first = next(iter(next(iter(by_readings.values())).values()))
    moves = any(map(needs_moves, scenarios.values()))
    if by_decisions := motion_by_decisions(first):
        floors = floors_of(first, task.seed, runs)
        motion = by_decisions(first, task.seed, runs, floors, task.motion, moves)
    else:
        motion = moved(task.motion, first, task.seed, runs, moves)
    end_s, shared = first.run.t_end_s, _SharedMotion(first, motion, task.seed, runs)
    for group in by_readings.values():
        one = next(iter(group.values()))
        if one.run.t_end_s != end_s:
            end_s, shared = one.run.t_end_s, _SharedMotion(one, beginning(motion, one), task.seed, runs)
        yield shared.rows(group)


class _SharedMotion:
    """The motion of some runs, and what is computed once for all floors, sensors and strategies.

    Args:
        scenario: one of those that have this motion.
    """

    def __init__(self, scenario: Scenario, motion: Motion, seed: int, runs: range) -> None:
        self.motion, self.seed, self.runs = motion, seed, runs
        self.timeline, self.walk = timeline_of(scenario, motion), Walk(motion.samples)
        self.shape = (len(runs), self.timeline.robots)
        self.end_s = motion.ends["end_s"].to_numpy().reshape(self.shape).max(axis=1)

    def rows(self, group: Mapping[str, Scenario]) -> pl.DataFrame:
        """Return the rows of scenarios, by key, that have the same readings."""
        scenarios, runs = list(group.values()), self.runs
        common, t_end_s = scenarios[0], scenarios[0].run.t_end_s
        floors = floors_of(common, self.seed, runs)
        with_energies = any(map(reads_energies, scenarios))
        readings = read_samples(common, self.seed, self.motion.samples, floors, with_energies)
        energy = energies_read(common, readings) if with_energies else None
        known: dict[tuple[str, float], tuple[Array, Array]] = {}  # fill ratios and truths by question
        finals, followed, reported, judged = [], [], [], []
        for scenario in scenarios:
            asked = (scenario.task.model_dump_json(), scenario.decision.decision_boundary)
            if asked not in known:
                known[asked] = fills_and_truth(scenario, floors, list(runs), self.end_s)
            judged.append(known[asked])
            replayed = (scenario, self.seed, self.timeline, readings.observation, energy)
            frames: list[pl.DataFrame] = []
            if scenario.change.is_given or keeps_map(scenario):
                swarm, _, log = replay_followed(*replayed)
                frames += self._over_time(scenario, floors, swarm, log)
            else:
                swarm = replay_to_end(*replayed)
            if may_change(scenario):
                frames.append(agreements_of(swarm, runs))
            finals.append(final_columns(scenario, swarm))
            followed.append({name: self._by_run(frames, column) for name, column in FOLLOWED.items()})
            reported += self._reported(scenario, swarm, judged[-1][0])
        robots = {name: np.stack([one[name].reshape(self.shape) for one in finals]) for name in finals[0]}
        fills, truth = (np.stack(values) for values in zip(*judged, strict=True))
        of_runs = run_columns(
            robots["decision"], robots["decision_time_s"], fills, truth, self.end_s, t_end_s
        )
        robots = robot_columns(robots, truth)
        swarms = Swarms.of_arrays(robots, of_runs, t_end_s, [costs_of(one) for one in scenarios])
        swarms.runs = {**swarms.runs} | {
            name: np.concatenate([one[name] for one in followed]) for name in FOLLOWED
        }
        figures = figures_of(swarms)
        tiles = floors[runs[0]].tiles.size  # the same in all runs
        walk = pl.DataFrame(dict(self.walk.figures(readings.tile, readings.observation, tiles)))
        return self._frame(list(group), t_end_s, robots, of_runs, figures, walk, reported)

    def _over_time(
        self, scenario: Scenario, floors: Mapping[int, Floor], swarm: Any, log: Any
    ) -> Iterator[pl.DataFrame]:
        """Yield what is judged after each sample: answers on a floor that changes, and maps."""
        samples = self.motion.samples.select("run", "robot", "time_s")
        if scenario.change.is_given:
            columns = {name: samples[name].to_numpy() for name in samples.columns}
            columns["decision"] = log.decision
            if "changed_s" in strategy_used(scenario).reported:
                columns["changed_s"] = log.states["changed_s"]
            yield answers_table(scenario, self.seed, floors, columns, self.end_s).select("run", *JUDGED)
        if keeps_map(scenario):
            beliefs = samples.with_columns(belief_below=log.belief)
            yield map_figures(scenario, swarm, floors, self.end_s, beliefs).select("run", *MAPPED)

    def _reported(self, scenario: Scenario, swarm: Any, asked: Array) -> list[list[Any] | None]:
        """Return what robots reported at the end of each run."""
        if not strategy_used(scenario).reports:
            return [None] * len(self.runs)
        rows = reported_at_end(scenario, swarm, self.runs, asked)
        by_run = rows.partition_by("run", as_dict=True, include_key=False)
        return [by_run[run,].to_dicts() if (run,) in by_run else None for run in self.runs]

    def _frame(
        self, keys: Sequence[str], t_end_s: float, robots: Columns, runs: Columns, figures: Columns,
        walk: pl.DataFrame, reported: list[Any],
    ) -> pl.DataFrame:  # fmt: skip
        cells, (count, size) = len(keys), self.shape
        of_runs = {"run": np.arange(self.runs.start, self.runs.stop), **runs}
        columns = [pl.Series("key", np.repeat(keys, count))]
        columns += [
            as_series(name, np.broadcast_to(of_runs[name], (cells, count)).ravel(), kind)
            for name, kind in RUNS.items()
            if name not in figures
        ]
        columns += [
            pl.Series(name, np.tile(self._by_run([walk], name), cells), nan_to_null=True) for name in WALK
        ]
        columns += [pl.Series(name, values, nan_to_null=True) for name, values in figures.items()]
        columns += [
            as_series(f"robot.{name}", robots[name].ravel(), kind)
            .reshape((cells * count, size))
            .cast(pl.List(kind))
            for name, kind in OF_ROBOTS.items()
        ]
        frame = pl.DataFrame([*columns, pl.Series("reported", reported, dtype=REPORT)])
        failures = self.motion.failures
        if failures is None:
            return frame.with_columns(failed_s=pl.lit(None, pl.Float64), failed=pl.lit(None, pl.String))
        failed = failures.filter(pl.col("time_s") < t_end_s).select("run", failed_s="time_s", failed="reason")
        return frame.join(failed, on="run", how="left", maintain_order="left")

    def _by_run(self, frames: Iterable[pl.DataFrame], name: str) -> NDArray[np.float64]:
        """Return a column by run from the frame that has it; nan for runs without a value."""
        values = np.full(len(self.runs), np.nan)
        for frame in frames:
            if name in frame.columns:
                place = frame["run"].to_numpy().astype(np.int64) - self.runs.start
                values[place] = frame[name].cast(pl.Float64).to_numpy()
        return values


def beginning(motion: Motion, scenario: Scenario) -> Motion:
    """Cut a motion to the shorter runs of a scenario that moves in the same way.

    A sample taken, or a stop begun, exactly at the end of the shorter runs is not part of them. The table of ends gets
    new values. Its ``stop_start_s`` is the start of the stop in which a robot is at the end, or null if it is in none.
    It is in a stop if it sampled in the last control period, since it walks on only in the next one, or if the stop for
    its next sample has begun. Positions at the end are null, since they cannot be known from the samples. Moves and
    failures are not cut off, since nothing uses those after the end.

    Args:
        motion: of the longer runs. scenario: with the shorter runs.
    """
    # A tick is the moment at which a control period begins. Runs end at the first tick at or after ``run.t_end_s``.
    tick_s, end_s = scenario.tick_s, scenario.ticks * scenario.run.control_period_ms / 1000.0
    # Times are whole ticks up to rounding errors. So that these errors do not matter, the limits are not ticks: one is
    # a quarter of a tick before the end, the other a quarter of a tick before the last tick that precedes the end.
    before_end_s, before_last_tick_s = end_s - tick_s / 4, end_s - 1.25 * tick_s
    samples, ends = motion.samples, motion.ends
    time_s, stop_s = samples["time_s"].to_numpy(), samples["stop_start_s"].to_numpy()
    end_row = _end_rows_of(ends, samples, scenario.swarm.robots)
    is_before = time_s < before_end_s
    # Per robot (row of ``ends``): start of the stop for its sample in the last control period; nan if there is none.
    last_stop = np.full(ends.height, np.nan)
    in_last_tick = is_before & (time_s > before_last_tick_s)
    last_stop[end_row[in_last_tick]] = stop_s[in_last_tick]
    # Per robot: start of the stop for its first sample after the end; nan if there is none. Samples are assigned from
    # the last one to the first, so that the first one of each robot is what remains.
    next_stop = np.full(ends.height, np.nan)
    after_end = np.flatnonzero(~is_before)[::-1]
    next_stop[end_row[after_end]] = stop_s[after_end]
    # A robot without a later sample may have begun a stop that lasts to the end of the longer motion.
    next_stop = np.where(np.isnan(next_stop), ends["stop_start_s"].to_numpy(), next_stop)
    begun = np.where(next_stop < before_end_s, next_stop, np.nan)  # only stops that begin before the end
    standing = pl.Series("stop_start_s", np.where(np.isnan(last_stop), begun, last_stop), nan_to_null=True)
    unknown = {name: pl.lit(None, dtype=pl.Float64) for name in ("x_m", "y_m", "heading_rad")}
    ends = ends.with_columns(standing, end_s=pl.lit(end_s), **unknown)
    return Motion(
        samples=samples.filter(pl.Series(is_before)),
        ends=ends.select(list(ENDS)),
        moves=motion.moves,
        failures=motion.failures,
    )


def _end_rows_of(ends: pl.DataFrame, samples: pl.DataFrame, robots: int) -> NDArray[np.int64]:
    """Return for each sample the row of its run and robot in the table of ends, (samples,)."""
    runs = ends["run"].to_numpy()[::robots]  # the table has a row for each run and robot, in this order
    run = np.searchsorted(runs, samples["run"].to_numpy())  # position of each sample's run in ``runs``
    return np.asarray(run * robots + samples["robot"].to_numpy(), dtype=np.int64)
