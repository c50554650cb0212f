"""``vibroswarm league``: strategies compared on the same floors, motion, readings and radio.

A league is such a comparison. An entry of a league is a strategy with its settings. The forced error is the share of
wrong robots, where an undecided robot counts as if it had decided for the answer that it believes more at the end.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from vibroswarm.cli.command_line import Option
from vibroswarm.cli.options import (
    Execution,
    Force,
    Paged,
    ScenarioBase,
    Seed,
    SeveralSizes,
    SeveralStrategies,
)
from vibroswarm.cli.terminal import say
from vibroswarm.errors import InputError

if TYPE_CHECKING:
    from vibroswarm.league.entries import Entry, LeagueFloor
    from vibroswarm.league.standings import League
    from vibroswarm.scenario.scenario import Scenario


@dataclass(kw_only=True)
class Players(ScenarioBase, SeveralSizes, SeveralStrategies):
    """Strategies, swarms and floors that play, and the scenario that they have in common."""

    seed: Seed = 1
    patterns: Annotated[tuple[str, ...] | None, Option("patterns of floors (default: the paper's five)")] = (
        None
    )
    fills: Annotated[
        tuple[float, ...] | None,
        Option("fill ratios below 0.5; each also mirrored (default 0.46,0.48)", "F,..."),
    ] = None
    shares: Annotated[
        tuple[float, ...] | None,
        Option(
            "shares of three kinds of tile or more, on random floors; each kind has each share once", "F,..."
        ),
    ] = None


@dataclass(kw_only=True)
class Entries:
    """With which settings strategies play."""

    settings_file: Annotated[
        Path | None,
        Option(
            "fields that each strategy sets, in TOML (default: those found by 'vibroswarm league tune')",
            name="--settings",
        ),
    ] = None
    untuned: Annotated[bool, Option("use the scenario's settings and each strategy's defaults")] = False
    own_motion: Annotated[
        bool, Option("each strategy moves as suits it: use the settings that were found with motion")
    ] = False
    vary: Annotated[
        Sequence[str],
        Option(
            "one entry for each value, of one strategy or of all; may be repeated", "[STRATEGY:]FIELD=A,B,..."
        ),
    ] = ()

    def __post_init__(self) -> None:
        """Refuse options that exclude each other."""
        if self.own_motion and (self.untuned or self.settings_file is not None):
            raise InputError("conflicts with --untuned and --settings; use one of them", field="--own-motion")
        if self.untuned and self.settings_file is not None:
            raise InputError("conflicts with --settings; use one of them", field="--untuned")


@dataclass(kw_only=True)
class Tests:
    """What is tested besides the league itself."""

    belief_runs: Annotated[
        int, Option("motions on which beliefs are compared with outcomes; 0: none (default 100)", low=0)
    ] = 100
    faults: Annotated[
        tuple[str, ...] | None,
        Option(
            "kinds of faults that each strategy is tested with (default: stuck_at_1,opposite,radio_dead,stopped)",
            "KIND,...",
        ),
    ] = None
    fault_runs: Annotated[
        int, Option("runs per fault, number of faulty robots and floor; 0: none (default 100)", low=0)
    ] = 100


def league(
    *,
    runs: Annotated[int, Option("runs per floor and size")] = 300,
    reference: Annotated[
        str | None, Option("entry that others are compared with (default: the first)")
    ] = None,
    scenario: Players,
    entries: Entries,
    tests: Tests,
    execution: Execution,
    output: Paged,
) -> None:
    """Compare strategies on the same floors, motion, readings and radio, with what each costs to send.

    An undecided robot that leans to the wrong side at the end counts as wrong (forced error).

    examples:
      vibroswarm league --runs 1000
      vibroswarm league --strategy none,soft --vary none:decision.credible_threshold=0.8,0.9,0.95 --out out/league
      vibroswarm league --strategy soft,totals,mine.py:mine --settings frozen.toml --robots 5,10,20
      vibroswarm league --own-motion --runs 300 --out out/own-motion
      vibroswarm league --shares 0.4,0.36,0.24
    """
    from vibroswarm.cli.deliver import deliver
    from vibroswarm.cli.out_folder import claim
    from vibroswarm.cli.progress import study_progress
    from vibroswarm.cli.studies import print_plan
    from vibroswarm.core.atomic_io import write_files
    from vibroswarm.core.tables import csv_bytes
    from vibroswarm.documents.league import league_document
    from vibroswarm.league.fault_curves import KINDS
    from vibroswarm.league.tables import check_tests, further_tables, league_tables
    from vibroswarm.study.store import Store

    made, basic_entries = league_of(scenario, entries, runs)
    if scenario.shares is not None:  # beliefs, and messages of the opposite, are those of two kinds
        tests = replace(tests, belief_runs=0, fault_runs=0)
    check_tests(made, reference, tests.belief_runs, tests.fault_runs, tests.faults)
    study = made.study  # refuses a floor on which no decision is right, before `--force` removes the folder
    # `Store.existing` refuses a folder that holds anything but runs of this league.
    claim(output, lambda folder: Store.existing(folder, study, shards=False))
    print_plan(
        study, output.out, None, tests=len(basic_entries) * bool(tests.belief_runs or tests.fault_runs)
    )
    with study_progress("simulating") as progress:
        standings = made.play(output.out, progress=progress, **execution.how)
    basic = replace(made, entries=basic_entries)
    tables = league_tables(standings, reference) | further_tables(
        basic,
        output.out,
        study_progress,
        belief_runs=tests.belief_runs,
        fault_runs=tests.fault_runs,
        kinds=tests.faults or KINDS,
        **execution.where,
    )
    if output.out is not None or output.json:
        tables["summary"] = standings.summary
    if output.out is not None:
        write_files(output.out, {f"{name}.csv": csv_bytes(table) for name, table in tables.items()})
    deliver(league_document(standings, tables), output, "league")


def league_of(players: Players, options: Entries, runs: int) -> tuple[League, tuple[Entry, ...]]:
    """Return the league that the options describe, and its basic entries: one for each strategy.

    The league has further entries: settings for several forced errors, and those of ``--vary``.

    Raises:
        InputError: a strategy or setting is unknown.
    """
    from vibroswarm.league.entries import (
        entries_of,
        frozen_settings,
        main_entries,
        read_settings,
        varied_by,
    )
    from vibroswarm.league.standings import League

    names, base, floors, robots = players_of(players)
    # `settings` has the fields that each strategy sets, by strategy.
    settings: Any
    if options.untuned:
        settings = {}  # no fields are set: entries have the scenario's settings, or else their strategies' defaults
    elif options.settings_file is not None:
        settings = read_settings(options.settings_file)
    else:
        settings = frozen_settings(options.own_motion)
    entries = entries_of(names, settings)
    basic_entries = main_entries(entries)
    for text in options.vary:
        entries = varied_by(entries, text)
    return League(base, entries, floors, robots, runs=runs, seed=players.seed), basic_entries


def players_of(
    players: Players,
) -> tuple[list[str], Scenario, tuple[LeagueFloor, ...], tuple[int, ...]]:
    """Return the names of strategies, the base scenario, the floors and the swarm sizes that the options describe.

    Raises:
        InputError: ``--floor`` or ``--tiles`` is given, or the value of an option is wrong.
    """
    from vibroswarm.cli.scenario_options import chosen, scenario_from
    from vibroswarm.league.entries import FILLS, PATTERNS, default_strategies, floors_of

    for option in ("floor", "tiles"):
        if getattr(players, option) is not None:
            raise InputError("is not for a league; use --patterns and --fills", field=f"--{option}")
    if players.shares is not None:
        return _players_of_kinds(players, players.shares)
    names = [chosen("strategy", name) for name in players.strategy or default_strategies()]
    base = scenario_from(replace(players, strategy=None, robots=None))
    floors = floors_of(players.patterns or PATTERNS, players.fills or FILLS)
    return names, base, floors, players.robots or (5, 10)


def _players_of_kinds(
    players: Players, shares: tuple[float, ...]
) -> tuple[list[str], Scenario, tuple[LeagueFloor, ...], tuple[int, ...]]:
    """Return what ``players_of`` does, for a league of several kinds of tile."""
    from vibroswarm.cli.scenario_options import chosen, scenario_from
    from vibroswarm.league.entries import SIZE, default_strategies, floors_of_kinds

    if players.patterns or players.fills:
        raise InputError("conflicts with --patterns and --fills; use one of them", field="--shares")
    floors = floors_of_kinds(shares)
    players = _with_kinds(players, len(shares))
    names = [chosen("strategy", name) for name in players.strategy or default_strategies(len(shares))]
    tiles = f"{SIZE['floor.rows']}x{SIZE['floor.columns']}"
    base = scenario_from(
        replace(players, strategy=(names[0],), robots=None, floor=floors[0].source, tiles=tiles)
    )
    if base.sensor.kinds != len(shares):
        raise InputError(
            f"has {len(shares)} shares, and the sensor '{base.sensor.model}' knows {base.sensor.kinds} kinds of tile; "
            "add --set sensor.model=confusion and --set sensor.confusion.kinds=...",
            field="--shares",
        )
    return names, base, floors, players.robots or (5, 10)


def _with_kinds(players: Players, kinds: int) -> Players:
    """Return players with a sensor of as many kinds, and a task, where their options name none; print a note of it."""
    named = {setting.partition("=")[0].strip() for setting in players.settings}
    has_base = players.preset is not None or players.scenario is not None
    settings, notes = list(players.settings), []
    if not has_base and players.energies is None and not any(name.startswith("sensor.") for name in named):
        settings += ["sensor.model=confusion", f"sensor.confusion.kinds={kinds}"]
        notes.append(f"--set sensor.model=confusion --set sensor.confusion.kinds={kinds}")
    task = players.task
    if not has_base and task is None and "task.name" not in named:
        task = "majority"
        notes.append("--task majority")
    if notes:
        say(f"--shares without a sensor or a task of {kinds} kinds: with {' '.join(notes)}.")
    return replace(players, settings=settings, task=task)


def tune(
    *,
    runs: Annotated[int, Option("runs of each setting, floor and size in the first round")] = 20,
    points: Annotated[int, Option("settings tried for each tuned field of a strategy")] = 48,
    own_motion: Annotated[
        bool, Option("search the motion too, for 'vibroswarm league --own-motion'")
    ] = False,
    spaces: Annotated[
        Path | None,
        Option(
            'bounds of the fields to search, in TOML: [voter] with "strategy.voter.phase_s" = { from = 5, to = 90 }'
        ),
    ] = None,
    out: Annotated[Path | None, Option("write the settings here, for 'vibroswarm league --settings'")] = None,
    force: Force = False,
    scenario: Players,
    execution: Execution,
) -> None:
    """Find settings for the strategies of a league: those that decide soonest at each of several forced errors.

    The errors are the same for all strategies; in three rounds, each on fresh motion and floors. Until the file --out
    is written, finished runs are saved in a folder beside it, and the same command resumes.

    example:
      vibroswarm league tune --strategy none,soft --out settings.toml
      vibroswarm league --strategy none,soft --settings settings.toml --seed 2
    """
    from vibroswarm.cli.deliver import print_document
    from vibroswarm.cli.interruption import folder_of_runs, saves_in
    from vibroswarm.cli.output import print_saved_file
    from vibroswarm.cli.progress import progress_bar
    from vibroswarm.core.atomic_io import remove_folder, whole_file
    from vibroswarm.documents.tune import tune_document
    from vibroswarm.league.entries import read_settings
    from vibroswarm.league.tuning import spaces as shipped_spaces
    from vibroswarm.league.tuning import tune as tuned_by

    names, base, floors, robots = players_of(scenario)
    with ExitStack() as stack:
        # The file is opened before the work, so that a name that cannot be written is refused at once.
        file = None if out is None else stack.enter_context(whole_file(out, replace=force))
        progress = stack.enter_context(progress_bar("tuning"))
        runs_folder = None if out is None else folder_of_runs(out)
        saves_in(runs_folder, resumes=True)
        if runs_folder is not None and force and runs_folder.exists():
            remove_folder(runs_folder)
        tuned = tuned_by(
            base,
            names,
            floors,
            robots,
            # the search spaces of the package, and those of the user's file in their place
            space_of=shipped_spaces(own_motion) | (read_settings(spaces) if spaces else {}),
            points=points,
            runs=runs,
            seed=scenario.seed,
            progress=progress,
            folder=runs_folder,
            **execution.where,
        )
        if file is not None:
            file.write_text(tuned.to_toml(), encoding="utf-8", newline="\n")
    # The file is complete, so the saved runs are no longer needed.
    if runs_folder is not None and runs_folder.exists():
        remove_folder(runs_folder)
    print_document(tune_document(tuned))
    print_saved_file(out)
