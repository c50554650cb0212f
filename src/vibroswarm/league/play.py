"""A league: strategies that are compared on the same floors, motion, readings and radio, but for fields that they set.

standings = play(league_of(strategy=["none", "soft"], robots=[5], runs=1000))
standings.tables["fronts"]
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Unpack

import polars as pl

from vibroswarm.errors import InputError
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
    read_settings,
    shipped_settings,
    varied_by,
)
from vibroswarm.league.fronts import front_table
from vibroswarm.league.standings import belief_table, cell_table, difference_table, standing_table, units_of
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.study.cells import LABEL
from vibroswarm.study.options import ScenarioOptions, chosen, scenario_of, several
from vibroswarm.study.runs import Runs
from vibroswarm.study.spec import Study


@dataclass(frozen=True)
class League:
    """What is played."""

    base: Scenario
    """Scenario with all fields that entries do not set."""
    entries: tuple[Entry, ...]
    floors: tuple[LeagueFloor, ...]
    """Floors on which every entry runs; all count the same in averages."""
    robots: tuple[int, ...] = (5, 10)
    """Swarm sizes with which every entry runs."""
    runs: int = 300
    """Number of runs of each entry, floor and swarm size."""
    seed: int = 1

    @cached_property
    def study(self) -> Study:
        """The study of all cells."""
        points = [{LABEL: one.name, "strategy.name": one.strategy, **one.settings} for one in self.entries]
        grid = {"floor.source": [one.source for one in self.floors], "swarm.robots": list(self.robots)}
        floors = {one.source: one.tiles for one in self.floors if one.tiles is not None}
        return Study(
            self.base.with_values(SIZE), {"list": points, "grid": grid},
            runs=self.runs, seed=self.seed, floors=floors, name="League",
        )  # fmt: skip


@dataclass(frozen=True)
class Standings:
    """The results of a league."""

    league: League
    runs: Runs
    tables: Mapping[str, pl.DataFrame]
    """``fronts``, ``standings``, ``differences``, ``beliefs``; ``fronts_by``, ``standings_by`` if wanted."""


def league_of(
    *,
    patterns: Sequence[str] | None = None,
    fills: Sequence[float] | None = None,
    shares: Sequence[float] | None = None,
    runs: int = 300,
    seed: int = 1,
    settings_file: Path | None = None,
    untuned: bool = False,
    own_motion: bool = False,
    vary: Sequence[str] = (),
    **scenario: Unpack[ScenarioOptions],
) -> League:
    """Return the league that options describe.

    Args:
        patterns, fills: see ``floors_of``. shares: of several kinds of tile, in their place. settings_file: None: those
            that ship, or with ``own_motion`` those that set motion too; untuned: none. vary: see ``varied_by``.
    """
    if scenario.get("floor") or scenario.get("tiles"):
        raise InputError("cannot be used with a league; use --patterns and --fills", field="--floor")
    strategies = several(scenario.get("strategy")) or default_strategies(len(shares or "ab"))
    names = [chosen("strategy", name) for name in strategies]
    floors = floors_of_kinds(shares) if shares else floors_of(patterns or PATTERNS, fills or FILLS)
    robots = several(scenario.get("robots"))
    options: ScenarioOptions = {**scenario, "strategy": None, "robots": robots[:1]}
    if shares:
        options |= {"strategy": names[0], "floor": floors[0].source, "tiles": "10x10"}
        if not (scenario.get("preset") or scenario.get("scenario") or scenario.get("energies")):
            sensor = ["sensor.model=confusion", f"sensor.confusion.kinds={len(shares)}"]
            options["settings"] = [*sensor, *scenario.get("settings", ())]
            options["task"] = scenario.get("task") or "majority"
    settings = read_settings(settings_file) if settings_file else shipped_settings(own_motion)
    entries = entries_of(names, {} if untuned else settings)
    for text in vary:
        entries = varied_by(entries, text)
    return League(scenario_of(**options), entries, floors, robots or (5, 10), runs, seed)


def play(
    league: League,
    folder: Path | None = None,
    *,
    by: Sequence[str] = (),
    reference: str | None = None,
    **how: Any,
) -> Standings:
    """Run what is missing in a folder, and compute the standings.

    Args:
        by: what has fronts and standings of its own: ``floor``, ``robots`` or both. reference: by default the first.
    """
    runs = league.study.run(folder, **how)
    runs.check_complete()
    cells = cell_table(runs.cells, league.entries, league.floors)
    units = units_of(runs, cells)
    tables = {
        "fronts": front_table(units),
        "standings": standing_table(units),
        "differences": difference_table(units, reference),
        "beliefs": belief_table(runs, cells),
    }
    if by:
        apart = units_of(runs, cells, by)
        tables |= {"fronts_by": front_table(apart, by), "standings_by": standing_table(apart, by)}
    return Standings(league, runs, tables)
