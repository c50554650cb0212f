"""What robots report: the values that a strategy declares (``Strategy.reports``), as a table.

Fields and arrays of a robot's state are reported after each of its samples; its other arrays, which are large, at the
end of the run.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.inference.agents import Swarm, strategy_used
from vibroswarm.inference.deliveries import Timeline
from vibroswarm.inference.replay_arrays import Log
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.strategies.place_map import WITH_MAP

REPORTS: Final[dict[str, Any]] = {
    "run": pl.UInt32,
    "robot": pl.UInt16,
    "sample": pl.UInt32,
    "name": pl.String,
    "index": pl.UInt32,
    "value": pl.Float64,
}
"""Columns of the table of reports. ``index`` is the place in an array, 0 for a field; ``value`` is null if there is
none yet. The rows of an array that is not of the state have the robot's last sample."""


def report_frame(scenario: Scenario, timeline: Timeline, log: Log, swarm: Swarm) -> pl.DataFrame | None:
    """Return the table of what robots reported, None if the strategy reports nothing."""
    parts = [_rows(scenario, name, timeline, log, swarm) for name in strategy_used(scenario).reported]
    return pl.concat(parts).sort("run", "robot", "sample", "name", "index") if parts else None


def _rows(scenario: Scenario, name: str, timeline: Timeline, log: Log, swarm: Swarm) -> pl.DataFrame:
    """Return the rows of a field or array: of the state after each sample, others at the end."""
    if name in (log.states.dtype.names or ()):
        rows, values = timeline.samples, log.states[name]
    else:
        samples = swarm.agents["samples"]
        latest = timeline.ends.select("run", "robot", sample=pl.Series(np.maximum(samples - 1, 0)))
        rows, values = latest.filter(samples > 0), array_at_end(scenario, name, swarm.arrays)[samples > 0]
    places = values.reshape(len(values), math.prod(values.shape[1:]))  # also of no rows
    of_place = np.repeat(np.arange(len(places)), places.shape[1])
    columns: dict[str, Any] = {key: rows[key].to_numpy()[of_place] for key in ("run", "robot", "sample")}
    columns |= {"name": [name] * of_place.size, "index": np.tile(np.arange(places.shape[1]), len(places))}
    columns["value"] = places.ravel().astype(np.float64)
    return pl.DataFrame(columns, schema=REPORTS, nan_to_null=True)


def array_at_end(scenario: Scenario, name: str, arrays: Any) -> NDArray[Any]:
    """Return a reported array at the end, (robots of all runs, size); the scratch array ``p`` is computed from
    evidence.
    """
    found = np.asarray(getattr(arrays, name))
    if name != "p" or scenario.strategy.name not in WITH_MAP:
        return found
    robots = scenario.swarm.robots
    return beliefs_of(arrays, len(found) // robots, robots)[0].reshape(len(found), -1)


def beliefs_of(arrays: Any, runs: int, robots: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the maps of robots that keep one, (runs, robots, tiles), and the pooled map, (runs, tiles), at the end."""
    from scipy.special import expit  # its import takes long

    # Axes: run, robot, sender, tile.
    odds = arrays.odds.reshape(runs, robots, robots, -1)
    weight = arrays.weight.reshape(runs, robots, robots, 1)
    # Log odds of a tile of which nothing is known, as each robot has learned them; 0 if tiles are independent.
    prior = arrays.prior_odds.reshape(runs, robots, 1)
    # Robot i's log odds from sender i are those from its own samples.
    own = odds[:, np.arange(robots), np.arange(robots)].sum(axis=1)
    return expit((odds * weight).sum(axis=2) + prior), expit(own + prior.mean(axis=1))


ESTIMATE: Final = ("estimate", "estimate_spread")
"""Reports that are figures of runs anyway (``statistics.figures``)."""
MOST_PLACES: Final = 16
"""Figures are computed of arrays of at most so many places."""
REPORTED: Final[dict[str, Any]] = {
    "run": pl.UInt32,
    "name": pl.String,
    "index": pl.UInt32,
    "value": pl.Float64,
    "error": pl.Float64,
}
"""Columns of the table of what robots reported at the end: means over the robots of a run, null if no robot has a
value. ``error``: mean distance from the number that the task asks for, null if the report estimates no number."""


def reported_at_end(
    scenario: Scenario, swarm: Swarm, runs: Sequence[int], asked: NDArray[np.float64]
) -> pl.DataFrame:
    """Return the table ``REPORTED`` of runs, by the robots' state at the end. Shapes: ``asked`` (runs,)."""
    has_sampled = swarm.agents["samples"] > 0
    parts = [pl.DataFrame(schema=REPORTED)]
    for name, one in strategy_used(scenario).reported.items():
        of_state = name in (swarm.states.dtype.names or ())
        at_end = swarm.states[name] if of_state else array_at_end(scenario, name, swarm.arrays)
        places = math.prod(at_end.shape[1:])
        if name in ESTIMATE or places > MOST_PLACES:
            continue
        known = np.where(has_sampled[:, None], at_end.reshape(len(at_end), places).astype(np.float64), np.nan)
        values = known.reshape(len(runs), scenario.swarm.robots, places)
        error = np.abs(values - asked[:, None, None]) if one.estimates else np.full_like(values, np.nan)
        columns = {
            "run": np.repeat(np.asarray(runs), places),
            "name": [name] * (len(runs) * places),
            "index": np.tile(np.arange(places), len(runs)),
            "value": _mean_of_known(values).ravel(),
            "error": _mean_of_known(error).ravel(),
        }
        parts.append(pl.DataFrame(columns, schema=REPORTED, nan_to_null=True))
    return pl.concat(parts)


def _mean_of_known(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return means over the robots (axis 1) that have a value, nan if none has."""
    with np.errstate(invalid="ignore"):
        return np.asarray(np.nansum(values, axis=1) / (~np.isnan(values)).sum(axis=1))
