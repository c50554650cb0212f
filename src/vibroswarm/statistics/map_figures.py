"""How good the maps are that robots have at the end of a run, and how soon they detect: a number for each run.

| figure | what it is |
|---|---|
| map_brier, map_auc, map_location_error_m | means over robots of a score of their maps (``map_scores``) |
| detection_time_s | mean over robots of the time from which on, to its end, a robot believes with at least p_c that \
more vibrates than the boundary; a robot of which this is never so counts with T_end |

Time to detection is that of evidence, not of decisions: a robot that has decided goes on believing, and one that was
sure for a while and then no longer is has not detected yet. It is known on floors of which more than the boundary
vibrates, for robots that ask so (task ``fill_ratio``); on others there is nothing to detect.

The scores are those of ``map_scores``. Strategies that keep a map are those of ``floor_maps``, and any that reports an
array ``p`` (``Strategy.reports``) with a number for each tile: the probability that it vibrates. Tiles of more than two
kinds, patches and values have none. The floor is that at the end of the run.

Maps of earlier times are not stored, so that the time from which on a map is right is not among these figures.

The maps themselves (``floor_maps``) are those that robots of ``places`` and ``explore`` keep, and a pooled one. A map
has for each tile the probability p that it vibrates. Each robot keeps log odds of each tile by sender: those from its
own samples, and those from each other robot's messages.

| name | what it is |
|---|---|
| vibrating | p = 1 / (1 + exp(-log odds)); log odds are the sum over senders, by the robot's weight of each sender |
| spread | sqrt(p (1 - p)) |
| pooled map | from the log odds that each robot has from its own samples, summed with equal weights |
| map at a time | from the samples taken by then, and all messages about these samples |
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.jit import read_only
from vibroswarm.floors.floor import Floor
from vibroswarm.inference.agents import Swarm
from vibroswarm.inference.deliveries import Timeline, timeline_of
from vibroswarm.inference.outcomes import fills_and_truth
from vibroswarm.inference.replay import classes_and_values, replay_to_end
from vibroswarm.inference.reports import beliefs_of
from vibroswarm.localisation.locate import estimates_key
from vibroswarm.motion.motion_tables import Motion
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.statistics.map_scores import map_scores
from vibroswarm.strategies.place_map import WITH_MAP

SCORES: Final = {"map_brier": "brier", "map_auc": "auc", "map_location_error_m": "location_error_m"}
"""Figures of a run by name, and the score of which each is the mean over robots."""
MAPPED: Final = (*SCORES, "detection_time_s")
"""Figures of runs whose robots keep maps."""
MAP_FIGURES: Final[dict[str, Any]] = {"run": pl.UInt32, **dict.fromkeys(MAPPED, pl.Float64)}
"""Columns of the table, one row for each run; null where a score does not exist, such as the AUC of equal tiles."""


def keeps_map(scenario: Scenario) -> bool:
    """Return whether robots keep a map of the tiles that vibrate."""
    strategy = scenario.strategy.entry
    has_tiles = scenario.sensor.kinds == 2 and not scenario.floor.has_surface
    return has_tiles and (strategy.name in WITH_MAP or "p" in strategy.reported)


def map_figures(
    scenario: Scenario,
    swarm: Swarm,
    floors: Mapping[int, Floor],
    end_s: NDArray[np.float64],
    samples: pl.DataFrame,
) -> pl.DataFrame:
    """Return the table ``MAP_FIGURES`` of runs, of a scenario that ``keeps_map``.

    Args:
        swarm: state of all robots at the end of the runs. floors: by number of the run. end_s: of each run, (runs,).
        samples: run, robot, time_s and belief_below of each sample, by run, robot and time.
    """
    runs, robots = len(floors), scenario.swarm.robots
    if scenario.strategy.name in WITH_MAP:
        maps = beliefs_of(swarm.arrays, runs, robots)[0]
    else:  # without an array p a field has this name, which is no map
        reported = getattr(swarm.arrays, "p", np.empty((runs * robots, 0)))
        maps = np.asarray(reported, dtype=np.float64).reshape(runs, robots, -1)
    detected_s = detection_times_s(scenario, floors, end_s, samples)
    rows = []
    for (run, floor), end, own in zip(floors.items(), end_s.tolist(), maps, strict=True):
        now = floor.at(end)
        row: dict[str, Any] = {"run": run}
        if own.shape[-1] == now.tiles.size:  # else the arrays are not maps of this floor, and have no figures
            scores = [map_scores(p, now) for p in own]
            row |= {name: float(np.mean([one[score] for one in scores])) for name, score in SCORES.items()}
            row["detection_time_s"] = detected_s.get(run)
        rows.append(row)
    return pl.DataFrame(rows, schema=MAP_FIGURES).fill_nan(None)


def detection_times_s(
    scenario: Scenario, floors: Mapping[int, Floor], end_s: NDArray[np.float64], samples: pl.DataFrame
) -> dict[int, float]:
    """Return the time to detection of the runs in which there is something to detect, by number of the run, s.

    The arguments are those of ``map_figures``.
    """
    truth = fills_and_truth(scenario, floors, list(floors), end_s)[1]
    damaged = [run for run, right in zip(floors, truth.tolist(), strict=True) if right == 1.0]
    known = samples.filter(pl.col("belief_below").is_not_null() & pl.col("belief_below").is_not_nan())
    if scenario.task.name != "fill_ratio" or known.is_empty():
        return {}
    says = (1.0 - pl.col("belief_below") >= scenario.decision.credible_threshold).cast(pl.Int8)
    stays = says.reverse().cum_min().reverse().over("run", "robot")
    by_robot = known.filter(stays == 1).group_by("run", "robot", maintain_order=True)
    first = by_robot.agg(pl.col("time_s").min())
    of_run = first.group_by("run").agg(pl.col("time_s").sum(), robots=pl.len())
    robots, t_end_s = scenario.swarm.robots, scenario.run.t_end_s
    sums = {run: (time_s, count) for run, time_s, count in of_run.iter_rows()}
    return {
        run: (time_s + (robots - count) * t_end_s) / robots
        for run in damaged
        for time_s, count in [sums.get(run, (0.0, 0))]
    }


MAPS: Final[dict[str, Any]] = {
    "run": pl.UInt32,
    "robot": pl.UInt16,
    "row": pl.UInt32,
    "column": pl.UInt32,
    "vibrating": pl.Float64,
    "spread": pl.Float64,
    "vibrates": pl.UInt8,
}
"""One row per run, robot (null: pooled) and tile. ``row``, ``column``: of the tile, rows from the top. ``vibrating``:
belief that the tile vibrates; ``spread``: its standard deviation; ``vibrates``: 1 if the tile vibrates at the end of
the run, else 0."""


def keeps_floor_map(scenario: Scenario) -> bool:
    """Return whether robots keep a map of the tiles that vibrate."""
    return scenario.strategy.name in WITH_MAP


def floor_maps(result: Result) -> pl.DataFrame:
    """Return the robots' maps and the pooled map at the end of each run: a table with the columns ``MAPS``.

    Results do not hold maps, so the strategy is replayed.

    Args:
        result: simulated to its end, of a strategy in ``WITH_MAP``.
    """
    scenario, robots = result.scenario, result.scenario.swarm.robots
    timeline = timeline_of(scenario, Motion(samples=result.motion, ends=result.ends, moves=result.moves))
    runs = timeline.rows.runs.tolist()
    maps = _maps_at_end(result, timeline, len(runs), *classes_and_values(result.observations))
    ends_s = dict(result.runs.select("run", "end_s").iter_rows())
    frames = []
    for own, run in zip(maps, runs, strict=True):
        tiles = result.floor(run).at(ends_s[run]).tiles
        row, column = np.indices(tiles.shape)
        of_tiles = pl.DataFrame({"row": row.ravel(), "column": column.ravel(), "vibrates": tiles.ravel()})
        for robot, belief in zip([*range(robots), None], own, strict=True):
            frames.append(
                of_tiles.select(
                    pl.lit(run).alias("run"),
                    pl.lit(robot).alias("robot"),
                    "row",
                    "column",
                    pl.Series("vibrating", belief),
                    pl.Series("spread", np.sqrt(belief * (1.0 - belief))),
                    "vibrates",
                ).cast(MAPS)  # type: ignore[arg-type]
            )
    return pl.concat(frames)


def maps_over_time(result: Result, run: int, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the maps of one run at several times.

    Args:
        result: simulated to its end, of a strategy in ``WITH_MAP``. run: number of a run of this result. time_s: times
            of the maps, s, (times,).
    Returns: beliefs that each tile vibrates, (times, robots + 1, tiles); the last entry of axis 1 is the pooled map.
    """
    scenario = result.scenario
    samples, ends = result.motion.filter(run=run), result.ends.filter(run=run)
    moves = None if result.moves is None else result.moves.filter(run=run)
    observation, energy = classes_and_values(result.observations.filter(run=run))
    whole = timeline_of(scenario, Motion(samples=samples, ends=ends, moves=moves))
    # An estimated place depends on the past alone, so the estimates of the whole run hold at each time too.
    estimates = whole.estimates(scenario, result.seed or 0)
    taken_s = samples["time_s"].to_numpy()
    maps = np.empty((len(time_s), scenario.swarm.robots + 1, result.floor(run).tiles.size))
    # The map at a time is the final map of a replay with only the samples taken by then.
    for now, now_s in zip(maps, time_s, strict=True):
        taken = taken_s <= now_s
        so_far = timeline_of(scenario, Motion(samples=samples.filter(taken), ends=ends, moves=moves))
        if estimates.size:  # it is empty if robots know their true places; else they are not computed again
            key = estimates_key(scenario, result.seed or 0)
            so_far = replace(so_far, _estimates={key: read_only(estimates[taken])})
        energy_so_far = None if energy is None else energy[taken]
        now[:] = _maps_at_end(result, so_far, 1, read_only(observation[taken]), energy_so_far)[0]
    return maps


def _maps_at_end(
    result: Result,
    timeline: Timeline,
    runs: int,
    observation: NDArray[np.uint8],
    energy: NDArray[np.float32] | None,
) -> NDArray[np.float64]:
    """Return beliefs that each tile vibrates at the end, (runs, robots + 1, tiles), of which the last are pooled."""
    assert result.seed is not None  # maps of a recording cannot be recomputed
    swarm = replay_to_end(result.scenario, result.seed, timeline, observation, energy)
    by_robot, pooled = beliefs_of(swarm.arrays, runs, result.scenario.swarm.robots)
    return np.concatenate([by_robot, pooled[:, None]], axis=1)
