"""The documents of single files: a scenario, settings of strategies, a study, a search, a table; and of a folder."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import polars as pl

from vibroswarm.core.numbers import count, decimals_of, listed, number
from vibroswarm.scenario.scenario import Scenario, preset
from vibroswarm.show.document import Column, Document, Table, Text, if_any

if TYPE_CHECKING:  # to show a scenario takes neither
    from vibroswarm.search.spec import Search
    from vibroswarm.study.spec import Study

DIGITS: Final = 6
"""Significant digits of the numbers of a table whose meaning is not known."""
MOST_CHARACTERS: Final = 200
"""Most characters of a value of a field."""


def search_file_document(search: Search) -> Document:
    """Return what a file of a search holds."""
    names, method = list(search.space.names), search.settings.method_name
    return Document(
        title="Search",
        answer=(f"Search of {count(len(names), 'field')} by {method}: {listed(names)}.",),
        made_by={"search": search.hash, "method": method},
        data={"fields": pl.DataFrame({"field": names})},
    )


def study_file_document(study: Study, path: str) -> Document:
    """Return what a file of a study holds, and the command that runs it."""
    varied = listed(study.varied) if study.varied else "nothing"
    return Document(
        title=study.name or "Study",
        answer=(
            f"{study.name or 'Study'}: {count(len(study.cells), 'cell')}, seed {study.seed}, varied: {varied}.",
        ),
        parts=(Text(f"To run it: vibroswarm evaluate {shlex.quote(path)} --out DIR"),),
        made_by={"study": study.hash, "seed": str(study.seed), "cells": str(len(study.cells))},
        data={"varied": pl.DataFrame({"field": list(study.varied)}, schema={"field": pl.String})},
    )


def scenario_file_document(scenario: Scenario, path: str) -> Document:
    """Return the fields of a scenario that differ from those of the preset ``paper``.

    A table inside a section, such as the parameters of a strategy, is compared and shown as a whole.
    """
    here, paper = scenario.model_dump(mode="json"), preset("paper").model_dump(mode="json")
    # every section is a dictionary; the preset may have no such table
    rows = [
        (f"{section}.{name}", _short(value), _short(paper[section].get(name)))
        for section, fields in here.items()
        for name, value in fields.items()
        if value != paper[section].get(name)
    ]
    frame = pl.DataFrame(rows, schema=dict.fromkeys(("field", "here", "paper"), pl.String), orient="row")
    words = (
        f"{count(len(rows), 'field differs', 'fields differ')} from preset paper"
        if rows
        else "Every field is as in preset paper"
    )
    return Document(
        title=f"Scenario {path}",
        answer=(f"{words}.",),
        parts=(
            Text(f"To run it: vibroswarm run --scenario {shlex.quote(path)}"),
            *([Table(frame, name="fields")] if rows else []),
        ),
        made_by={"scenario": scenario.hash},
    )


def _short(value: Any) -> str:
    """Return a value as text, which is cut off after ``MOST_CHARACTERS`` and then ends with ``...``; ``-`` for None."""
    if value is None:
        return "-"
    text = " ".join(map(str, value)) if isinstance(value, list) else str(value)
    return text if len(text) <= MOST_CHARACTERS else f"{text[:MOST_CHARACTERS]} ..."


def table_document(frame: pl.DataFrame, name: str) -> Document:
    """Return a table of any file, with numbers of six significant digits."""
    columns, shown = {}, frame
    for column, kind in frame.schema.items():
        if kind.is_float():
            decimals = decimals_of(frame[column], DIGITS)
            if decimals is None:  # no number of decimals suits all
                words = [None if value is None else number(value, digits=DIGITS) for value in frame[column]]
                shown = shown.with_columns(pl.Series(column, words, pl.String))
            else:
                columns[column] = Column(decimals=decimals)
    size = f"{count(frame.height, 'row')}, {count(frame.width, 'column')}"
    return Document(
        title=name,
        answer=(f"{name}: {size}.",),
        parts=(Table(shown, columns, name="table", names=min(frame.width, 1)),),
        data={"table": frame},
    )


def folder_document(sizes: Mapping[str, tuple[int, int]], pictures: Sequence[str]) -> Document:
    """Return which tables, pictures and pages a folder holds.

    Args:
        sizes: rows and columns of each table.
    """
    rows = [(name, *size) for name, size in sizes.items()]
    frame = pl.DataFrame(
        rows, schema={"table": pl.String, "rows": pl.Int64, "columns": pl.Int64}, orient="row"
    )
    return Document(
        title="Folder",
        answer=(
            f"{count(len(sizes), 'table')}, {count(len(pictures), 'picture or page', 'pictures and pages')}.",
        ),
        parts=(
            *if_any(frame, lambda _: [Table(frame, name="tables")]),
            Text(f"Pictures and pages: {', '.join(pictures)}" if pictures else ""),
        ),
        data={"tables": frame, "pictures": pl.DataFrame({"file": pictures}, schema={"file": pl.String})},
    )
