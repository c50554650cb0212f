"""``vibroswarm league``: strategies compared on the same floors, motion, readings and radio.

A league is such a comparison. An entry of a league is a strategy with its settings. The forced error is the share of
wrong robots, where an undecided robot counts as if it had decided for the answer that it believes more at the end.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vibroswarm.cli.options import (
    add_execution_options,
    add_json,
    add_out,
    add_scenario_options,
    add_seed,
    list_of,
    real,
    whole,
)
from vibroswarm.cli.output import add_open
from vibroswarm.errors import InputError, check_choice

if TYPE_CHECKING:
    import polars as pl

    from vibroswarm.league.entries import Entry, LeagueFloor
    from vibroswarm.league.standings import League, Standings
    from vibroswarm.scenario.scenario import Scenario

EPILOG = """\
examples:
  vibroswarm league --runs 1000
  vibroswarm league --strategy none,soft --vary none:decision.credible_threshold=0.8,0.9,0.95 --out out/league
  vibroswarm league --strategy soft,totals,mine.py:mine --settings frozen.toml --robots 5,10,20
  vibroswarm league --own-motion --runs 300 --out out/own-motion
"""


def add_parser(commands: Any) -> None:
    """Add the command ``league`` and its options to the program's commands."""
    parser = commands.add_parser(
        "league",
        help="compare strategies on equal terms: time at equal error, error at equal time",
        description="Compare strategies on the same floors, motion, readings and radio, with what each costs to send. "
        "An undecided robot that leans to the wrong side at the end counts as wrong (forced error).",
        epilog=EPILOG,
    )
    group = add_league_options(parser, runs=1000)
    group.add_argument(
        "--settings",
        dest="entry_settings",
        metavar="FILE",
        type=Path,
        help="fields that each strategy sets, in TOML (default: those found by 'vibroswarm tune')",
    )
    group.add_argument(
        "--untuned", action="store_true", help="use the scenario's settings and each strategy's defaults"
    )
    group.add_argument(
        "--own-motion",
        action="store_true",
        help="each strategy moves as suits it: use the settings that were found with motion",
    )
    group.add_argument(
        "--vary",
        metavar="[STRATEGY:]FIELD=A,B,...",
        action="append",
        default=[],
        help="one entry for each value, of one strategy or of all; may be repeated",
    )
    group.add_argument(
        "--belief-runs",
        metavar="N",
        type=whole,
        default=100,
        help="motions on which beliefs are compared with outcomes; 0: none (default 100)",
    )
    group.add_argument(
        "--faults",
        metavar="KIND,...",
        type=list_of(),
        help="kinds of faults that each strategy is tested with (default: stuck_at_1,opposite,radio_dead,stopped)",
    )
    group.add_argument(
        "--fault-runs",
        metavar="N",
        type=whole,
        default=100,
        help="runs per fault, number of faulty robots and floor; 0: none (default 100)",
    )
    group.add_argument(
        "--reference", metavar="NAME", help="entry that others are compared with (default: the first)"
    )
    add_json(group)
    add_out(group, "save runs, tables and report here, or resume", force=True)
    add_open(group)
    # After Ctrl-C, the work saved in the folder --out can be resumed.
    parser.set_defaults(run=run, resumes="folder")


def add_league_options(parser: argparse.ArgumentParser, *, runs: int) -> argparse._ArgumentGroup:
    """Add the options that ``league`` and ``tune`` share: strategies, floors, swarm sizes and runs.

    Args:
        runs: default of ``--runs``.
    Returns:
        The group of options "league".
    """
    # --robots takes a list here: the swarm sizes.
    add_seed(add_scenario_options(parser, robots=list_of(whole)))
    group = parser.add_argument_group("league")
    group.add_argument(
        "--patterns", metavar="NAME,...", type=list_of(), help="of floors (default: the paper's five)"
    )
    group.add_argument(
        "--fills",
        metavar="F,...",
        type=list_of(real),
        help="fill ratios below 0.5; each also mirrored (default 0.46,0.48)",
    )
    group.add_argument(
        "--runs", metavar="N", type=whole, default=runs, help=f"runs per floor and size (default {runs})"
    )
    add_execution_options(parser)
    return group


def run(arguments: argparse.Namespace) -> int:
    """Simulate every strategy on every floor with every swarm size; print and save the tables.

    Returns the exit code.
    """
    from vibroswarm.cli.deliver import deliver
    from vibroswarm.cli.out_folder import claim
    from vibroswarm.cli.output import check_open
    from vibroswarm.cli.progress import study_progress
    from vibroswarm.core.atomic_io import write_files
    from vibroswarm.core.tables import csv_bytes
    from vibroswarm.documents.league import league_document
    from vibroswarm.league.entries import main_entries
    from vibroswarm.scenario.fault_fields import FAULTS
    from vibroswarm.study.store import Store

    check_open(arguments)
    league, basic_entries = league_from(arguments)
    main = main_entries(league.entries)
    known_names = [*dict.fromkeys(name for one in main for name in (one.label, one.strategy))]
    if arguments.reference is not None and arguments.reference not in known_names:
        known = ", ".join(f"'{name}'" for name in known_names)
        raise InputError(f"'{arguments.reference}' is not an entry (entries: {known})", field="--reference")
    for kind in arguments.faults or ():  # refuse an unknown kind now, before anything is simulated
        check_choice(kind, "--faults", FAULTS)
    # Without --faults, a league with swarms of one robot is accepted: its table of faults is empty.
    if arguments.faults and arguments.fault_runs and min(league.robots) == 1:
        raise InputError(
            "needs swarms of at least 2 robots, one of which works; see --robots", field="--faults"
        )
    for option, runs in (("--belief-runs", arguments.belief_runs), ("--fault-runs", arguments.fault_runs)):
        if runs < 0:
            raise InputError(f"{runs} is negative; give 0 or more", field=option)
    if (arguments.belief_runs or arguments.fault_runs) and league.boundaries != {0.5}:
        raise InputError(
            "must be 0.5 to compare beliefs and faults; add --belief-runs 0 --fault-runs 0",
            field="decision.decision_boundary",
        )
    _ = league.study  # refuses a floor on which no decision is right, before `--force` removes the folder
    # `Store.existing` refuses a folder that holds anything but runs of this league.
    claim(arguments, lambda folder: Store.existing(folder, league.study))
    with study_progress("simulating") as progress:
        standings = league.play(
            arguments.out,
            progress=progress,
            mixed=arguments.mixed,
            workers=arguments.workers,
            executor=arguments.executor,
        )
    tables = _tables_of(arguments, league, basic_entries, standings)
    if arguments.out is not None:
        write_files(arguments.out, {f"{name}.csv": csv_bytes(table) for name, table in tables.items()})
    document = league_document(standings, tables)
    deliver(document, arguments, "league", "tables (CSV), the runs (shards) and a report")
    return 0


def _tables_of(
    arguments: argparse.Namespace, league: League, basic_entries: tuple[Entry, ...], standings: Standings
) -> dict[str, pl.DataFrame]:
    """Return the tables of a league by name, which ``--out`` saves as CSV.

    The tables "beliefs" and "faults" need simulations of their own. They are run here, unless ``--belief-runs`` or
    ``--fault-runs`` is 0; the table is then missing.

    Args:
        basic_entries: the entries of these two tables: one for each strategy, without the further entries of
            the league.
        standings: the finished league.
    """
    from vibroswarm.cli.progress import study_progress
    from vibroswarm.league.belief_calibration import BELIEFS, belief_calibration
    from vibroswarm.league.fault_curves import FOLDER as FAULTS_FOLDER
    from vibroswarm.league.fault_curves import KINDS, fault_curves
    from vibroswarm.league.tables import league_tables

    out: Path | None = arguments.out
    tables = league_tables(standings, arguments.reference)
    if arguments.belief_runs:
        with study_progress("comparing beliefs") as progress:
            tables["beliefs"] = belief_calibration(
                replace(league, entries=basic_entries),
                None if out is None else out / BELIEFS,
                runs=arguments.belief_runs,
                progress=progress,
                workers=arguments.workers,
                executor=arguments.executor,
            )
    if arguments.fault_runs:
        with study_progress("with faulty robots") as progress:
            tables["faults"] = fault_curves(
                replace(league, entries=basic_entries),
                None if out is None else out / FAULTS_FOLDER,
                kinds=arguments.faults or KINDS,
                runs=arguments.fault_runs,
                progress=progress,
                workers=arguments.workers,
                executor=arguments.executor,
            )
    return tables


def league_from(arguments: argparse.Namespace) -> tuple[League, tuple[Entry, ...]]:
    """Return the league that the options describe, and its basic entries: one for each strategy.

    The league has further entries: settings for several forced errors, and those of ``--vary``.

    Raises:
        InputError: options conflict, or a strategy or setting is unknown.
    """
    from vibroswarm.league.entries import entries_of, frozen_settings, main_entries, read_settings
    from vibroswarm.league.standings import League

    names, base, floors, robots = players_from(arguments)
    if arguments.own_motion and (arguments.untuned or arguments.entry_settings is not None):
        raise InputError("conflicts with --untuned and --settings; use one of them", field="--own-motion")
    # `settings` has the fields that each strategy sets, by strategy.
    if arguments.untuned:
        if arguments.entry_settings is not None:
            raise InputError("conflicts with --settings; use one of them", field="--untuned")
        settings = {}  # no fields are set: entries have the scenario's settings, or else their strategies' defaults
    elif arguments.entry_settings is not None:
        settings = read_settings(arguments.entry_settings)
    else:
        settings = frozen_settings(arguments.own_motion)
    entries = entries_of(names, settings)
    basic_entries = main_entries(entries)
    for text in arguments.vary:
        entries = _varied(entries, text)
    league = League(base, entries, floors, robots, runs=arguments.runs, seed=arguments.seed)
    return league, basic_entries


def players_from(
    arguments: argparse.Namespace,
) -> tuple[list[str], Scenario, tuple[LeagueFloor, ...], tuple[int, ...]]:
    """Return the names of strategies, the base scenario, the floors and the swarm sizes that the options describe.

    A league varies the strategy and the swarm size, so these options hold lists. ``scenario_from`` takes single values;
    therefore ``arguments.strategy`` and ``arguments.robots`` are set to None before it makes the base scenario.

    Without ``--strategy``, the names are those of ``default_strategies``.

    Raises:
        InputError: ``--floor`` or ``--tiles`` is given, or the value of an option is wrong.
    """
    from vibroswarm.cli.scenario_options import chosen, scenario_from
    from vibroswarm.league.entries import FILLS, PATTERNS, default_strategies, floors_of

    for option in ("floor", "tiles"):
        if getattr(arguments, option) is not None:
            raise InputError("is not for a league; use --patterns and --fills", field=f"--{option}")
    names = (
        default_strategies()
        if arguments.strategy is None
        else [one.strip() for one in arguments.strategy.split(",")]
    )
    names = [chosen("strategy", name) for name in names]
    robots = tuple(arguments.robots or (5, 10))
    arguments.strategy = arguments.robots = None
    floors = floors_of(arguments.patterns or PATTERNS, arguments.fills or FILLS)
    return names, scenario_from(arguments), floors, robots


def _varied(entries: tuple[Entry, ...], text: str) -> tuple[Entry, ...]:
    """Replace entries of a league by several: one for each value that ``--vary`` gives a field.

    Entries of other strategies than that of ``text`` stay as they are, and so does the order.

    Args:
        text: a value of ``--vary``: ``FIELD=A,B`` to vary all entries, or ``STRATEGY:FIELD=A,B`` to vary the entries of
            one strategy.
    Raises:
        InputError: the text is not of this form, its field is unknown, or no entry has its strategy.
    """
    from vibroswarm.league.entries import varied
    from vibroswarm.scenario.scenario import parse_setting

    name, separator, values = text.partition("=")
    if not separator or not values.strip():
        raise InputError(f"'{text}' is not of the form [strategy:]section.field=value,value", field="--vary")
    strategy, colon, field = name.strip().rpartition(":")  # without a colon, all of the name is the field
    return varied(
        entries,
        strategy if colon else None,  # None: of all strategies
        field,
        # `parse_setting` returns the name and the value, converted to its type
        [parse_setting(f"{field}={value}")[1] for value in values.split(",")],
    )
