"""What robots report: the values that a strategy declares (``Strategy.reports``), as a table.

Fields of a robot's state are reported after each of its samples; arrays, which are large, at the end of the run.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import polars as pl

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

    Args:
        timeline: samples and ends of the runs that were replayed. log: state after each sample. swarm: state of all
            robots at the end, in the order of ``timeline.ends``.
    """
    if not strategy.reports:
        return None
    fields = log.states.dtype.names or ()
    parts = [
        _of_samples(name, timeline, log) if name in fields else _of_ends(name, timeline, swarm)
        for name in strategy.reports
    ]
    keys = ["run", "robot", "sample", "name", "index"]
    return pl.concat(parts).sort(keys, maintain_order=True)


def _of_samples(name: str, timeline: Timeline, log: Log) -> pl.DataFrame:
    """Return the rows of a field of the robots' states."""
    keys = [timeline.samples[key] for key in ("run", "robot", "sample")]
    values = pl.Series("value", log.states[name].astype(np.float64), nan_to_null=True)
    named = pl.lit(name).alias("name"), pl.lit(0, dtype=pl.UInt32).alias("index")
    return pl.DataFrame(keys).with_columns(*named, values)


def _of_ends(name: str, timeline: Timeline, swarm: Swarm) -> pl.DataFrame:
    """Return the rows of an array of each robot that sampled, at the end of its run."""
    values = getattr(swarm.arrays, name)
    sampled = np.flatnonzero(swarm.agents["samples"] > 0)
    run, robot = (timeline.ends[key].to_numpy()[sampled] for key in ("run", "robot"))
    last, size = swarm.agents["samples"][sampled] - 1, values.shape[1]
    columns = {
        "run": np.repeat(run, size),
        "robot": np.repeat(robot, size),
        "sample": np.repeat(last, size),
        "name": [name] * (sampled.size * size),
        "index": np.tile(np.arange(size), sampled.size),
        "value": pl.Series(values[sampled].ravel().astype(np.float64), nan_to_null=True),
    }
    return pl.DataFrame(columns, schema=REPORTS)
