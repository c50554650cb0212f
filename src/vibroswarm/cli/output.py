"""What every command prints with: JSON, tables, values with their intervals, and the outcome of a study."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

from vibroswarm.cli import terminal

if TYPE_CHECKING:
    from vibroswarm.analysis.intervals import Interval
    from vibroswarm.study.summary import Outcome


def print_json(document: Any) -> None:
    """Print one JSON document."""
    print(json.dumps(document, indent=2, allow_nan=False))


def paragraph(text: str) -> str:
    """Break text into lines, between words only; all are indented as the first."""
    from textwrap import fill

    indent = text[: len(text) - len(text.lstrip())]
    return fill(
        text,
        terminal.text_width(),
        subsequent_indent=indent,
        break_long_words=False,
        break_on_hyphens=False,
    )


def print_paragraph(text: str) -> None:
    """Print text, broken into lines as by ``paragraph``."""
    print(paragraph(text))


def print_table(
    columns: Sequence[str],
    rows: Iterable[Sequence[object]],
    *,
    names: int = 1,
    texts: int = 1,
    more: Sequence[str] = (),
) -> None:
    """Print a table in a layout that fits the terminal (``cli.tables``).

    Args:
        names: number of first columns that name a row. texts: number of first columns aligned to the left.
        more: columns that are printed with ``--wide`` only.
    """
    print("\n".join(table_lines(columns, rows, names=names, texts=texts, more=more)))


def table_lines(
    columns: Sequence[str],
    rows: Iterable[Sequence[object]],
    *,
    names: int = 1,
    texts: int = 1,
    more: Sequence[str] = (),
) -> list[str]:
    """Return the lines that ``print_table`` prints."""
    from vibroswarm.cli.tables import layout, table_of

    hidden = [] if terminal.printing.wide else [name for name in columns if name in more]
    shown = [j for j, name in enumerate(columns) if name not in hidden]
    table = table_of(
        [columns[j] for j in shown], [[row[j] for j in shown] for row in rows], names=names, texts=texts
    )
    lines = layout(table, terminal.width())
    if hidden:
        lines += paragraph(
            f"Also with --wide: {', '.join(name.partition(',')[0] for name in hidden)}."
        ).splitlines()
    return lines


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

    print_answers(outcome)
    _print_cells(outcome)
    runs = {cell_outcome.summary.runs for cell_outcome in outcome.cells}
    count = f"{min(runs):,}" if len(runs) == 1 else f"{min(runs):,} to {max(runs):,}"
    print_paragraph(
        f"{count} runs per cell; in brackets 95 % intervals over runs (Wilson, t). An undecided run counts with its "
        "whole time."
    )
    until, levels = (
        outcome.result.study.until,
        {cell_outcome.settled.level for cell_outcome in outcome.cells if cell_outcome.settled},
    )
    if until is not None and levels:
        levels_text = " to ".join(f"{100 * level:.2f} %" for level in sorted({min(levels), max(levels)}))
        print_paragraph(
            f"Intervals of {until.figure} are at {levels_text}, corrected for repeated looks: they hold at 95 %."
        )
    print_effects(outcome)
    for warning in outcome.warnings:
        print_paragraph(f"Warning: {warning}")


def most_rows() -> int:
    """Return how many rows of a long table are printed."""
    return 10**9 if terminal.printing.wide else MOST_ROWS


def _print_cells(outcome: Outcome) -> None:
    """Print the figures of each cell as a table."""
    print_table(
        [
            "cell",
            "right, %",
            "wrong, %",
            "split, %",
            "incomplete, %",
            "robots undecided, %",
            "decision time, s",
            "belief in truth",
        ],
        [
            [
                cell_outcome.cell.name,
                *(
                    with_interval(share, ".1f", scale=100.0)
                    for share in (
                        cell_outcome.summary.swarm_right,
                        cell_outcome.summary.swarm_wrong,
                        cell_outcome.summary.swarm_split,
                        cell_outcome.summary.swarm_incomplete,
                        cell_outcome.summary.robots_undecided,
                    )
                ),
                with_interval(cell_outcome.summary.decision_time_s, ".0f"),
                with_interval(cell_outcome.summary.belief_in_truth, ".3f"),
            ]
            for cell_outcome in outcome.cells[: most_rows()]
        ],
        more=("split, %", "incomplete, %", "belief in truth"),
    )
    if (left := len(outcome.cells) - most_rows()) > 0:
        print(f"... and {left} more cells (--wide prints all).")
