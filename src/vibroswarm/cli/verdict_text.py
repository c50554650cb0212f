"""The verdict as text."""

from __future__ import annotations

from vibroswarm import strategies
from vibroswarm.analysis.opinion import OPINION_NOTE, holds_opinions
from vibroswarm.analysis.verdict import RobotVerdict, Verdict
from vibroswarm.cli.output import paragraph, table_lines
from vibroswarm.cli.robot_summary import MOST_ROBOTS, summary_lines
from vibroswarm.cli.terminal import printing
from vibroswarm.faults.assignment import fault_words
from vibroswarm.result import Result


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


def verdict_text(result: Result, found: Verdict) -> str:
    """Return the whole verdict in plain text, the outcome first."""
    scenario, floor = result.scenario, result.floor()
    ones, tiles = int(floor.tiles.sum()), floor.tiles.size
    origin = "as recorded" if result.seed is None else f"seed {result.seed}"
    robots = f"{len(found.robots)} robot{'' if len(found.robots) == 1 else 's'}"
    lines = [
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
