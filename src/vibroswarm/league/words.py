"""A league from the words of ``vibroswarm league``, so that Python plays the same league with the same words::

asked = league_of(strategy=["none", "soft"], robots=[5], runs=1000)
standings, tables = played(asked)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple, Unpack

import polars as pl

from vibroswarm.core.stages import SILENT, Stages
from vibroswarm.errors import InputError, in_file
from vibroswarm.league.belief_calibration import BELIEFS, belief_calibration, belief_league
from vibroswarm.league.entries import (
    FILLS,
    PATTERNS,
    SIZE,
    Entry,
    LeagueFloor,
    default_strategies,
    entries_of,
    floors_of,
    floors_of_kinds,
    frozen_settings,
    main_entries,
    read_settings,
    reference_in,
    varied_by,
)
from vibroswarm.league.fronts import best_table, front_table
from vibroswarm.league.standings import League, Standings
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.study.options import (
    ScenarioOptions,
    chosen,
    scenario_of,
    several,
)
from vibroswarm.study.spec import Study


class Players(NamedTuple):
    """What a league is about, whatever the settings of its strategies."""

    names: list[str]
    """Strategies, as scenarios name them."""
    base: Scenario
    floors: tuple[LeagueFloor, ...]
    robots: tuple[int, ...]
    note: str = ""
    """What was chosen because no word says it; empty: nothing."""


class Asked(NamedTuple):
    """A league to be played."""

    league: League
    """With settings for several forced errors, and those that are varied."""
    basic: League
    """The same with one entry for each strategy, on which beliefs are tested."""
    note: str = ""
    """As of ``Players``."""


def players_of(
    *,
    patterns: Sequence[str] | None = None,
    fills: Sequence[float] | None = None,
    shares: Sequence[float] | None = None,
    **scenario: Unpack[ScenarioOptions],
) -> Players:
    """Return the strategies, the base scenario, the floors and the swarm sizes that words describe.

    Args:
        patterns, fills: as of ``floors_of``. shares: of several kinds of tile, in their place (``floors_of_kinds``).
        scenario: of its strategies and numbers of robots, each plays.
    Raises:
        InputError: a floor is given, or the value of a word is wrong.
    """
    for option in ("floor", "tiles"):
        if scenario.get(option) is not None:
            raise InputError("is not for a league; use --patterns and --fills", field=f"--{option}")
    kinds = 2 if shares is None else len(shares)
    note = ""
    if shares is None:
        floors = floors_of(patterns or PATTERNS, fills or FILLS)
    elif patterns or fills:
        raise InputError("conflicts with --patterns and --fills; use one of them", field="--shares")
    else:
        floors = floors_of_kinds(shares)
        scenario, note = _with_kinds(scenario, kinds)
    strategies, robots = scenario.get("strategy"), scenario.get("robots")
    names = [
        chosen("strategy", name)
        for name in several(strategies) or default_strategies(*([kinds] if shares else []))
    ]
    own: ScenarioOptions = {**scenario, "strategy": None, "robots": several(robots)[:1]}
    if shares is not None:
        tiles = f"{SIZE['floor.rows']}x{SIZE['floor.columns']}"
        own |= {"strategy": names[0], "floor": floors[0].source, "tiles": tiles}
    base = scenario_of(**own)
    if shares is not None and base.sensor.kinds != kinds:
        raise InputError(
            f"has {kinds} shares, and the sensor '{base.sensor.model}' knows {base.sensor.kinds} kinds of tile; "
            "add --set sensor.model=confusion and --set sensor.confusion.kinds=...",
            field="--shares",
        )
    return Players(names, base, floors, tuple(several(robots)) or (5, 10), note)


def _with_kinds(scenario: ScenarioOptions, kinds: int) -> tuple[ScenarioOptions, str]:
    """Return words with a sensor of as many kinds, and a task, where they name none; and a note of what was added."""
    settings = [*scenario.get("settings", ())]
    named = {setting.partition("=")[0].strip() for setting in settings}
    has_base = scenario.get("preset") is not None or scenario.get("scenario") is not None
    notes = []
    if not has_base and scenario.get("energies") is None and not any(n.startswith("sensor.") for n in named):
        added = ["sensor.model=confusion", f"sensor.confusion.kinds={kinds}"]
        settings += added
        notes += [f"--set {setting}" for setting in added]
    task = scenario.get("task")
    if not has_base and task is None and "task.name" not in named:
        task = "majority"
        notes.append("--task majority")
    note = f"--shares without a sensor or a task of {kinds} kinds: with {' '.join(notes)}." if notes else ""
    return {**scenario, "settings": settings, "task": task}, note


def league_of(
    *,
    runs: int = 300,
    seed: int = 1,
    settings_file: Path | None = None,
    untuned: bool = False,
    own_motion: bool = False,
    vary: Sequence[str] = (),
    **players: Any,
) -> Asked:
    """Return the league that words describe.

    Args:
        settings_file: fields that each strategy sets; None: those that ship. untuned: no fields are set, so that
            entries have the scenario's settings, or else their strategies' defaults. own_motion: the settings that ship
            and set each strategy's motion too. vary: as of ``varied_by``. players: as of ``players_of``.
    Raises:
        InputError: words conflict, or a strategy or setting is unknown or wrong.
    """
    if own_motion and (untuned or settings_file is not None):
        raise InputError("conflicts with --untuned and --settings; use one of them", field="--own-motion")
    if untuned and settings_file is not None:
        raise InputError("conflicts with --settings; use one of them", field="--untuned")
    names, base, floors, robots, note = players_of(**players)
    if settings_file is not None:
        entries = _entries_in(settings_file, names, base)
    else:
        entries = entries_of(names, {} if untuned else frozen_settings(own_motion))
    basic = League(base, main_entries(entries), floors, robots, runs=runs, seed=seed)
    for text in vary:
        entries = varied_by(entries, text)
    return Asked(replace(basic, entries=entries), basic, note)


def _scenario_of(entry: Entry, base: Scenario) -> Scenario:
    return base.with_values({**SIZE, "strategy.name": entry.code or entry.strategy, **entry.settings})


def _entries_in(path: Path, names: Sequence[str], base: Scenario) -> tuple[Entry, ...]:
    """Return the entries of a file of settings, each of which goes together with the base."""
    settings = read_settings(path)
    with in_file(path):
        entries = entries_of(names, settings)
        for entry in entries:
            _scenario_of(entry, base)
    return entries


def played(
    asked: Asked,
    folder: Path | None = None,
    *,
    reference: str | None = None,
    belief_runs: int = 100,
    stages: Stages = SILENT,
    **where: Any,
) -> tuple[Standings, dict[str, pl.DataFrame]]:
    """Play a league and test its strategies' beliefs; return the standings and all tables.

    Args:
        folder: where runs are saved; None: nowhere. reference: as of ``league_tables``.
        belief_runs: as of ``belief_runs_of``. stages: told what is done. where: as of ``study.run.run``.
    Returns: the tables of ``league_tables``, and "beliefs", which is missing if none of its runs are wanted.
    """
    belief_runs = belief_runs_of(asked, reference, belief_runs)
    with stages.runs("simulating") as progress:
        standings = asked.league.play(folder, progress=progress, **where)
    tables = league_tables(standings, reference)
    if belief_runs:
        saved = None if folder is None else folder / BELIEFS
        with stages.runs("comparing beliefs") as progress:
            tables["beliefs"] = belief_calibration(
                asked.basic, saved, runs=belief_runs, progress=progress, **where
            )
    return standings, tables


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


def belief_runs_of(asked: Asked, reference: str | None, belief_runs: int) -> int:
    """Return the runs of the test of beliefs; 0 of several kinds of tile, since beliefs are those of two.

    Args:
        belief_runs: that are wanted; 0: none.
    Raises:
        InputError: the reference does not play, or the test does not fit the league.
    """
    league = asked.league
    if league.base.sensor.kinds != 2:
        belief_runs = 0
    reference_in(main_entries(league.entries), reference, "--reference")
    if belief_runs and league.boundaries != {0.5}:
        raise InputError(
            "must be 0.5 to compare beliefs; add --belief-runs 0", field="decision.decision_boundary"
        )
    return belief_runs


def studies_of_tests(basic: League, belief_runs: int) -> dict[str, Study]:
    """Return the study of the test that ``played`` makes, by the name of its folder in that of the league."""
    league = belief_league(basic, belief_runs) if belief_runs else None
    return {BELIEFS: league.study} if league and league.entries else {}
