"""Where a result goes: its report to the terminal, or as JSON to stdout, and into the folder of ``--out``.

| the folder of ``--out`` | what happens |
|---|---|
| is missing, or holds no results | it is used |
| was begun by the same command with the same settings | it is continued |
| was begun by another one | it is refused; ``--force`` removes all but finished runs of studies |
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from vibroswarm.cli import terminal
from vibroswarm.cli.options import Paged
from vibroswarm.core.atomic_io import make_folder, write_file
from vibroswarm.errors import InputError

if TYPE_CHECKING:
    from polars import DataFrame

BEGUN: Final = "command.json"
"""The file that says which command has begun a folder, with which settings."""
RUNS: Final = "runs"
"""The folder of runs, whose files are named by what they hold, so that any study can use them."""


def claim(output: Any, command: str, *settings: object) -> None:
    """Make the folder of ``--out`` this command's, or refuse it before the work begins."""
    folder: Path | None = output.out
    if folder is None:
        return
    digest = hashlib.sha256(repr(settings).encode()).hexdigest()[:16]
    begun, text = folder / BEGUN, json.dumps({"command": command, "settings": digest})
    others = [path for path in folder.iterdir() if path.name not in (RUNS, BEGUN)] if folder.exists() else []
    if others and not begun.is_file():
        raise InputError("holds something else; give another --out", field=str(folder))
    if others and begun.read_text(encoding="utf-8") != text:
        if not output.force:
            raise InputError(
                "holds results of another command or other settings; give another --out, or add --force to replace "
                "them",
                field=str(folder),
            )
        for path in others:
            remove = shutil.rmtree if path.is_dir() else Path.unlink
            remove(path)
    make_folder(folder)
    write_file(begun, text)


def deliver(
    result: object,
    output: Paged,
    tables: Mapping[str, DataFrame] | None = None,
    page: str = "report.html",
    *,
    is_result: bool = False,
    **options: Any,
) -> None:
    """Print the report of a result; save it and tables in the folder of ``--out``, which is claimed already."""
    from vibroswarm.report.report import report

    said = report(result, **options)
    try:
        print_report(said, as_json=output.json)
    finally:  # also if the reader, such as `head`, has enough
        if output.out is not None:
            _save(said, output.out, output, tables or {}, page, is_result)
    if output.out is None:
        terminal.report("Not saved; add --out DIR to save tables, the data behind them, and a page")
        return
    terminal.report(f"Saved in {output.out}; page: {page}")
    if output.open:
        open_page(output.out / page)


def _save(
    report: Any, folder: Path, output: Paged, tables: Mapping[str, DataFrame], page: str, is_result: bool
) -> None:
    from vibroswarm.report.save import save, save_pictures, save_table

    for name, table in tables.items():
        save_table(table, folder / name)
    draws = page == "report.html" and not getattr(output, "no_pictures", False)
    save(report, folder, page=draws, tables=not is_result)
    if getattr(output, "pictures", False):
        save_pictures(report, folder)


def open_page(page: Path) -> None:
    """Open a page in the browser."""
    import webbrowser  # here, as other imports that help need not wait for

    webbrowser.open(page.absolute().as_uri())


def print_report(result: object, *, as_json: bool = False, **options: Any) -> None:
    """Print the report of a result as wide as the terminal, or as JSON."""
    from vibroswarm.report.report import report
    from vibroswarm.report.save import data
    from vibroswarm.report.terminal import show

    said = report(result, **options)
    if as_json:
        print(json.dumps(data(said), indent=1))
    else:
        show(said, terminal.console())


def print_saved_file(path: Path | None, note: str = "", *, as_json: bool = False) -> None:
    """Print where a file was written, if it was, unless stdout holds JSON."""
    if path is not None and not as_json:
        print(terminal.plain(f"Saved: {path}{f' ({note})' if note else ''}"))
