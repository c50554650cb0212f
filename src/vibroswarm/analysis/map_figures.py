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

from vibroswarm import strategies
from vibroswarm.analysis.map_scores import map_scores
from vibroswarm.core.jit import read_only
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor
from vibroswarm.inference.agents import Swarm
from vibroswarm.inference.deliveries import timeline_of
from vibroswarm.inference.outcomes import fills_and_truth
from vibroswarm.inference.replay import classes_and_values, replay_to_end
from vibroswarm.inference.reports import beliefs_of
from vibroswarm.localisation.locate import estimates_key
from vibroswarm.motion.motion_tables import Motion
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.strategies.place_map import WITH_MAP

SCORES: Final = {"map_brier": "brier", "map_auc": "auc", "map_location_error_m": "location_error_m"}
"""Figures of a run by name, and the score of which each is the mean over robots."""
MAPPED: Final = (*SCORES, "detection_time_s")
"""Figures of runs whose robots keep maps."""
MAP_FIGURES: Final[dict[str, Any]] = {"run": pl.UInt32, **dict.fromkeys(MAPPED, pl.Float64)}
"""Columns of the table, one row for each run; null where a score does not exist, such as the AUC of equal tiles."""


def keeps_map(scenario: Scenario) -> bool:
    """Return whether robots keep a map of the tiles that vibrate; False for a strategy whose code is not loaded."""
    known = strategies.known().get(scenario.strategy.name)
    has_tiles = scenario.sensor.kinds == 2 and not scenario.floor.has_surface
    return known is not None and has_tiles and (known.name in WITH_MAP or "p" in known.reported)


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
        result: of a strategy in ``WITH_MAP``, simulated to its end.
    Raises:
        InputError: another strategy, a recording, or a result without the moves that estimated places need.
    """
    seed = _check_maps(result)
    scenario = result.scenario
    timeline = timeline_of(scenario, Motion(samples=result.motion, ends=result.ends, moves=result.moves))
    robots, runs = scenario.swarm.robots, timeline.rows.runs.tolist()
    by_robot, pooled = beliefs_of(
        replay_to_end(scenario, seed, timeline, *classes_and_values(result.observations)).arrays,
        len(runs),
        robots,
    )
    frames = []
    ends_s = dict(result.runs.select("run", "end_s").iter_rows())
    for r, run in enumerate(runs):
        tiles = result.floor(run).at(ends_s[run]).tiles
        frames += [_frame(run, i, by_robot[r, i], tiles) for i in range(robots)]
        frames.append(_frame(run, robot=None, belief=pooled[r], tiles=tiles))
    return pl.concat(frames)


def maps_over_time(result: Result, run: int, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the maps of one run at several times.

    Args:
        result: of a strategy in ``WITH_MAP``, simulated to its end. run: number of a run of this result. time_s: times
            of the maps, s, (times,).
    Returns: beliefs that each tile vibrates, (times, robots + 1, tiles); the last entry of axis 1 is the pooled map.
    Raises:
        InputError: another strategy, a recording, a result without the moves that estimated places need, or no run of
            this number.
    """
    seed = _check_maps(result)
    scenario, robots = result.scenario, result.scenario.swarm.robots
    tiles = result.floor(run).tiles.size
    of_run = pl.col("run") == run
    samples, ends = result.motion.filter(of_run), result.ends.filter(of_run)
    moves = None if result.moves is None else result.moves.filter(of_run)
    observation, energy = classes_and_values(result.observations.filter(of_run))
    whole = timeline_of(scenario, Motion(samples=samples, ends=ends, moves=moves))
    # An estimated place depends on the past alone, so the estimates of the whole run hold at each time too.
    estimates = whole.estimates(scenario, seed)
    taken_s, maps = samples["time_s"].to_numpy(), []
    # The map at a time is the final map of a replay with only the samples taken by then.
    for now_s in time_s:
        taken = taken_s <= now_s
        so_far = timeline_of(scenario, Motion(samples=samples.filter(taken), ends=ends, moves=moves))
        if estimates.size:  # it is empty if robots know their true places
            # The shortened timeline gets the estimates in its cache, so that it does not compute them again.
            cache: dict[Any, NDArray[np.float64]] = {
                estimates_key(scenario, seed): read_only(estimates[taken])
            }
            so_far = replace(so_far, _estimates=cache)
        energy_so_far = None if energy is None else energy[taken]
        swarm = replay_to_end(scenario, seed, so_far, read_only(observation[taken]), energy_so_far)
        by_robot, pooled = beliefs_of(swarm.arrays, runs=1, robots=robots)
        maps.append(np.concatenate([by_robot[0], pooled]))
    return np.array(maps).reshape(len(time_s), robots + 1, tiles)


def _check_maps(result: Result) -> int:
    """Check that the robots of a result keep maps that can be recomputed, and return the result's seed.

    Raises:
        InputError: the strategy keeps no map, or the result is a recording.
    """
    if not keeps_floor_map(result.scenario):
        raise InputError(
            f"'{result.scenario.strategy.name}' keeps no map of what vibrates; {' and '.join(WITH_MAP)} do",
            field="strategy.name",
        )
    if result.seed is None:
        raise InputError(
            "is a recording, whose maps cannot be recomputed; give a simulated result", field="result"
        )
    return result.seed


def _frame(
    run: int, robot: int | None, belief: NDArray[np.float64], tiles: NDArray[np.uint8]
) -> pl.DataFrame:
    """Return one map as a table with the columns ``MAPS``.

    Args:
        robot: its number; None: the pooled map. belief: that each tile vibrates, (tiles,), row by row.
        tiles: of the floor, 1 where it vibrates, (rows, columns).
    """
    row, column = np.indices(tiles.shape)
    return pl.DataFrame(
        {
            "run": np.full(belief.size, run),
            "robot": [robot] * belief.size,
            "row": row.ravel(),
            "column": column.ravel(),
            "vibrating": belief,
            "spread": np.sqrt(belief * (1.0 - belief)),
            "vibrates": tiles.ravel(),
        },
        schema=MAPS,
        strict=False,  # converts the integers to the types of the schema
    )
