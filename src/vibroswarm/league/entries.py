"""Who takes part in a league, with which settings, and on which floors.

The settings of a file are tables of fields, one for each strategy::

    [none]
    "decision.credible_threshold" = 0.9
    [totals]
    "strategy.totals.threshold" = 2.5

Each strategy plays at those settings, and at the base scenario's for every other field.

Floors: each pattern of the paper at f and at 1 - f, for the two fill ratios f that the paper has. A floor above 1/2 is
the inverse of the one below: its vibrating tiles are still, and the reverse. So no strategy gains by leaning to one
side, and the number of tiles that must change to cross the boundary is the same on both.
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
from vibroswarm.strategies import strategy

PATTERNS: Final = ("random", "diagonal", "stripe", "block-diagonal", "alternating")
SIZE: Final = {"floor.rows": 10, "floor.columns": 10, "floor.tiles": None}
"""Of random floors: as many tiles as the patterns have."""
FILLS: Final = (0.46, 0.48)
"""Fill ratios below 1/2; each has its mirror above."""


@dataclass(frozen=True)
class Entry(NotebookView):
    """A strategy and the fields that it sets.

    Args:
        label: its name in tables. strategy: the strategy's name. settings: by field of the scenario.
        tuned: whether the settings were chosen for a league. code: of a user's strategy, as a scenario names it.
    """

    label: str
    strategy: str
    settings: Mapping[str, Any]
    tuned: bool = False
    code: str | None = None

    @property
    def bytes_on_air(self) -> int:
        """Bytes of one message."""
        return strategy(self.strategy).bytes_on_air


@dataclass(frozen=True)
class LeagueFloor(NotebookView):
    """A floor that all strategies meet.

    Args:
        pattern: of ``PATTERNS``. fill_ratio: share of its tiles that vibrate. source: as ``floor.source`` names it.
        tiles: rows of 0 and 1 from the top, if the study has to define it.
    """

    pattern: str
    fill_ratio: float
    source: str
    tiles: tuple[str, ...] | None = None


def entries_of(names: Sequence[str], settings: Mapping[str, Mapping[str, Any]]) -> tuple[Entry, ...]:
    """Return an entry for each strategy.

    Args:
        names: of strategies, each once; or code that is loaded (``plugins.load_file``). settings: by strategy, see
            above; those of other strategies are ignored.
    Raises:
        InputError: a strategy is unknown or occurs twice, or a field is unknown.
    """
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
            name,
            name,
            dict(settings.get(name, {})),
            name in settings,
            given if plugins.is_code(given) else None,
        )
        for name, given in codes.items()
    )


def varied(
    entries: Sequence[Entry], strategy_name: str | None, field: str, values: Sequence[Any]
) -> tuple[Entry, ...]:
    """Replace entries by one for each value of a field.

    Args:
        strategy_name: of this strategy's entries only; None: of all.
    Raises:
        InputError: the field is unknown, or the strategy does not take part.
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
            said = f"{field.rpartition('.')[2]} {word})"
            label = f"{entry.label[:-1]}, {said}" if entry.label.endswith(")") else f"{entry.label} ({said}"
            found.append(replace(entry, label=label, settings={**entry.settings, field: value}))
    return tuple(found)


def with_fronts(entries: Sequence[Entry]) -> tuple[Entry, ...]:
    """Replace entries whose strategies are in ``front_settings`` by one for each combination of the values there."""
    fronts = front_settings()
    found = tuple(entries)
    for name in {entry.strategy for entry in entries} & set(fronts):
        for field, values in fronts[name].items():
            found = varied(found, name, field, values)
    return found


def frozen_settings(own_motion: bool = False) -> dict[str, dict[str, Any]]:
    """Return the settings that ship with the package; the file says how they were found.

    Args:
        own_motion: those that set each strategy's motion too.
    """
    return shipped("settings_own_motion.toml" if own_motion else "settings.toml")


def shipped(name: str) -> dict[str, dict[str, Any]]:
    """Return a file of tables that ships with the package."""
    return parsed_toml(files("vibroswarm.league").joinpath(name).read_text(encoding="utf-8"), name)


def read_settings(path: Path) -> dict[str, dict[str, Any]]:
    """Read a file of settings.

    Raises:
        InputError: it is not a file of tables.
    """
    settings = parsed_toml(read_text(path, "a file of settings"), str(path))
    for name, table in settings.items():
        if not isinstance(table, dict):
            raise InputError("must be a table of fields: [none]", field=f"{path}: {name}")
    return settings


def floors_of(patterns: Sequence[str] = PATTERNS, fills: Sequence[float] = FILLS) -> tuple[LeagueFloor, ...]:
    """Return the floors of a league: each pattern at each fill ratio and at its mirror above 1/2.

    Raises:
        InputError: no such pattern, it does not exist at this fill ratio, or that is not below 1/2.
    """
    found: list[LeagueFloor] = []
    for name in patterns:
        check_choice(name, "patterns", PATTERNS)
        for fill in fills:
            if not 0.0 < fill < 0.5:
                raise InputError(f"{fill:g} is not between 0 and 0.5; its mirror is added", field="fills")
            source = f"{name}:{fill:g}"
            if is_random(source):
                above = f"{name}:{1.0 - fill:g}"
                found += [LeagueFloor(name, fill, source), LeagueFloor(name, round(1.0 - fill, 6), above)]
                continue
            inverse = tuple("".join(map(str, row)) for row in 1 - pattern(source))
            found.append(LeagueFloor(name, fill, source))
            found.append(LeagueFloor(name, round(1.0 - fill, 6), f"inverse-{name}-{1.0 - fill:g}", inverse))
    return tuple(found)
