"""What robots report: the values that a strategy declares (``Strategy.reports``), as a table.

Fields of a robot's state are reported after each of its samples; arrays, which are large, at the end of the run.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.inference.agents import Swarm
from vibroswarm.inference.deliveries import Timeline
from vibroswarm.inference.replay_arrays import Log
from vibroswarm.strategies.base import Strategy

REPORTS: Final[dict[str, Any]] = {
    "run": pl.UInt32,
    "robot": pl.UInt16,
    "sample": pl.UInt32,
    "name": pl.String,
    "index": pl.UInt32,
    "value": pl.Float64,
}
"""Columns of the table of reports. ``index`` is the place in an array, 0 for a field; ``value`` is null if there is
none yet. The rows of an array have the robot's last sample."""


def report_frame(strategy: Strategy, timeline: Timeline, log: Log, swarm: Swarm) -> pl.DataFrame | None:
    """Return the table of what robots reported, None if the strategy reports nothing.

    Rows are put in order without the threads of polars, which a forked process does not have.

    Args:
        timeline: samples and ends of the runs that were replayed. log: state after each sample. swarm: state of all
            robots at the end, in the order of ``timeline.ends``.
    """
    if not strategy.reports:
        return None
    fields = log.states.dtype.names or ()
    names = sorted(strategy.reports)
    parts = [
        _of_samples(name, timeline, log) if name in fields else _of_ends(name, timeline, swarm)
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
    """Return the rows of a field of the robots' states, all but their name."""
    rows: dict[str, NDArray[Any]] = {
        key: timeline.samples[key].to_numpy() for key in ("run", "robot", "sample")
    }
    value = log.states[name].astype(np.float64)
    return rows | {"index": np.zeros(value.size, dtype=np.int64), "value": value}


def _of_ends(name: str, timeline: Timeline, swarm: Swarm) -> dict[str, NDArray[Any]]:
    """Return the rows of an array of each robot that sampled, at the end of its run; all but their name."""
    values = getattr(swarm.arrays, name)
    sampled = np.flatnonzero(swarm.agents["samples"] > 0)
    size = values.shape[1]
    rows: dict[str, NDArray[Any]] = {
        key: np.repeat(timeline.ends[key].to_numpy()[sampled], size) for key in ("run", "robot")
    }
    rows["sample"] = np.repeat(swarm.agents["samples"][sampled] - 1, size)
    rows["index"] = np.tile(np.arange(size), sampled.size)
    return rows | {"value": values[sampled].ravel().astype(np.float64)}
