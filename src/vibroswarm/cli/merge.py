"""``vibroswarm merge``: join the shards of a study.

A shard is the part of a study's runs that one call with the option ``--shard K/N`` has done, in a folder of its own.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from vibroswarm.cli.options import add_execution_options
from vibroswarm.cli.studies import add_outcome_options, confirm_and_print


def add_parser(commands: Any) -> None:
    """Add the command ``merge`` and its options to the program's commands."""
    parser = commands.add_parser(
        "merge",
        help="join the shards of a study",
        description="Join folders made with --shard, and summarise the study.",
    )
    parser.add_argument("out", metavar="OUT", type=Path, help="new folder, or one of the same study")
    parser.add_argument("shares", metavar="SHARD", type=Path, nargs="+", help="folders of shards")
    parser.add_argument("--force", action="store_true", help="replace OUT if it holds something else")
    add_execution_options(parser)  # for the repetition of comparisons on other seeds
    add_outcome_options(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Join the shards in one folder, repeat the comparisons on other seeds, print and save the summary.

    Returns the exit code.
    """
    from vibroswarm.cli.out_folder import claim
    from vibroswarm.cli.output import check_open
    from vibroswarm.study.cell_comparison import pairs_of
    from vibroswarm.study.run import jobs_of_one_study, merge
    from vibroswarm.study.store import Store
    from vibroswarm.study.study_result import StudyResult

    check_open(arguments)
    # Shards that cannot be merged are refused now, since `--force` removes the folder.
    study = jobs_of_one_study(arguments.shares)[0].study
    # `Store.existing` refuses a folder that holds anything but runs of this study.
    pairs_of(study, arguments.reference)  # refuses an unknown reference before anything is written
    claim(arguments, lambda folder: Store.existing(folder, study))
    store = merge(arguments.out, arguments.shares)
    every_cell = tuple(cell.number for cell in store.study.cells)
    result = StudyResult(store.study, store, selected=every_cell)
    return confirm_and_print(result, arguments)
