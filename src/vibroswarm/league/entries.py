"""The entries of a league (strategies with their settings) and its floors.

A file of settings has one or several tables of scenario fields for each strategy; each table is an entry::

    [[soft]]
    forced_error = 0.161                 # what it had where it was chosen; not used
    "strategy.soft.eta" = 5000.0

The floors are each pattern of the paper at f and at 1 - f, there inverted, so that no strategy gains by leaning to one
side. A floor and its mirror count as one floor in all tables.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any, Final, NamedTuple

from vibroswarm.core.numbers import stated
from vibroswarm.core.untrusted_files import parsed_toml, read_text
from vibroswarm.errors import InputError, check_choice
from vibroswarm.floors.source import is_random, resolve, source_of
from vibroswarm.scenario.scenario import parse_values
from vibroswarm.strategies import known
from vibroswarm.strategies.static_analysis import reads_places
from vibroswarm.study.runs import plain_of

PATTERNS: Final = ("random", "diagonal", "stripe", "block-diagonal", "alternating")
"""Names of the patterns of a league's floors."""
SIZE: Final = {"floor.rows": 10, "floor.columns": 10, "floor.tiles": None}
"""Grid of random floors, the same as that of the patterns."""
FILLS: Final = (0.46, 0.48)
"""Fill ratios below 1/2; a league also has their mirrors 1 - f."""
GUESSING: Final = ("dc", "dmvd", "dmmd")
"""Strategies that play only when named: made for readings at every control step, they guess on a league's floors."""
FOR_CHANGES: Final = ("forget", "reset", "fading")
"""Strategies for floors that change; the floors of a league stay as they are."""


class Entry(NamedTuple):
    """A strategy and the scenario fields that it sets."""

    name: str
    """Name of the entry in tables."""
    strategy: str
    """As a scenario names it: a name, or a file and class."""
    settings: Mapping[str, Any] = {}
    """Values of scenario fields, by dotted name."""


class LeagueFloor(NamedTuple):
    """A floor on which all strategies run."""

    name: str
    """Pattern and fill ratio; a floor and its mirror have the same."""
    source: str
    """Value of the scenario field ``floor.source``."""
    tiles: tuple[str, ...] | None = None
    """Rows of 0 and 1 from the top, if ``source`` is not a known pattern, so that the study has to define it."""


def default_strategies(kinds: int = 2) -> list[str]:
    """Return the strategies of a league: none that guess, know places, or are for changes or other kinds."""
    if kinds > 2:
        return [name for name, strategy in known().items() if strategy.answers_kinds]
    return [
        name
        for name, strategy in known().items()
        if not (name in GUESSING + FOR_CHANGES or strategy.answers_kinds or reads_places(strategy))
    ]


def entries_of(strategies: Sequence[str], settings: Mapping[str, Any]) -> tuple[Entry, ...]:
    """Return the entries of each strategy: one for each of its tables of settings, or one without settings."""
    entries = []
    for strategy in strategies:
        name = plain_of(strategy)
        tables = settings.get(name, {})
        tables = tables if isinstance(tables, list) else [tables]
        for number, table in enumerate(tables, 1):
            fields = {field: value for field, value in table.items() if field != "forced_error"}
            entries.append(Entry(f"{name} {number}" if len(tables) > 1 else name, strategy, fields))
    return tuple(entries)


def varied_by(entries: Sequence[Entry], text: str) -> tuple[Entry, ...]:
    """Replace entries by one for each value of ``[STRATEGY:]FIELD=A,B``, with the value in their names."""
    name, values = parse_values(text, "[strategy:]section.field=value,value")
    strategy, only_one, field = name.rpartition(":")
    if only_one:
        check_choice(strategy, "vary", dict.fromkeys(plain_of(entry.strategy) for entry in entries))
    varied = []
    for entry in entries:
        is_varied = not only_one or plain_of(entry.strategy) == strategy
        for value in values if is_varied else ():
            label = f"{field.rpartition('.')[2]} {stated(value) if isinstance(value, float) else value}"
            # "soft (eta 1500)", and with a second field "soft (eta 1500, kappa 2)"
            start = f"{entry.name[:-1]}, " if entry.name.endswith(")") else f"{entry.name} ("
            varied.append(Entry(f"{start}{label})", entry.strategy, {**entry.settings, field: value}))
        if not is_varied:
            varied.append(entry)
    return tuple(varied)


def shipped_settings(own_motion: bool = False) -> dict[str, Any]:
    """Return the settings by strategy that are part of the package; the file says how they were chosen."""
    name = "settings_own_motion.toml" if own_motion else "settings.toml"
    return parsed_toml(files("vibroswarm.league").joinpath(name).read_text(encoding="utf-8"), name)


def read_settings(path: Path) -> dict[str, Any]:
    """Read a file of settings."""
    return parsed_toml(read_text(path, "a file of settings"), str(path))


def floors_of(patterns: Sequence[str] = PATTERNS, fills: Sequence[float] = FILLS) -> tuple[LeagueFloor, ...]:
    """Return the floors of a league: each of ``PATTERNS`` at each fill ratio f below 1/2 and at 1 - f."""
    floors: list[LeagueFloor] = []
    for pattern in patterns:
        check_choice(pattern, "patterns", PATTERNS)
        for fill in fills:
            if not 0.0 < fill < 0.5:
                raise InputError(f"must be below 0.5, not {fill:g}; mirrors are added", field="fills")
            source, above, inverse = source_of(pattern, fill), source_of(pattern, 1.0 - fill), None
            if not is_random(source):  # each run draws its own random floor, so there is none to invert
                inverse = tuple("".join(map(str, row)) for row in 1 - resolve(source, None)[0])
                above = f"inverse-{above.replace(':', '-')}"
            name = f"{pattern} {stated(fill)}"
            floors += [LeagueFloor(name, source), LeagueFloor(name, above, inverse)]
    return tuple(floors)


def floors_of_kinds(shares: Sequence[float]) -> tuple[LeagueFloor, ...]:
    """Return random floors of several kinds of tile, each kind having each of the different shares once."""
    name = f"random {','.join(map(stated, shares))}"
    turned = ([*shares[-k:], *shares[:-k]] if k else shares for k in range(len(shares)))
    return tuple(LeagueFloor(name, source_of("random", *each)) for each in turned)
