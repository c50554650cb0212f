"""The outcome of a study as tables in the terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from vibroswarm.cli.output import console, percent, print_table, with_interval

if TYPE_CHECKING:
    from vibroswarm.study.cell_comparison import Compared
    from vibroswarm.study.summary import Outcome

MOST_ROWS = 60


def print_tables(outcome: Outcome) -> None:
    """Print cells, comparisons and warnings."""
    out = console()
    _print_cells(outcome)
    if len(outcome.cells) > MOST_ROWS:
        out.print(f"... and {len(outcome.cells) - MOST_ROWS} more cells, in summary.csv.")
    runs = {one.summary.runs for one in outcome.cells}
    how = f"{min(runs):,}" if len(runs) == 1 else f"{min(runs):,} to {max(runs):,}"
    out.print(
        f"{how} runs per cell; in brackets 95 % intervals over runs (Wilson, t). An undecided run counts with its "
        "whole time.",
        style="dim",
    )
    until, levels = outcome.result.study.until, {one.settled.level for one in outcome.cells if one.settled}
    if until is not None and levels:
        shown = " to ".join(f"{100 * level:.2f} %" for level in sorted({min(levels), max(levels)}))
        out.print(
            f"Intervals of {until.figure} are at {shown}, corrected for repeated looks: they hold at 95 %.",
            style="dim",
        )
    if outcome.comparisons:
        _print_comparisons(outcome)
        out.print(
            "Differences run by run, 95 % sign-flip intervals; p by Holm over all of them. 'again': on other seeds, "
            "with fresh motion and floors. No significant difference is not evidence of no difference.",
            style="dim",
        )
    for warning in outcome.warnings:
        out.print(f"Warning: {warning}")


def _print_cells(outcome: Outcome) -> None:
    print_table(
        [
            "cell",
            "right",
            "wrong",
            "split",
            "incomplete",
            "robots undecided",
            "decision time, s",
            "belief in truth",
        ],
        [
            [
                one.cell.name,
                *map(
                    percent,
                    (
                        one.summary.swarm_right,
                        one.summary.swarm_wrong,
                        one.summary.swarm_split,
                        one.summary.swarm_incomplete,
                        one.summary.robots_undecided,
                    ),
                ),
                with_interval(one.summary.decision_time_s, ".0f"),
                with_interval(one.summary.belief_in_truth, ".3f"),
            ]
            for one in outcome.cells[:MOST_ROWS]
        ],
    )


def _print_comparisons(outcome: Outcome) -> None:
    by_pair: dict[tuple[int, int], dict[str, Compared]] = {}
    for one in outcome.comparisons:
        by_pair.setdefault((one.cell.number, one.reference.number), {})[one.first.figure] = one
    rows = []
    for figures in list(by_pair.values())[:MOST_ROWS]:
        time, right = figures["decision_time_s"], figures["right_share"]
        rows.append(
            [
                time.name,
                with_interval(time.first.difference, "+.0f"),
                f"{time.first.wins}/{time.first.ties}/{time.first.losses}",
                _p(time.first.p_holm),
                _again(time),
                percent(right.first.difference, "+.1f"),
                _again(right),
            ]
        )
    columns = [
        "compared",
        "decision time, s",
        "better/equal/worse",
        "p",
        "again",
        "robots right, points",
        "again",
    ]
    print_table(columns, rows)


def _again(one: Compared) -> str:
    """Whether the comparison was confirmed on other seeds."""
    if one.replicate is None:
        return "not tried"
    if one.replicate.confirmed:
        return "confirmed"
    return "-" if one.replicate.says.startswith("the first block") else "not confirmed"


def _p(value: float) -> str:
    return "-" if value != value else ("<0.001" if value < 0.001 else f"{value:.3f}")
