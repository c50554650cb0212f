"""``vibroswarm merge``: the shares of a study, done here and there, as one."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from vibroswarm.cli.studies import add_outcome_options, check_style, say_outcome


def add_parser(commands: Any) -> None:
    """Make the command known."""
    parser = commands.add_parser(
        "merge",
        help="join the shares of a study",
        description="Join what was done with --shard in several folders, and sum it up.",
        allow_abbrev=False,
    )
    parser.add_argument("out", metavar="OUT", type=Path, help="a new folder, or one of the same study")
    parser.add_argument("shares", metavar="SHARE", type=Path, nargs="+", help="folders of shares")
    add_outcome_options(parser)
    parser.set_defaults(run=run, parser=parser)


def run(arguments: argparse.Namespace) -> int:
    """Copy the shards, say what is missing, sum up."""
    from vibroswarm.study.merge import merge
    from vibroswarm.study.result import StudyResult

    check_style(arguments.style)
    store = merge(arguments.out, arguments.shares)
    result = StudyResult(store.study, store, tuple(cell.number for cell in store.study.cells))
    return say_outcome(result, None, arguments)
