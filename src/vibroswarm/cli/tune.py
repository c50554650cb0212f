"""``vibroswarm tune``: find settings for the strategies of a league."""

from __future__ import annotations

import argparse
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vibroswarm.cli.league import add_league_options, players_from, values_text
from vibroswarm.cli.options import add_out, whole

if TYPE_CHECKING:
    from vibroswarm.league.tuning import Tuned

EPILOG = """\
example:
  vibroswarm tune --strategy none,soft --out settings.toml
  vibroswarm league --strategy none,soft --settings settings.toml --seed 2
"""


def add_parser(commands: Any) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "tune",
        help="find settings for the strategies of a league, with equal numbers of runs",
        description="For each strategy, find the settings with the smallest decision time among those whose forced "
        "error is not above that of the scenario as it is; in two rounds, with as many runs for each strategy.",
        epilog=EPILOG,
    )
    group = add_league_options(parser, runs=100)
    group.add_argument(
        "--points", metavar="N", type=whole, default=64, help="settings tried per strategy (default 64)"
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
    parser.set_defaults(run=run, resumes="file")


def run(arguments: argparse.Namespace) -> int:
    """Tune, print and write the settings."""
    from vibroswarm.cli.interruption import folder_of_runs
    from vibroswarm.cli.output import print_line
    from vibroswarm.cli.progress import progress_bar
    from vibroswarm.core.atomic_io import remove_folder, whole_file
    from vibroswarm.league.entries import read_settings
    from vibroswarm.league.tuning import AGAIN, FINALISTS, spaces, tune

    names, base, floors, robots = players_from(arguments)
    with ExitStack() as stack:
        # Opened first: a name that cannot be written is refused before the work, not after.
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
        how = (
            f"{arguments.points} settings per strategy with {arguments.runs} runs of each of {len(floors)} floors and "
            f"swarms of {', '.join(map(str, robots))}, then the best {FINALISTS} and the default with "
            f"{AGAIN * arguments.runs} fresh runs (seeds {arguments.seed} and {arguments.seed + 1})."
        )
        if out is not None:
            out.write_text(tuned.to_toml(how), encoding="utf-8", newline="\n")
    if runs_folder is not None and runs_folder.exists():
        remove_folder(runs_folder)
    _print_tuned(tuned, how)
    if arguments.out is not None:
        print_line(f"Saved: {arguments.out}")
    return 0


def _print_tuned(tuned: Tuned, how: str) -> None:
    """Print the settings that were found, what they give, and how they were found."""
    from vibroswarm.cli.output import print_paragraph, print_table

    chosen = tuned.table.filter("is_chosen").sort("decision_time_s")
    print_paragraph(
        f"Settings by the smallest decision time with at most {100 * tuned.target:.1f} % forced error"
    )
    print()
    print_table(
        ["strategy", "forced error, %", "decision time, s"],
        [
            [
                row["strategy"],
                values_text(row, "forced_error", 100, ".1f"),
                values_text(row, "decision_time_s", 1, ".0f"),
            ]
            for row in chosen.iter_rows(named=True)
        ],
    )
    print()
    for row in chosen.iter_rows(named=True):
        print_paragraph(f"{row['strategy']}: {row['settings'] or 'as the scenario has them, and by default'}")
    print()
    print_paragraph(
        f"{how} The figures favour the settings that were lucky: play a league with another seed."
    )
