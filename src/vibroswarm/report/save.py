"""Save a report: its page, its tables as CSV and Parquet, its pictures, and all but pictures as JSON."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any, Final

import polars as pl

from vibroswarm.core.atomic_io import make_folder, write_file
from vibroswarm.core.tables import csv_bytes, parquet_bytes
from vibroswarm.report.report import Report, Table

PAGE: Final = "report.html"
"""Name of the page in a folder of results."""
PICTURES: Final = "pictures"
"""Name of the folder of pictures in a folder of results."""

DATA: Final = "report.json"
"""Name of the file with what a report says; it is written last."""
LAYOUT: Final = ("title", "caption", "titles", "folded")
TEXTS: Final = ("title", "answer", "setting", "warnings", "made_by")


def data(report: Report) -> dict[str, Any]:
    """Return a report for JSON, its tables row by row; numbers that are not finite are None."""
    tables = {name: table.frame.to_dicts() for name, table in report.tables.items()}
    layouts = {
        name: {field: getattr(table, field) for field in LAYOUT} for name, table in report.tables.items()
    }
    texts = {name: getattr(report, name) for name in TEXTS}
    return _finite({**texts, "tables": tables, "layouts": layouts})  # type: ignore[no-any-return]


def read(path: Path) -> Report:
    """Read a report without its pictures from the file ``DATA``."""
    values = json.loads(path.read_text(encoding="utf-8"))
    texts = {name: tuple(values[name]) for name in ("answer", "warnings")}
    folder = path.parent
    parts = {
        name: Table(_frame(folder / f"{name}.parquet", rows), **values["layouts"][name])
        for name, rows in values["tables"].items()
    }
    return Report(values["title"], parts=parts, setting=values["setting"], made_by=values["made_by"], **texts)


def save(report: Report, folder: Path, *, page: bool = True, tables: bool = True) -> None:
    """Write a report into a folder; what is there of the same report is not drawn again."""
    make_folder(folder)
    text = json.dumps(data(report), indent=1, allow_nan=False)
    path = folder / DATA
    is_there = path.is_file() and path.read_text(encoding="utf-8") == text
    if page and not (is_there and (folder / PAGE).is_file()):
        from vibroswarm.report.page import page as page_of

        write_file(folder / PAGE, page_of(report))
    if not is_there:
        for name, table in report.tables.items() if tables else ():
            save_table(table.frame, folder / name)
        write_file(path, text)


def save_table(frame: pl.DataFrame, path: Path) -> None:
    """Write a table as CSV and Parquet, beside each other."""
    write_file(path.with_name(f"{path.name}.csv"), csv_bytes(frame))
    write_file(path.with_name(f"{path.name}.parquet"), parquet_bytes(frame))


def save_pictures(report: Report, folder: Path) -> None:
    """Write each picture as SVG, PDF, PNG and CSV, as soon as it is drawn."""
    make_folder(folder / PICTURES)
    for name, figure in report.figures.items():
        figure.picture.write(folder / PICTURES / name)


def _frame(path: Path, rows: list[dict[str, Any]]) -> pl.DataFrame:
    is_ours = path.with_suffix(".csv").is_file()  # a result has tables of the same names, as Parquet alone
    return pl.read_parquet(path) if is_ours else pl.DataFrame(rows, infer_schema_length=None)


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
