"""Simulate a batch of runs: motion once, each floor and sensor once, then strategy by strategy."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.analysis.sampling import Walk
from vibroswarm.floors.floor import Floor
from vibroswarm.inference.agents import final_columns
from vibroswarm.inference.outcomes import fill_ratios, robot_columns, run_columns, truths
from vibroswarm.inference.replay import INFERENCE, infer, replay_to_end
from vibroswarm.inference.timeline import timeline_of
from vibroswarm.motion.contract import ENDS, MOTION, Motion, source
from vibroswarm.networks import network
from vibroswarm.observation.model import OBSERVATIONS, Places, Readings, observation_frame
from vibroswarm.scenario import Scenario
from vibroswarm.simulation import check_scenario, floors_of, simulate, steers
from vibroswarm.study.plan import Texts
from vibroswarm.study.rows import Columns, columns_of, walked
from vibroswarm.study.texts import scenario_of

SAMPLES: Final[dict[str, Any]] = {
    "cell": pl.UInt32,
    **MOTION,
    **{k: v for k, v in OBSERVATIONS.items() if k not in MOTION},
    **{k: v for k, v in INFERENCE.items() if k not in MOTION},
}
"""One row a cell and sample, kept on request."""


class Cancelled(Exception):  # noqa: N818  (nothing went wrong)
    """The study was stopped while a batch was under way."""


class BatchOutcomes(NamedTuple):
    """Outcomes of some runs of some cells: as ``BatchRows.put`` takes it, and the samples if they are kept."""

    cells: Sequence[Sequence[int]]
    robots: Columns
    runs: Columns
    samples: list[pl.DataFrame]


class Asked(NamedTuple):
    """Which runs, from which seed, by which source of motion, and whether samples are kept."""

    runs: range
    seed: int
    motion: str
    samples: bool
    cancelled: Callable[[], bool] = lambda: False

    def check(self) -> None:
        """Raise Cancelled if so it is."""
        if self.cancelled():
            raise Cancelled


def simulate_batch(observed: Texts, asked: Asked) -> Iterator[BatchOutcomes]:
    """Simulate the runs, floor by floor and sensor by sensor.

    Args:
        observed: see ``work.Work``.
    Raises:
        Cancelled: between two steps.
    """
    for inferences in observed:
        for text, _ in inferences:
            check_scenario(scenario_of(text))
    first = scenario_of(observed[0][0][0])
    if first.run.stop == "all_decided" or steers(first):
        ((text, cells),) = observed[0]
        yield _until_all_decided(scenario_of(text), cells, asked)
        return
    asked.check()
    names = {scenario_of(text).network.name for inferences in observed for text, _ in inferences}
    moves = any(network(name).asks_places for name in names)
    whole = source(asked.motion).batch(first, asked.seed, asked.runs, False, moves)
    moved, end_s = _SharedMotion(first, whole, asked), first.run.t_end_s
    for inferences in observed:
        seen = scenario_of(inferences[0][0])
        if seen.run.t_end_s != end_s:
            moved, end_s = _SharedMotion(seen, beginning(whole, seen), asked), seen.run.t_end_s
        asked.check()
        yield moved.outcomes(
            [scenario_of(text) for text, _ in inferences], [cells for _, cells in inferences]
        )


def _until_all_decided(scenario: Scenario, cells: Sequence[int], asked: Asked) -> BatchOutcomes:
    """Runs that end when all have decided: of one cell, or several that are equal."""
    result = simulate(scenario, asked.seed, asked.runs, motion=asked.motion, energies=asked.samples)
    tile, observation = (result.observations[name].to_numpy() for name in ("tile", "observation"))
    walk = Walk(result.motion).figures(tile, observation, result.floor(asked.runs[0]).tiles.size)
    robots, of_runs = columns_of(result)
    tables = (result.motion, result.observations, result.inference)
    samples = samples_of(*tables, cells) if asked.samples else []
    return BatchOutcomes([cells], robots, {**of_runs, **walked(walk, asked.runs)}, samples)


class _SharedMotion:
    """Some runs of a motion, and what floors, sensors and strategies share of them."""

    def __init__(self, scenario: Scenario, motion: Motion, asked: Asked) -> None:
        self.motion, self.asked = motion, asked
        self.timeline = timeline_of(scenario, motion)
        self.places, self.walk = Places(asked.seed, motion.samples), Walk(motion.samples)
        ends = motion.ends["end_s"].to_numpy().reshape(-1, self.timeline.robots)
        self.end_s = ends.max(axis=1)
        self._floors: dict[Any, dict[int, Floor]] = {}

    def outcomes(self, scenarios: Sequence[Scenario], cells: Sequence[Sequence[int]]) -> BatchOutcomes:
        """Outcomes of scenarios that differ in how robots decide and speak only."""
        seen, runs, seed = scenarios[0], self.asked.runs, self.asked.seed
        floors = self._floors_of(seen)
        read = self.places.read(seen, floors, self.asked.samples)
        each = []
        for scenario in scenarios:
            self.asked.check()
            each.append(final_columns(replay_to_end(scenario, seed, self.timeline, read.observation)))
        shape = (len(runs), self.timeline.robots)
        finals = {name: np.stack([one[name].reshape(shape) for one in each]) for name in each[0]}
        fills = np.array(fill_ratios(floors, list(runs), seen.arena.width_m, seen.arena.height_m))
        truth = _truths_of(scenarios, floors, list(runs), fills)
        decided = finals["decision"], finals["decision_time_s"]
        walk = self.walk.figures(read.tile, read.observation, floors[runs[0]].tiles.size)
        of_runs = {
            **run_columns(*decided, fills, truth, self.end_s, seen.run.t_end_s),
            **walked(walk, runs),
        }
        samples = self._samples(scenarios, cells, read) if self.asked.samples else []
        return BatchOutcomes(cells, robot_columns(finals, truth), of_runs, samples)

    def _floors_of(self, scenario: Scenario) -> dict[int, Floor]:
        """The floor of each run, laid once for all sensors."""
        if scenario.floor not in self._floors:
            self._floors[scenario.floor] = floors_of(scenario, self.asked.seed, self.asked.runs)
        return self._floors[scenario.floor]

    def _samples(
        self, scenarios: Sequence[Scenario], cells: Sequence[Sequence[int]], read: Readings
    ) -> list[pl.DataFrame]:
        motion = self.motion.samples
        observations = observation_frame(scenarios[0], motion, read, energies=True)
        found = []
        for scenario, same in zip(scenarios, cells, strict=True):
            inference, _ = infer(scenario, self.asked.seed, self.timeline, observations)
            found += samples_of(motion, observations, inference, same)
        return found


def _truths_of(
    scenarios: Sequence[Scenario], floors: dict[int, Floor], runs: list[int], fills: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The truth for each scenario and run, (scenarios, runs); each question is asked once."""
    known: dict[Any, NDArray[np.float64]] = {}
    for scenario in scenarios:
        question = (scenario.task.model_dump_json(), scenario.decision.decision_boundary)
        if question not in known:
            known[question] = truths(scenario, floors, runs, fills)
    return np.stack([known[one.task.model_dump_json(), one.decision.decision_boundary] for one in scenarios])


def samples_of(
    motion: pl.DataFrame, observations: pl.DataFrame, inference: pl.DataFrame, cells: Sequence[int]
) -> list[pl.DataFrame]:
    """The table ``SAMPLES`` of each of some cells that are equal."""
    others = (table.drop("run", "robot", "sample") for table in (observations, inference))
    rows = pl.concat([motion, *others], how="horizontal")
    return [rows.select(pl.lit(cell, dtype=pl.UInt32).alias("cell"), *list(SAMPLES)[1:]) for cell in cells]


def beginning(motion: Motion, scenario: Scenario) -> Motion:
    """The beginning of a motion, up to the end of a scenario that moves alike but not as long: what its own would be.

    A sample belongs to the tick before its time; a robot that took one at the last tick still stands in it. Where
    robots are at the end is not told (null), since the table of samples does not know.
    """
    tick_s, end_s = scenario.tick_s, scenario.ticks * scenario.run.control_period_ms / 1000.0
    samples, ends = motion.samples, motion.ends
    time_s, stop_s = samples["time_s"].to_numpy(), samples["stop_start_s"].to_numpy()
    place = _place_in(ends, samples, scenario.swarm.robots)
    before = time_s < end_s - tick_s / 4
    last, following = np.full(ends.height, np.nan), np.full(ends.height, np.nan)
    latest, later = before & (time_s > end_s - 1.25 * tick_s), np.flatnonzero(~before)[::-1]
    last[place[latest]] = stop_s[latest]
    following[place[later]] = stop_s[later]  # from the end, so that the first one stays
    under_way = np.where(np.isnan(following), ends["stop_start_s"].to_numpy(), following)
    since = np.where(under_way < end_s - tick_s / 4, under_way, np.nan)
    standing = pl.Series("stop_start_s", np.where(np.isnan(last), since, last), nan_to_null=True)
    unknown = {name: pl.lit(None, dtype=pl.Float64) for name in ("x_m", "y_m", "heading_rad")}
    ends = ends.with_columns(standing, end_s=pl.lit(end_s), **unknown)
    return Motion(samples.filter(pl.Series(before)), ends.select(list(ENDS)), None, motion.moves)


def _place_in(ends: pl.DataFrame, samples: pl.DataFrame, robots: int) -> NDArray[np.int64]:
    """Which of the ends, a row a run and robot in order, is that of each sample's robot, (rows,)."""
    runs = ends["run"].to_numpy()[::robots]
    run = np.searchsorted(runs, samples["run"].to_numpy())
    place: NDArray[np.int64] = run * robots + samples["robot"].to_numpy()
    return place
