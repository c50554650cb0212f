"""A verdict in sentences, as the terminal and notebooks show it."""

from __future__ import annotations

from vibroswarm import strategies
from vibroswarm.analysis.verdict import RobotVerdict, Verdict


def strategy_name(name: str) -> str:
    """Return a readable name of a strategy: the beginning of its description, or its name."""
    known = strategies.known().get(name)
    return known.about.partition(":")[0] if known is not None and known.about else name


def percent(share: float) -> str:
    """``0.5`` as ``50 %``."""
    return f"{100 * share:.4g} %"


def decision_words(decision: int | None, answers: tuple[str, str]) -> str:
    """Return what a decision means for the floor.

    Args:
        answers: ``verdict.answers_of`` the scenario.
    """
    return "undecided" if decision is None or decision == -1 else answers[decision]


def headline(found: Verdict) -> str:
    """Return the outcome in one sentence."""
    if found.consensus is None:
        return "Decisions were not logged."
    robots = len(found.robots)
    answer = decision_words(found.decision, found.answers)
    together = "the robot decided" if robots == 1 else f"all {robots} robots decided"
    at = "" if found.consensus_time_s is None else f" by {found.consensus_time_s:.1f} s"
    if found.consensus == "right":
        return f"CONSENSUS, RIGHT: {together} '{answer}'{at}."
    if found.consensus == "wrong":
        return f"CONSENSUS, WRONG: {together} '{answer}'{at}."
    if found.consensus == "truth_undefined":
        reason = "the fill ratio equals the boundary, neither" if found.of_shares else "neither answer"
        return f"CONSENSUS: {together} '{answer}'{at}; {reason} is right."
    decided = robots - found.undecided
    sides = f"{found.right} right, {found.wrong} wrong" if found.truth is not None else f"{decided} decided"
    if found.consensus == "split":
        return f"SPLIT: all {robots} robots decided, but differently: {sides}."
    return f"INCOMPLETE: {found.undecided} of {robots} robots undecided after {found.end_s:g} s ({sides})."


def confidence(found: Verdict) -> str:
    """Return the robots' confidence in their decisions."""
    beliefs = [r.belief_in_decision for r in found.robots if r.belief_in_decision is not None]
    note = "Robots treat all bits as independent; those of neighbouring samples are not."
    if not beliefs:
        beliefs = [r.belief for r in found.robots if r.belief is not None]
        if not beliefs:
            if any(r.samples for r in found.robots):
                return "Confidence: not defined; this strategy has no belief."
            return "No robot took a sample."
        answer = "less" if found.of_shares else found.answers[0]
        return f"Confidence: no robot decided; belief in '{answer}' is {_range(beliefs)}. {note}"
    return f"Confidence at decision time: {_range(beliefs)}. {note}"


def _range(shares: list[float]) -> str:
    low, high = (
        percent(min(max(share, 1e-4), 1 - 1e-4)) for share in (round(min(shares), 4), round(max(shares), 4))
    )
    return low if low == high else f"{low} to {high}"


def robot_row(robot: RobotVerdict, answers: tuple[str, str]) -> list[object]:
    """Return one robot as a row of the table."""
    at = "never" if robot.decision_time_s is None else f"{robot.decision_time_s:.1f}"
    sure = "" if robot.belief_in_decision is None else f"{100 * robot.belief_in_decision:.1f}"
    estimate = "-"
    if robot.estimate is not None and robot.interval is not None:
        estimate = f"{robot.estimate:.3f} [{robot.interval[0]:.3f}, {robot.interval[1]:.3f}]"
    heard = "-" if robot.received is None else robot.received
    decision = decision_words(robot.decision, answers).replace(
        " % vibrates", " %"
    )  # the headline has the verb
    return [robot.robot, decision, at, sure, estimate, robot.samples, heard]
