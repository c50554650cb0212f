"""The figures of a document as files: SVG, PDF, PNG and CSV of each, and a table of captions."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Final

import polars as pl

from vibroswarm.core.atomic_io import whole_folder
from vibroswarm.core.tables import csv_bytes
from vibroswarm.show.document import Document

CAPTIONS: Final = "captions.csv"
"""A folder of figures that contains this file was written here, and may be replaced."""


def remove_figures(folder: Path) -> None:
    """Remove a folder of figures, if one is there."""
    if (folder / CAPTIONS).is_file():
        shutil.rmtree(folder)


def write_figures(
    folder: Path, document: Document, style: str, progress: Callable[[float], None] = lambda share: None
) -> None:
    """Write the figures of a document into a folder, which is replaced as a whole.

    Args:
        style: one of ``vibroswarm.plots.style``. progress: called with the share of figures done.
    Raises:
        InputError: there is no such style, or the folder cannot be written.
        RunError: the disk is full or failed.
    """
    figures = document.figures.values()
    with whole_folder(folder, replace=True, marker=CAPTIONS) as part:
        rows = []
        for place, figure in enumerate(figures, start=1):
            drawn = figure.draw(style)
            drawn.write(part / figure.name)
            rows.append((figure.name, figure.title, drawn.caption))
            progress(place / len(figures))
        captions = pl.DataFrame(rows, schema=["name", "title", "caption"], orient="row")
        (part / CAPTIONS).write_bytes(csv_bytes(captions))
