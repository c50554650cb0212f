"""Find settings for the strategies of a league, with the same number of runs and the same criterion for each.

**Criterion**: among the settings whose forced error is at most the target, the setting with the smallest decision time.
If there is none, the setting with the smallest forced error. The target is the forced error of the base scenario with
its own strategy, on the same floors and motion.

There are two rounds, in each of which all strategies have the same number of runs:

1. ``points`` settings of each strategy, spread evenly over its search space (Sobol sequence), with ``runs`` runs each;
2. the best ``FINALISTS`` settings by the criterion, and the strategy's default settings, with ``AGAIN`` times as many
   runs. These have fresh motion and floors, so that luck in the first round does not help in the second.

The chosen settings are still partly lucky in the second round. So report their figures from a league whose seed is
that of neither round, never from the tuning.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import polars as pl
import tomli_w

from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.errors import InputError
from vibroswarm.league.entries import Entry, LeagueFloor, entries_of, shipped
from vibroswarm.league.standings import League, Standings
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.show.numbers import count
from vibroswarm.study.factors import points_of

FINALISTS: Final = 7
"""Settings of the first round that enter the second."""
DIGITS: Final = 3
"""Significant digits of settings."""
AGAIN: Final = 4
"""Runs of the second round, relative to the first."""
BASE: Final = "base"
"""Label of the entry that sets the target."""


@dataclass(frozen=True)
class Tuned(NotebookView):
    """Result of a tuning."""

    settings: Mapping[str, Mapping[str, Any]]
    """The chosen settings, by strategy and field."""
    table: pl.DataFrame
    """All settings of the second round, one row each: name, strategy, forced_error and decision_time_s with limits,
    is_chosen, settings as text."""
    target: float
    """Forced error that settings should not exceed."""
    how: str = ""
    """How they were found, in one sentence."""

    def to_toml(self) -> str:
        """Return the text of a file of settings for a league; the comment at its top says how they were found."""
        return f"# {self.how}\n\n" + tomli_w.dumps(
            {name: dict(table) for name, table in self.settings.items()}
        )


def spaces(own_motion: bool = False) -> dict[str, dict[str, Any]]:
    """Return the search spaces that are part of the package.

    Args:
        own_motion: whether to search the fields of motion too, so that each strategy gets a motion of its own. Their
            bounds are the same for all strategies.
    Returns: for each strategy a mapping from field to its bounds, as in a study's ``sobol`` block, or to a fixed value.
    """
    known = shipped("spaces.toml")
    motion = shipped("motion_space.toml")["motion"] if own_motion else {}
    return {name: {**space, **motion} for name, space in known.items()}


def tune(
    base: Scenario,
    strategies: Sequence[str],
    floors: Sequence[LeagueFloor],
    robots: Sequence[int],
    *,
    space_of: Mapping[str, Mapping[str, Any]] | None = None,
    points: int = 64,
    runs: int = 100,
    seed: int = 1,
    progress: Callable[[float], None] = lambda share: None,
    folder: Path | None = None,
    **how: Any,
) -> Tuned:
    """Tune each strategy in two rounds.

    Args:
        base: scenario with all fields that strategies do not set; its own strategy gives the target.
        strategies: names of the strategies to tune. floors, robots: floors and swarm sizes of both rounds.
        space_of: search space by strategy: for each field its bounds, or a value that all settings share; by default
            ``spaces()``. points: settings of each strategy in the first round. runs: of each setting, floor and size
            in the first round.
        seed: of the first round; the second round has seed + 1. progress: called before each strategy with
            the share of strategies that are tuned.
        folder: where runs are saved, so that the same call continues after an interruption; None: they are not saved.
        how: further arguments of ``study.run.run``, such as workers.
    Raises:
        InputError: a strategy is unknown, occurs twice or has no space; a setting is not valid; or ``folder`` contains
            runs of another tuning.
        RunError: runs failed, or the disk is full.
    """
    known_spaces = spaces() if space_of is None else space_of
    tuned = entries_of(strategies, {})
    for entry in tuned:
        if entry.strategy not in known_spaces:
            raise InputError(f"no space to search for '{entry.strategy}'; give one", field="strategy")
    # Both rounds are described as leagues, whose only entry (the base scenario's strategy) is replaced by ``play``.
    first_round = League(
        base=base,
        entries=(Entry(label=BASE, strategy=base.strategy.name, settings={}),),
        floors=tuple(floors),
        robots=tuple(robots),
        runs=runs,
        seed=seed,
    )
    second_round = replace(first_round, runs=AGAIN * runs, seed=seed + 1)
    settings, tables = {}, []

    def play(part: str, entries: Sequence[Entry], league: League) -> Standings:
        """Run entries with the floors, runs and seed of a round; runs are saved in the subfolder ``part``."""
        saved_in = None if folder is None else folder / part
        return replace(league, entries=tuple(entries)).play(saved_in, **how)

    # The target is measured on the runs of the second round, since settings are finally chosen on those runs.
    reference = play("target", second_round.entries, second_round)
    target = reference.interval(entry=0, figure="forced_error").estimate
    for done, entry in enumerate(tuned):
        progress(done / len(tuned))  # share of the strategies that are tuned
        candidates, default = _candidates(entry, known_spaces[entry.strategy], points, seed)
        ranked = by_criterion(play(f"{done}-first", candidates, first_round), target)
        finalists = [*(candidates[k] for k in ranked[:FINALISTS]), default]
        found = play(f"{done}-second", finalists, second_round)
        best = finalists[by_criterion(found, target)[0]]
        settings[entry.strategy] = dict(best.settings)
        tables.append(_table(found, finalists, best))
    found_by = (
        f"{count(points, 'setting')} per strategy with {count(runs, 'run')} of each of "
        f"{count(len(first_round.floors), 'floor')} and swarms of "
        f"{', '.join(map(str, robots))}, then the best {FINALISTS} and the default with {AGAIN * runs} fresh runs "
        f"(seeds {seed} and {seed + 1})."
    )
    return Tuned(settings, pl.concat(tables), target, found_by)


def _candidates(entry: Entry, space: Mapping[str, Any], points: int, seed: int) -> tuple[list[Entry], Entry]:
    """Draw the settings of a strategy for the first round.

    Args:
        entry: entry of the strategy, without settings.
        space: search space. For a field that is searched, its value is a mapping with the bounds; for any other field,
            it is the value that all settings have.
        points: number of settings to draw. seed: of the Sobol sequence that they are drawn from.
    Returns: one entry per drawn setting, its floats rounded to ``DIGITS`` significant digits, or a single entry if no
        field is searched; and an entry with only the fixed fields, so that the searched fields have their default
        values.
    """
    ranges = {field: given for field, given in space.items() if isinstance(given, Mapping)}
    fixed = {field: given for field, given in space.items() if field not in ranges}
    # A study's ``sobol`` block: number of points, seed, and the bounds of each field. Without a field to search, there
    # is a single setting, that of the fixed fields, which ``points_of`` gives without blocks.
    drawn = points_of({"sobol": {"points": points, "seed": seed, **ranges}} if ranges else {})
    candidates = [
        replace(entry, label=f"{entry.strategy} {k}", settings=fixed | _rounded(point, ranges))
        for k, point in enumerate(drawn)
    ]
    return candidates, replace(entry, label=f"{entry.strategy} by default", settings=fixed)


def _table(found: Standings, finalists: Sequence[Entry], best: Entry) -> pl.DataFrame:
    """Return the figures of the finalists of a strategy, with their settings as text: rows of ``Tuned.table``.

    Args:
        found: standings of the second round. finalists: its entries. best: the chosen entry.
    """
    words = {one.label: ", ".join(f"{k} = {v}" for k, v in one.settings.items()) for one in finalists}
    return found.table.select(
        "name", "strategy", "forced_error", "forced_error_low", "forced_error_high",
        "decision_time_s", "decision_time_s_low", "decision_time_s_high",
        is_chosen=pl.col("name") == best.label,
        settings=pl.col("name").replace_strict(words, return_dtype=pl.String),
    )  # fmt: skip


def _rounded(point: Mapping[str, Any], ranges: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Round the floats among the values of a setting to ``DIGITS`` significant digits; other values stay as they are.

    Settings are read and copied by people, and further digits make no difference to the results. A value that rounding
    moves out of the bounds of its field becomes the bound.

    Args:
        point: values by field. ranges: for each of these fields, a mapping with its bounds.
    """
    settings: dict[str, Any] = {}
    for field, value in point.items():
        settings[field] = value
        if isinstance(value, float):
            low, high = float(ranges[field]["from"]), float(ranges[field]["to"])
            settings[field] = min(max(float(f"{value:.{DIGITS}g}"), low), high)
    return settings


def by_criterion(standings: Standings, target: float) -> list[int]:
    """Return the indices of a league's entries, sorted by the criterion of tuning, the best first.

    Entries whose forced error is at most ``target`` come first, sorted by decision time. The other entries follow,
    sorted by forced error. Ties keep the order of the league. Forced errors and ``target`` must not be nan.
    """
    entries = range(len(standings.league.entries))
    errors = [standings.interval(k, "forced_error").estimate for k in entries]
    times_s = [standings.interval(k, "decision_time_s").estimate for k in entries]
    return sorted(entries, key=lambda k: (0, times_s[k], k) if errors[k] <= target else (1, errors[k], k))
