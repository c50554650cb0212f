"""The verdict of a run as text: the outcome, what was simulated, and a table of robots.

The robots of a large swarm are summarised by decision, with the range of each figure.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final

from vibroswarm.analysis.true_places import true_places_notes
from vibroswarm.analysis.verdict import (
    OPINION_NOTE,
    RobotVerdict,
    Verdict,
    agreement_words,
    confidence,
    headline,
    holds_opinions,
    percent,
    robot_row,
    strategy_name,
)
from vibroswarm.cli.output import paragraph, table_lines
from vibroswarm.cli.terminal import printing
from vibroswarm.result import Result
from vibroswarm.scenario.fault_draws import fault_words


def fault_lines(result: Result) -> list[str]:
    """Return a list of one sentence: which robots had which faults in the first run of a result.

    The list is empty if the scenario has no faults.
    """
    if result.faults is None:
        return []
    of_run = result.faults.filter(result.faults["run"] == result.runs["run"][0])
    robots = result.scenario.swarm.robots
    if of_run.is_empty():
        return [f"Faults: none of {robots} robots failed."]
    each = [
        f"robot {row['robot']} {fault_words(row['fault'])}"
        + ("" if row["from_s"] == 0 else f" from {row['from_s']:.4g} s")
        for row in of_run.to_dicts()
    ]
    failed = of_run["robot"].n_unique()
    return [f"Faults: {failed} of {robots} robots failed: {'; '.join(each)}."]


def failure_lines(result: Result) -> list[str]:
    """Return, for each run that a simulator of physics gave up, a sentence that says when and why.

    The list is empty if no run failed.
    """
    if result.failures is None:
        return []
    return [
        f"RUN FAILED at {row['time_s']:.4g} s: {row['reason']}. Its robots stand since then; what follows is no result."
        for row in result.failures.to_dicts()
    ]


def verdict_text(result: Result, found: Verdict) -> str:
    """Return the verdict on a run as text of several lines.

    The lines are, in this order: that robots knew their true places, if they used them; failures of the physics
    simulator, if any; the outcome; whether agreement lasted, if it did not; the confidence; swarm, strategy and floor;
    the share of ones read, if it is known; the boundary of the share of ones, if it differs from the boundary of the
    fill ratio; faults, if robots can have any; a note if robots hold opinions; and the table of robots.

    Args:
        result: a result of a single run, whose number need not be 0: floor, faults and failures are taken from it.
        found: the verdict on that run.
    """
    scenario, floor = result.scenario, result.floor(int(result.runs["run"][0]))
    ones, tiles = int(floor.tiles.sum()), floor.tiles.size
    origin = "as recorded" if result.seed is None else f"seed {result.seed}"
    robots = f"{len(found.robots)} robot{'' if len(found.robots) == 1 else 's'}"
    lines = [
        *true_places_notes([scenario]),
        *failure_lines(result),
        headline(found),
        *([agreement_words(found)] if agreement_words(found) else []),
        confidence(found),
        "",
        f"{robots}, {strategy_name(scenario.strategy.name)}, on '{floor.name}' "
        f"({ones} of {tiles} tiles vibrate, fill ratio {found.fill_ratio:.4g}), {origin}",
    ]
    # Shares are rounded to 4 decimals, so that percentages have at most two.
    if found.share_of_ones_read is not None:
        lines.append(
            f"Samples read as vibrating: {percent(round(found.share_of_ones_read, 4))} (expected on this floor, with "
            f"the sensor's errors: {percent(round(found.share_of_ones_expected, 4))})."
        )
    if found.readings_boundary != found.decision_boundary:  # robots allow for the sensor's errors
        lines.append(
            f"Robots compare the share of ones with {percent(round(found.readings_boundary, 4))}, expected on a floor "
            f"with {percent(found.decision_boundary)} vibrating tiles."
        )
    lines += fault_lines(result)
    opinions = holds_opinions(scenario)
    posterior = "opinion" if opinions else "share of ones"
    if opinions:
        lines.append(OPINION_NOTE)
    return "\n".join([*map(paragraph, lines), "", *robot_lines(found, posterior), ""])


def robot_lines(found: Verdict, posterior: str = "share of ones") -> list[str]:
    """Return the lines of the table of robots: one row for each robot, or in a large swarm one for each decision.

    With ``--wide``, each robot has a row in a large swarm too.

    Args:
        found: the verdict on the run.
        posterior: header of the column of posteriors: "share of ones", or "opinion" for strategies whose robots count
            the conclusions of others as readings.
    """
    if len(found.robots) > MOST_ROBOTS and not printing.wide:
        return summary_lines(found, posterior)
    return table_lines(
        ["robot", "decision", "at, s", "confidence, %", f"{posterior} (95 %)", "own", "heard"],
        [robot_row(robot, found.answers) for robot in found.robots],
        texts=2,  # the second column, the decision, is text too
    )


MOST_ROBOTS: Final = 20
"""Largest swarm, in robots, whose robots have a row each without ``--wide``."""


def summary_lines(found: Verdict, posterior: str = "share of ones") -> list[str]:
    """Return the lines of a table with a row for each decision: number of robots, and the range of their figures.

    Args:
        found: the verdict on the run.
        posterior: header of the column of posteriors: "share of ones" or "opinion".
    """
    from vibroswarm.analysis.verdict import decision_words

    groups: dict[str, list[RobotVerdict]] = {}
    # Robots are sorted by decision, so that the rows are in the order of decisions. Undecided robots (-1) and robots
    # whose decision is not logged (None) come last; `or 0` is for None, which cannot be compared with numbers.
    for robot in sorted(found.robots, key=lambda one: (one.decision in (None, -1), one.decision or 0)):
        groups.setdefault(decision_words(robot.decision, found.answers), []).append(robot)
    rows = [
        [
            answer,
            len(robots),
            _range((robot.decision_time_s for robot in robots), ".1f"),
            _range((_percent(robot.belief_in_decision) for robot in robots), ".1f"),
            _range((robot.estimate for robot in robots), ".3f"),
            _range((robot.samples for robot in robots), ".0f"),
            _range((robot.received for robot in robots), ".0f"),
        ]
        for answer, robots in groups.items()
    ]
    columns = ["decision", "robots", "at, s", "confidence, %", posterior, "own", "heard"]
    return [*table_lines(columns, rows), "Smallest to largest of the robots; --wide prints each robot."]


def _percent(share: float | None) -> float | None:
    """Return a share in percent; None stays None."""
    return None if share is None else 100 * share


def _range(values: Iterable[float | None], form: str) -> str:
    """Format the range from the smallest to the largest value; ``-`` if there is no value other than None and NaN."""
    known = [value for value in values if value is not None and not math.isnan(value)]
    if not known:
        return "-"
    low, high = f"{min(known):{form}}", f"{max(known):{form}}"
    return low if low == high else f"{low} to {high}"
