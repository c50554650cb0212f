"""Compute how many robots that fail a strategy bears: its outcomes over the share of faulty robots.

| name | symbol | unit | equation |
|---|---|---|---|
| share | - | - | share of the swarm that has the fault, rounded to whole robots |
| judged | - | - | robots whose decisions count: those without any fault in the run, or all |
| wrong, undecided, right | - | - | share of the robots judged, over all runs; the run is the unit |
| swarm_wrong, swarm_right | - | - | share of the runs in which all robots judged decided so |

By default the working robots are judged. What is asked is how a strategy bears the faults of others: a robot that does
not move or hear cannot decide, whatever its strategy, and would only show as undecided, in proportion to the share.
The tables of a result count all robots, as an operator who does not know which have failed would. A run in which every
robot fails has nobody to judge and is left out.

Robots that fail at a share fail at each larger one too, in the same runs on the same floors: points are paired.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, Literal

import numpy as np
import polars as pl

from vibroswarm.analysis.cell_summary import summary
from vibroswarm.analysis.intervals import Interval, plain
from vibroswarm.errors import InputError, check_choice
from vibroswarm.faults import working
from vibroswarm.inference.deliveries import needs_moves, timeline_of
from vibroswarm.inference.outcomes import as_series, numbers, run_columns
from vibroswarm.motion.source import source
from vibroswarm.observation.observe import observe
from vibroswarm.scenario.fault_fields import FAULTS, MOTION_FAULTS, robots_of_share
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import check_runs, floors_of, simulate, steers, summarise

Judged = Literal["working", "all"]
JUDGED: Final = ("working", "all")
FIGURES: Final = {
    "wrong": "robots_wrong",
    "undecided": "robots_undecided",
    "right": "robots_right",
    "swarm_wrong": "swarm_wrong",
    "swarm_right": "swarm_right",
}
"""Columns of a curve, and the figures of ``cell_summary`` they are."""


def judged_tables(
    scenario: Scenario, seed: int, robots: pl.DataFrame, runs: pl.DataFrame, judged: Judged = "working"
) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Return the tables of robots and of runs as if only some robots had been there.

    Args:
        scenario, seed: of the runs. robots, runs: as a ``Result`` has them, with all robots of each run.
        judged: "working": the robots without any fault before the end of the run; "all": the tables as they are.
    Returns: the rows of the robots judged, and the runs that have any, with consensus and counts of these robots.
    """
    check_choice(judged, "judged", JUDGED)
    if judged == "all" or not scenario.faults.kinds:
        return robots, runs
    fine = working(scenario, seed, runs["run"].to_list())
    shape = fine.shape
    if robots.height != fine.size:
        raise InputError("the tables of robots and of runs are not of the same runs", field="runs")
    decision = robots["decision"].to_numpy().reshape(shape)
    time_s, truth = numbers(robots["decision_time_s"]).reshape(shape), numbers(runs["truth"])
    end_s, fills = runs["end_s"].to_numpy(), runs["fill_ratio"].to_numpy()
    columns: dict[str, list[Any]] = {
        name: [] for name in ("consensus", "consensus_time_s", "right", "wrong", "undecided")
    }
    kept = np.flatnonzero(fine.any(axis=1))
    for r in kept:
        own, one = fine[r], slice(r, r + 1)
        found = run_columns(
            decision[one, own], time_s[one, own], fills[one], truth[one], end_s[one], scenario.run.t_end_s
        )
        for name, values in columns.items():
            values.append(found[name][0])
    some = runs[kept.tolist()]
    new = [
        as_series(
            name,
            np.array(values, dtype=np.float64 if name == "consensus_time_s" else np.int64),
            some.schema[name],
        )
        for name, values in columns.items()
    ]
    return robots.filter(pl.Series(fine.ravel())), some.with_columns(new)


def fault_curve(
    scenario: Scenario,
    kind: str,
    shares: Sequence[float],
    seed: int = 1,
    runs: int | Sequence[int] = 200,
    *,
    judged: Judged = "working",
    level: float = 0.95,
) -> pl.DataFrame:
    """Simulate a scenario with larger and larger shares of faulty robots; return one row per share.

    Args:
        scenario: its other faults stay as they are. kind: of the fault, such as "stuck_at_1". shares: of the swarm,
            from 0 to 1. seed, runs: as of ``simulate``. judged: whose decisions count, see the module. level: of
            confidence of each interval.
    Returns: share, robots (how many have the fault), runs, and each of ``FIGURES`` with its limits (``wrong``,
        ``wrong_low``, ``wrong_high``); null where nobody is judged.
    Raises:
        InputError: an unknown kind, a share that is none, or a scenario that cannot be simulated.
    """
    check_choice(kind, "kind", FAULTS)
    check_choice(judged, "judged", JUDGED)
    points = [scenario.with_values({f"faults.{kind}": float(share), "run.stop": "t_end"}) for share in shares]
    if not points:
        raise InputError("give at least one share", field="shares")
    numbers_of = check_runs(seed, runs)
    tables = _tables(points, kind, seed, numbers_of)
    rows = []
    for share, point, (robots, of_runs) in zip(shares, points, tables, strict=True):
        head = {"share": float(share), "robots": robots_of_share(float(share), point.swarm.robots)}
        some_robots, some_runs = judged_tables(point, seed, robots, of_runs, judged)
        rows.append(head | {"runs": some_runs.height} | _figures(point, some_robots, some_runs, level))
    return pl.DataFrame(rows, infer_schema_length=None)


def _figures(scenario: Scenario, robots: pl.DataFrame, runs: pl.DataFrame, level: float) -> dict[str, Any]:
    """Return the figures of one point, with their limits; None if no run has a robot that is judged."""
    found: dict[str, Any] = {}
    whole = summary(robots, runs, scenario.run.t_end_s, level) if runs.height else None
    for name, figure in FIGURES.items():
        value: Interval | None = None if whole is None else getattr(whole, figure)
        for end, limit in zip(
            ("", "_low", "_high"), (None,) * 3 if value is None else value[:3], strict=True
        ):
            found[f"{name}{end}"] = None if limit is None else plain(limit)
    return found


def _tables(
    points: Sequence[Scenario], kind: str, seed: int, runs: Sequence[int]
) -> list[tuple[pl.DataFrame, pl.DataFrame]]:
    """Return the tables of robots and runs of each point; motion is shared unless fault or strategy changes it."""
    first = points[0]
    if kind in MOTION_FAULTS or steers(first):
        results = (simulate(point, seed, runs, energies=False) for point in points)
        return [(result.robots, result.runs) for result in results]
    motion = source("event").batch(first, seed, runs, False, needs_moves(first))
    timeline, floors = timeline_of(first, motion), floors_of(first, seed, runs)
    return [
        summarise(point, seed, floors, timeline, observe(point, seed, motion.samples, floors, energies=False))
        for point in points
    ]
