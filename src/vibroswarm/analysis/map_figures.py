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
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm import strategies
from vibroswarm.analysis.map_scores import map_scores
from vibroswarm.floors.floor import Floor
from vibroswarm.inference.agents import Swarm
from vibroswarm.inference.outcomes import fills_and_truth
from vibroswarm.inference.robot_maps import beliefs_of
from vibroswarm.localisation.locate import draws_read
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
        maps = beliefs_of(swarm.arrays, runs, robots, draws_read(scenario))[0]
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
