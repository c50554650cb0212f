"""Files that commands have written, for ``vibroswarm show``: scenarios, settings, studies, searches, floors, tables."""

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
FLOORS: Final = (".txt", ".png")


def show_file(path: Path, arguments: argparse.Namespace) -> None:
    """Print what a file holds, found by its ending and its content.

    Raises:
        InputError: there is no such file, or no command writes such a file.
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
    elif path.suffix == ".zip":
        _show_archive(path, arguments)
    else:
        raise InputError(
            "is neither a folder nor a file that vibroswarm shows (.toml, .csv, .parquet, .txt, .png, .zip)",
            field=str(path),
        )


def _show_toml(path: Path, arguments: argparse.Namespace) -> None:
    """Print a scenario, the settings of strategies, a study or a search."""
    from vibroswarm.core.untrusted_files import parsed_toml, read_text

    text = read_text(path, "a file in TOML")
    tables = parsed_toml(text, str(path))
    what: dict[str, Any]
    if {"space", "objective", "search"} & set(tables):
        from vibroswarm.optimize.spec import Search

        search = Search.read(path)
        what = {"search": search.hash, "method": search.settings.method, "fields": list(search.space.names)}
        words = f"Search of {search.space.size} fields by {search.settings.method}: {', '.join(search.space.names)}."
    elif {"grid", "zip", "list", "random", "sobol", "runs", "until"} & set(tables):
        from vibroswarm.study.spec import Study

        study = Study.read(path)
        what = {
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
        print_json(what)
    else:
        print_paragraph(words)


def _is_settings(tables: dict[str, Any]) -> bool:
    """Return whether these are settings of strategies, as ``tune`` writes them: dotted fields by strategy."""
    return bool(tables) and all(
        isinstance(table, dict) and all("." in field for field in table) for table in tables.values()
    )


def _show_settings(text: str, tables: dict[str, Any], arguments: argparse.Namespace) -> None:
    """Print the settings of each strategy, after the comment that says how they were found."""
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
        names=2,
    )
    if without := [name for name, table in tables.items() if not table]:
        print_paragraph(f"As the scenario has them, and by default: {', '.join(without)}")


def _show_scenario(scenario: Scenario, path: Path, arguments: argparse.Namespace) -> None:
    """Print the fields of a scenario that differ from preset paper."""
    from vibroswarm.scenario.scenario import preset

    here, paper = scenario.model_dump(mode="json"), preset("paper").model_dump(mode="json")
    differing = {
        f"{section}.{name}": (value, paper.get(section, {}).get(name))
        for section, fields in here.items()
        if isinstance(fields, dict)
        for name, value in fields.items()
        if value != paper.get(section, {}).get(name)
    }
    if arguments.json:
        print_json(
            {"scenario": scenario.hash, "differs": {name: now for name, (now, _) in differing.items()}}
        )
        return
    print_paragraph(f"Scenario {scenario.hash}. To run it: vibroswarm run --scenario {path}")
    if not differing:
        print_paragraph("Every field is as in preset paper.")
        return
    print_paragraph(f"{len(differing)} fields differ from preset paper:")
    rows = [[name, _short(now), _short(then)] for name, (now, then) in differing.items()]
    print_table(["field", "here", "paper"], rows, texts=3)


def _short(value: Any) -> str:
    """Return a value as text, cut if it is a long list."""
    if value is None:
        return "-"
    text = " ".join(map(str, value)) if isinstance(value, list) else str(value)
    return text if len(text) <= 200 else f"{text[:200]} ..."


def _is_floor(path: Path) -> bool:
    """Return whether a CSV file holds a grid of tiles rather than a table with named columns."""
    if path.suffix != ".csv":
        return False
    with path.open("rb") as stream:
        first = stream.readline(10_000)
    return not any(chr(byte).isalpha() for byte in first)


def _show_floor(path: Path, arguments: argparse.Namespace) -> None:
    """Draw a floor, and print how difficult it is."""
    import sys

    from vibroswarm.cli import terminal
    from vibroswarm.cli.floors import as_json, in_words
    from vibroswarm.floors.difficulty import measure
    from vibroswarm.floors.io import can_draw_blocks, draw
    from vibroswarm.floors.source import resolve

    tiles, name = resolve(str(path), None, 0)
    if arguments.json:
        print_json(as_json(name, measure(tiles)))
        return
    print_line(draw(tiles, blocks=can_draw_blocks(sys.stdout), width=terminal.width()))
    print_paragraph(in_words(measure(tiles)))


def _show_archive(path: Path, arguments: argparse.Namespace) -> None:
    """Print the verdicts in an archive of a reproduction."""
    import io

    import polars as pl

    from vibroswarm.paper.archive import Zipped

    with Zipped(path) as archive:
        claims = pl.read_csv(io.BytesIO(archive.read("claims.csv")))
    _print_frame(claims, arguments)
    if not arguments.json:
        print_paragraph(f"To check it: vibroswarm reproduce --from {path} --check")


def _show_table(path: Path, arguments: argparse.Namespace) -> None:
    """Print a table."""
    _print_frame(_frame(path), arguments)


def _frame(path: Path) -> pl.DataFrame:
    import polars as pl

    try:
        return pl.read_csv(path) if path.suffix == ".csv" else pl.read_parquet(path)
    except (pl.exceptions.PolarsError, OSError) as error:
        raise InputError(f"cannot be read: {str(error).splitlines()[0]}", field=str(path)) from None


def _print_frame(table: pl.DataFrame, arguments: argparse.Namespace) -> None:
    if arguments.json:
        print_json(table.fill_nan(None).to_dicts())
        return
    rows = [[_cell(value) for value in row] for row in table.iter_rows()]
    texts = next((k for k, kind in enumerate(table.dtypes) if kind.is_numeric()), table.width)
    print_table(table.columns, rows, texts=texts)


def _cell(value: Any) -> str:
    """Return a value of a table as text: fractions to six significant digits, ``-`` for a missing value."""
    if value is None or value != value:
        return "-"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def show_tables(folder: Path, arguments: argparse.Namespace) -> None:
    """Print which tables and pictures a folder holds that has nothing else.

    Raises:
        InputError: it has none.
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
