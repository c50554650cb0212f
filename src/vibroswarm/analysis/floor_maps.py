"""The maps that robots of ``places`` and ``explore`` have of the floor, as tables: by robot, and of all own samples.

| name | equation |
|---|---|
| vibrating | p of a tile: 1 / (1 + exp(-log odds)), of all senders as the robot weighs them |
| spread | sqrt(p (1 - p)) |
| pooled | p from what each robot knows by its own samples, all of them trusted |
| pairs of rates | p is the mean over them, by the robot's probabilities; pooled: by the mean of these |
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray
from scipy.special import expit

from vibroswarm.errors import InputError
from vibroswarm.inference.deliveries import timeline_of
from vibroswarm.inference.replay import replay_to_end
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
    scenario = result.scenario
    if scenario.strategy.name not in WITH_MAP:
        raise InputError(
            f"'{scenario.strategy.name}' keeps no map of the floor; {' and '.join(WITH_MAP)} do",
            field="strategy.name",
        )
    if result.seed is None:
        raise InputError("was recorded; its maps cannot be computed again", field="result")
    timeline = timeline_of(scenario, Motion(result.motion, result.ends, None, result.moves))
    swarm = replay_to_end(scenario, result.seed, timeline, result.observations["observation"].to_numpy())
    robots, runs = scenario.swarm.robots, timeline.runs.tolist()
    odds = swarm.arrays.odds.reshape(len(runs), robots, PAIRS, robots, -1)
    weight = swarm.arrays.weight.reshape(len(runs), robots, 1, robots, 1)
    credence = swarm.arrays.credence.reshape(len(runs), robots, PAIRS, 1)
    by_robot = (expit((odds * weight).sum(axis=3)) * credence).sum(axis=2)
    own = odds[:, np.arange(robots), :, np.arange(robots)].sum(axis=0)
    pooled = (expit(own) * credence.mean(axis=1)).sum(axis=1)
    frames = []
    for r, run in enumerate(runs):
        floor = result.floor(run)
        frames += [_frame(run, i, by_robot[r, i], floor.tiles) for i in range(robots)]
        frames.append(_frame(run, None, pooled[r], floor.tiles))
    return pl.concat(frames)


def _frame(
    run: int, robot: int | None, belief: NDArray[np.float64], tiles: NDArray[np.uint8]
) -> pl.DataFrame:
    """Return the map of one robot, or pooled."""
    belief, (row, column) = np.clip(belief, 0.0, 1.0), np.indices(tiles.shape)  # sums of shares round
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


def map_cells(maps: pl.DataFrame, run: int, robot: int | None = None) -> pl.DataFrame:
    """Return one map as ``plots.draw_heat`` takes it: x, y, value; y grows upwards.

    Args:
        maps: as ``floor_maps`` returns them. run, robot: which; without a robot the pooled one.
    Raises:
        InputError: there is no such map.
    """
    of_robot = pl.col("robot").is_null() if robot is None else pl.col("robot") == robot
    own = maps.filter((pl.col("run") == run) & of_robot)
    if own.is_empty():
        raise InputError(f"there is no map of run {run}, robot {robot}", field="run")
    top = own["row"].max()
    return own.select(
        x=pl.col("column") + 1,
        y=pl.lit(top).cast(pl.Int64) + 1 - pl.col("row").cast(pl.Int64),
        value="vibrating",
    )
