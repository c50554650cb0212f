"""Print the results of ``vibroswarm optimize``.

The score that a search believed is the winner's score on the runs of the search. It is too good, since the winner was
chosen for it. The true score is estimated on fresh runs.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from vibroswarm.cli.output import percent, print_paragraph, print_table, with_interval
from vibroswarm.optimize.search_tables import (
    GRID_LUCK,
    failures_in,
    failures_said,
    fresh_failures_said,
    reasons,
    values_said,
)

if TYPE_CHECKING:
    from vibroswarm.optimize.grid import Nodes
    from vibroswarm.optimize.loop import Found
    from vibroswarm.optimize.objective import Objective
    from vibroswarm.optimize.scenario_comparison import Checked
    from vibroswarm.optimize.sensitivity import Sensitivity
    from vibroswarm.optimize.validation import Front, Scored, Truth


def print_found(found: Found, truth: Truth | None, front: Front | None) -> None:
    """Print what a search found, and how many of its runs failed.

    A search with one objective finds the best candidate, which is compared with the starts of the search. A search with
    several objectives finds a Pareto front.

    Args:
        found: the result of the search.
        truth: the scores of the best candidate and of the starts on fresh runs; None with several objectives.
        front: the Pareto front, scored on fresh runs; None with one objective, or if the front is empty.
    """
    for note in found.notes:
        print_paragraph(note)
    if front is not None:
        _print_front(front)
    if truth is not None:
        objective = found.search.objectives[0]
        print_truth(truth, found.values, objective)
        for scored in (truth.winner, *truth.others):
            if fresh_failures := fresh_failures_said(scored):
                print_paragraph(f"  {fresh_failures}")
        _print_parts(truth.winner)
        # for each start: its score, and the score of the best candidate minus that score, paired by run
        for other, difference in zip(truth.others, truth.against, strict=True):
            print_paragraph(
                f"{other.name}: {with_interval(other.score, '.2f')}{_unit(objective)}; best - {other.name}: "
                f"{with_interval(difference, '+.2f')}"
            )
    archive = found.archive
    print_paragraph(f"{len(archive):,} candidates in {found.runs:,} runs; {failures_in(archive)}")
    for cause in reasons(archive):
        print_paragraph(f"  failed: {cause}")


def _unit(objective: Objective) -> str:
    """Return the unit of an objective after a blank, to be put after a score; an empty text if it has no unit."""
    return f" {objective.unit}".rstrip()


def print_truth(truth: Truth, values: dict[str, Any], objective: Objective) -> None:
    """Print the best values, the score that the search believed, and the score on fresh runs.

    Args:
        truth: the best candidate's scores.
        values: the best candidate's values, by field.
        objective: what the scores measure; its unit is printed after them.
    """
    unit = _unit(objective)
    print_paragraph(f"Best: {values_said(values)}")
    print_paragraph(f"  believed by the search  {truth.believed:.4g}{unit}")
    print_paragraph(
        f"  true, on fresh runs     {with_interval(truth.winner.score, '.2f')}{unit} ({truth.winner.score.n:,} runs)"
    )
    print_paragraph(f"  {truth.words}")


def _print_front(front: Front) -> None:
    """Print the candidates of a Pareto front, with the scores that the search believed and those on fresh runs.

    A candidate is marked with a dash if, on fresh runs, another candidate dominates it (``member.stays`` is false): the
    other one is not worse in any objective, and better in at least one.
    """
    print_paragraph(f"{len(front.members)} candidates on the Pareto front of {' and '.join(front.names)}:")
    for member in front.members:
        scores = "; ".join(
            # `rstrip`: no blank follows the score if the unit is empty
            f"believed {believed:.4g}, true {with_interval(true, '.2f')}{f' {unit}'.rstrip()}"
            for believed, true, unit in zip(member.believed, member.true, front.units, strict=True)
        )
        print_paragraph(f"  {'  ' if member.stays else '- '}{scores}: {values_said(member.values)}")
        if member.failed:
            print_paragraph(f"    {member.failed:,} of its fresh runs FAILED and are not counted")
    dominated = "" if all(member.stays for member in front.members) else " -: dominated on fresh runs."
    print_paragraph(f"  {front.words}{dominated}")


def _print_parts(scored: Scored) -> None:
    """Print the parts of a score of the cost ``time_at_error``: decision time, wrong and undecided; else nothing.

    This cost is the decision time, with penalties if the wrong or the undecided robots exceed a limit. So these two
    shares are also compared with their limits.
    """
    if scored.parts is None:  # another cost
        return
    compared_with_limit = scored.near  # in words, by the name of the part
    print_paragraph(f"  decision time {with_interval(scored.parts['decision_time_s'], '.0f')} s")
    for words, name in (("wrong decisions", "robot_error"), ("undecided", "robots_undecided")):
        print_paragraph(f"  {words} {percent(scored.parts[name])}: {compared_with_limit[name]}")
    if scored.cases:
        print_paragraph("  (each in its worst case)")


def print_grid(nodes: Nodes) -> None:
    """Print the score of every cell of a grid; mark the lowest, and those that are not significantly higher."""
    print_paragraph(
        f"{nodes.grid.objective.words}, {nodes.best.scored.score.n:,} runs per cell on shared motion:"
    )
    print_table(
        ["cell", "score", "decision time, s", "wrong, %", "undecided, %", ""],
        [
            [
                node.cell.name,
                with_interval(node.scored.score, ".2f"),
                f"{node.time_s:.0f}",
                f"{100 * node.wrong:.1f}",
                f"{100 * node.undecided:.1f}",
                "*" if node is nodes.best else "=" if node.as_good else "",
            ]
            for node in nodes.nodes
        ],
    )
    print_paragraph(f"* the lowest score; = {GRID_LUCK}")


def print_sensitivity(found: Sensitivity) -> None:
    """Print the Sobol indices of each field: of the field alone, and in total with its interactions."""
    print_table(
        ["field", "total", "alone"],
        [
            [
                index.name,
                f"{index.total:.2f} [{index.total_low:.2f}, {index.total_high:.2f}]",
                f"{index.first:.2f} [{index.first_low:.2f}, {index.first_high:.2f}]",
            ]
            for index in found.fields
        ],
    )
    print_paragraph(
        "Shares of the variance over the space: with interactions, and of the field alone; 95 % bootstrap."
    )
    # `not ... > 0` also holds for NaN, which the limits are if the noise of the runs hides all effects.
    if without_effect := [index.name for index in found.fields if not index.total_low > 0]:
        print_paragraph(
            f"No significant effect: {', '.join(without_effect)}. Four times the --budget makes intervals half as wide."
        )
    print_paragraph(
        f"{found.runs:,} runs at {found.points:,} points, {found.replicates} each; {failures_said(found.failed)}"
    )
    print_paragraph(
        f"Noise of the runs, {100 * found.noise_share:.0f} % of the variance of the points' mean costs, is removed."
    )


def print_comparison(found: Checked) -> None:
    """Print the scores of two scenarios and their difference (first - second), then the differences of other figures.

    The difference of the scores is also printed for a second block of runs, on other seeds.
    """
    print_paragraph(found.says)
    print_paragraph(f"{found.objective.words}, {found.first.score.n:,} fresh runs of each, in pairs:")
    for scored in (found.first, found.second):
        failed = f" ({scored.failed:,} runs FAILED)" if scored.failed else ""
        print_paragraph(
            f"  {scored.name}: {with_interval(scored.score, '.2f')}{_unit(found.objective)}{failed}"
        )
        _print_parts(scored)
    print_paragraph(
        f"  difference: {with_interval(found.difference, '+.2f')}; on other seeds "
        f"{with_interval(found.replicate, '+.2f')}"
    )
    for paired in found.figures:
        print_paragraph(
            f"  {paired.figure}: {with_interval(paired.difference, '+.3f')} "
            f"({paired.first:.4g} - {paired.second:.4g})"
        )
