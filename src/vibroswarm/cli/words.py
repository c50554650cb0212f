"""The verdict in a person's words."""

from __future__ import annotations

from textwrap import fill

from vibroswarm import strategies
from vibroswarm.analysis.verdict import RobotVerdict, Verdict
from vibroswarm.result import Result

WIDTH = 100


def strategy_said(name: str) -> str:
    """A strategy in a few words: what it says of itself before the colon, or its name."""
    known = strategies.known().get(name)
    return known.about.partition(":")[0] if known is not None and known.about else name


def percent(share: float) -> str:
    """``0.5`` as ``50 %``."""
    return f"{100 * share:.4g} %"


def decision_words(decision: int | None, answers: tuple[str, str]) -> str:
    """What a decision says about the floor.

    Args:
        answers: ``verdict.answers_of`` its scenario.
    """
    return "undecided" if decision is None or decision == -1 else answers[decision]


def headline(found: Verdict) -> str:
    """The outcome in one sentence."""
    if found.consensus is None:
        return "What the robots decided was not logged."
    robots = len(found.robots)
    what = decision_words(found.decision, found.answers)
    together = "the robot decided" if robots == 1 else f"all {robots} robots decided"
    at = "" if found.consensus_time_s is None else f" by {found.consensus_time_s:.1f} s"
    if found.consensus == "right":
        return f"CONSENSUS, RIGHT: {together} '{what}'{at}."
    if found.consensus == "wrong":
        return f"CONSENSUS, WRONG: {together} '{what}'{at}, and that is not so."
    if found.consensus == "agreed":
        why = "the fill ratio is the boundary itself, neither" if found.of_shares else "neither answer"
        return f"CONSENSUS: {together} '{what}'{at}; {why} is right."
    decided = robots - found.undecided
    sides = f"{found.right} right, {found.wrong} wrong" if found.truth is not None else f"{decided} decided"
    if found.consensus == "split":
        return f"SPLIT: all {robots} robots decided, but not alike: {sides}."
    return f"INCOMPLETE: {found.undecided} of {robots} robots undecided after {found.end_s:g} s ({sides})."


def how_sure(found: Verdict) -> str:
    """How sure the robots were."""
    beliefs = [r.belief_in_decision for r in found.robots if r.belief_in_decision is not None]
    note = "A belief counts every bit as independent evidence, which bits of neighbouring samples are not."
    if not beliefs:
        beliefs = [r.belief for r in found.robots if r.belief is not None]
        if not beliefs:
            if any(r.samples for r in found.robots):
                return "How sure: the robots keep no belief."
            return "No robot took a sample."
        what = "less" if found.of_shares else found.answers[0]
        return f"How sure: no robot was; belief in '{what}' is {_range(beliefs)}. {note}"
    return f"How sure: belief in the decision, when it fell, {_range(beliefs)}. {note}"


def _range(shares: list[float]) -> str:
    low, high = (
        percent(min(max(share, 1e-4), 1 - 1e-4)) for share in (round(min(shares), 4), round(max(shares), 4))
    )
    return low if low == high else f"{low} to {high}"


def robot_line(robot: RobotVerdict, answers: tuple[str, str]) -> str:
    """One robot in one line of the table."""
    at = "never" if robot.decision_time_s is None else f"{robot.decision_time_s:.1f} s"
    sure = "" if robot.belief_in_decision is None else f"{100 * robot.belief_in_decision:.1f} %"
    estimate = "not told"
    if robot.estimate is not None and robot.interval is not None:
        estimate = f"{robot.estimate:.3f} [{robot.interval[0]:.3f}, {robot.interval[1]:.3f}]"
    heard = "-" if robot.received is None else str(robot.received)
    return (
        f"{robot.robot:>5}  {decision_words(robot.decision, answers):<26} {at:>9} {sure:>8}   "
        f"{estimate:<20} {robot.samples:>8} {heard:>6}"
    )


def verdict_text(result: Result, found: Verdict) -> str:
    """The whole verdict, some lines of plain text."""
    scenario, floor = result.scenario, result.floor()
    ones, tiles = int(floor.tiles.sum()), floor.tiles.size
    made = "as recorded" if result.seed is None else f"seed {result.seed}"
    robots = f"{len(found.robots)} robot{'' if len(found.robots) == 1 else 's'}"
    lines = [
        f"{robots}, {strategy_said(scenario.strategy.name)}, on '{floor.name}' "
        f"({ones} of {tiles} tiles vibrate, fill ratio {found.fill_ratio:.4g}), {made}",
        "",
        headline(found),
        how_sure(found),
    ]
    if found.share_of_ones_read is not None:
        lines.append(
            f"Samples read as vibrating: {percent(round(found.share_of_ones_read, 4))}; with the sensor's errors, "
            f"{percent(round(found.share_of_ones_expected, 4))} are expected on this floor."
        )
    if found.readings_boundary != found.decision_boundary:
        lines.append(
            f"Robots test the share of ones against {percent(round(found.readings_boundary, 4))}, which a floor with "
            f"{percent(found.decision_boundary)} vibrating tiles is expected to give."
        )
    lines += [
        "",
        f"{'robot':>5}  {'decision':<26} {'at':>9} {'belief':>8}   "
        f"{'share of ones (95 %)':<20} {'own':>8} {'heard':>6}",
        *(robot_line(robot, found.answers) for robot in found.robots),
        "",
    ]
    return "\n".join(fill(line, WIDTH) if ". " in line else line for line in lines)
