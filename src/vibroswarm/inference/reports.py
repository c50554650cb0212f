"""What robots report: the values that a strategy declares (``Strategy.reports``), as a table.

Fields and arrays of a robot's state are reported after each of its samples; its other arrays, which are large, at the
end of the run.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.inference.agents import Swarm, strategy_used
from vibroswarm.inference.deliveries import Timeline
from vibroswarm.inference.replay_arrays import Log
from vibroswarm.inference.robot_maps import beliefs_of
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.strategies.base import Report
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
    """Return the table of what robots reported, None if the strategy reports nothing.

    Rows are put in order without the threads of polars, which a forked process does not have.

    Args:
        timeline: samples and ends of the runs that were replayed. log: state after each sample. swarm: state of all
            robots at the end, in the order of ``timeline.ends``.
    """
    names = list(strategy_used(scenario).reported)
    if not names:
        return None
    fields = log.states.dtype.names or ()
    parts = [
        _of_samples(name, timeline, log) if name in fields else _of_ends(scenario, name, timeline, swarm)
        for name in names
    ]
    column = {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}
    column["name"] = np.repeat(np.arange(len(names)), [part["run"].size for part in parts])
    order = np.lexsort([column[key] for key in ("index", "name", "sample", "robot", "run")])
    written = np.array(names, dtype=object)
    values: dict[str, Any] = {key: rows[order] for key, rows in column.items()}
    values["name"] = written[values["name"]].tolist()
    return pl.DataFrame(
        [pl.Series(key, values[key], dtype=kind, nan_to_null=key == "value") for key, kind in REPORTS.items()]
    )


def _of_samples(name: str, timeline: Timeline, log: Log) -> dict[str, NDArray[Any]]:
    """Return the rows of a field or array of the robots' states, all but their name."""
    rows: dict[str, NDArray[Any]] = {
        key: timeline.samples[key].to_numpy() for key in ("run", "robot", "sample")
    }
    return _by_index(rows, log.states[name])


def _of_ends(scenario: Scenario, name: str, timeline: Timeline, swarm: Swarm) -> dict[str, NDArray[Any]]:
    """Return the rows of an array of each robot that sampled, at the end of its run; all but their name."""
    sampled = np.flatnonzero(swarm.agents["samples"] > 0)
    rows: dict[str, NDArray[Any]] = {key: timeline.ends[key].to_numpy()[sampled] for key in ("run", "robot")}
    rows["sample"] = swarm.agents["samples"][sampled] - 1
    return _by_index(rows, array_at_end(scenario, name, swarm.arrays)[sampled])


def array_at_end(scenario: Scenario, name: str, arrays: Any) -> NDArray[Any]:
    """Return a reported array of each robot at the end of its run, (robots of all runs, size).

    The array ``p`` of robots that keep a map is scratch, so that the map is computed from their evidence.

    Args:
        arrays: of all robots, as in ``Swarm.arrays``.
    """
    found = np.asarray(getattr(arrays, name))
    if name != "p" or scenario.strategy.name not in WITH_MAP:
        return found
    robots = scenario.swarm.robots
    return beliefs_of(arrays, len(found) // robots, robots)[0].reshape(len(found), -1)


def _by_index(rows: dict[str, NDArray[Any]], values: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """Return a row for each place of an array; ``values`` is (rows,), or (rows, size)."""
    places = values.reshape(len(values), math.prod(values.shape[1:]))  # also of no rows
    repeated = {key: np.repeat(column, places.shape[1]) for key, column in rows.items()}
    index = np.tile(np.arange(places.shape[1]), len(places))
    return repeated | {"index": index, "value": places.ravel().astype(np.float64)}


ESTIMATE: Final = ("estimate", "estimate_spread")
"""Reports that are figures of runs anyway (``analysis.figures``)."""
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
    """Return the table ``REPORTED`` of runs, by the robots' state at the end.

    Args:
        swarm: state of all robots at the end of the runs. asked: (runs,), the number that the task asks for.
    """
    reported = strategy_used(scenario).reported
    has_sampled = swarm.agents["samples"] > 0
    fields = swarm.states.dtype.names or ()
    values = {}
    for name in reported:
        at_end = swarm.states[name] if name in fields else array_at_end(scenario, name, swarm.arrays)
        places = at_end.reshape(len(at_end), math.prod(at_end.shape[1:])).astype(np.float64)
        places = np.where(has_sampled[:, None], places, np.nan)
        values[name] = places.reshape(len(runs), scenario.swarm.robots, places.shape[1])
    return _means(reported, values, runs, asked)


def _means(
    reported: Mapping[str, Report],
    values: Mapping[str, NDArray[np.float64]],
    runs: Sequence[int],
    asked: NDArray[np.float64],
) -> pl.DataFrame:
    """Return the table ``REPORTED``.

    Args:
        values: by name, (runs, robots, places), nan where a robot has none.
    """
    parts = [pl.DataFrame(schema=REPORTED)]
    for name, one in reported.items():
        if name in ESTIMATE or name not in values or values[name].shape[2] > MOST_PLACES:
            continue
        error = (
            np.abs(values[name] - asked[:, None, None])
            if one.estimates
            else np.full_like(values[name], np.nan)
        )
        count, _, places = values[name].shape
        parts.append(
            pl.DataFrame(
                {
                    "run": np.repeat(np.asarray(runs), places),
                    "name": [name] * (count * places),
                    "index": np.tile(np.arange(places), count),
                    "value": _mean_of_known(values[name]).ravel(),
                    "error": _mean_of_known(error).ravel(),
                },
                schema=REPORTED,
                nan_to_null=True,
            )
        )
    return pl.concat(parts)


def _mean_of_known(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return means over the robots (axis 1) that have a value, nan if none has."""
    known = ~np.isnan(values)
    with np.errstate(invalid="ignore"):
        mean: NDArray[np.float64] = np.where(known, values, 0.0).sum(axis=1) / known.sum(axis=1)
    return mean
