"""``vibroswarm reproduce``: the paper's figures and tables, and a verdict on each of its claims."""

from __future__ import annotations

import argparse
import os
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vibroswarm.errors import InputError, RunError, nearest

if TYPE_CHECKING:
    from vibroswarm.paper.item import Item, Settings
    from vibroswarm.paper.reproduce import Reproduction

EPILOG = """\
examples:
  vibroswarm reproduce --out out/paper                          all of it; again: what is there is taken
  vibroswarm reproduce --only fill-ratios swarm-sizes --runs 200 --out out/some
  vibroswarm reproduce --out out/paper --archive paper.zip      to be confirmed elsewhere
  vibroswarm reproduce --from paper.zip --check
"""
RECORDINGS = "VIBROSWARM_RUGBOT"


def add_parser(commands: Any) -> None:
    """Make the command known."""
    parser = commands.add_parser(
        "reproduce",
        help="the paper's figures and tables anew, with a verdict on each claim",
        description="Compute every figure and table of the paper, and say which of its claims hold.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("--out", metavar="DIR", type=Path, help="keep report, figures, tables and runs here")
    parser.add_argument("--only", metavar="NAME", nargs="+", help="only these items; 'list' names them")
    parser.add_argument("--runs", metavar="N", default="1000", help="runs a cell (default 1000)")
    parser.add_argument("--seed", metavar="S", default="1", help="of all cells (default 1)")
    parser.add_argument("--columns", metavar="A,B", help="only these presets: paper, text, calibrated")
    parser.add_argument("--workers", metavar="N", help="threads (default: all processors)")
    parser.add_argument(
        "--recordings", metavar="DIR", type=Path,
        help=f"the study's recordings, for the calibration (default: {RECORDINGS} of the environment)",
    )  # fmt: skip
    parser.add_argument(
        "--control", metavar="NAME",
        help="a negative control, in which verdicts must turn: labels (swapped), threshold (1.55), false-positives, "
        "standstill, no-messages or losses",
    )  # fmt: skip
    parser.add_argument(
        "--archive", metavar="ZIP", type=Path, help="also write scenarios, seeds, versions and results here"
    )
    parser.add_argument("--from", metavar="ZIP", type=Path, dest="archived", help="an archive, for --check")
    parser.add_argument(
        "--check", metavar="N", nargs="?", const="8",
        help="compute N cells of the archive again (default 8) and say whether it is confirmed",
    )  # fmt: skip
    parser.add_argument("--no-pictures", action="store_true", help="tables and verdicts only")
    parser.set_defaults(run=run, parser=parser)


def run(arguments: argparse.Namespace) -> int:
    """Compute what is missing, write the report, say the verdicts."""
    from vibroswarm.cli.progress import progress_bar, reproduce_progress
    from vibroswarm.folder_lock import folder_lock
    from vibroswarm.paper.archive import write_archive
    from vibroswarm.paper.items import all_items
    from vibroswarm.paper.report import REPORT, write_all
    from vibroswarm.paper.reproduce import reproduce

    if arguments.only == ["list"]:
        for item in all_items():
            print(f"{item.name:<16} {item.title}")
        return 0
    if (arguments.archived is None) != (arguments.check is None):
        raise InputError("--from names an archive, and --check checks it: say both", field="--from")
    if arguments.archived is not None:
        return check(arguments)
    if arguments.out is None:
        raise InputError("is needed: where shall it be kept?", field="--out")
    items, settings = _items(arguments), settings_of(arguments)
    try:
        arguments.out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot be made: {error.strerror}", field=str(arguments.out)) from None
    with folder_lock(arguments.out):
        with reproduce_progress(len(items)) as tell:
            made = reproduce(settings, arguments.out, items, tell, again=arguments.archive is not None)
        with progress_bar("drawing") as draws:
            write_all(made, arguments.out, draws, pictures=not arguments.no_pictures)
    if arguments.archive is not None:
        write_archive(made, arguments.archive)
    _say(made)
    print(f"Kept in {arguments.out}; open {(arguments.out / REPORT).resolve()} in a browser.")
    return 0


def check(arguments: argparse.Namespace) -> int:
    """Confirm an archive, or say what differs."""
    from vibroswarm.cli.progress import progress_bar
    from vibroswarm.cli.scenarios import whole_number
    from vibroswarm.paper.confirm import confirm

    count = whole_number(arguments.check, "--check")
    if count < 1:
        raise InputError(f"{count} is too few; at least 1", field="--check")
    workers = None if arguments.workers is None else whole_number(arguments.workers, "--workers")
    with progress_bar("checking") as tell:
        found = confirm(arguments.archived, count, workers, tell)
    for command in found.checked:
        print(f"computed again: {command}")
    reason = f", since versions differ ({found.why})" if found.why else ", with the same versions"
    if found.wrong:
        for words in found.wrong:
            print(f"DIFFERS: {words}")
        raise RunError(f"the archive is not confirmed; it was compared {found.how}{reason}")
    print(f"Confirmed {found.how}{reason}: {len(found.checked)} cells computed again.")
    return 0


def _items(arguments: argparse.Namespace) -> tuple[Item, ...]:
    from vibroswarm.paper.items import items_named

    return items_named(arguments.only)


def settings_of(arguments: argparse.Namespace) -> Settings:
    """What the options ask for."""
    from vibroswarm.cli.scenarios import whole_number
    from vibroswarm.paper.columns import COLUMNS, CONTROLS
    from vibroswarm.paper.item import Settings
    from vibroswarm.study.spec import MOST_RUNS

    columns = COLUMNS if arguments.columns is None else tuple(arguments.columns.split(","))
    for column in columns:
        if column not in COLUMNS:
            raise InputError(f"there is no column '{column}'{nearest(column, COLUMNS)}", field="--columns")
    if arguments.control is not None and arguments.control not in CONTROLS:
        raise InputError(
            f"there is no control '{arguments.control}' ({', '.join(CONTROLS)})", field="--control"
        )
    runs = whole_number(arguments.runs, "--runs")
    if not 2 <= runs <= MOST_RUNS:
        raise InputError(f"{runs} is wrong; give a whole number from 2", field="--runs")
    recordings = arguments.recordings
    if recordings is None and os.environ.get(RECORDINGS):
        recordings = Path(os.environ[RECORDINGS])
    return Settings(
        runs=runs,
        seed=whole_number(arguments.seed, "--seed"),
        columns=tuple(column for column in COLUMNS if column in columns),
        control=arguments.control,
        recordings=recordings,
        workers=None if arguments.workers is None else whole_number(arguments.workers, "--workers"),
    )


def _say(made: Reproduction) -> None:
    from vibroswarm.paper.claims import CHECKED, VERDICTS
    from vibroswarm.paper.report import claims_table

    decided = made.decided
    for one in made.made:
        if one.skipped:
            print(f"{one.item.name}: skipped. {one.skipped}")
    table = claims_table(decided)
    columns = [
        column
        for column in made.settings.columns
        if table.height and table[column].null_count() < table.height
    ]
    widths = {column: max(len(words) for words in table[column].fill_null("-")) for column in columns}
    for row in table.to_dicts():
        told = (f"{column}: {row[column] or '-':<{widths[column]}}" for column in columns)
        print(f"{row['claim']:<26}" + "  ".join(told).rstrip())
    for column in columns:
        for kind, words in (("claim", VERDICTS), ("check", tuple(dict.fromkeys(CHECKED.values())))):
            mine = (one for one in decided if one.column == column and one.claim.kind == kind)
            counted = Counter(one.verdict for one in mine)
            counts = [f"{counted[word]} {word}" for word in words if counted[word]]
            if counts:
                print(f"{column}, {kind}s: {', '.join(counts)}")
