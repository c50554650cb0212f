"""What every command prints with: JSON, tables, values with their intervals, and where results are saved."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from vibroswarm.cli import terminal
from vibroswarm.errors import InputError

if TYPE_CHECKING:
    from vibroswarm.analysis.intervals import Interval

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
    """Print a block; inside ``collected``, collect it instead."""
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
    """Format a value as ``44.1 % [41.0, 47.2]``; ``-`` without a value, and no brackets without an interval.

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


def add_open(parser: Any, help: str = "open the report in the browser") -> None:
    """Add the option that opens the page or report."""
    parser.add_argument("--open", action="store_true", help=help)


def check_open(arguments: argparse.Namespace) -> None:
    """Refuse ``--open`` where nothing is saved; called before the work.

    Raises:
        InputError: ``--open`` is given without ``--out``.
    """
    if getattr(arguments, "open", False) and arguments.out is None:
        raise InputError("needs --out DIR, where the page is saved", field="--open")


def print_saved(arguments: argparse.Namespace, what: str, page: str | None = None) -> None:
    """Print where results are saved, and open the page if ``--open``.

    Args:
        what: what is saved, or would be. page: its file in the folder, if there is one.
    """
    as_json = getattr(arguments, "json", False)
    if not as_json:
        if arguments.out is None:
            print_paragraph(f"Not saved; add --out DIR to save {what}")
        else:
            print_line(f"Saved in {arguments.out}: {what}")
            if page is not None:
                kind = "Report" if page == "report.html" else "Page"
                print_line(f"{kind}: open {(arguments.out / page).resolve()} in a browser")
    sys.stdout.flush()
    if getattr(arguments, "open", False) and arguments.out is not None:
        if page is None:
            print("vibroswarm: nothing to open: no page was written", file=sys.stderr)
        else:
            open_page(arguments.out / page)


def open_page(path: Path) -> bool:
    """Open a file in the browser; without one, say so on stderr and return False."""
    import webbrowser

    path = path.resolve()
    opened = False
    if has_display():
        try:
            opened = webbrowser.open(path.as_uri())
        except webbrowser.Error:
            opened = False
    if not opened:
        print(
            f"vibroswarm: no browser can be opened here; open {path} on a machine that has one",
            file=sys.stderr,
            flush=True,
        )
    return opened


def has_display() -> bool:
    """Return whether a browser could show a window; BROWSER names one where there is no display."""
    if sys.platform in ("win32", "darwin") or os.environ.get("BROWSER"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
