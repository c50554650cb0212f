"""``vibroswarm league``: strategies compared on the same floors, motion, readings and radio.

A league is such a comparison. An entry of a league is a strategy with its settings. The forced error is the share of
wrong robots, where an undecided robot counts as if it had decided for the answer that it believes more at the end.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from vibroswarm.cli.command_line import Option
from vibroswarm.cli.deliver import deliver
from vibroswarm.cli.options import (
    Paged,
    SwarmOptions,
    Where,
)
from vibroswarm.cli.out_folder import claim
from vibroswarm.cli.progress import STAGES
from vibroswarm.cli.scenario_options import keywords_of, warned
from vibroswarm.cli.studies import print_plan
from vibroswarm.cli.terminal import say
from vibroswarm.core.atomic_io import write_files


@dataclass(kw_only=True)
class Players(SwarmOptions):
    """Strategies, swarms and floors that play, and the scenario that they have in common."""

    # The two seeds that follow are those of tests and of later rounds.
    seed: Annotated[int, Option("same scenario and seed: same result", "S", low=0, high=2**62)] = 1
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


def league(
    *,
    runs: Annotated[int, Option("runs per floor and size")] = 300,
    belief_runs: Annotated[
        int, Option("motions on which beliefs are compared with outcomes; 0: none (default 100)", low=0)
    ] = 100,
    reference: Annotated[
        str | None, Option("entry that others are compared with (default: the first)")
    ] = None,
    scenario: Players,
    entries: Entries,
    execution: Where,
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
    from vibroswarm.core.tables import csv_bytes
    from vibroswarm.documents.league import league_document
    from vibroswarm.league.words import belief_runs_of, league_of, played, studies_of_tests

    asked = league_of(
        runs=runs, seed=scenario.seed, **vars(entries), **floors_of(scenario), **keywords_of(scenario)
    )
    if asked.note:
        say(asked.note)
    warned(asked.league.base)
    belief_runs = belief_runs_of(asked, reference, belief_runs)
    study = (
        asked.league.study
    )  # refuses a floor on which no decision is right, before `--force` removes the folder
    claim(output, "league", study.hash)
    tested = studies_of_tests(asked.basic, belief_runs)
    print_plan(study, *tested.values())
    standings, tables = played(
        asked, output.out, reference=reference, belief_runs=belief_runs, stages=STAGES, **execution.where
    )
    if output.out is not None or output.json:
        tables["summary"] = standings.summary
    if output.out is not None:
        write_files(output.out, {f"{name}.csv": csv_bytes(table) for name, table in tables.items()})
    deliver(league_document(standings, tables), output)


def floors_of(players: Players) -> dict[str, Any]:
    """Return the options that say which floors play, by name."""
    return {name: getattr(players, name) for name in ("patterns", "fills", "shares")}
