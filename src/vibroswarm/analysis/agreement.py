"""Say on what swarms agreed, and whether agreements lasted, also on floors on which no answer is right.

| name | definition |
|---|---|
| agreed on 0, 1 | share of all runs in which every robot made this decision |
| split, incomplete | share of runs in which decisions differ, or a robot is undecided |
| agreement lasted | share of the runs with an agreement in which opinions still agreed at the end of the run |

On a floor whose fill ratio equals the boundary, or for a task without a right answer, these shares are the outcome:
does a swarm break the tie, on which side, and does it stay there?

Decisions of most strategies are final, or are those at the end of the run. In strategies that decide by opinions
(``Strategy.decides``) the swarm has decided when its opinions have agreed for ``decision.hold_s``, but opinions may
change after that. Opinions of robots with faults do not count, unless all robots of the run have faults.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
import polars as pl

from vibroswarm import strategies
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import Scenario

if TYPE_CHECKING:
    from vibroswarm.inference.agents import (
        Swarm,
    )  # at run time only its rows are read, so no kernels are loaded

AGREEMENTS: Final[dict[str, Any]] = {"run": pl.UInt32, "holds": pl.Boolean}
"""Columns of the table of agreements, one row for each run in which all robots decided alike: whether their opinions
still agree with it at the end of the run."""
NO_AGREEMENTS: Final = pl.DataFrame(schema=AGREEMENTS)
"""Of decisions that are final."""
_KEY: Final = ("run", "robot")


def may_change(scenario: Scenario) -> bool:
    """Return whether opinions may change after the swarm has decided; False for a strategy whose code is not loaded.

    A run that stops when all have decided ends with the agreement, so that nothing is known of what comes after it.
    """
    known = strategies.known().get(scenario.strategy.name)
    return known is not None and known.decides == "opinion" and scenario.run.stop == "t_end"


def is_followed(scenario: Scenario) -> bool:
    """Return whether a run has numbers about its answers over time: opinions may change, or the floor does."""
    return may_change(scenario) or scenario.change.is_given


def agreements_of(swarm: Swarm, runs: range) -> pl.DataFrame:
    """Return the table of agreements of a strategy that decides by opinions.

    Args:
        swarm: state of all robots at the end of the runs. runs: their numbers.
    """
    shape = (len(runs), -1)
    decision, opinion = (swarm.agents[name].reshape(shape) for name in ("decision", "opinion"))
    works = swarm.failures["works"].reshape(shape) == 1
    agreed = (decision != -1).all(axis=1) & (decision == decision[:, :1]).all(axis=1)
    holds = ((opinion == decision) | ~works).all(axis=1)
    numbers = np.arange(runs.start, runs.stop)
    return pl.DataFrame({"run": numbers[agreed], "holds": holds[agreed]}, schema=AGREEMENTS)


def _counted(result: Result) -> pl.DataFrame:
    """Return run, robot and decision of each robot, and whether its opinion ``counts``: those with faults do not.

    If all robots of a run have faults, all of them count.
    """
    rows = result.robots.select(*_KEY, "decision")
    if result.faults is None:
        return rows.with_columns(counts=pl.lit(True))
    faulty = result.faults.select(_KEY).unique().with_columns(counts=pl.lit(False))
    rows = rows.join(faulty, on=_KEY, how="left").with_columns(pl.col("counts").fill_null(True))
    return rows.with_columns(counts=pl.col("counts") | ~pl.col("counts").any().over("run"))


class Agreement(NamedTuple):
    """A span of time in which all robots that count had the same opinion, by their samples."""

    answer: int
    """The opinion: 0 or 1."""
    since_s: float
    """Time of the sample with which the last of them came to agree."""
    until_s: float | None
    """Time of the sample with which the first of them left; None: it lasted to the end of the run."""


def agreements_over_time(result: Result, run: int) -> list[Agreement]:
    """Return when the opinions of a run's robots agreed, in order of time; empty if decisions are not logged."""
    of_run = pl.col("run") == run
    counted = _counted(result).filter(of_run & pl.col("counts"))["robot"].to_list()
    key = [*_KEY, "sample"]
    opinions = result.inference.filter(of_run).select(*key, "decision").drop_nulls("decision")
    before = pl.col("decision").shift(1, fill_value=-1).over("robot", order_by="sample")
    changes = opinions.filter(pl.col("decision") != before, pl.col("robot").is_in(counted))
    timed = changes.join(result.motion.select(*key, "time_s"), on=key, how="left").sort("time_s", "robot")
    spans: list[Agreement] = []
    opinion = dict.fromkeys(counted, -1)
    for robot, new, time_s in timed.select("robot", "decision", "time_s").iter_rows():
        opinion[robot] = new
        if spans and spans[-1].until_s is None:  # they agreed until now
            spans[-1] = spans[-1]._replace(until_s=time_s)
        if new != -1 and set(opinion.values()) == {new}:
            spans.append(Agreement(new, time_s, None))
    return spans
