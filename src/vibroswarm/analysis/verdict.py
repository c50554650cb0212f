"""Summarise one run: the swarm's outcome, its time, and the belief and estimate of each robot.

| name | symbol | equation |
|---|---|---|
| confidence at decision time | - | p for decision 0, 1 - p for decision 1, at the decision |
| estimate | f | alpha / (alpha + beta), posterior mean at the end |
| interval | - | 2.5 % and 97.5 % quantiles of Beta(alpha, beta) |
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import polars as pl

from vibroswarm import tasks
from vibroswarm.core.fork_guard import check_threads
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.errors import InputError, check_kind, shown
from vibroswarm.observation.decision_boundary import expected_ones_on, readings_boundary
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import Scenario


@dataclass(frozen=True)
class RobotVerdict(NotebookView):
    """The outcome of one robot; times in s."""

    robot: int
    decision: int
    decision_time_s: float | None
    belief_at_decision: float | None
    belief_in_decision: float | None
    belief: float | None
    estimate: float | None
    """None, like the posterior, if a recording does not contain it."""
    interval: tuple[float, float] | None
    alpha: int | None
    beta: int | None
    samples: int
    received: int | None

    def __repr__(self) -> str:
        at = "" if self.decision_time_s is None else f" at {self.decision_time_s:.1f} s"
        known = {None: "not logged", -1: "undecided"}
        estimate = "" if self.estimate is None else f", estimate {self.estimate:.3f}"
        decided = known.get(self.decision, f"decision {self.decision}{at}")
        return f"RobotVerdict(robot {self.robot}: {decided}{estimate}, {self.samples} samples)"


@dataclass(frozen=True)
class Verdict(NotebookView):
    """The outcome of one run; times in s."""

    consensus: str | None
    """None if a recording does not contain decisions."""
    consensus_time_s: float | None
    decision: int | None
    """The decision of all robots if they agree, else None."""
    truth: int | None
    fill_ratio: float
    decision_boundary: float
    answers: tuple[str, str]
    """The meaning of decisions 0 and 1 in words."""
    of_shares: bool
    """Whether the question is about the share of vibrating tiles."""
    right: int
    wrong: int
    undecided: int
    end_s: float
    readings_boundary: float
    """The share of ones with which robots compare their readings (``observation.decision_boundary``)."""
    share_of_ones_expected: float
    """Probability that a sample at a uniformly random place in the arena reads as vibrating, with the sensor's errors
    and what vibration does across tile edges."""
    share_of_ones_read: float | None
    robots: tuple[RobotVerdict, ...]

    def __repr__(self) -> str:
        at = "" if self.consensus_time_s is None else f" by {self.consensus_time_s:.1f} s"
        counts = [
            f"{count} {word}"
            for word, count in (("right", self.right), ("wrong", self.wrong), ("undecided", self.undecided))
            if count is not None
        ]
        robots = f"{len(self.robots)} robot{'s' * (len(self.robots) != 1)}"
        outcome = "decisions not logged" if self.consensus is None else f"{self.consensus}{at}"
        return f"Verdict({outcome}; {', '.join([*counts, f'of {robots}'])}; fill ratio {self.fill_ratio:.4g})"

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        return asdict(self)


def verdict(result: Result, run: int | None = None) -> Verdict:
    """Summarise one run of a result.

    Args:
        run: its number; by default the first of the result.
    Raises:
        InputError: the result holds no such run.
    """
    check_threads()
    check_kind(result, Result, "result", "a Result, as simulate() returns")
    available = result.runs["run"].to_list()
    run = int(available[0]) if run is None and available else run
    if run is None or run not in available:
        raise InputError(f"there is no run {shown(run)} in this result", field="run")
    of_run = pl.col("run") == run
    summary = result.runs.filter(of_run).to_dicts()[0]
    robots = tuple(_robot(row) for row in result.robots.filter(of_run).to_dicts())
    alike = {robot.decision for robot in robots}
    fill = summary["fill_ratio"]
    arena = result.scenario.arena
    size = (arena.width_m, arena.height_m)
    bits = result.observations.filter(of_run)["observation"]
    return Verdict(
        consensus=summary["consensus"],
        consensus_time_s=summary["consensus_time_s"],
        decision=alike.pop() if len(alike) == 1 and not alike & {-1, None} else None,
        truth=summary["truth"],
        fill_ratio=fill,
        decision_boundary=result.scenario.decision.decision_boundary,
        answers=answers_of(result.scenario),
        of_shares=result.scenario.task.name == "fill_ratio",
        right=summary["right"],
        wrong=summary["wrong"],
        undecided=summary["undecided"],
        end_s=summary["end_s"],
        readings_boundary=readings_boundary(result.scenario),
        share_of_ones_expected=expected_ones_on(result.scenario.sensor, result.floor(run), size),
        share_of_ones_read=float(bits.cast(pl.Float64).mean()) if bits.len() else None,  # type: ignore[arg-type]
        robots=robots,
    )


def answers_of(scenario: Scenario) -> tuple[str, str]:
    """Return the meaning of decisions 0 and 1; "no" and "yes" for a task whose code is not loaded."""
    known = tasks.known().get(scenario.task.name)
    boundary = f"{100 * scenario.decision.decision_boundary:.4g} %"
    no, yes = known.answers if known is not None else ("no", "yes")
    return no.replace("{boundary}", boundary), yes.replace("{boundary}", boundary)


def _robot(row: dict[str, Any]) -> RobotVerdict:
    """Summarise one robot, with a credible interval of the share of ones."""
    from scipy.special import betaincinv

    alpha, beta, belief = row["alpha"], row["beta"], row["belief_at_decision"]
    sure = None if belief is None else (belief if row["decision"] == 0 else 1.0 - belief)
    return RobotVerdict(
        robot=row["robot"],
        decision=row["decision"],
        decision_time_s=row["decision_time_s"],
        belief_at_decision=belief,
        belief_in_decision=sure,
        belief=row["belief_below"],
        estimate=None if alpha is None else alpha / (alpha + beta),
        interval=None
        if alpha is None
        else (float(betaincinv(alpha, beta, 0.025)), float(betaincinv(alpha, beta, 0.975))),
        alpha=alpha,
        beta=beta,
        samples=row["samples"],
        received=row["messages_received"],
    )
