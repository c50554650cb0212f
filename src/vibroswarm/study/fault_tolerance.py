"""Judge only the robots of a swarm that work: those without any fault in the run.

The question is then how a strategy tolerates the faults of other robots. A robot that does not move or hear cannot
decide, whatever its strategy; it would only add to the undecided. (The tables of a result count all robots, as an
operator does who does not know which robots have failed.) A run in which every robot fails has no robot to judge and is
left out.
"""

from __future__ import annotations

from typing import Final, Literal

import numpy as np
import polars as pl

from vibroswarm.errors import InputError, check_choice
from vibroswarm.inference.outcomes import as_series, numbers, right_of, run_columns, wrong_of
from vibroswarm.scenario.fault_draws import working
from vibroswarm.scenario.scenario import Scenario

Judged = Literal["working", "all"]
JUDGED: Final = ("working", "all")
"""Which robots' decisions count: those without any fault in the run, or all."""


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
