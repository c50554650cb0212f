"""Compute the maps of the floor that robots of the strategies ``places`` and ``explore`` keep, and a pooled map.

A map has for each tile the probability p that it vibrates. Each robot keeps log odds of each tile by sender: those from
its own samples, and those from each other robot's messages.

| name | what it is |
|---|---|
| vibrating | p = 1 / (1 + exp(-log odds)); log odds are the sum over senders, by the robot's weight of each sender |
| spread | sqrt(p (1 - p)) |
| pooled map | from the log odds that each robot has from its own samples, summed with equal weights |
| map at a time | from the samples taken by then, and all messages about these samples |

A strategy may keep several maps at once. Over draws of its place, p is the mean over the maps of all draws. Over pairs
of error rates, p is the mean over the pairs, weighted by the robot's probabilities of the pairs (in the pooled map: by
the mean of these probabilities over robots).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.jit import read_only
from vibroswarm.errors import InputError
from vibroswarm.inference.deliveries import timeline_of
from vibroswarm.inference.replay import classes_and_values, replay_to_end
from vibroswarm.inference.robot_maps import beliefs_of
from vibroswarm.localisation.locate import draws_read, estimates_key
from vibroswarm.motion.motion_tables import Motion
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.strategies.place_map import WITH_MAP

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
    """Return whether robots keep a map of the tiles that vibrate: of two kinds, that is."""
    return scenario.strategy.name in WITH_MAP and scenario.sensor.kinds == scenario.sensor.readings == 2


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
        draws_read(scenario),
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
        by_robot, pooled = beliefs_of(swarm.arrays, runs=1, robots=robots, draws=draws_read(scenario))
        maps.append(np.concatenate([by_robot[0], pooled]))
    return np.array(maps).reshape(len(time_s), robots + 1, tiles)


def _check_maps(result: Result) -> int:
    """Check that the robots of a result keep maps that can be recomputed, and return the result's seed.

    Raises:
        InputError: the strategy keeps no map, or the result is a recording.
    """
    if not keeps_floor_map(result.scenario):
        raise InputError(
            f"'{result.scenario.strategy.name}' keeps no map of what vibrates; {' and '.join(WITH_MAP)} do, where "
            "there are two kinds of tile",
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
