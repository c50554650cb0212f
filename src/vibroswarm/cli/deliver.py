"""Where a result goes: to the terminal or as JSON to stdout, and into the folder of ``--out``."""

from __future__ import annotations

import webbrowser
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vibroswarm.cli import old_documents, terminal
from vibroswarm.cli.options import Paged
from vibroswarm.core.folders import REPORT

if TYPE_CHECKING:
    from polars import DataFrame


def deliver(
    result: object,
    output: Paged,
    tables: Mapping[str, DataFrame] | None = None,
    also: Callable[[Path], object] | None = None,
    page: str = REPORT,
) -> None:
    """Print the report of a result; save it and tables in the folder of ``--out``, which is claimed already.

    Args:
        tables: by name; they become CSV and Parquet. also: writes further files into the folder.
        page: name of a page that is there already, in the place of the report's.
    """
    document = old_documents.document_of(result)
    print_document(document, as_json=output.json)
    if output.out is None:
        terminal.report("Not saved; add --out DIR to save tables, the data behind them, and a page")
        return
    for name, table in (tables or {}).items():
        write_table(table, output.out / name)
    if also is not None:
        also(output.out)
    old_documents.save(document, output, page)
    terminal.report(f"Saved in {output.out}; page: {page}")
    if output.open:
        webbrowser.open((output.out / page).absolute().as_uri())


def write_table(table: DataFrame, path: Path) -> None:
    """Write a table as CSV and Parquet."""
    from vibroswarm.core.atomic_io import write_file
    from vibroswarm.core.tables import csv_bytes, parquet_bytes

    write_file(path.with_suffix(".csv"), csv_bytes(table))
    write_file(path.with_suffix(".parquet"), parquet_bytes(table))


def print_document(result: Any, *, as_json: bool = False) -> None:
    """Print the report of a result as wide as the terminal, or as JSON."""
    old_documents.show(old_documents.document_of(result), as_json)


def print_saved_file(path: Path | None, note: str = "", *, as_json: bool = False) -> None:
    """Print where a file was written, if it was, unless stdout holds JSON."""
    if path is not None and not as_json:
        print(terminal.plain(f"Saved: {path}{f' ({note})' if note else ''}"))
