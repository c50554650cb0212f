"""``vibroswarm merge``: join the shards of a study."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from vibroswarm.cli.studies import add_outcome_options, print_outcome


def add_parser(commands: Any) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "merge",
        help="join the shards of a study",
        description="Join folders made with --shard, and summarise the study.",
    )
    parser.add_argument("out", metavar="OUT", type=Path, help="new folder, or one of the same study")
    parser.add_argument("shares", metavar="SHARD", type=Path, nargs="+", help="folders of shards")
    parser.add_argument("--force", action="store_true", help="replace OUT if it holds something else")
    add_outcome_options(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Copy the shards and summarise the study."""
    from vibroswarm.cli.out_folder import claim
    from vibroswarm.cli.output import check_open
    from vibroswarm.study.store import Store
    from vibroswarm.study.study_result import StudyResult, merge

    check_open(arguments)
    first = Store.open(arguments.shares[0]).study
    claim(arguments, lambda: Store.existing(arguments.out, first))
    store = merge(arguments.out, arguments.shares)
    result = StudyResult(store.study, store, tuple(cell.number for cell in store.study.cells))
    return print_outcome(result, None, arguments)
