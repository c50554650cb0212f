"""Maps that robots keep of the floor, how good they are at the end of a run, and how soon they detect.

| name | equation |
|---|---|
| vibrating | p = 1 / (1 + exp(-log odds)); log odds are the sum over senders, by the robot's weight of each sender |
| spread | sqrt(p (1 - p)) |
| pooled map | from the log odds that each robot has from its own samples, summed with equal weights |
| Brier score | mean over tiles of (p_t - x_t)^2; 1/4 of a map that knows nothing |
| log score | mean of -ln of the probability given to what is true, at least 1e-12 |
| AUC | probability that a vibrating tile has a larger p_t than a still one; ties count half |
| right | share of tiles with p_t above 1/2 where they vibrate, below where they do not |
| surely wrong | tiles with more than 95 % for what is not true |
| location error | distance between the centres of gravity of the map and of what vibrates |
| calibration | of tiles with p_t in a bin: their mean p_t, and the share that vibrates |
| detection_time_s | mean over robots of the time from which on, to its end, a robot believes with at least p_c that \
more vibrates than the boundary, decided or not; a robot of which this is never so counts with T_end |

Figures of a run are means over robots. Time to detection is known for robots that ask so (task ``fill_ratio``), on
floors of which more than the boundary vibrates. Scores are those of tiles of two kinds, for the strategies of
``WITH_MAP`` and any that reports an array ``p`` with a number for each tile: the probability that it vibrates.
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
from vibroswarm.statistics.intervals import Values, wilson_limits
from vibroswarm.strategies.place_map import WITH_MAP

SCORES: Final = {"map_brier": "brier", "map_auc": "auc", "map_location_error_m": "location_error_m"}
"""Figures of a run by name, and the score of which each is the mean over robots."""
MAPPED: Final = (*SCORES, "detection_time_s")
"""Figures of runs whose robots keep maps."""


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
) -> dict[str, NDArray[np.float64]]:
    """Return the figures ``MAPPED`` of a scenario that ``keeps_map``, (runs,) each; nan where a run does not have one.

    Args:
        swarm: at the end. end_s: (runs,). samples: run, robot, time_s and belief_below, by run, robot and time.
    """
    runs, robots = len(floors), scenario.swarm.robots
    if scenario.strategy.name in WITH_MAP:
        maps = beliefs_of(swarm.arrays, runs, robots)[0]
    else:  # without an array p a field has this name, which is no map
        reported = getattr(swarm.arrays, "p", np.empty((runs * robots, 0)))
        maps = np.asarray(reported, dtype=np.float64).reshape(runs, robots, -1)
    detected_s = detection_times_s(scenario, floors, end_s, samples)
    found = {name: np.full(runs, np.nan) for name in MAPPED}
    for place, (run, end, own) in enumerate(zip(floors, end_s.tolist(), maps, strict=True)):
        now = floors[run].at(end)
        if own.shape[-1] == now.tiles.size:  # else the arrays are not maps of this floor, and have no figures
            scores = [map_scores(p, now) for p in own]
            for name, score in SCORES.items():
                found[name][place] = np.mean([one[score] for one in scores])
            found["detection_time_s"][place] = detected_s.get(run, np.nan)
    return found


def detection_times_s(
    scenario: Scenario, floors: Mapping[int, Floor], end_s: NDArray[np.float64], samples: pl.DataFrame
) -> dict[int, float]:
    """Return the time to detection (s) of runs in which there is something to detect, by number of the run."""
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
"""One row per run, robot (null: pooled) and tile; ``vibrating``: belief, ``spread``: of it, ``vibrates``: truth."""


def floor_maps(result: Result) -> pl.DataFrame:
    """Return the robots' maps and the pooled map at the end of each run (``MAPS``), by replaying the strategy."""
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
    """Return the maps of one run at times (s), (times, robots + 1, tiles); the last robot is the pooled map."""
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


BINS: Final = (0.0, 0.05, 0.2, 0.4, 0.6, 0.8, 0.95, 1.0)
"""Edges of the bins of calibration."""
SURE: Final = 0.95


def map_scores(p: Values, floor: Floor) -> dict[str, float]:
    """Return the scores of one map by name, from the probability of each tile, (tiles,)."""
    x = floor.tiles.ravel().astype(np.float64)
    told = np.where(x == 1, p, 1.0 - p)
    return {
        "brier": float(np.mean((p - x) ** 2)),
        "log_score": float(-np.log(np.maximum(told, 1e-12)).mean()),
        "auc": _auc(p, x),
        "right": float(np.mean(told > 0.5)),
        "surely_wrong": float((told < 1.0 - SURE).sum()),
        "location_error_m": _location_error_m(p, x, floor),
    }


def _auc(p: Values, x: Values) -> float:
    """Return the area under the curve of hits against false calls; nan if all tiles are alike or one p is nan."""
    vibrating, still = int((x == 1).sum()), int((x == 0).sum())
    if not vibrating or not still or np.isnan(p).any():
        return float("nan")
    # Mann and Whitney: ranks of the vibrating tiles, ties at their mean rank, less those among themselves.
    ranks = pl.Series(p).rank().to_numpy()
    return float((ranks[x == 1].sum() - 0.5 * vibrating * (vibrating + 1)) / (vibrating * still))


def _location_error_m(p: Values, x: Values, floor: Floor) -> float:
    """Return the distance between the centres of gravity of map and truth; nan if nothing vibrates."""
    rows, columns, width_m, height_m, _, _ = floor.geometry
    row, column = (index.ravel() for index in np.indices((int(rows), int(columns))))
    if not x.any() or not p.any():
        return float("nan")
    (x0, y0), (x1, y1) = ((np.average(column, weights=w), np.average(row, weights=w)) for w in (p, x))
    return float(np.hypot((x0 - x1) * width_m, (y0 - y1) * height_m))


def calibration(p: Values, x: Values) -> pl.DataFrame:
    """Return a row for each bin of probability: tiles, mean probability, share that vibrates, with Wilson's limits.

    The limits are those of independent tiles, which tiles of one map, or of several maps of one floor, are not.
    """
    bin_of = np.clip(np.searchsorted(BINS, p, side="right") - 1, 0, len(BINS) - 2)
    rows = []
    for k in range(len(BINS) - 1):
        own = bin_of == k
        if own.any():
            low, high = wilson_limits(x[own].sum(), own.sum())
            rows.append(
                (BINS[k], BINS[k + 1], int(own.sum()), p[own].mean(), x[own].mean(), float(low), float(high))
            )
    names = ("from", "to", "tiles", "probability", "vibrating", "vibrating_low", "vibrating_high")
    return pl.DataFrame(
        rows,
        schema=dict(zip(names, (pl.Float64, pl.Float64, pl.Int64, *[pl.Float64] * 4), strict=True)),
        orient="row",
    )
