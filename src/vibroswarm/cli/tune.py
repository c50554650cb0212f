"""``vibroswarm tune``: find settings for the strategies of a league."""

from __future__ import annotations

import argparse
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from vibroswarm.cli.league import add_league_options, players_from
from vibroswarm.cli.options import add_out, whole

EPILOG = """\
example:
  vibroswarm tune --strategy none,soft --out settings.toml
  vibroswarm league --strategy none,soft --settings settings.toml --seed 2
"""


def add_parser(commands: Any) -> None:
    """Add the command ``tune`` and its options to the program's commands.

    Its texts mention the forced error: the share of wrong robots, where an undecided robot counts as if it had decided
    for the answer that it believes more at the end.
    """
    parser = commands.add_parser(
        "tune",
        help="find settings for the strategies of a league: each strategy's front of time against error",
        description="For each strategy, find the settings that decide soonest at each of several forced errors, the "
        "same for all strategies; in three rounds, each on fresh motion and floors.",
        epilog=EPILOG,
    )
    group = add_league_options(parser, runs=20)
    group.add_argument(
        "--points",
        metavar="N",
        type=whole,
        default=48,
        help="settings tried for each tuned field of a strategy (default 48)",
    )
    group.add_argument(
        "--own-motion",
        action="store_true",
        help="search the motion too, for 'vibroswarm league --own-motion'",
    )
    group.add_argument(
        "--spaces",
        metavar="FILE",
        type=Path,
        help='bounds of the fields to search, in TOML: [voter] with "strategy.voter.phase_s" = { from = 5, to = 90 }',
    )
    add_out(group, "write the settings here, for 'vibroswarm league --settings'", metavar="FILE", force=True)
    # After Ctrl-C, the runs saved beside the file --out can be resumed.
    parser.set_defaults(run=run, resumes="file")


def run(arguments: argparse.Namespace) -> int:
    """Find settings for each strategy, print them and write them to ``--out``; return the exit code.

    Until the file is written, finished runs are saved in a folder beside it, so that the same command can resume the
    search after an interruption. With ``--force``, a folder of runs that exists is removed first.
    """
    from vibroswarm.cli.deliver import print_in_terminal
    from vibroswarm.cli.interruption import folder_of_runs
    from vibroswarm.cli.output import print_line
    from vibroswarm.cli.progress import progress_bar
    from vibroswarm.core.atomic_io import remove_folder, whole_file
    from vibroswarm.documents.tune import tune_document
    from vibroswarm.league.entries import read_settings
    from vibroswarm.league.tuning import spaces, tune

    names, base, floors, robots = players_from(arguments)
    with ExitStack() as stack:
        # The file is opened before the work, so that a name that cannot be written is refused at once. Without --out,
        # `out` and `runs_folder` are None.
        out = arguments.out and stack.enter_context(whole_file(arguments.out, replace=arguments.force))
        progress = stack.enter_context(progress_bar("tuning"))
        runs_folder = arguments.out and folder_of_runs(arguments.out)
        if runs_folder is not None and arguments.force and runs_folder.exists():
            remove_folder(runs_folder)
        tuned = tune(
            base,
            names,
            floors,
            robots,
            # the search spaces of the package, and those of the user's file in their place
            space_of=spaces(arguments.own_motion)
            | (read_settings(arguments.spaces) if arguments.spaces else {}),
            points=arguments.points,
            runs=arguments.runs,
            seed=arguments.seed,
            progress=progress,
            folder=runs_folder,
            workers=arguments.workers,
            executor=arguments.executor,
        )
        if out is not None:
            out.write_text(tuned.to_toml(), encoding="utf-8", newline="\n")
    # The file is complete, so the saved runs are no longer needed.
    if runs_folder is not None and runs_folder.exists():
        remove_folder(runs_folder)
    print_in_terminal(tune_document(tuned))
    if arguments.out is not None:
        print_line(f"Saved: {arguments.out}")
    return 0
