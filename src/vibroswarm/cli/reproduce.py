"""``vibroswarm reproduce``: the paper's figures and tables, and a verdict on each of its claims."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vibroswarm.cli.options import add_out, add_pictures, add_workers, list_of, whole
from vibroswarm.cli.output import add_open
from vibroswarm.errors import InputError, nearest

if TYPE_CHECKING:
    from vibroswarm.paper.item import Settings

EPILOG = """\
examples:
  vibroswarm reproduce --out out/paper                          everything; run again to resume
  vibroswarm reproduce --only fill-ratios swarm-sizes --runs 200 --out out/some
  vibroswarm reproduce --out out/paper --archive paper.zip      one file to publish
"""
RECORDINGS = "VIBROSWARM_RUGBOT"
"""The environment variable with the folder of the recordings, used if ``--recordings`` is not given."""


def add_parser(commands: Any) -> None:
    """Add the command ``reproduce`` and its options to the program's commands."""
    parser = commands.add_parser(
        "reproduce",
        help="recompute the paper's figures and tables, with a verdict on each claim",
        description="Compute every figure and table of the paper, and report which of its claims hold.",
        epilog=EPILOG,
    )
    add_out(parser, "save report, tables and runs here, or resume", force=True)
    add_open(parser)
    parser.add_argument("--only", metavar="NAME", nargs="+", help="only these items; 'list' lists them")
    parser.add_argument("--runs", metavar="N", type=whole, default=1000, help="runs per cell (default 1000)")
    parser.add_argument("--seed", metavar="S", type=whole, default=1, help="seed of all cells (default 1)")
    parser.add_argument(
        "--columns", metavar="A,B", type=list_of(), help="only these presets: paper, text, calibrated"
    )
    add_workers(parser, "threads (default: all processors)")
    parser.add_argument(
        "--recordings",
        metavar="DIR",
        type=Path,
        help=f"the study's recordings, for the calibration (default: environment variable {RECORDINGS})",
    )
    parser.add_argument(
        "--control",
        metavar="NAME",
        help="negative control, under which verdicts must change: labels (swapped), threshold (1.55), "
        "false-positives, standstill, no-messages or losses",
    )
    parser.add_argument(
        "--archive", metavar="ZIP", type=Path, help="also write scenarios, seeds, versions and results to ZIP"
    )
    add_pictures(parser)
    # After Ctrl-C, the work saved in the folder --out can be resumed.
    parser.set_defaults(run=run, resumes="folder")


def run(arguments: argparse.Namespace) -> int:
    """Compute the requested figures and tables (items), write the report and print the verdicts; return the exit code.

    Items whose results are in the folder ``--out`` already are not computed again. With ``--only list``, the items are
    listed instead.
    """
    from vibroswarm.cli.deliver import deliver, save_requested_pictures
    from vibroswarm.cli.out_folder import claim
    from vibroswarm.cli.output import check_open
    from vibroswarm.cli.progress import labelled_progress_bar, progress_bar
    from vibroswarm.core.atomic_io import folder_lock
    from vibroswarm.documents.reproduction import reproduction_document
    from vibroswarm.paper.archive import write_archive
    from vibroswarm.paper.items import all_items, items_named
    from vibroswarm.paper.reproduce import reproduce
    from vibroswarm.paper.reproduction_tables import TABLES, write_tables
    from vibroswarm.show.document import without_pictures

    if arguments.only == ["list"]:
        for item in all_items():
            print(f"{item.name:<16} {item.title}")
        return 0
    if arguments.out is None:
        raise InputError("is required", field="--out")
    items, settings = items_named(arguments.only), settings_of(arguments)
    check_open(arguments)
    claim(arguments, lambda folder: _refuse_other(folder, arguments.archive))
    try:
        arguments.out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot be created: {error.strerror}", field=str(arguments.out)) from None
    with folder_lock(arguments.out):
        with labelled_progress_bar(f"reproducing {len(items)} items") as progress:
            # An archive holds the cells of all items, also of those whose results are in the folder already.
            reproduction = reproduce(
                settings, arguments.out, items, progress, with_cells=arguments.archive is not None
            )
        write_tables(reproduction, arguments.out / TABLES)
        document = reproduction_document(reproduction)
        with progress_bar("drawing") as progress_of_drawing:
            save_requested_pictures(document, arguments, arguments.out, progress_of_drawing)
        if arguments.no_pictures:
            document = without_pictures(document)
        if arguments.archive is not None:
            write_archive(reproduction, arguments.archive)
        pictures = "pictures, " if arguments.pictures else ""
        deliver(document, arguments, "reproduce", f"tables, {pictures}the runs and a report")
    return 0


PARTS = ("items", "runs", "pictures", "tables", "report.html", "printed.json", ".lock")
"""Names of the files and folders that the folder of a reproduction may hold."""


def _refuse_other(folder: Path, archive: Path | None) -> None:
    """Refuse a file, and a folder that holds anything but the parts of a reproduction, its archive and hidden files.

    A reproduction with other settings is accepted: ``reproduce`` recomputes the items that depend on a changed setting.

    Raises:
        InputError: the folder is refused.
    """
    if not folder.is_dir():
        raise InputError("is a file; give the name of a folder", field=str(folder))
    own = None if archive is None else archive.absolute()
    other = [
        path.name
        for path in folder.iterdir()
        if path.name not in PARTS and path.name[0] != "." and path.absolute() != own
    ]
    if other:
        raise InputError(f"exists but is not a reproduction: it holds '{other[0]}'", field=str(folder))


def settings_of(arguments: argparse.Namespace) -> Settings:
    """Return the settings of a reproduction that the options give.

    If ``--recordings`` is not given, the environment variable ``RECORDINGS`` names their folder, unless it is empty.

    Raises:
        InputError: a column or control is unknown, or the number of runs is out of range.
    """
    from vibroswarm.paper.columns import COLUMNS, CONTROLS
    from vibroswarm.paper.item import Settings
    from vibroswarm.study.spec import MOST_RUNS

    columns = arguments.columns or COLUMNS
    for column in columns:
        if column not in COLUMNS:
            raise InputError(f"unknown column '{column}'{nearest(column, COLUMNS)}", field="--columns")
    if arguments.control is not None and arguments.control not in CONTROLS:
        raise InputError(
            f"unknown control '{arguments.control}' (known: {', '.join(CONTROLS)})", field="--control"
        )
    if not 2 <= arguments.runs <= MOST_RUNS:  # a confidence interval over runs needs two
        raise InputError(f"{arguments.runs} is not from 2 to {MOST_RUNS}", field="--runs")
    recordings = arguments.recordings
    if recordings is None and os.environ.get(RECORDINGS):
        recordings = Path(os.environ[RECORDINGS])
    return Settings(
        runs=arguments.runs,
        seed=arguments.seed,
        columns=tuple(column for column in COLUMNS if column in columns),  # in the order of the report
        control=arguments.control,
        recordings=recordings,
        workers=arguments.workers,
    )
