"""The tables of a league by name."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import polars as pl

from vibroswarm.errors import InputError, check_choice
from vibroswarm.league.belief_calibration import BELIEFS, belief_calibration, belief_league
from vibroswarm.league.best import best_table
from vibroswarm.league.entries import main_entries, reference_in
from vibroswarm.league.fault_curves import FOLDER, KINDS, fault_curves, league_with_faults, most_faulty
from vibroswarm.league.fronts import front_table
from vibroswarm.league.standings import League, Standings
from vibroswarm.scenario.fault_fields import FAULTS
from vibroswarm.study.runner import Progress
from vibroswarm.study.spec import Study


def league_tables(standings: Standings, reference: str | None = None) -> dict[str, pl.DataFrame]:
    """Compute the tables of a league that need no further runs.

    Args:
        reference: label of the entry with which others are compared, or name of its strategy; by default the first.
    Returns: "fronts" (from ``front_table``), "best" (from ``best_table``), "standings" and "floors" of ``Standings``;
        of its ``main`` entries "differences" and "floor_differences"; and "maps" if robots keep maps.
    Raises:
        InputError: there is no such entry.
    """
    main, maps = standings.main, standings.maps
    return {
        "fronts": front_table(standings),
        "best": best_table(standings),
        "standings": standings.table,
        "differences": main.differences(reference),
        "floor_differences": main.floor_differences(reference),
        "floors": standings.floor_table,
    } | ({"maps": maps} if maps.height else {})


def further_tables(
    basic: League,
    folder: Path | None,
    stage: Callable[[str], AbstractContextManager[Progress]],
    *,
    belief_runs: int = 100,
    fault_runs: int = 100,
    kinds: Sequence[str] = KINDS,
    **how: Any,
) -> dict[str, pl.DataFrame]:
    """Simulate what is tested besides a league: "beliefs" and "faults", each missing if none of its runs are wanted.

    Args:
        basic: the league with one entry for each strategy. folder: of the league, which saves these runs too; None:
            they are not saved. stage: returns the context of a stage by its name, whose value is called with progress.
        belief_runs, fault_runs, kinds, how: as of ``belief_calibration`` and ``fault_curves``.
    """
    tables = {}
    if belief_runs:
        saved = None if folder is None else folder / BELIEFS
        with stage("comparing beliefs") as progress:
            tables["beliefs"] = belief_calibration(basic, saved, runs=belief_runs, progress=progress, **how)
    if fault_runs:
        saved = None if folder is None else folder / FOLDER
        with stage("with faulty robots") as progress:
            tables["faults"] = fault_curves(
                basic, saved, kinds=kinds, runs=fault_runs, progress=progress, **how
            )
    return tables


def studies_of_tests(
    basic: League, belief_runs: int, fault_runs: int, kinds: Sequence[str] = KINDS
) -> dict[str, Study]:
    """Return the studies that ``further_tables`` runs, by the name of their folder in that of the league."""
    leagues = {}
    if belief_runs:
        leagues[BELIEFS] = belief_league(basic, belief_runs)
    if fault_runs and (most := most_faulty(basic)):
        leagues[FOLDER] = league_with_faults(basic, kinds, most, fault_runs)
    return {name: league.study for name, league in leagues.items() if league.entries}


def check_tests(
    league: League, reference: str | None, belief_runs: int, fault_runs: int, kinds: Sequence[str] | None
) -> None:
    """Refuse a reference that does not play, and tests that do not fit a league, before anything is simulated.

    Args:
        kinds: of faults that were asked for; None: the usual ones, of which a swarm of one robot has none.
    """
    reference_in(main_entries(league.entries), reference, "--reference")
    for kind in kinds or ():
        check_choice(kind, "--faults", FAULTS)
    if kinds and not fault_runs:
        raise InputError(
            "there are no runs with faults: with --fault-runs 0, or on several kinds of tile",
            field="--faults",
        )
    if kinds and fault_runs and min(league.robots) == 1:
        raise InputError(
            "needs swarms of at least 2 robots, one of which works; see --robots", field="--faults"
        )
    if (belief_runs or fault_runs) and league.boundaries != {0.5}:
        raise InputError(
            "must be 0.5 to compare beliefs and faults; add --belief-runs 0 --fault-runs 0",
            field="decision.decision_boundary",
        )
