"""How good the maps are that robots have at the end of a run: means over robots, a number for each run.

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
from vibroswarm.analysis.floor_maps import WITH_MAP, beliefs_of, floor_maps
from vibroswarm.analysis.map_scores import map_scores
from vibroswarm.floors.floor import Floor
from vibroswarm.inference.agents import Swarm
from vibroswarm.localisation.locate import draws_read
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import Scenario

MAPPED: Final = {"map_brier": "brier", "map_auc": "auc", "map_location_error_m": "location_error_m"}
"""Figures of a run by name, and the score of which each is the mean over robots."""
MAP_FIGURES: Final[dict[str, Any]] = {"run": pl.UInt32, **dict.fromkeys(MAPPED, pl.Float64)}
"""Columns of the table, one row for each run; null where a score does not exist, such as the AUC of equal tiles."""


def keeps_map(scenario: Scenario) -> bool:
    """Return whether robots keep a map of the tiles that vibrate; False for a strategy whose code is not loaded."""
    known = strategies.known().get(scenario.strategy.name)
    has_tiles = scenario.sensor.kinds == 2 and not scenario.floor.has_surface
    return known is not None and has_tiles and (known.name in WITH_MAP or "p" in known.reports)


def map_figures(
    scenario: Scenario, swarm: Swarm, floors: Mapping[int, Floor], end_s: NDArray[np.float64]
) -> pl.DataFrame:
    """Return the table ``MAP_FIGURES`` of runs, of a scenario that ``keeps_map``.

    Args:
        swarm: state of all robots at the end of the runs. floors: by number of the run. end_s: of each run, (runs,).
    """
    runs, robots = len(floors), scenario.swarm.robots
    if scenario.strategy.name in WITH_MAP:
        maps = beliefs_of(swarm, runs, robots, draws_read(scenario))[0]
    else:  # without an array p a field has this name, which is no map
        reported = getattr(swarm.arrays, "p", np.empty((runs * robots, 0)))
        maps = np.asarray(reported, dtype=np.float64).reshape(runs, robots, -1)
    return _table(dict(zip(floors, maps, strict=True)), floors, end_s)


def map_figures_of(result: Result) -> pl.DataFrame:
    """Return the table ``MAP_FIGURES`` of a simulated result of a scenario that ``keeps_map``."""
    floors = {run: result.floor(run) for run in result.runs["run"].to_list()}
    if result.scenario.strategy.name in WITH_MAP:
        found = floor_maps(result).filter(pl.col("robot").is_not_null()).select("run", "robot", p="vibrating")
    else:
        assert result.reports is not None
        found = result.reports.filter(pl.col("name") == "p").select("run", "robot", "index", p="value")
        # A field of this name has a row for each sample, and no index but 0.
        found = found.filter(pl.col("index").max().over("run", "robot") > 0)
    maps = {
        run: np.array([own["p"].to_list() for _, own in of_run.group_by("robot", maintain_order=True)])
        for (run,), of_run in found.group_by("run", maintain_order=True)
    }
    return _table(maps, floors, result.runs["end_s"].to_numpy())


def _table(
    maps: Mapping[int, NDArray[np.float64]], floors: Mapping[int, Floor], end_s: NDArray[np.float64]
) -> pl.DataFrame:
    """Return the table of the means over robots; runs whose arrays are not maps of their floor have no scores.

    Args:
        maps: probabilities of tiles by number of the run, (robots, tiles) each.
    """
    rows = []
    for (run, floor), end in zip(floors.items(), end_s.tolist(), strict=True):
        now, own = floor.at(end), maps.get(run, np.empty((0, 0)))
        row: dict[str, Any] = {"run": run}
        if own.shape[-1] == now.tiles.size and own.size:
            scores = [map_scores(p, now) for p in own]
            row |= {name: float(np.mean([one[score] for one in scores])) for name, score in MAPPED.items()}
        rows.append(row)
    return pl.DataFrame(rows, schema=MAP_FIGURES).fill_nan(None)
