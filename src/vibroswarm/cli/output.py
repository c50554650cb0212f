"""What every command prints with: JSON, tables, values with their intervals, and the outcome of a study."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Final

from vibroswarm.cli import terminal

if TYPE_CHECKING:
    from vibroswarm.analysis.intervals import Interval
    from vibroswarm.study.summary import Outcome


MOST_ROWS: Final = 60
"""Rows of a table that are printed without ``--wide``."""


def print_json(document: Any) -> None:
    """Print one JSON document."""
    print(json.dumps(document, indent=2, allow_nan=False))


def paragraph(text: str) -> str:
    """Break text into lines, between words only; all are indented as the first."""
    from textwrap import fill

    indent = text[: len(text) - len(text.lstrip())]
    lines = fill(
        text.replace(" %", "\u00a0%"),  # a number keeps its unit
        terminal.text_width(),
        subsequent_indent=indent,
        break_long_words=False,
        break_on_hyphens=False,
    )
    return lines.replace("\u00a0%", " %")


def print_paragraph(text: str) -> None:
    """Print text, broken into lines as by ``paragraph``."""
    put({"text": text})


def print_line(text: str = "") -> None:
    """Print a line as it is, such as a path or an empty line."""
    put({"line": text})


def print_table(
    columns: Sequence[str],
    rows: Iterable[Sequence[object]],
    *,
    names: int = 1,
    texts: int = 1,
    more: Sequence[str] = (),
) -> None:
    """Print a table in a layout that fits the terminal (``cli.tables``), its first 60 rows unless ``--wide``.

    Args:
        names: number of first columns that name a row. texts: number of first columns aligned to the left.
        more: columns that are printed with ``--wide`` only.
    """
    cells = [[str(value) for value in row] for row in rows]
    put({"columns": [*columns], "rows": cells, "names": names, "texts": texts, "more": [*more]})


Block = dict[str, Any]
"""Something printed: a paragraph (``text``), a line (``line``) or a table (the arguments of ``print_table``)."""
_collecting: list[list[Block]] = []


@contextmanager
def collected() -> Iterator[list[Block]]:
    """Collect what is printed inside, instead of printing it."""
    blocks: list[Block] = []
    _collecting.append(blocks)
    try:
        yield blocks
    finally:
        _collecting.pop()


def put(block: Block) -> None:
    """Print a block, or collect it."""
    if _collecting:
        _collecting[-1].append(block)
    elif "text" in block:
        print(paragraph(block["text"]))
    elif "line" in block:
        print(block["line"])
    else:
        rows = block["rows"]
        shown = rows if terminal.printing.wide else rows[:MOST_ROWS]
        settings = {name: block[name] for name in ("names", "texts", "more")}
        print("\n".join(table_lines(block["columns"], shown, **settings)))
        if len(rows) > len(shown):
            print(paragraph(f"... and {len(rows) - len(shown)} more rows (--wide prints all)."))


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


def _print_cells(outcome: Outcome) -> None:
    """Print the figures of each cell as a table."""
    print_table(
        [
            "cell",
            *(["failed runs"] if outcome.has_failed_runs else []),
            "swarms right, %",
            "swarms wrong, %",
            "split, %",
            "incomplete, %",
            "robots undecided, %",
            "decision time, s",
            "belief in the truth",
        ],
        [
            [
                cell_outcome.cell.name,
                *([cell_outcome.failed.height] if outcome.has_failed_runs else []),
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
            for cell_outcome in outcome.cells
        ],
        more=("split, %", "incomplete, %", "belief in the truth"),
    )
