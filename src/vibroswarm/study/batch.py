"""Simulate some runs of cells that share their motion, which is simulated once, as are readings of a floor and sensor.

If runs end when all robots have decided, or a strategy steers, only equal scenarios share motion. Robots of a run that
its source of motion gives up stand from then on, and count as undecided (columns ``failed_s``, ``failed``).
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
    numbers,
    robot_columns,
    run_columns,
)
from vibroswarm.inference.replay import replay_followed, replay_to_end
from vibroswarm.inference.reports import REPORTED, reported_at_end
from vibroswarm.motion.motion_tables import Motion
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
from vibroswarm.statistics.figures import FOLLOWED, Swarms, figures_of
from vibroswarm.statistics.map_figures import keeps_map, map_figures
from vibroswarm.statistics.over_time import JUDGED, agreement_held, answers_table, may_change
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
    """Return a key that is equal for scenarios with the same motion."""
    by_decisions = scenario.run.stop == "all_decided" or steers(scenario)
    return scenario.hash if by_decisions else _key(scenario, OF_MOTION)


def _key(scenario: Scenario, sections: Iterable[str]) -> str:
    return "\n".join(getattr(scenario, section).model_dump_json() for section in sections)


SAMPLES: Final = 200_000
"""Most samples of the runs of a block, and most rows of robots, which limits memory."""
STANDING_MS: Final = 1000.0
"""Typical time that a robot stands for a sample, ms; added to the sample interval, which alone may be 0."""
LEAST: Final = 10
"""Runs of a block of a short study, so that many workers are busy."""
MOST: Final = 500
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
    """Simulate the runs of a task: a row for each scenario and run; CodeError if user code failed."""
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
    """Yield the rows of the scenarios, by key, that share floor and sensor."""
    runs = range(task.first, task.last)
    by_readings: dict[str, dict[str, Scenario]] = {}
    for key, scenario in scenarios.items():
        check_scenario(scenario)
        by_readings.setdefault(_key(scenario, OF_OBSERVATION), {})[key] = scenario
    first = next(iter(next(iter(by_readings.values())).values()))
    moves = any(map(needs_moves, scenarios.values()))
    if by_decisions := motion_by_decisions(first):
        floors = floors_of(first, task.seed, runs)
        motion = by_decisions(first, task.seed, runs, floors, task.motion, moves)
    else:
        motion = moved(task.motion, first, task.seed, runs, moves)
    shared = _SharedMotion(first, motion, task.seed, runs)
    yield from map(shared.rows, by_readings.values())


class _SharedMotion:
    """The motion of some runs, and what is computed once for all floors, sensors and strategies."""

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
            over_time = dict.fromkeys(FOLLOWED, np.full(len(runs), np.nan))
            if scenario.change.is_given or keeps_map(scenario):
                swarm, _, log = replay_followed(*replayed)
                over_time |= self._over_time(scenario, floors, swarm, log)
            else:
                swarm = replay_to_end(*replayed)
            if may_change(scenario):
                over_time["agreement_held"] = agreement_held(swarm, len(runs))
            finals.append(final_columns(scenario, swarm))
            followed.append(over_time)
            reported += self._reported(scenario, swarm, judged[-1][0])
        robots = {name: np.stack([one[name].reshape(self.shape) for one in finals]) for name in finals[0]}
        fills, truth = (np.stack(values) for values in zip(*judged, strict=True))
        of_runs = run_columns(
            robots["decision"], robots["decision_time_s"], fills, truth, self.end_s, t_end_s
        )
        robots = robot_columns(robots, truth)
        swarms = Swarms.of_arrays(robots, of_runs, t_end_s, [costs_of(one) for one in scenarios])
        swarms.runs |= {name: np.concatenate([one[name] for one in followed]) for name in FOLLOWED}
        figures = figures_of(swarms)
        tiles = floors[runs[0]].tiles.size  # the same in all runs
        walk = pl.DataFrame(dict(self.walk.figures(readings.tile, readings.observation, tiles)))
        return self._frame(list(group), robots, of_runs, figures, walk, reported)

    def _over_time(
        self, scenario: Scenario, floors: Mapping[int, Floor], swarm: Any, log: Any
    ) -> dict[str, Array]:
        """Return what is judged after each sample, by run: answers on a floor that changes, and maps."""
        samples, found = self.motion.samples.select("run", "robot", "time_s"), dict[str, Array]()
        if scenario.change.is_given:
            columns = {name: samples[name].to_numpy() for name in samples.columns}
            columns["decision"] = log.decision
            if "changed_s" in strategy_used(scenario).reported:
                columns["changed_s"] = log.states["changed_s"]
            answers = answers_table(scenario, self.seed, floors, columns, self.end_s)
            found |= {name: numbers(answers[name]) for name in JUDGED}
        if keeps_map(scenario):
            beliefs = samples.with_columns(belief_below=log.belief)
            found |= map_figures(scenario, swarm, floors, self.end_s, beliefs)
        return found

    def _reported(self, scenario: Scenario, swarm: Any, asked: Array) -> list[list[Any] | None]:
        """Return what robots reported at the end of each run."""
        if not strategy_used(scenario).reports:
            return [None] * len(self.runs)
        rows = reported_at_end(scenario, swarm, self.runs, asked)
        by_run = rows.partition_by("run", as_dict=True, include_key=False)
        return [by_run[run,].to_dicts() if (run,) in by_run else None for run in self.runs]

    def _frame(
        self, keys: Sequence[str], robots: Columns, runs: Columns, figures: Columns, walk: pl.DataFrame,
        reported: list[Any],
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
            pl.Series(name, np.tile(self._by_run(walk[name], walk["run"]), cells), nan_to_null=True)
            for name in WALK
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
        failed = failures.select("run", failed_s="time_s", failed="reason")
        return frame.join(failed, on="run", how="left", maintain_order="left")

    def _by_run(self, column: pl.Series, run: pl.Series) -> NDArray[np.float64]:
        """Return a column by run; nan for runs without a value."""
        values = np.full(len(self.runs), np.nan)
        values[run.to_numpy().astype(np.int64) - self.runs.start] = column.cast(pl.Float64).to_numpy()
        return values
