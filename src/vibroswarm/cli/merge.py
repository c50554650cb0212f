"""``vibroswarm merge``: join the shards of a study."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from vibroswarm.cli.study_options import add_outcome_options, print_outcome


def add_parser(commands: Any) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "merge",
        help="join the shards of a study",
        description="Join folders made with --shard, and summarise the study.",
    )
    parser.add_argument("out", metavar="OUT", type=Path, help="new folder, or one of the same study")
    parser.add_argument("shares", metavar="SHARD", type=Path, nargs="+", help="folders of shards")
    add_outcome_options(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Copy the shards and summarise the study."""
    from vibroswarm.study.study_result import StudyResult, merge

    store = merge(arguments.out, arguments.shares)
    result = StudyResult(store.study, store, tuple(cell.number for cell in store.study.cells))
    return print_outcome(result, None, arguments)
