"""Print the results of commands: JSON, paragraphs, tables, values with their intervals, and where results are saved."""

from __future__ import annotations

import argparse
import json
import math
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
"""Most rows of a table that are printed without ``--wide``."""


def print_json(document: Any) -> None:
    """Print one JSON document.

    JSON has no NaN and no infinity: callers replace them, usually by None.

    Raises:
        ValueError: the document holds such a number.
    """
    print(json.dumps(document, indent=2, allow_nan=False))


def paragraph(text: str) -> str:
    """Break text between words into lines that fit the terminal, and indent every line like the first.

    A number and its % sign stay on one line, because a no-break space joins them while the text is broken.
    """
    from textwrap import fill

    indent = text[: len(text) - len(text.lstrip())]
    lines = fill(
        text.replace(" %", "\u00a0%"),
        terminal.text_width(),
        subsequent_indent=indent,
        break_long_words=False,
        break_on_hyphens=False,
    )
    return lines.replace("\u00a0%", " %")


def print_paragraph(text: str) -> None:
    """Print text, broken into lines that fit the terminal (``paragraph``)."""
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
    """Print a table; its first ``names`` columns name the rows, and its first ``texts`` columns hold text.

    The layout fits the terminal (``cli.tables``). Only the first 60 rows are printed, or all with ``--wide``.

    Args:
        columns: headers.
        rows: for each row, one value for each column, printed as ``str`` formats it.
        names: how many of the first columns name the row, such as strategy and figure. A layout for a narrow terminal
            repeats these columns, or puts them on a line of their own.
        texts: how many of the first columns hold text, including those that name the row. Text is aligned to the left,
            and the columns of text after the names may be wrapped. All other columns hold numbers, aligned to the
            right. Columns that name the row always count as text, so a number below ``names`` has no effect.
        more: headers of the columns that are printed with ``--wide`` only. They come after the columns of text, so that
            ``names`` and ``texts`` hold with and without them.
    """
    cells = [[str(value) for value in row] for row in rows]
    put({"columns": [*columns], "rows": cells, "names": names, "texts": texts, "more": [*more]})


Block = dict[str, Any]
"""Something to print: a paragraph under the key ``text``, a line under the key ``line``, or the arguments of
``print_table`` by name."""
_collecting: list[list[Block]] = []
"""One list for each ``collected`` context that has not ended, the innermost last."""


@contextmanager
def collected() -> Iterator[list[Block]]:
    """Yield a list that collects the blocks that would be printed inside the context."""
    blocks: list[Block] = []
    _collecting.append(blocks)
    try:
        yield blocks
    finally:
        _collecting.pop()


def put(block: Block) -> None:
    """Print a paragraph, line or table; inside a ``collected`` context, append it to that context's list instead."""
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
    """Return the lines of a table with all its rows; the arguments are those of ``print_table``.

    Without ``--wide``, the columns of ``more`` are left out, and listed below the table.
    """
    from vibroswarm.cli.tables import layout, table_of

    hidden = [] if terminal.printing.wide else [name for name in columns if name in more]
    shown = [j for j, name in enumerate(columns) if name not in hidden]
    table = table_of(
        [columns[j] for j in shown], [[row[j] for j in shown] for row in rows], names=names, texts=texts
    )
    lines = layout(table, terminal.width())
    if hidden:
        without_units = [name.partition(",")[0] for name in hidden]  # "wrong" of "wrong, %"
        lines += paragraph(f"Also with --wide: {', '.join(without_units)}.").splitlines()
    return lines


def with_interval(value: Interval | None, form: str, *, scale: float = 1.0, unit: str = "") -> str:
    """Format an estimate with its interval, such as ``44.1 % [41.0, 47.2]``.

    Args:
        value: the estimate with its limits. The result is ``-`` if the value is None or the estimate is NaN, and the
            estimate without an interval if the lower limit is NaN or both limits are infinite.
        form: format specification of each number, such as ``.1f``.
        scale: factor by which each number is multiplied.
        unit: text that follows the estimate, such as " %".
    """
    if value is None or math.isnan(value.estimate):
        return "-"
    estimate, low, high = (f"{scale * number:{form}}" for number in (value.estimate, value.low, value.high))
    is_known = not math.isnan(value.low) and (math.isfinite(value.low) or math.isfinite(value.high))
    return f"{estimate}{unit} [{low}, {high}]" if is_known else f"{estimate}{unit}"


def percent(share: Interval | None, form: str = ".1f") -> str:
    """Return a share with its interval, in percent."""
    return with_interval(share, form, scale=100.0, unit=" %")


def add_open(parser: Any, help: str = "open the report in the browser") -> None:
    """Add the option that opens the page or report."""
    parser.add_argument("--open", action="store_true", help=help)


def check_open(arguments: argparse.Namespace) -> None:
    """Refuse ``--open`` without ``--out`` before the work begins, because only a saved page can be opened.

    Raises:
        InputError: ``--open`` is given without ``--out``.
    """
    if getattr(arguments, "open", False) and arguments.out is None:
        raise InputError("needs --out DIR, where the page is saved", field="--open")


def print_saved(arguments: argparse.Namespace, what: str, page: str | None = None) -> None:
    """Print where results are saved, or without ``--out`` that they are not; with ``--open``, open their page.

    With ``--json`` nothing is printed on stdout, which holds the JSON document only. A command without the option
    ``--json`` or ``--open`` counts as called without it.

    Args:
        what: what is saved, or what would be saved with ``--out``, in words.
        page: file name of the page or report in the folder ``--out``; None if no page was written.
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
    sys.stdout.flush()  # so that the results are seen before the browser opens
    if getattr(arguments, "open", False) and arguments.out is not None:
        if page is None:
            print("vibroswarm: nothing to open: no page was written", file=sys.stderr)
        else:
            open_page(arguments.out / page)


def open_page(path: Path) -> bool:
    """Open a file in the browser and return True; if that fails, print on stderr what to do, and return False."""
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
    """Return whether a browser can be opened: a display exists, or the environment variable BROWSER names a browser."""
    if sys.platform in ("win32", "darwin") or os.environ.get("BROWSER"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
