"""``vibroswarm league``: strategies compared on the same floors, motion, readings and radio."""

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
    """Add the command."""
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
        "--fronts",
        action="store_true",
        help="play several settings of each strategy's own parameters, and compare fronts",
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
    parser.set_defaults(run=run, resumes="folder")


def add_league_options(parser: argparse.ArgumentParser, *, runs: int) -> argparse._ArgumentGroup:
    """Add the options that say who meets whom where; returns their group.

    Args:
        runs: the number of runs by default.
    """
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
    """Play the league, print and save its tables."""
    from vibroswarm.cli.out_folder import claim, deliver
    from vibroswarm.cli.output import check_open, print_saved
    from vibroswarm.cli.progress import study_progress
    from vibroswarm.core.atomic_io import write_files
    from vibroswarm.core.tables import csv_bytes
    from vibroswarm.league.report import write_league_report
    from vibroswarm.scenario.fault_fields import FAULTS
    from vibroswarm.study.store import Store

    check_open(arguments)
    league, plain = league_from(arguments)
    if arguments.reference is not None and arguments.reference not in [one.label for one in league.entries]:
        known = ", ".join(f"'{one.label}'" for one in league.entries)
        raise InputError(f"'{arguments.reference}' is not an entry (entries: {known})", field="--reference")
    for kind in arguments.faults or ():  # before anything is simulated
        check_choice(kind, "--faults", FAULTS)
    claim(arguments, lambda: Store.existing(arguments.out, league.study))
    with study_progress("simulating") as progress:
        standings = league.play(
            arguments.out,
            progress=progress,
            mixed=arguments.mixed,
            workers=arguments.workers,
            executor=arguments.executor,
        )
    tables = _tables_of(arguments, league, plain, standings)
    if arguments.out is not None:
        write_files(arguments.out, {f"{name}.csv": csv_bytes(table) for name, table in tables.items()})
        write_league_report(arguments.out, standings, tables)
    deliver(
        arguments,
        arguments.out,
        "league",
        lambda: print_standings(standings, tables),
        lambda: {name: table.fill_nan(None).to_dicts() for name, table in tables.items()},
    )
    print_saved(arguments, "tables (CSV), the runs (shards) and a report", "report.html")
    return 0


def _tables_of(
    arguments: argparse.Namespace, league: League, plain: tuple[Entry, ...], standings: Standings
) -> dict[str, pl.DataFrame]:
    """Return the tables of a league by name; simulates what beliefs and faults need.

    Args:
        plain: the entries whose beliefs are compared, and which are tested with faults.
    """
    from vibroswarm.cli.progress import study_progress
    from vibroswarm.league.belief_calibration import BELIEFS, belief_calibration
    from vibroswarm.league.fault_curves import FOLDER as FAULTS_FOLDER
    from vibroswarm.league.fault_curves import KINDS, fault_curves
    from vibroswarm.league.fronts import front_table

    tables = {
        "standings": standings.table,
        "differences": standings.differences(arguments.reference),
        "floor_differences": standings.floor_differences(arguments.reference),
        "fronts": front_table(standings, arguments.reference),
        "floors": standings.floor_table,
    }
    if arguments.belief_runs:
        with study_progress("comparing beliefs") as progress:
            tables["beliefs"] = belief_calibration(
                replace(league, entries=plain),
                arguments.out and arguments.out / BELIEFS,
                runs=arguments.belief_runs,
                progress=progress,
                workers=arguments.workers,
                executor=arguments.executor,
            )
    if arguments.fault_runs:
        with study_progress("with faulty robots") as progress:
            tables["faults"] = fault_curves(
                replace(league, entries=plain),
                arguments.out and arguments.out / FAULTS_FOLDER,
                kinds=arguments.faults or KINDS,
                runs=arguments.fault_runs,
                progress=progress,
                workers=arguments.workers,
                executor=arguments.executor,
            )
    return tables


def league_from(arguments: argparse.Namespace) -> tuple[League, tuple[Entry, ...]]:
    """Return the league that the options describe, and its entries before --fronts and --vary."""
    from vibroswarm.league.entries import entries_of, frozen_settings, read_settings, with_fronts
    from vibroswarm.league.standings import League

    names, base, floors, robots = players_from(arguments)
    if arguments.own_motion and (arguments.untuned or arguments.entry_settings is not None):
        raise InputError("conflicts with --untuned and --settings; use one of them", field="--own-motion")
    if arguments.untuned:
        if arguments.entry_settings is not None:
            raise InputError("conflicts with --settings; use one of them", field="--untuned")
        settings = {}
    elif arguments.entry_settings is not None:
        settings = read_settings(arguments.entry_settings)
    else:
        settings = frozen_settings(arguments.own_motion)
    plain = entries_of(names, settings)
    entries = with_fronts(plain) if arguments.fronts else plain
    for text in arguments.vary:
        entries = _varied(entries, text)
    return League(base, entries, floors, robots, arguments.runs, arguments.seed), plain


def players_from(
    arguments: argparse.Namespace,
) -> tuple[list[str], Scenario, tuple[LeagueFloor, ...], tuple[int, ...]]:
    """Return strategies, base scenario, floors and swarm sizes.

    Raises:
        InputError: an option is wrong.
    """
    from vibroswarm.cli.scenario_options import chosen, scenario_from
    from vibroswarm.league.entries import FILLS, PATTERNS, floors_of

    for option in ("floor", "tiles"):
        if getattr(arguments, option) is not None:
            raise InputError("is not for a league; use --patterns and --fills", field=f"--{option}")
    names = (
        on_equal_terms()
        if arguments.strategy is None
        else [one.strip() for one in arguments.strategy.split(",")]
    )
    names = [chosen("strategy", name) for name in names]
    robots, arguments.strategy, arguments.robots = tuple(arguments.robots or (5, 10)), None, None
    floors = floors_of(arguments.patterns or PATTERNS, arguments.fills or FILLS)
    return names, scenario_from(arguments), floors, robots


def on_equal_terms() -> list[str]:
    """Return the strategies that play by default: all but those that know the places of their readings."""
    from vibroswarm.strategies import known
    from vibroswarm.strategies.static_analysis import told

    return [name for name, one in known().items() if "place of each reading" not in told(one, "tiles")]


def _varied(entries: tuple[Entry, ...], text: str) -> tuple[Entry, ...]:
    from vibroswarm.league.entries import varied
    from vibroswarm.scenario.scenario import parse_setting

    name, separator, values = text.partition("=")
    if not separator or not values.strip():
        raise InputError(f"'{text}' is not of the form [strategy:]section.field=value,value", field="--vary")
    of, colon, field = name.strip().rpartition(":")
    return varied(
        entries,
        of if colon else None,
        field,
        [parse_setting(f"{field}={one}")[1] for one in values.split(",")],
    )


def print_standings(standings: Standings, tables: dict[str, pl.DataFrame]) -> None:
    """Print the answer, then the tables."""
    from vibroswarm.cli.output import print_line, print_paragraph, print_table
    from vibroswarm.league.report import answers

    league, table = standings.league, tables["standings"]
    for sentence in answers(table, tables):
        print_paragraph(sentence)
    print_line()
    print_table(
        [
            "strategy",
            "forced error, %",
            "right, %",
            "wrong, %",
            "undecided, %",
            "decision time, s",
            "worst floor, %",
            "messages",
            "bytes",
        ],
        [
            [
                row["name"],
                values_text(row, "forced_error", 100, ".1f"),
                *(f"{100 * row[name]:.1f}" for name in ("right", "wrong", "undecided")),
                values_text(row, "decision_time_s", 1, ".0f"),
                "-" if row["worst_floor_error"] is None else f"{100 * row['worst_floor_error']:.1f}",
                f"{row['sent']:.0f}",
                f"{row['bytes_sent']:.0f}",
            ]
            for row in table.iter_rows(named=True)
        ],
        more=("right, %", "worst floor, %", "messages", "bytes"),
    )
    if tables["differences"].height:
        print_line()
        differences = tables["differences"]
        print_paragraph(f"Difference from {differences['reference'][0]}; p by Holm over the entries")
        rows = [_difference(row) for row in differences.iter_rows(named=True)]
        print_table(["strategy", "figure", "difference", "p"], rows, names=2)
    if "beliefs" in tables and tables["beliefs"].height:
        print_beliefs(tables["beliefs"])
    if "faults" in tables and tables["faults"].height:
        print_faults(tables["faults"])
    if (tables["fronts"]["points"] > 1).any():
        print_fronts(tables["fronts"])
    print_line()
    untuned = [entry.label for entry in league.entries if not entry.tuned]
    if untuned:
        print_paragraph(f"Not tuned for a league ('vibroswarm tune'): {', '.join(untuned)}")
    sizes = ", ".join(map(str, league.robots))
    print_paragraph(
        f"Averages over {len(league.floors)} floors and swarms of {sizes}; {league.runs} runs of each, 95 % intervals "
        "over motions. Forced error: wrong, or undecided and leaning to the wrong side at the end. The worst floor is "
        "chosen by other motions than those that measure it. Messages and bytes: per robot and run."
    )


def print_beliefs(beliefs: pl.DataFrame) -> None:
    """Print the confidence of robots when they decided, and how often they were right."""
    from vibroswarm.cli.output import print_line, print_paragraph, print_table

    print_line()
    print_paragraph("Robots that decided: their confidence, and how often they were right")
    print_table(
        ["strategy", "settings", "floors", "confidence, %", "right, %", "decided, %"],
        [
            [
                row["name"],
                row["settings"],
                row["prior"],
                values_text(row, "confidence", 100, ".1f"),
                values_text(row, "right", 100, ".1f"),
                f"{100 * row['decided']:.0f}",
            ]
            for row in beliefs.iter_rows(named=True)
        ],
        names=3,
    )


def print_fronts(fronts: pl.DataFrame) -> None:
    """Print time at equal error and error at equal time."""
    from vibroswarm.cli.output import print_line, print_table

    print_line()
    print_line("At equal error, and at equal time")
    print_table(
        ["strategy", "entries on front", "time at its error, s", "error at its time, %"],
        [
            [
                row["strategy"],
                row["points"],
                values_text(row, "time_at_equal_error_s", 1, ".0f"),
                values_text(row, "error_at_equal_time", 100, ".1f"),
            ]
            for row in fronts.iter_rows(named=True)
        ],
    )


def print_faults(curves: pl.DataFrame) -> None:
    """Print the forced error of each entry without faulty robots and with the most, and how many it tolerates."""
    from vibroswarm.cli.output import print_line, print_paragraph, print_table
    from vibroswarm.league.fault_curves import MARGIN, borne

    kinds = curves["kind"].unique(maintain_order=True).to_list()
    errors = {
        (row["name"], row["kind"], row["faulty"]): f"{100 * row['forced_error']:.1f}"
        for row in curves.iter_rows(named=True)
    }
    count = {(row["name"], row["kind"]): row["borne"] for row in borne(curves).iter_rows(named=True)}
    print_line()
    print_paragraph(
        "Faulty robots that a strategy tolerates, and the forced error (%) of the others with 0, 1, ... of them"
    )
    rows = []
    for name in curves["name"].unique(maintain_order=True):
        row = [name]
        for kind in kinds:
            found = [text for (n, k, _), text in errors.items() if (n, k) == (name, kind)]
            row.append(f"{count[name, kind]}: {', '.join(found)}" if found else "-")
        rows.append(row)
    print_table(["strategy", *(kind.replace("_", " ") for kind in kinds)], rows)
    print_paragraph(
        f"Bears: the 95 % interval of the rise lies below {100 * MARGIN:.0f} points, for that number and all below."
    )


def _difference(row: dict[str, Any]) -> list[str]:
    is_time = row["figure"] == "decision_time_s"
    scale, form, unit = (1, "+.0f", " s") if is_time else (100, "+.1f", " points")
    name = "decision time" if is_time else "forced error"
    p = "-" if row["p_holm"] is None else "<0.001" if row["p_holm"] < 0.001 else f"{row['p_holm']:.3f}"
    return [row["name"], name, values_text(row, "difference", scale, form, unit), p]


def values_text(row: dict[str, Any], name: str, scale: float, form: str, unit: str = "") -> str:
    """Write a figure of a row with its limits: ``44.1 % [41.0, 47.2]``."""
    values = [row[name + end] for end in ("", "_low", "_high")]
    if values[0] is None or values[0] != values[0]:
        return "not reached"
    estimate = f"{scale * values[0]:{form}}{unit}"
    if any(one is None or one != one for one in values[1:]):
        return estimate
    return f"{estimate} [{scale * values[1]:{form}}, {scale * values[2]:{form}}]"
