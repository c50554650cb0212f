"""The verdict as text; the robots of a large swarm in a few lines, with the range of each figure."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from vibroswarm.analysis.verdict import (
    OPINION_NOTE,
    RobotVerdict,
    Verdict,
    confidence,
    headline,
    holds_opinions,
    percent,
    robot_row,
    strategy_name,
)
from vibroswarm.cli.output import paragraph, table_lines
from vibroswarm.cli.terminal import printing
from vibroswarm.faults import fault_words
from vibroswarm.result import Result


def fault_lines(result: Result) -> list[str]:
    """Return which robots failed in the run, and how, in a sentence; none where none can."""
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
    """Return that the run failed, and why, in a sentence; none if it did not."""
    if result.failures is None:
        return []
    return [
        f"RUN FAILED at {row['time_s']:.4g} s: {row['reason']}. Its robots stand since then; what follows is no result."
        for row in result.failures.to_dicts()
    ]


def verdict_text(result: Result, found: Verdict) -> str:
    """Return the whole verdict in plain text, the outcome first."""
    scenario, floor = result.scenario, result.floor()
    ones, tiles = int(floor.tiles.sum()), floor.tiles.size
    origin = "as recorded" if result.seed is None else f"seed {result.seed}"
    robots = f"{len(found.robots)} robot{'' if len(found.robots) == 1 else 's'}"
    lines = [
        *failure_lines(result),
        headline(found),
        confidence(found),
        "",
        f"{robots}, {strategy_name(scenario.strategy.name)}, on '{floor.name}' "
        f"({ones} of {tiles} tiles vibrate, fill ratio {found.fill_ratio:.4g}), {origin}",
    ]
    if found.share_of_ones_read is not None:
        lines.append(
            f"Samples read as vibrating: {percent(round(found.share_of_ones_read, 4))} (expected on this floor, with "
            f"the sensor's errors: {percent(round(found.share_of_ones_expected, 4))})."
        )
    if found.readings_boundary != found.decision_boundary:
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
    """Return the table of robots: one row each, or of a large swarm one for each decision."""
    if len(found.robots) > MOST_ROBOTS and not printing.wide:
        return summary_lines(found, posterior)
    return table_lines(
        ["robot", "decision", "at, s", "confidence, %", f"{posterior} (95 %)", "own", "heard"],
        [robot_row(robot, found.answers) for robot in found.robots],
        texts=2,
    )


MOST_ROBOTS: Final = 20
"""Robots that have a row each without ``--wide``."""


def summary_lines(found: Verdict, posterior: str = "share of ones") -> list[str]:
    """Return a table of how many robots decided what, when, and with what confidence."""
    from vibroswarm.analysis.verdict import decision_words

    groups: dict[str, list[RobotVerdict]] = {}
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
    return None if share is None else 100 * share


def _range(values: Iterable[float | None], form: str) -> str:
    """Return the smallest to the largest value, ``-`` without any."""
    known = [value for value in values if value is not None and value == value]
    if not known:
        return "-"
    low, high = f"{min(known):{form}}", f"{max(known):{form}}"
    return low if low == high else f"{low} to {high}"
