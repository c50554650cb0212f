"""What every command prints with: JSON, tables, values with their intervals, and the outcome of a study."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from rich.console import Console

    from vibroswarm.analysis.intervals import Interval
    from vibroswarm.study.summary import Outcome


TEXT_WIDTH: Final = 100
"""Of paragraphs."""
TABLE_WIDTH: Final = 170
"""Of tables that do not go to a terminal."""


def print_json(document: Any) -> None:
    """Print one JSON document."""
    print(json.dumps(document, indent=2, allow_nan=False))


def print_paragraph(text: str) -> None:
    """Print text, broken into lines."""
    from textwrap import fill

    print(fill(text, TEXT_WIDTH))


def console() -> Console:
    """Return a console on stdout."""
    from rich.console import Console

    return Console(
        file=sys.stdout, highlight=False, markup=False, width=None if sys.stdout.isatty() else TABLE_WIDTH
    )


def print_table(columns: Sequence[str], rows: Iterable[Sequence[object]], *, texts: int = 1) -> None:
    """Print a table; the first ``texts`` columns are aligned to the left, all others to the right."""
    print("\n".join(table_lines(columns, rows, texts=texts)))


def table_lines(columns: Sequence[str], rows: Iterable[Sequence[object]], *, texts: int = 1) -> list[str]:
    """Return the lines that ``print_table`` prints."""
    from rich.table import Table

    table = Table(box=None, pad_edge=False, header_style="bold", show_header=any(columns))
    for place, name in enumerate(columns):
        is_text = place < texts
        table.add_column(name, justify="left" if is_text else "right", overflow="fold", no_wrap=not is_text)
    for row in rows:
        table.add_row(*map(str, row))
    out = console()
    with out.capture() as captured:
        out.print(table)
    return [line.rstrip() for line in captured.get().splitlines()]


def with_interval(value: Interval | None, form: str, *, scale: float = 1.0, unit: str = "") -> str:
    """``44.1 % [41.0, 47.2]``; ``-`` without a value, and no brackets without an interval.

    Args:
        form: format specification of each number, such as ``.1f``.
        scale: factor on each number.
        unit: behind the estimate.
    """
    if value is None or value.estimate != value.estimate:
        return "-"
    estimate, low, high = (f"{scale * number:{form}}" for number in (value.estimate, value.low, value.high))
    return f"{estimate}{unit}" if value.low != value.low else f"{estimate}{unit} [{low}, {high}]"


def percent(share: Interval | None, form: str = ".1f") -> str:
    """Return a share with its interval, in percent."""
    return with_interval(share, form, scale=100.0, unit=" %")


MOST_ROWS = 60


def print_tables(outcome: Outcome) -> None:
    """Print the answer, the cells and warnings."""
    from vibroswarm.cli.answers_text import print_answers, print_effects

    out = console()
    print_answers(outcome)
    _print_cells(outcome)
    if len(outcome.cells) > MOST_ROWS:
        out.print(f"... and {len(outcome.cells) - MOST_ROWS} more cells, in summary.csv.")
    runs = {cell_outcome.summary.runs for cell_outcome in outcome.cells}
    count = f"{min(runs):,}" if len(runs) == 1 else f"{min(runs):,} to {max(runs):,}"
    out.print(
        f"{count} runs per cell; in brackets 95 % intervals over runs (Wilson, t). An undecided run counts with its "
        "whole time.",
        style="dim",
    )
    until, levels = (
        outcome.result.study.until,
        {cell_outcome.settled.level for cell_outcome in outcome.cells if cell_outcome.settled},
    )
    if until is not None and levels:
        levels_text = " to ".join(f"{100 * level:.2f} %" for level in sorted({min(levels), max(levels)}))
        out.print(
            f"Intervals of {until.figure} are at {levels_text}, corrected for repeated looks: they hold at 95 %.",
            style="dim",
        )
    print_effects(outcome)
    for warning in outcome.warnings:
        out.print(f"Warning: {warning}")


def _print_cells(outcome: Outcome) -> None:
    """Print the figures of each cell as a table."""
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
                cell_outcome.cell.name,
                *map(
                    percent,
                    (
                        cell_outcome.summary.swarm_right,
                        cell_outcome.summary.swarm_wrong,
                        cell_outcome.summary.swarm_split,
                        cell_outcome.summary.swarm_incomplete,
                        cell_outcome.summary.robots_undecided,
                    ),
                ),
                with_interval(cell_outcome.summary.decision_time_s, ".0f"),
                with_interval(cell_outcome.summary.belief_in_truth, ".3f"),
            ]
            for cell_outcome in outcome.cells[:MOST_ROWS]
        ],
    )
