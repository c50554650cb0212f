"""Define the entries of a league (strategies with their settings) and its floors.

A league compares strategies on the same floors. A file of settings has one table of scenario fields for each strategy::

    [none]
    "decision.credible_threshold" = 0.9
    [totals]
    "strategy.totals.threshold" = 2.5

Each strategy runs with these settings; all other fields are those of the base scenario. A strategy may have several
tables, of which each is an entry: those that ``tuning`` finds lie along a front, and ``forced_error`` says where::

    [[soft]]
    forced_error = 0.161
    "strategy.soft.eta" = 5000.0

The floors are each pattern of the paper at f and at 1 - f, for the two fill ratios f of the paper. A patterned floor
above 1/2 is the inverse of the floor below: its vibrating tiles are still, and vice versa. So no strategy gains by
leaning to one side, and the number of tiles that must change to cross the boundary is the same on both sides.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.numbers import percent, stated
from vibroswarm.core.untrusted_files import parsed_toml, read_text
from vibroswarm.errors import InputError, check_choice, check_known_keys, named, number_of
from vibroswarm.floors.source import is_random, resolve, source_of
from vibroswarm.scenario import plugins
from vibroswarm.scenario.scenario import field_types, parse_values
from vibroswarm.strategies import known
from vibroswarm.strategies.static_analysis import told

PATTERNS: Final = ("random", "diagonal", "stripe", "block-diagonal", "alternating")
"""Names of the patterns of a league's floors."""
ROWS, COLUMNS = 10, 10
SIZE: Final = {"floor.rows": ROWS, "floor.columns": COLUMNS, "floor.tiles": None}
"""Grid of random floors, the same as that of the patterns."""
FILLS: Final = (0.46, 0.48)
"""Fill ratios below 1/2; a league also has their mirrors 1 - f."""
AIM: Final = "forced_error"
"""Key of a table of settings for the forced error that it had when it was tuned."""
MAIN_AIM: Final = 0.16
"""The settings nearest to this forced error stand for a strategy where it plays with one setting. On the floors of a
league it is near the least forced error that most strategies reach."""


@dataclass(frozen=True)
class Entry:
    """A strategy and the scenario fields that it sets."""

    label: str
    """Name of the entry in tables."""
    strategy: str
    """Name of the strategy."""
    settings: Mapping[str, Any]
    """Values of scenario fields, by dotted name."""
    tuned: bool = False
    """Whether settings for this strategy were given."""
    aim: float | None = None
    """Forced error of the settings when they were tuned; None: not known."""
    code: str | None = None
    """Code of a user's strategy, as a scenario names it (a file and class); None: the strategy is known by its name."""


@dataclass(frozen=True)
class LeagueFloor:
    """A floor on which all strategies run."""

    pattern: str
    """One of ``PATTERNS``."""
    fill_ratio: float
    """Share of the tiles that vibrate."""
    source: str
    """Value of the scenario field ``floor.source``."""
    tiles: tuple[str, ...] | None = None
    """Rows of 0 and 1 from the top, if ``source`` is not a known pattern, so that the study has to define it."""


GUESSING: Final = ("dc", "dmvd", "dmmd")
"""Strategies that play in a league only when named: on its floors they guess, whatever their settings (``best.GUESS``).
They were made for nearly noiseless readings at every control step; here a reading comes every few seconds."""
FOR_CHANGES: Final = ("forget", "reset", "fading")
"""Strategies for floors that change; the floors of a league stay as they are."""


def default_strategies(kinds: int = 2) -> list[str]:
    """Return the names of the strategies that a league compares by default, with this number of kinds of tile.

    Left out are those that guess (``GUESSING``), those for floors that change, those for several kinds of tile, which
    are others of the league where there are two, and those that use the places of their readings: their robots must
    know where they are, so they do not compete on equal terms.
    """
    # `told` lists what a robot knows in advance, and the place of each reading if the strategy uses it. `boundary_of`
    # (the field decision.boundary_of) only affects whether the sensor's error rates are listed, so any value will do.
    if kinds > 2:
        return [name for name, strategy in known().items() if strategy.answers_kinds]
    return [
        name
        for name, strategy in known().items()
        if name not in (*GUESSING, *FOR_CHANGES)
        and not strategy.answers_kinds
        and "place of each reading" not in told(strategy, boundary_of="tiles")
    ]


Settings = Mapping[str, Mapping[str, Any] | Sequence[Mapping[str, Any]]]
"""Tables of scenario fields by strategy, one or several of each, as in a file of settings."""


def entries_of(names: Sequence[str], settings: Settings) -> tuple[Entry, ...]:
    """Return the entries of each strategy: one for each of its tables of settings, or one without settings.

    Args:
        names: of strategies, each once; or names of code (a file and class) that was loaded by ``plugins.load_file``.
        settings: tables of fields by strategy, as in a file of settings; tables of strategies that are not among
            ``names`` are ignored.
    Raises:
        InputError: a strategy is unknown or occurs twice, or a field is unknown.
    """
    # For each strategy's own name, the name as it was given (which for code is a file and class).
    codes = {plugins.name_in(name) if plugins.is_code(name) else name: name for name in names}
    if len(codes) < len(names):
        raise InputError("a strategy occurs twice", field="strategy")
    fields = field_types()
    found: list[Entry] = []
    for name, given in codes.items():
        check_choice(name, "strategy", plugins.known_for("strategy", name))
        several = tables_of(settings.get(name, {}))
        for number, table in enumerate(several):
            values = dict(table)
            aim = _aim_in(values, name)
            check_known_keys(values, f"settings of {name}", fields)
            found.append(
                Entry(
                    label=_label(name, aim, number if len(several) > 1 else None),
                    strategy=name,
                    settings=values,
                    tuned=name in settings,
                    aim=aim,
                    code=given if plugins.is_code(given) else None,
                )
            )
    return tuple(found)


def tables_of(given: Mapping[str, Any] | Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Return the tables of a strategy in settings, of which it may have one or several."""
    return [given] if isinstance(given, Mapping) else [*given]


def _aim_in(table: dict[str, Any], name: str) -> float | None:
    """Remove ``AIM`` from a table of settings of a strategy, and return its value; None if there is none."""
    if AIM not in table:
        return None
    return number_of(table.pop(AIM), f"settings of {name}.{AIM}", 0.0, 0.5)


def _label(name: str, aim: float | None, number: int | None) -> str:
    """Return the label of an entry of a strategy; ``number``: its place among several tables, from 0."""
    if aim is None:
        return name if number is None else f"{name} {number + 1}"
    return f"{name} {percent(aim)}"


def main_entries(entries: Sequence[Entry], error: float = MAIN_AIM) -> tuple[Entry, ...]:
    """Return the entries without an aim, and of each strategy with aims those whose aim is nearest to an error."""
    nearest: dict[str, float] = {}
    for entry in entries:
        if entry.aim is not None:
            found = nearest.get(entry.strategy, entry.aim)
            nearest[entry.strategy] = min(found, entry.aim, key=lambda aim: abs(aim - error))
    return tuple(entry for entry in entries if entry.aim is None or entry.aim == nearest[entry.strategy])


def reference_in(entries: Sequence[Entry], reference: str | None, field: str = "reference") -> str:
    """Return the label of the entry that others are compared with.

    Args:
        reference: its label, or the name of its strategy, of which the first entry is taken; None: the first of all.
        field: for the error.
    Raises:
        InputError: no entry is so named.
    """
    labels = {entry.label: entry.label for entry in entries}
    for entry in entries:
        labels.setdefault(entry.strategy, entry.label)
    if reference is None:
        return entries[0].label
    check_choice(reference, field, labels)
    return labels[reference]


def varied_by(entries: Sequence[Entry], text: str) -> tuple[Entry, ...]:
    """Replace each entry by several, one for each value of a field, with the value in their labels.

    Args:
        text: ``FIELD=A,B`` varies all entries, ``STRATEGY:FIELD=A,B`` those of one strategy.
    Returns: the entries in the given order, with its replacements in place of each entry that is replaced.
    Raises:
        InputError: the text is not of this form, its field is unknown, or no entry has its strategy.
    """
    name, values = parse_values(text, "[strategy:]section.field=value,value")
    strategy, only_one, field = name.rpartition(":")
    check_known_keys([field], "vary", field_types())
    if only_one:
        check_choice(strategy, "vary", dict.fromkeys(entry.strategy for entry in entries))
    found: list[Entry] = []
    for entry in entries:
        if only_one and entry.strategy != strategy:
            found.append(entry)
            continue
        for value in values:
            word = stated(value) if isinstance(value, float) else str(value)
            setting = f"{field.rpartition('.')[2]} {word}"
            # "soft (eta 1500)", and with a second field "soft (eta 1500, kappa 2)".
            has_settings = entry.label.endswith(")")
            label = f"{entry.label[:-1]}, {setting})" if has_settings else f"{entry.label} ({setting})"
            found.append(replace(entry, label=label, settings={**entry.settings, field: value}))
    return tuple(found)


def frozen_settings(own_motion: bool = False) -> dict[str, Any]:
    """Return the settings by strategy that are part of the package; the file says how they were found.

    Args:
        own_motion: whether to return the settings that also set each strategy's motion.
    """
    return shipped("settings_own_motion.toml" if own_motion else "settings.toml")


def shipped(name: str) -> dict[str, Any]:
    """Read a TOML file of tables that is part of the package."""
    return parsed_toml(files("vibroswarm.league").joinpath(name).read_text(encoding="utf-8"), name)


def read_settings(path: Path) -> dict[str, Any]:
    """Read a file of settings: one or several tables of fields for each strategy.

    Raises:
        InputError: the file cannot be read, or is not a TOML file of tables.
    """
    settings = parsed_toml(read_text(path, "a file of settings"), str(path))
    for name, table in settings.items():
        tables = table if isinstance(table, list) and table else [table]
        if not all(isinstance(one, dict) for one in tables):
            raise InputError(
                "must be the table of a strategy's fields, such as [none]", field=f"{path}: {name}"
            )
    return settings


def floors_of(patterns: Sequence[str] = PATTERNS, fills: Sequence[float] = FILLS) -> tuple[LeagueFloor, ...]:
    """Return the floors of a league: each pattern at each fill ratio f and at 1 - f.

    Args:
        patterns: names from ``PATTERNS``. fills: fill ratios f, below 1/2.
    Raises:
        InputError: an unknown pattern, a fill ratio that the pattern does not have, or one that is not below 1/2.
    """
    found: list[LeagueFloor] = []
    for name in patterns:
        check_choice(name, "patterns", PATTERNS)
        for fill in fills:
            if not 0.0 < fill < 0.5:
                raise InputError(
                    f"{fill:g} is not between 0 and 0.5; give fill ratios below 1/2, to which mirrors are added",
                    field="fills",
                )
            source, above, inverse = source_of(name, fill), source_of(name, 1.0 - fill), None
            tiles = _tiles_of(source)
            if not is_random(source):  # each run draws its own random floor, so there is none to invert
                inverse = tuple("".join(map(str, row)) for row in 1 - tiles)
                above = f"inverse-{above.replace(':', '-')}"
            found += [
                LeagueFloor(pattern=name, fill_ratio=fill, source=source),
                # ``round``: in floating point 1 - f may differ a little from the decimal number.
                LeagueFloor(pattern=name, fill_ratio=round(1.0 - fill, 6), source=above, tiles=inverse),
            ]
    return tuple(found)


def _tiles_of(source: str) -> NDArray[np.uint8]:
    with named("fills"):
        return resolve(source, (ROWS, COLUMNS) if is_random(source) else None)[0]


def floors_of_kinds(shares: Sequence[float]) -> tuple[LeagueFloor, ...]:
    """Return the floors of a league of several kinds of tile: random ones, each kind having each share once.

    Args:
        shares: of the kinds, which sum to 1 and differ, so that one kind is the most common.
    Raises:
        InputError: two shares are equal, or there are fewer than three.
    """
    if len(shares) < 3 or len(set(shares)) < len(shares):
        raise InputError(
            "give three shares or more that differ, such as 0.4,0.36,0.24; with two kinds use --fills",
            field="--shares",
        )
    turned = ([*shares[-k:], *shares[:-k]] if k else [*shares] for k in range(len(shares)))
    sources = [(source_of("random", *one), one[1]) for one in turned]
    return tuple(LeagueFloor(pattern="random", fill_ratio=share, source=source) for source, share in sources)
