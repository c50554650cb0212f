"""The robots of a large swarm in a few lines: a row for each decision, with the range of each figure."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from vibroswarm.analysis.verdict import RobotVerdict, Verdict
from vibroswarm.cli.output import table_lines

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
