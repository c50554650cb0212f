"""``vibroswarm lab export``: a result or a recording written as a log, or as CSV."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from vibroswarm.errors import InputError, nearest


def add_parser(tasks: Any) -> None:
    """Make the task known."""
    parser = tasks.add_parser(
        "export",
        help="a result written as a log of the robots or of the simulator, or as CSV",
        description="Write one run of a result (vibroswarm run --out) as a log, or all its tables as CSV.",
        allow_abbrev=False,
    )
    parser.add_argument("folder", metavar="DIR", type=Path, help="of a result or a recording")
    parser.add_argument("--format", metavar="NAME", default="rugbot", help="rugbot (default), webots or csv")
    parser.add_argument("--session", metavar="N", default="1", help="which run, from 1 (logs hold one)")
    parser.add_argument("--out", metavar="PATH", type=Path, required=True, help="a file; a folder for csv")
    parser.add_argument("--force", action="store_true", help="replace what is there")
    parser.set_defaults(run=run, parser=parser)


def run(arguments: argparse.Namespace) -> int:
    """Read, write."""
    from vibroswarm.cli.scenarios import whole_number
    from vibroswarm.lab.write import WRITERS
    from vibroswarm.result import Result

    if arguments.format not in WRITERS:
        raise InputError(
            f"there is no format '{arguments.format}'{nearest(arguments.format, WRITERS)} "
            f"(there are {', '.join(WRITERS)})",
            field="--format",
        )
    session = whole_number(arguments.session, "--session")
    result = Result.read(arguments.folder)
    WRITERS[arguments.format](result, arguments.out, session - 1, replace=arguments.force)
    print(f"Written: {arguments.out}")
    return 0
