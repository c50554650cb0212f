"""The maps that robots of ``places`` and ``explore`` have of the floor, as tables: by robot, and of all own samples.

| name | equation |
|---|---|
| vibrating | p of a tile: 1 / (1 + exp(-log odds)), of all senders as the robot weighs them |
| spread | sqrt(p (1 - p)) |
| pooled | p from what each robot knows by its own samples, all of them trusted |
| at a time | from the samples taken by then, and all messages about them |
| draws of places | p is the mean over the maps of all draws |
| pairs of rates | p is the mean over them, by the robot's probabilities; pooled: by the mean of these |
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray
from scipy.special import expit

from vibroswarm.core.jit import read_only
from vibroswarm.errors import InputError
from vibroswarm.inference.agents import Swarm
from vibroswarm.inference.deliveries import timeline_of
from vibroswarm.inference.replay import bits_and_energies, replay_to_end
from vibroswarm.localisation.locate import draws_read, estimates_key
from vibroswarm.motion.motion_tables import Motion
from vibroswarm.result import Result
from vibroswarm.strategies.place_map import PAIRS

MAPS: Final[dict[str, Any]] = {
    "run": pl.UInt32,
    "robot": pl.UInt16,
    "row": pl.UInt32,
    "column": pl.UInt32,
    "vibrating": pl.Float64,
    "spread": pl.Float64,
    "vibrates": pl.UInt8,
}
"""One row per run, robot (null: pooled) and tile, rows from the top. ``vibrating``: the belief that the tile vibrates;
``vibrates``: whether it does."""

WITH_MAP: Final = ("places", "explore")
"""Strategies whose robots keep a map."""


def floor_maps(result: Result) -> pl.DataFrame:
    """Return the robots' maps at the end of each run (``MAPS``); the grid of tiles is known to them.

    Args:
        result: of a strategy in ``WITH_MAP``, simulated to its end.
    Raises:
        InputError: another strategy, a recording, or a result without the moves that estimated places need.
    """
    seed = _check_maps(result)
    scenario = result.scenario
    timeline = timeline_of(scenario, Motion(result.motion, result.ends, None, result.moves))
    robots, runs = scenario.swarm.robots, timeline.runs.tolist()
    by_robot, pooled = _beliefs(
        replay_to_end(scenario, seed, timeline, *bits_and_energies(result.observations)),
        len(runs),
        robots,
        draws_read(scenario),
    )
    frames = []
    for r, run in enumerate(runs):
        floor = result.floor(run)
        frames += [_frame(run, i, by_robot[r, i], floor.tiles) for i in range(robots)]
        frames.append(_frame(run, None, pooled[r], floor.tiles))
    return pl.concat(frames)


def maps_over_time(result: Result, run: int, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a run's maps at times, (times, robots + 1, tiles) beliefs that the tile vibrates; the last is pooled.

    Args:
        result: as for ``floor_maps``. time_s: (times,).
    Raises:
        InputError: as ``floor_maps``.
    """
    seed = _check_maps(result)
    scenario, robots = result.scenario, result.scenario.swarm.robots
    of_run = pl.col("run") == run
    samples, ends = result.motion.filter(of_run), result.ends.filter(of_run)
    moves = None if result.moves is None else result.moves.filter(of_run)
    seen = result.observations.filter(of_run)
    observation, energy = bits_and_energies(seen)
    whole = timeline_of(scenario, Motion(samples, ends, None, moves))
    estimates = whole.estimates(scenario, seed)  # of the past alone, so the same for any later end
    taken_s, maps = samples["time_s"].to_numpy(), []
    for now_s in time_s:
        known = taken_s <= now_s
        until = timeline_of(scenario, Motion(samples.filter(known), ends, None, moves))
        if estimates.size:
            cache: dict[Any, NDArray[np.float64]] = {
                estimates_key(scenario, seed): read_only(estimates[known])
            }
            until = replace(until, _estimates=cache)
        told = None if energy is None else energy[known]
        swarm = replay_to_end(scenario, seed, until, read_only(observation[known]), told)
        by_robot, pooled = _beliefs(swarm, 1, robots, draws_read(scenario))
        maps.append(np.concatenate([by_robot[0], pooled]))
    return np.array(maps)


def _check_maps(result: Result) -> int:
    """Return the seed of a result whose robots keep maps.

    Raises:
        InputError: they keep none, or the result is a recording.
    """
    name = result.scenario.strategy.name
    if name not in WITH_MAP:
        raise InputError(
            f"'{name}' keeps no map of the floor; {' and '.join(WITH_MAP)} do", field="strategy.name"
        )
    if result.seed is None:
        raise InputError("was recorded; its maps cannot be computed again", field="result")
    return result.seed


def _beliefs(
    swarm: Swarm, runs: int, robots: int, draws: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the maps by robot, (runs, robots, tiles), and pooled, (runs, tiles)."""
    has_pairs = hasattr(swarm.arrays, "credence")
    maps = PAIRS if has_pairs else max(draws, 1)
    odds = swarm.arrays.odds.reshape(runs, robots, maps, robots, -1)
    weight = swarm.arrays.weight.reshape(runs, robots, 1, robots, 1)
    credence = np.full((runs, robots, maps, 1), 1.0 / maps)
    if has_pairs:
        credence = swarm.arrays.credence.reshape(runs, robots, PAIRS, 1)
    by_robot = (expit((odds * weight).sum(axis=3)) * credence).sum(axis=2)
    own = odds[:, np.arange(robots), :, np.arange(robots)].sum(axis=0)
    pooled = (expit(own) * credence.mean(axis=1)).sum(axis=1)
    return np.clip(by_robot, 0.0, 1.0), np.clip(pooled, 0.0, 1.0)  # sums of shares round


def _frame(
    run: int, robot: int | None, belief: NDArray[np.float64], tiles: NDArray[np.uint8]
) -> pl.DataFrame:
    """Return the map of one robot, or pooled."""
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
        strict=False,
    )
