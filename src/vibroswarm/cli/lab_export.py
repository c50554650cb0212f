"""``vibroswarm lab export``: write a result or a recording as a log or as CSV."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from vibroswarm.cli.options import whole


def add_parser(tasks: Any) -> None:
    """Add the task."""
    parser = tasks.add_parser(
        "export",
        help="write a result as a log of the robots or of the simulator, or as CSV",
        description="Write one run of a result (vibroswarm run --out) as a log, or all its tables as CSV.",
    )
    parser.add_argument("folder", metavar="DIR", type=Path, help="folder of a result or recording")
    parser.add_argument(
        "--format",
        metavar="NAME",
        choices=("rugbot", "webots", "csv"),
        default="rugbot",
        help="rugbot (default), webots or csv",
    )
    parser.add_argument(
        "--session", metavar="N", type=whole, default=1, help="run to write to a log, from 1 (default 1)"
    )
    parser.add_argument("--out", metavar="PATH", type=Path, required=True, help="file; for csv a folder")
    parser.add_argument("--force", action="store_true", help="replace PATH if it exists")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Read the result and write it."""
    from vibroswarm.recordings.export import WRITERS
    from vibroswarm.result import Result

    result = Result.read(arguments.folder)
    WRITERS[arguments.format](result, arguments.out, arguments.session - 1, replace=arguments.force)
    print(f"Saved: {arguments.out}")
    return 0
