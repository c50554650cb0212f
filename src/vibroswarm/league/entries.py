"""Define the entries of a league (strategies with their settings) and its floors.

A league compares strategies on the same floors. A file of settings has one table of scenario fields for each strategy::

    [none]
    "decision.credible_threshold" = 0.9
    [totals]
    "strategy.totals.threshold" = 2.5

Each strategy runs with these settings; all other fields are those of the base scenario.

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

from vibroswarm.analysis.forced_error import front_settings
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.core.untrusted_files import parsed_toml, read_text
from vibroswarm.errors import InputError, check_choice
from vibroswarm.floors.source import is_random, pattern
from vibroswarm.scenario import plugins
from vibroswarm.scenario.scenario import field_names

PATTERNS: Final = ("random", "diagonal", "stripe", "block-diagonal", "alternating")
"""Names of the patterns of a league's floors."""
SIZE: Final = {"floor.rows": 10, "floor.columns": 10, "floor.tiles": None}
"""Grid of random floors, the same as that of the patterns."""
FILLS: Final = (0.46, 0.48)
"""Fill ratios below 1/2; a league also has their mirrors 1 - f."""


@dataclass(frozen=True)
class Entry(NotebookView):
    """A strategy and the scenario fields that it sets."""

    label: str
    """Name of the entry in tables."""
    strategy: str
    """Name of the strategy."""
    settings: Mapping[str, Any]
    """Values of scenario fields, by dotted name."""
    tuned: bool = False
    """Whether settings for this strategy were given."""
    code: str | None = None
    """Code of a user's strategy, as a scenario names it (a file and class); None: the strategy is known by its name."""


@dataclass(frozen=True)
class LeagueFloor(NotebookView):
    """A floor on which all strategies run."""

    pattern: str
    """One of ``PATTERNS``."""
    fill_ratio: float
    """Share of the tiles that vibrate."""
    source: str
    """Value of the scenario field ``floor.source``."""
    tiles: tuple[str, ...] | None = None
    """Rows of 0 and 1 from the top, if ``source`` is not a known pattern, so that the study has to define it."""


def entries_of(names: Sequence[str], settings: Mapping[str, Mapping[str, Any]]) -> tuple[Entry, ...]:
    """Return one entry for each strategy.

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
    fields = field_names()
    for name in codes:
        check_choice(name, "strategy", plugins.known_for("strategy", name))
        for field in settings.get(name, {}):
            check_choice(field, f"settings of {name}", fields)
    return tuple(
        Entry(
            label=name,
            strategy=name,
            settings=dict(settings.get(name, {})),
            tuned=name in settings,
            code=given if plugins.is_code(given) else None,
        )
        for name, given in codes.items()
    )


def varied(
    entries: Sequence[Entry], strategy_name: str | None, field: str, values: Sequence[Any]
) -> tuple[Entry, ...]:
    """Replace each entry by several, one for each value of a field, with the value in their labels.

    Args:
        strategy_name: only entries of this strategy are replaced; None: all entries. field: dotted name of a scenario
            field. values: its values.
    Returns: the entries in the given order, with its replacements in place of each entry that is replaced.
    Raises:
        InputError: the field is unknown, or no entry has the strategy.
    """
    check_choice(field, "vary", field_names())
    if strategy_name is not None:
        check_choice(strategy_name, "vary", [entry.strategy for entry in entries])
    found: list[Entry] = []
    for entry in entries:
        if strategy_name not in (None, entry.strategy):
            found.append(entry)
            continue
        for value in values:
            word = f"{value:g}" if isinstance(value, float) else str(value)
            setting = f"{field.rpartition('.')[2]} {word}"
            # "soft (eta 1500)", and with a second field "soft (eta 1500, kappa 2)".
            has_settings = entry.label.endswith(")")
            label = f"{entry.label[:-1]}, {setting})" if has_settings else f"{entry.label} ({setting})"
            found.append(replace(entry, label=label, settings={**entry.settings, field: value}))
    return tuple(found)


def with_fronts(entries: Sequence[Entry]) -> tuple[Entry, ...]:
    """Replace each entry by one entry for each combination of the values that ``front_settings`` has for its strategy.

    Entries of strategies that ``front_settings`` does not have stay as they are.
    """
    fronts = front_settings()
    found = tuple(entries)
    for name in {entry.strategy for entry in entries} & set(fronts):
        for field, values in fronts[name].items():
            found = varied(found, name, field, values)
    return found


def frozen_settings(own_motion: bool = False) -> dict[str, dict[str, Any]]:
    """Return the settings by strategy that are part of the package; the file says how they were found.

    Args:
        own_motion: whether to return the settings that also set each strategy's motion.
    """
    return shipped("settings_own_motion.toml" if own_motion else "settings.toml")


def shipped(name: str) -> dict[str, dict[str, Any]]:
    """Read a TOML file of tables that is part of the package."""
    return parsed_toml(files("vibroswarm.league").joinpath(name).read_text(encoding="utf-8"), name)


def read_settings(path: Path) -> dict[str, dict[str, Any]]:
    """Read a file of settings: a table of fields for each strategy.

    Raises:
        InputError: the file cannot be read, or is not a TOML file of tables.
    """
    settings = parsed_toml(read_text(path, "a file of settings"), str(path))
    for name, table in settings.items():
        if not isinstance(table, dict):
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
            source = f"{name}:{fill:g}"
            # ``round``: in floating point 1 - f may differ a little from the decimal number.
            fill_above = round(1.0 - fill, 6)
            found.append(LeagueFloor(pattern=name, fill_ratio=fill, source=source))
            if is_random(source):  # each run draws its own floor, so there is none to invert
                above = f"{name}:{1.0 - fill:g}"
                found.append(LeagueFloor(pattern=name, fill_ratio=fill_above, source=above))
                continue
            inverse = tuple("".join(map(str, row)) for row in 1 - pattern(source))
            above = f"inverse-{name}-{1.0 - fill:g}"
            found.append(LeagueFloor(pattern=name, fill_ratio=fill_above, source=above, tiles=inverse))
    return tuple(found)
