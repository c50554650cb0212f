"""``vibroswarm show`` for a file: a scenario, settings of strategies, study, search, floor or table."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from vibroswarm.cli.output import print_json, print_line, print_paragraph, print_table
from vibroswarm.errors import InputError

if TYPE_CHECKING:
    import polars as pl

    from vibroswarm.scenario.scenario import Scenario

TABLES: Final = (".csv", ".parquet")
"""Suffixes of files that hold a table; a .csv file may also hold a floor."""
FLOORS: Final = (".txt", ".png")
"""Suffixes of files that hold a floor."""


def show_file(path: Path, arguments: argparse.Namespace) -> None:
    """Print what a file holds; the kind of file is detected by its suffix and its content.

    Raises:
        InputError: the file cannot be read, its suffix is not known, or its content is wrong.
    """
    from vibroswarm.core.tables import MAX_BYTES
    from vibroswarm.core.untrusted_files import check_plain

    check_plain(path, MAX_BYTES, "a file of vibroswarm")
    if path.suffix == ".toml":
        _show_toml(path, arguments)
    elif path.suffix in TABLES and not _is_floor(path):
        _show_table(path, arguments)
    elif path.suffix in (*FLOORS, ".csv"):
        _show_floor(path, arguments)
    else:
        raise InputError(
            "is neither a folder nor a file that vibroswarm shows (.toml, .csv, .parquet, .txt, .png)",
            field=str(path),
        )


def _show_toml(path: Path, arguments: argparse.Namespace) -> None:
    """Print what a TOML file describes: a search, a study, settings of strategies or a scenario.

    A search and a study are detected by the names of their entries, settings by the form of their keys; any other file
    is read as a scenario. For a search or a study, only a summary is printed.
    """
    from vibroswarm.core.untrusted_files import parsed_toml, read_text

    text = read_text(path, "a file in TOML")
    tables = parsed_toml(text, str(path))
    summary: dict[str, Any]
    if {"space", "objective", "search"} & set(tables):  # entries of files for `optimize` only
        from vibroswarm.optimize.spec import Search

        search = Search.read(path)
        summary = {
            "search": search.hash,
            "method": search.settings.method,
            "fields": list(search.space.names),
        }
        words = f"Search of {search.space.size} fields by {search.settings.method}: {', '.join(search.space.names)}."
        # ``optimize --method grid`` writes such a file without settings of a search, which can be read as both.
        if "search" not in tables and (cells := _cells_of_grid(path)):
            summary |= {"method": "grid", "cells": cells}
            words = f"Grid of {cells} cells over {', '.join(search.space.names)}, or fields of a search."
    # entries that no scenario has; a search may have some of them, so it is detected first
    elif {"grid", "zip", "list", "random", "sobol", "runs", "until"} & set(tables):
        from vibroswarm.study.spec import Study

        study = Study.read(path)
        summary = {
            "study": study.hash,
            "cells": len(study.cells),
            "seed": study.seed,
            "varied": list(study.varied),
        }
        words = (
            f"{study.name or 'Study'}: {len(study.cells)} cells, seed {study.seed}, varied: "
            f"{', '.join(study.varied) or 'nothing'}. To run it: vibroswarm sweep {path} --out DIR"
        )
    elif _is_settings(tables):
        _show_settings(text, tables, arguments)
        return
    else:
        from vibroswarm.scenario.scenario import Scenario

        _show_scenario(Scenario.read(path), path, arguments)
        return
    if arguments.json:
        print_json(summary)
    else:
        print_paragraph(words)


def _cells_of_grid(path: Path) -> int:
    """Return the number of cells if a search file is read as a grid; 0 if it cannot be."""
    from vibroswarm.optimize.grid import Grid

    try:
        return len(Grid.read(path).study.cells)
    except InputError:  # some fields have bounds only, or there are several objectives
        return 0


def _is_settings(tables: dict[str, Any]) -> bool:
    """Return whether a file holds settings of strategies, as ``tune`` writes them.

    Such a file has one table for each strategy, in which all keys are dotted names of fields, such as
    ``"strategy.soft.eta"``.
    """
    return bool(tables) and all(
        isinstance(table, dict) and all("." in field for field in table) for table in tables.values()
    )


def _show_settings(text: str, tables: dict[str, Any], arguments: argparse.Namespace) -> None:
    """Print the settings of each strategy, after the file's first comment, which states how ``tune`` chose them.

    Args:
        text: the text of the file.
        tables: the parsed content of the file: for each strategy, the values of its fields.
    """
    if arguments.json:
        print_json(tables)
        return
    for line in text.splitlines():
        if not line.startswith("#"):
            break
        print_paragraph(line.lstrip("# "))
    print_table(
        ["strategy", "field", "value"],
        [[name, field, value] for name, table in tables.items() for field, value in table.items()],
        names=2,  # strategy and field name a row
    )
    if without := [name for name, table in tables.items() if not table]:
        print_paragraph(
            f"No fields set (as in the scenario, else the strategy's defaults): {', '.join(without)}"
        )


def _show_scenario(scenario: Scenario, path: Path, arguments: argparse.Namespace) -> None:
    """Print the fields of a scenario that differ from those of the preset ``paper``.

    A table inside a section, such as the parameters of a strategy, is compared and printed as a whole.
    """
    from vibroswarm.scenario.scenario import preset

    here, paper = scenario.model_dump(mode="json"), preset("paper").model_dump(mode="json")
    # For each field that differs, by dotted name: its value here and its value in the preset (None if the preset has no
    # such table). Every section is a dictionary.
    differing = {
        f"{section}.{name}": (value, paper[section].get(name))
        for section, fields in here.items()
        for name, value in fields.items()
        if value != paper[section].get(name)
    }
    if arguments.json:
        values = {name: value for name, (value, _) in differing.items()}
        print_json({"scenario": scenario.hash, "differs": values})
        return
    print_paragraph(f"Scenario {scenario.hash}. To run it: vibroswarm run --scenario {path}")
    if not differing:
        print_paragraph("Every field is as in preset paper.")
        return
    print_paragraph(f"{len(differing)} fields differ from preset paper:")
    rows = [[name, _short(value), _short(of_paper)] for name, (value, of_paper) in differing.items()]
    columns = ["field", "here", "paper"]
    print_table(columns, rows, texts=len(columns))  # all columns are text, because only text may be wrapped


def _short(value: Any) -> str:
    """Return a value as text, which is cut off after 200 characters and then ends with ``...``; ``-`` for None."""
    if value is None:
        return "-"
    text = " ".join(map(str, value)) if isinstance(value, list) else str(value)
    return text if len(text) <= 200 else f"{text[:200]} ..."


def _is_floor(path: Path) -> bool:
    """Return whether a file is a CSV file that holds a floor and not a table.

    The first line that is not a comment has the names of the columns in a table, and numbers in a floor.
    """
    if path.suffix != ".csv":
        return False
    with path.open("rb") as stream:
        begin = stream.read(10_000).decode("utf-8-sig", errors="replace")
    for line in begin.splitlines():
        if cells := line.partition("#")[0].replace(",", " ").replace(";", " ").split():
            return all(_is_number(cell) for cell in cells)
    return False


def _is_number(text: str) -> bool:
    """Return whether a text is a number."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def _show_floor(path: Path, arguments: argparse.Namespace) -> None:
    """Draw a floor from its file, and print its measures of difficulty."""
    import sys

    from vibroswarm.cli import terminal
    from vibroswarm.cli.floors import as_json, in_words
    from vibroswarm.floors.difficulty import measure
    from vibroswarm.floors.io import can_draw_blocks, draw, read_tiles

    tiles, name = read_tiles(path), path.name
    if arguments.json:
        print_json(as_json(name, measure(tiles)))
        return
    print_line(draw(tiles, blocks=can_draw_blocks(sys.stdout), width=terminal.width()))
    print_paragraph(in_words(measure(tiles)))


MOST_COLUMNS: Final = 10_000
"""Largest number of columns of a table in CSV."""
MOST_CSV: Final = 2**30
"""Size limit of a table in CSV, bytes."""


def _show_table(path: Path, arguments: argparse.Namespace) -> None:
    """Print a table: of a long one only the first rows, unless all are requested; the others are not formatted."""
    from vibroswarm.cli import terminal
    from vibroswarm.cli.output import MOST_ROWS

    table = _frame(path)
    if arguments.json or terminal.printing.wide or table.height <= MOST_ROWS:
        _print_frame(table, arguments)
        return
    _print_frame(table.head(MOST_ROWS), arguments)
    print_paragraph(f"... and {table.height - MOST_ROWS} more rows (--wide prints all).")


def _frame(path: Path) -> pl.DataFrame:
    """Read a table from a CSV or Parquet file.

    Raises:
        InputError: it cannot be read.
    """
    import io

    import polars as pl

    from vibroswarm.core.tables import read_frame
    from vibroswarm.core.untrusted_files import read_bytes

    if path.suffix != ".csv":
        return read_frame(path, path.stem)
    data = read_bytes(path, MOST_CSV, "a table")
    head = data.partition(b"\n")[0]
    if head.count(b",") >= MOST_COLUMNS:
        raise InputError(f"has more than {MOST_COLUMNS:,} columns; that is not a table", field=str(path))
    try:
        return pl.read_csv(io.BytesIO(data))
    except (pl.exceptions.PolarsError, OSError) as error:
        raise InputError(f"cannot be read: {_first_line(error)}", field=str(path)) from None
    except pl.exceptions.PanicException as error:  # a BaseException, so it is not caught above
        raise InputError(f"cannot be read: {str(error)[:80]}", field=str(path)) from None


def _first_line(error: Exception) -> str:
    """Return the first line of an error's message; the name of its type if the message is empty."""
    return (str(error).splitlines() or [type(error).__name__])[0]


def _print_frame(table: pl.DataFrame, arguments: argparse.Namespace) -> None:
    """Print a table, or with ``--json`` its rows; columns before the first one of numbers are aligned to the left."""
    if arguments.json:
        import polars as pl
        from polars.selectors import float as float_columns

        # JSON has no nan and no infinity: `when` without `otherwise` makes them null.
        finite = pl.when(float_columns().is_finite()).then(float_columns())
        print_json(table.with_columns(finite).to_dicts())
        return
    rows = [[_cell(value) for value in row] for row in table.iter_rows()]
    first_numeric = next((k for k, kind in enumerate(table.dtypes) if kind.is_numeric()), table.width)
    print_table(table.columns, rows, texts=first_numeric)


def _cell(value: Any) -> str:
    """Return a value of a table as text: floats with six significant digits, ``-`` for None and NaN."""
    if value is None or value != value:  # only NaN differs from itself
        return "-"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def show_tables(folder: Path, arguments: argparse.Namespace) -> None:
    """Print the names and sizes of the tables in a folder, and the names of its pictures and pages.

    ``show`` prints this for a folder that is no result, study or search and has no ``printed.json``.

    Raises:
        InputError: the folder has neither tables nor pictures.
    """
    tables = sorted(path for path in folder.iterdir() if path.suffix in TABLES)
    pictures = sorted(
        path.name for path in folder.iterdir() if path.suffix in (".png", ".svg", ".pdf", ".html")
    )
    if not tables and not pictures:
        raise InputError("holds nothing that a command of vibroswarm writes", field=str(folder))
    sizes = {path.name: _frame(path).shape for path in tables}
    if arguments.json:
        print_json({"tables": {name: list(size) for name, size in sizes.items()}, "pictures": pictures})
        return
    if sizes:
        rows = [[name, f"{height:,}", width] for name, (height, width) in sizes.items()]
        print_table(["table", "rows", "columns"], rows)
    if pictures:
        print_paragraph(f"Pictures and pages: {', '.join(pictures)}")
