"""Compute how a strategy tolerates faulty robots: its outcomes against the share of robots with a fault.

| name | what it is |
|---|---|
| share | share of the swarm that has the fault, rounded to whole robots |
| judged | robots whose decisions count: those without any fault in the run ("working"), or "all" |
| wrong, undecided, right | share of the judged robots, over all runs; intervals treat the run as the unit |
| swarm_wrong, swarm_right | share of the runs in which all judged robots decided wrong, right |

By default the working robots are judged, since the question is how a strategy tolerates the faults of other robots. A
robot that does not move or hear cannot decide, whatever its strategy; it would only add to the undecided. (The tables
of a result count all robots, as an operator does who does not know which robots have failed.) A run in which every
robot fails has no robot to judge and is left out.

Robots that fail at one share also fail at each larger share, in the same runs on the same floors. So the points of a
curve can be compared run by run.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, Literal

import numpy as np
import polars as pl

from vibroswarm.analysis.cell_summary import summary
from vibroswarm.analysis.intervals import columns_of
from vibroswarm.errors import InputError, check_choice
from vibroswarm.inference.outcomes import as_series, numbers, right_of, run_columns, wrong_of
from vibroswarm.scenario.fault_draws import working
from vibroswarm.scenario.fault_fields import FAULTS, robots_of_share
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.study.run import run
from vibroswarm.study.spec import Study

Judged = Literal["working", "all"]
JUDGED: Final = ("working", "all")
"""Which robots' decisions count: those without any fault in the run, or all."""
FIGURES: Final = {
    "wrong": "robots_wrong",
    "undecided": "robots_undecided",
    "right": "robots_right",
    "swarm_wrong": "swarm_wrong",
    "swarm_right": "swarm_right",
}
"""Columns of a curve, and the fields of ``CellSummary`` from which they are copied."""


def judged_tables(
    scenario: Scenario, seed: int, robots: pl.DataFrame, runs: pl.DataFrame, judged: Judged = "working"
) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Return the tables of robots and of runs with only the judged robots counted.

    Args:
        scenario, seed: of the runs. robots, runs: as a ``Result`` has them, with all robots of each run; both sorted by
            run, and ``robots`` by robot within a run.
        judged: "working": the robots without any fault before t_end, even if the run stopped before the fault; "all":
            the tables as they are, which are also returned if the scenario has no faults.
    Returns: the table of the judged robots, and the table of the runs with at least one of them. In the table of runs
        consensus, its time and the numbers of right, wrong and undecided robots are computed from these robots alone.
        Both tables are empty if no run has a judged robot.
    Raises:
        InputError: another word for ``judged``; or working robots are to be selected, and the number of rows of
            ``robots`` is not runs times robots.
    """
    check_choice(judged, "judged", JUDGED)
    if judged == "all" or not scenario.faults.kinds:
        return robots, runs
    has_no_fault = working(scenario, seed, runs["run"].to_list())  # (runs, robots)
    shape = has_no_fault.shape
    if robots.height != has_no_fault.size:
        raise InputError(
            "the tables of robots and of runs must have the same runs, with all robots", field="runs"
        )
    # A working robot of the run stands for each robot that does not work, which changes no consensus.
    stands_for = np.where(has_no_fault, np.arange(shape[1]), has_no_fault.argmax(axis=1)[:, None])
    decision, time_s = (
        np.take_along_axis(numbers(robots[name]).reshape(shape), stands_for, axis=1)
        for name in ("decision", "decision_time_s")
    )
    truth, end_s = numbers(runs["truth"]), runs["end_s"].to_numpy()
    found = run_columns(decision, time_s, runs["fill_ratio"].to_numpy(), truth, end_s, scenario.run.t_end_s)
    counted = {
        "right": right_of(decision, truth),
        "wrong": wrong_of(decision, truth),
        "undecided": decision == -1,
    }
    found |= {name: (robots_so & has_no_fault).sum(axis=1) for name, robots_so in counted.items()}
    new = [
        as_series(name, found[name], runs.schema[name])
        for name in ("consensus", "consensus_time_s", *counted)
    ]
    has_working = pl.Series(has_no_fault.any(axis=1))
    return robots.filter(pl.Series(has_no_fault.ravel())), runs.with_columns(new).filter(has_working)


def fault_curve(
    scenario: Scenario,
    kind: str,
    shares: Sequence[float],
    seed: int = 1,
    runs: int = 200,
    *,
    judged: Judged = "working",
    level: float = 0.95,
    **how: Any,
) -> pl.DataFrame:
    """Compute a strategy's outcomes against the share of faulty robots, by simulating a scenario with each share.

    Every run goes to t_end, also if the scenario stops early: where faults do not change the motion, all shares use the
    same motion, which therefore must not end with the decisions.

    Args:
        scenario: its other kinds of fault stay as they are. kind: of the fault that is varied, such as "stuck_at_1".
        shares: shares of the swarm that have this fault, from 0 to 1. seed: of the runs. runs: their number.
        judged: robots whose decisions count: "working" or "all". level: confidence level of each interval.
        how: further arguments of ``study.run.run``, such as workers.
    Returns: one row per share, in the order given: share, robots (number of robots with the fault), runs (number of
        runs with a judged robot), and each of ``FIGURES`` with its limits (``wrong``, ``wrong_low``, ``wrong_high``);
        these are null if no run has a judged robot.
    Raises:
        InputError: an unknown kind, another word for ``judged``, no share, a share outside 0 to 1, a level that is not
            between 0 and 1, or a scenario that cannot be simulated.
    """
    check_choice(kind, "kind", FAULTS)
    check_choice(judged, "judged", JUDGED)
    points = [scenario.with_values({f"faults.{kind}": float(share), "run.stop": "t_end"}) for share in shares]
    if not points:
        raise InputError("give at least one share", field="shares")
    result = run(Study.of_scenarios({str(k): point for k, point in enumerate(points)}, runs, seed), **how)
    rows = []
    for k, (share, point) in enumerate(zip(shares, points, strict=True)):
        robots, of_runs = result.tables(k)
        head = {"share": float(share), "robots": robots_of_share(float(share), point.swarm.robots)}
        judged_robots, judged_runs = judged_tables(point, seed, robots, of_runs, judged)
        rows.append(head | {"runs": judged_runs.height} | _figures(point, judged_robots, judged_runs, level))
    # Types of columns are inferred from all rows, since the first rows may be null.
    return pl.DataFrame(rows, infer_schema_length=None)


def _figures(scenario: Scenario, robots: pl.DataFrame, runs: pl.DataFrame, level: float) -> dict[str, Any]:
    """Return ``FIGURES`` of one point of the curve with their limits; all are None if there are no runs."""
    row: dict[str, Any] = {}
    cell = summary(robots, runs, scenario.run.t_end_s, level) if runs.height else None
    for name, field in FIGURES.items():
        row |= columns_of(name, (None, None, None) if cell is None else getattr(cell, field))
    return row
