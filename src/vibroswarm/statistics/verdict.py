"""Summarise one run in numbers: the swarm's outcome, its time, and the belief of each robot.

| name | symbol | equation |
|---|---|---|
| belief | p | the robot's probability that the share of ones is below the boundary: belief in decision 0 |
| confidence at decision time | - | p for decision 0, 1 - p for decision 1, at the time of the decision |
| estimate | f | alpha / (alpha + beta), posterior mean at the end; under feedback an opinion, not an estimate |
| interval | - | 2.5 % and 97.5 % quantiles of Beta(alpha, beta) |
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import polars as pl

from vibroswarm import strategies
from vibroswarm.core.numbers import number, span, stated_percent
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor
from vibroswarm.observation.decision_boundary import grid_of, readings_boundary
from vibroswarm.observation.energy_model import claims_differ
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.statistics.figures import ESTIMATES, run_figures
from vibroswarm.strategies.static_analysis import fields_read, told


@dataclass(frozen=True)
class RobotVerdict:
    """The outcome of one robot; times in s. Values that a recording does not contain are None."""

    robot: int
    """Number of the robot."""
    decision: int
    """0 or 1; -1: undecided; None: not logged."""
    decision_time_s: float | None
    """Time of the decision; None if there is none."""
    belief_at_decision: float | None
    """p at the decision; None if there is none."""
    belief_in_decision: float | None
    """Confidence at decision time; None if the robot has not decided or has no belief."""
    belief: float | None
    """p at the decision or, for an undecided robot, at its last sample or timer."""
    estimate: float | None
    """Posterior mean of the share of ones, or the robot's own estimate."""
    interval: tuple[float, float] | None
    """Its 95 % credible interval."""
    alpha: int | None
    beta: int | None
    """alpha and beta of the posterior at the end."""
    samples: int
    """Number of samples that the robot took."""
    received: int | None
    """Number of messages that it received."""


@dataclass(frozen=True)
class Verdict:
    """The outcome of one run; times in s.

    ``consensus``, ``right``, ``wrong`` and ``undecided`` are None if a recording lacks the decision of any robot.
    """

    consensus: str | None
    """One of ``outcomes.CONSENSUS``."""
    consensus_time_s: float | None
    """When the last robot decided; None without a consensus."""
    decision: int | None
    """The decision of all robots if they agree, else None."""
    truth: int | None
    """The right decision at the end of the run; None if neither decision is right."""
    fill_ratio: float
    """Fill ratio of the floor at the end of the run."""
    decision_boundary: float
    answers: tuple[str, ...]
    """The meaning of decisions 0, 1 and so on in words."""
    right: int
    """Number of robots that decided right."""
    wrong: int
    """Number of robots that decided wrong."""
    undecided: int
    """Number of undecided robots."""
    end_s: float
    """End of the run."""
    readings_boundary: float
    """The share of ones with which robots compare their readings (``observation.decision_boundary``)."""
    robots: tuple[RobotVerdict, ...]
    estimated: str = ""
    """The number that the task asks for, in words; empty if it asks for a decision."""
    estimate_error: float | None = None
    """Mean over robots of the distance of their estimates from the true number, which is ``fill_ratio``."""
    estimate_coverage: float | None = None
    """Share of the robots whose 90 % interval holds it."""
    estimate_crps: float | None = None
    """Mean continuous ranked probability score of their estimates; None, as the coverage, if they state no spread."""
    asked_anew: bool = False
    """Whether what is right depends on each robot's own last answer."""


def verdict(result: Result, run: int | None = None) -> Verdict:
    """Summarise one run of a result.

    Args:
        run: number of the run; by default the first run of the result.
    Raises:
        InputError: the result holds no such run.
    """
    run = int(result.runs["run"][0]) if run is None else run
    of_run = pl.col("run") == run
    if result.runs.filter(of_run).is_empty():
        raise InputError(f"there is no run {run} in this result", field="run")
    (summary,) = result.runs.filter(of_run).to_dicts()
    by_counts = not result.scenario.strategy.entry.has_own_estimate
    robots = tuple(_robot(row, by_counts) for row in result.robots.filter(of_run).to_dicts())
    decisions = {robot.decision for robot in robots}
    is_agreed = len(decisions) == 1 and not decisions & {-1, None}
    fill = summary["fill_ratio"]
    return Verdict(
        consensus=summary["consensus"],
        consensus_time_s=summary["consensus_time_s"],
        decision=decisions.pop() if is_agreed else None,
        truth=summary["truth"],
        fill_ratio=fill,
        decision_boundary=result.scenario.decision.decision_boundary,
        answers=answers_of(result.scenario),
        right=summary["right"],
        wrong=summary["wrong"],
        undecided=summary["undecided"],
        end_s=summary["end_s"],
        readings_boundary=readings_boundary(result.scenario),
        robots=robots,
        **_scores(result, run),
    )


def _scores(result: Result, run: int) -> dict[str, Any]:
    """Return how good the estimates of a run are if the task asks for a number, and else whether it asks anew."""
    task = result.scenario.task
    asked = task.entry.estimated
    words = asked(task.params) if callable(asked) else asked
    if not words:
        return {"asked_anew": task.entry.is_asked_anew(task.params)}
    of_run = pl.col("run") == run
    table = run_figures(result.robots.filter(of_run), result.runs.filter(of_run), result.scenario.run.t_end_s)
    when = " at the end" if result.floor(run).is_changing else ""
    return {"estimated": words + when, **{name: table[name][0] for name in ESTIMATES}}


def mean_over_time(floor: Floor, end_s: float, expected: Callable[[Floor], Any]) -> Any:
    """Return what is expected on a floor, as a mean over the time of the run if the floor changes."""
    if not floor.is_changing:
        return expected(floor)
    stages = [(since_s, stage) for since_s, stage in floor.stages() if since_s < end_s]
    until_s = [*(since_s for since_s, _ in stages[1:]), end_s]
    means = (
        (until - since_s) * expected(stage) for (since_s, stage), until in zip(stages, until_s, strict=True)
    )
    return sum(means) / end_s


def answers_of(scenario: Scenario) -> tuple[str, ...]:
    """Return the meaning of decisions 0, 1 and so on in words."""
    boundary = stated_percent(scenario.decision.decision_boundary)
    answers = scenario.task.entry.answers_of(scenario.sensor.kinds)
    return tuple(answer.replace("{boundary}", boundary) for answer in answers)


WITHIN_95: Final = 1.959963984540054
"""Half of a 95 % interval of a normal distribution, in standard deviations."""


def _robot(row: dict[str, Any], by_counts: bool) -> RobotVerdict:
    """Summarise one robot from its row; ``by_counts``: it has no estimate of its own, and is judged by its counts."""
    from scipy.special import betaincinv

    alpha, beta, belief = row["alpha"], row["beta"], row["belief_at_decision"]
    estimate, spread = row["estimate"], row["estimate_spread"]
    interval = None if spread is None else (estimate - WITHIN_95 * spread, estimate + WITHIN_95 * spread)
    if by_counts and None not in (alpha, beta) and alpha + beta:  # more exact than the first two moments
        low, high = (float(betaincinv(alpha, beta, level)) for level in (0.025, 0.975))
        estimate, interval = alpha / (alpha + beta), (low, high) if alpha and beta else None
    # ``belief`` is p, the belief in decision 0. It is None for a robot that has not decided, or has no belief.
    confidence_at_decision = None if belief is None else (belief if row["decision"] == 0 else 1.0 - belief)
    return RobotVerdict(
        robot=row["robot"],
        decision=row["decision"],
        decision_time_s=row["decision_time_s"],
        belief_at_decision=belief,
        belief_in_decision=confidence_at_decision,
        belief=row["belief_below"],
        estimate=estimate,
        interval=interval,
        alpha=alpha,
        beta=beta,
        samples=row["samples"],
        received=row["messages_received"],
    )


def strategy_name(scenario: Scenario) -> str:
    """Return a readable name of a strategy: its description up to a colon, or else its name."""
    known = strategies.known().get(name := scenario.strategy.name)
    return known.about.partition(":")[0] if known is not None and known.about else name


def decision_words(decision: int | None, answers: tuple[str, ...]) -> str:
    """Return the meaning of a decision in words; "undecided" for -1, "not logged" for None."""
    if decision is None:
        return "not logged"
    return "undecided" if decision == -1 else answers[decision]


def estimates_in_words(found: Verdict) -> tuple[str, str]:
    """Return the range of the robots' estimates, empty if there are none, and a sentence on how good they are."""
    estimates = [robot.estimate for robot in found.robots if robot.estimate is not None]
    if not estimates or found.estimate_error is None:
        return "", "no robot has estimated it."
    sure = "they state no spread"
    if found.estimate_coverage is not None:
        holding = round(found.estimate_coverage * len(estimates))
        sure = f"the 90 % intervals of {holding} of {len(estimates)} hold it"
    return span(estimates), f"Mean error {number(found.estimate_error)}; {sure}."


def holds_opinions(scenario: Scenario) -> bool:
    """Return whether robots count conclusions of others as readings; False for strategies that are not built in."""
    name = scenario.strategy.name
    # The first two have feedback whatever their parameters.
    return name in ("positive", "soft") or (
        name == "bayes_bots" and bool(scenario.strategy.params.positive_feedback)
    )


def has_wrong_rates(scenario: Scenario) -> bool:
    """Return whether robots go by error rates of their sensor that are not its true ones."""
    uses_rates = "error rates" in told(scenario.strategy.entry, scenario.decision.boundary_of)
    return uses_rates and claims_differ(scenario.sensor, grid_of(scenario))


COUNTED: Final = {
    "total": ("observations, own and received", ("samples", "messages_received")),
    "own": ("own samples", ("samples",)),
    "received": ("received bits", ("messages_received",)),
}
"""What a gate (``decision.gate``) counts, in words, and by columns of the table of robots."""


def gate_unreached(scenario: Scenario, most: Any) -> str:
    """Return a sentence if no robot had enough observations to decide; empty if one had, or there is no gate.

    Args:
        most: most observations of a robot that count (``COUNTED``); None: not known.
    """
    rule = scenario.decision
    if scenario.task.asks_number or "min_observations" not in fields_read(scenario.strategy.entry):
        return ""
    if most is None or most > rule.min_observations:
        return ""
    return (
        f"No robot was allowed to decide: that takes more than {rule.min_observations} {COUNTED[rule.gate][0]} "
        f"(decision.min_observations); the most that one had is {most}."
    )
