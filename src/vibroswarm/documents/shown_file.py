"""The documents of a file or folder: a scenario, settings of strategies, study, search, floor, table or result."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import polars as pl

from vibroswarm.core.folders import check_files, kind_of, read_manifest
from vibroswarm.core.tables import MAX_BYTES, read_frame
from vibroswarm.core.untrusted_files import check_plain, parsed_toml, read_bytes, read_text
from vibroswarm.documents.saved import PRINTED, Shown, read_printed
from vibroswarm.errors import InputError, shown
from vibroswarm.show.document import Document

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

TABLES: Final = (".csv", ".parquet")
"""Suffixes of files that hold a table; a .csv file may also hold a floor."""
FLOORS: Final = (".txt", ".png", ".jpg", ".jpeg")
"""Suffixes of files that hold a floor."""


def file_document(path: Path, draw: Callable[[NDArray[np.uint8]], str]) -> Document:
    """Return what a file holds; the kind of file is detected by its suffix and its content.

    Args:
        draw: draws the tiles of a floor as text.
    Raises:
        InputError: the file cannot be read, its suffix is not known, or its content is wrong.
    """
    check_plain(path, MAX_BYTES, "a file of vibroswarm")
    if path.suffix == ".toml":
        return _toml_document(path)
    if path.suffix in TABLES and not _is_floor(path):
        from vibroswarm.documents.file import table_document

        return table_document(_frame(path), path.name)
    if path.suffix in (*FLOORS, ".csv"):
        from vibroswarm.documents.floor import floor_document
        from vibroswarm.floors.floor import Floor
        from vibroswarm.floors.io import read_tiles

        tiles = read_tiles(path)
        return floor_document(Floor.filling(tiles, name=path.name), draw(tiles))
    raise InputError(
        "is neither a folder nor a file that vibroswarm shows (.toml, .csv, .parquet, .txt, .png, .jpg)",
        field=str(path),
    )


def _toml_document(path: Path) -> Document:
    """Return what a TOML file describes: a search, a study or a scenario.

    A search and a study are detected by the names of their entries; any other file is read as a scenario.
    """
    from vibroswarm.documents import file

    text = read_text(path, "a file in TOML")
    tables = parsed_toml(text, str(path))
    if {"space", "objective", "search"} & set(tables):  # entries of files for `optimize` only
        from vibroswarm.search.spec import Search

        return file.search_file_document(Search.read(path))
    # entries that no scenario has; a search may have some of them, so it is detected first
    if {"grid", "zip", "list", "random", "sobol", "runs", "until"} & set(tables):
        from vibroswarm.study.spec import Study

        return file.study_file_document(Study.read(path), str(path))
    from vibroswarm.scenario.scenario import Scenario

    return file.scenario_file_document(Scenario.read(path), str(path))


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
    try:
        float(text)
    except ValueError:
        return False
    return True


MOST_COLUMNS: Final = 10_000
"""Largest number of columns of a table in CSV."""
MOST_CSV: Final = 2**30
"""Size limit of a table in CSV, bytes."""


def _frame(path: Path) -> pl.DataFrame:
    """Read a table from a CSV or Parquet file.

    Raises:
        InputError: it cannot be read.
    """
    if path.suffix != ".csv":
        return read_frame(path, path.stem)
    check_plain(path, MOST_CSV, "a table")
    with path.open("rb") as stream:
        if b"\0" in stream.read(10_000):  # before all of it is read
            raise InputError("is binary or UTF-16; give a CSV in UTF-8", field=str(path))
    data = read_bytes(path, MOST_CSV, "a table")
    head = data.partition(b"\n")[0]
    if head.count(b",") >= MOST_COLUMNS:
        raise InputError(f"has more than {MOST_COLUMNS:,} columns; that is not a table", field=str(path))
    try:
        return pl.read_csv(io.BytesIO(data))
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException, OSError) as error:
        first_line = next(iter(str(error).splitlines()), type(error).__name__)
        raise InputError(f"cannot be read: {first_line}", field=str(path)) from None


def shown_folder(folder: Path) -> Shown:
    """Return what a folder holds: the state of a study or search, and the results.

    Results are those that the command saved. If there are none, or they are damaged, a study is summarised again, and
    runs, recordings and tables are described.

    Raises:
        InputError: the folder holds a damaged search, or nothing that a command writes.
    """
    printed, damaged = None, None
    try:
        printed = read_printed(folder)
    except InputError as error:
        damaged = error
    try:
        found = _of_kind(folder, kind_of(folder), printed)
    except InputError as error:  # there is nothing else
        raise damaged or error from None
    if damaged is not None:
        first, *rest = found.documents
        first = replace(first, warnings=(f"damaged, not used: {damaged}", *first.warnings))
        return found._replace(documents=(first, *rest))
    return found


def _of_kind(folder: Path, kind: str | None, printed: Shown | None) -> Shown:
    """Return what a folder of a kind holds; ``printed``: what its command has saved."""
    saved = printed or Shown()
    if kind == "search":
        from vibroswarm.documents.search import search_state_document
        from vibroswarm.search.steps import held

        about = held(folder)
        state = search_state_document(about, is_validated=printed is not None)
        return saved._replace(documents=(state, *saved.documents), state=about)
    if kind == "study":
        from vibroswarm.documents.study_folder import results_or_need, state_document, study_state
        from vibroswarm.study.spec import Study

        study, runs = Study.open(folder)
        about, needed = study_state(study, runs), ""
        if printed is None:
            results, needed = results_or_need(runs)
            saved = Shown(() if results is None else (results,))
        about |= {"results_need": needed} if needed else {}
        return saved._replace(documents=(state_document(about, needed), *saved.documents), state=about)
    if printed is not None and kind == "recording":
        check_files(read_manifest(folder), folder)
    return printed or Shown((_result_document(folder, kind),))


def _result_document(folder: Path, kind: str | None) -> Document:
    """Return the document of a result or recording; of any other folder, the names of its tables and pictures."""
    if kind == "results" and not any(
        path.suffix in TABLES or path.name == PRINTED for path in folder.iterdir()
    ):
        command = read_manifest(folder)["command"]
        again = f"Not finished. Run the same {shown(f'vibroswarm {command}')} command again."
        return Document(title=str(folder), answer=(again,))
    if kind not in ("result", "recording"):
        return tables_document(folder)
    from vibroswarm.documents.run import result_document
    from vibroswarm.recordings.recording import read_result

    return result_document(read_result(folder))


def tables_document(folder: Path) -> Document:
    """Return the names and sizes of the tables in a folder, and the names of its pictures and pages.

    ``vibroswarm show`` prints this for a folder that is no result, study or search and has no ``printed.json``.

    Raises:
        InputError: the folder has neither tables nor pictures.
    """
    from vibroswarm.documents.file import folder_document

    tables = sorted(path for path in folder.iterdir() if path.suffix in TABLES)
    pictures = sorted(
        path.name for path in folder.iterdir() if path.suffix in (".png", ".svg", ".pdf", ".html")
    )
    if not tables and not pictures:
        raise InputError("holds nothing that a command of vibroswarm writes", field=str(folder))
    sizes = {path.name: _frame(path).shape for path in tables}
    return folder_document(sizes, pictures)
