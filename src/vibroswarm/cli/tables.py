"""The outcome of a study as tables in the terminal."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.table import Table

if TYPE_CHECKING:
    from vibroswarm.analysis.intervals import Interval
    from vibroswarm.study.compare import Compared
    from vibroswarm.study.outcome import Outcome

MOST_ROWS = 60


def say_tables(outcome: Outcome) -> None:
    """Cells, comparisons and warnings, on stdout."""
    console = Console(file=sys.stdout, highlight=False, width=None if sys.stdout.isatty() else 170)
    console.print(_cells(outcome))
    if len(outcome.cells) > MOST_ROWS:
        console.print(f"... and {len(outcome.cells) - MOST_ROWS} more cells, in summary.csv.")
    runs = {one.summary.runs for one in outcome.cells}
    how = f"{min(runs):,}" if len(runs) == 1 else f"{min(runs):,} to {max(runs):,}"
    console.print(
        f"{how} runs a cell; in brackets 95 % intervals, the run being the unit (Wilson, t). A run without a decision "
        "counts with its whole time.",
        style="dim",
    )
    until, levels = outcome.result.study.until, {one.settled.level for one in outcome.cells if one.settled}
    if until is not None and levels:
        told = " to ".join(f"{100 * level:.2f} %" for level in sorted({min(levels), max(levels)}))
        console.print(
            f"Intervals of {until.figure} are at {told}: corrected for the looks, they hold at 95 %.",
            style="dim",
        )
    if outcome.comparisons:
        console.print(_comparisons(outcome))
        console.print(
            "Differences run by run, 95 % sign-flip intervals; p by Holm over all of them. 'again': on other "
            "seeds, with fresh motion and floors. A difference that is not shown to be there is not shown to be "
            "absent.",
            style="dim",
        )
    for warning in outcome.warnings:
        console.print(f"[bold]Warning[/bold]: {_plain(warning)}")


def _cells(outcome: Outcome) -> Table:
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("cell", overflow="fold")
    for name in (
        "right",
        "wrong",
        "split",
        "incomplete",
        "robots undecided",
        "decision time, s",
        "belief in truth",
    ):
        table.add_column(name, justify="right", no_wrap=True)
    for one in outcome.cells[:MOST_ROWS]:
        s = one.summary
        shares = (s.swarm_right, s.swarm_wrong, s.swarm_split, s.swarm_incomplete, s.robots_undecided)
        table.add_row(
            _plain(one.cell.name),
            *(percent(share) for share in shares),
            number(s.decision_time_s, 0),
            number(s.belief_in_truth, 3),
        )
    return table


def _comparisons(outcome: Outcome) -> Table:
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("compared", overflow="fold")
    for name in ("decision time, s", "better/equal/worse", "p", "again", "robots right, points", "again"):
        table.add_column(name, justify="right", no_wrap=True)
    by_pair: dict[tuple[int, int], dict[str, Compared]] = {}
    for one in outcome.comparisons:
        by_pair.setdefault((one.cell.number, one.reference.number), {})[one.first.figure] = one
    for figures in list(by_pair.values())[:MOST_ROWS]:
        time, right = figures["decision_time_s"], figures["right_share"]
        table.add_row(
            _plain(time.name),
            number(time.first.difference, 0, sign=True),
            f"{time.first.wins}/{time.first.ties}/{time.first.losses}",
            _p(time.first.p_holm),
            _again(time),
            percent(right.first.difference, sign=True),
            _again(right),
        )
    return table


def percent(share: Interval, *, sign: bool = False) -> str:
    """``44.1 % [41.0, 47.2]``; ``-`` where it is not defined."""
    if share.estimate != share.estimate:
        return "-"
    mark = "+" if sign else ""
    low, high = (f"{100 * end:{mark}.1f}" for end in (share.low, share.high))
    return _plain(f"{100 * share.estimate:{mark}.1f} % [{low}, {high}]")


def number(value: Interval, digits: int, *, sign: bool = False) -> str:
    """``887 [873, 902]``; ``-`` where it is not defined."""
    if value.estimate != value.estimate:
        return "-"
    mark = "+" if sign else ""
    return _plain(
        f"{value.estimate:{mark}.{digits}f} [{value.low:{mark}.{digits}f}, {value.high:{mark}.{digits}f}]"
    )


def _again(one: Compared) -> str:
    if one.again is None:
        return "not tried"
    if one.again.confirmed:
        return "confirmed"
    return "-" if one.again.says.startswith("the first block") else "not confirmed"


def _p(value: float) -> str:
    return "-" if value != value else ("<0.001" if value < 0.001 else f"{value:.3f}")


def _plain(text: Any) -> str:
    from rich.markup import escape

    return escape(str(text))
