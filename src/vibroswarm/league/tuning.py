"""Find settings for the strategies of a league, each with the same number of runs and by the same criterion.

**Criterion**: of all settings whose forced error is at most the target, those with the smallest decision time; if there
are none, those with the smallest forced error. The target is the forced error of the base scenario with its own
strategy, on the same floors and motion.

Two rounds, in each of which all strategies have the same number of runs:

1. ``points`` settings of each strategy, spread evenly over its space (Sobol sequence), with ``runs`` runs each;
2. the best ``FINALISTS`` of them by the criterion, and the strategy's settings by default, with ``AGAIN`` times as many
   runs on fresh motion and floors, so that luck in the first round is not rewarded in the second.

The settings chosen are still lucky in the second round. Their figures are those of a league on other seeds, never
those of the tuning.
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
from vibroswarm.study.factors import points_of

FINALISTS: Final = 7
DIGITS: Final = 3
AGAIN: Final = 4
"""Runs of the second round, relative to the first."""
BASE: Final = "base"
"""Label of the entry that sets the target."""


@dataclass(frozen=True)
class Tuned(NotebookView):
    """Settings found.

    Args:
        settings: by strategy, then by field. table: all candidates of the second round: name, strategy, forced_error
            and decision_time_s with limits, is_chosen, settings as text. target: largest forced error wanted.
    """

    settings: Mapping[str, Mapping[str, Any]]
    table: pl.DataFrame
    target: float

    def to_toml(self, how: str) -> str:
        """Write the settings as a file that a league reads, under a comment that says how they were found."""
        comment = "".join(f"# {line}\n" for line in how.splitlines())
        return comment + "\n" + tomli_w.dumps({name: dict(table) for name, table in self.settings.items()})


def spaces(own_motion: bool = False) -> dict[str, dict[str, Any]]:
    """Return the spaces that ship with the package: by strategy, bounds by field as in a study's ``sobol`` block.

    Args:
        own_motion: with the bounds of motion, the same for all strategies.
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
    """Tune each strategy.

    Args:
        base: what strategies do not set; its own strategy gives the target. floors, robots: of the tuning.
        space_of: by strategy, bounds by field, or the value of a field that all settings share; by default
            ``spaces()``. points, runs: of the first round.
        seed: of the first round; the second has the next one. progress: called with the share done.
        folder: where runs are saved, so that the same call continues after an interruption; by default nowhere.
        how: workers and executor, as of ``League.play``.
    Raises:
        InputError: a strategy has no space, or ``folder`` holds runs of another tuning.
    """
    known = spaces() if space_of is None else space_of
    players = entries_of(strategies, {})
    for player in players:
        if player.strategy not in known:
            raise InputError(f"no space to search for '{player.strategy}'; give one", field="strategy")
    league = League(base, (Entry(BASE, base.strategy.name, {}),), tuple(floors), tuple(robots), runs, seed)
    second = replace(league, runs=AGAIN * runs, seed=seed + 1)
    settings, tables = {}, []

    def play(part: str, entries: Sequence[Entry], of: League) -> Standings:
        return replace(of, entries=tuple(entries)).play(folder and folder / part, **how)

    target = play("target", second.entries, second).interval(0, "forced_error").estimate
    for done, player in enumerate(players):
        progress(done / len(players))
        first, default = _candidates(player, known[player.strategy], points, seed)
        ranked = by_criterion(play(f"{done}-first", first, league), target)
        finalists = [*(first[k] for k in ranked[:FINALISTS]), default]
        found = play(f"{done}-second", finalists, second)
        best = finalists[by_criterion(found, target)[0]]
        settings[player.strategy] = dict(best.settings)
        tables.append(_table(found, finalists, best))
    return Tuned(settings, pl.concat(tables), target)


def _candidates(player: Entry, space: Mapping[str, Any], points: int, seed: int) -> tuple[list[Entry], Entry]:
    """Return the entries of the first round of a strategy, and the one with its default settings."""
    ranges = {field: given for field, given in space.items() if isinstance(given, Mapping)}
    fixed = {field: given for field, given in space.items() if field not in ranges}
    drawn = points_of({"sobol": {"points": points, "seed": seed, **ranges}})
    first = [
        replace(player, label=f"{player.strategy} {k}", settings=fixed | _rounded(point))
        for k, point in enumerate(drawn)
    ]
    return first, replace(player, label=f"{player.strategy} by default", settings=fixed)


def _table(found: Standings, finalists: Sequence[Entry], best: Entry) -> pl.DataFrame:
    """Return the figures of the finalists of a strategy, with their settings in words."""
    words = {one.label: ", ".join(f"{k} = {v}" for k, v in one.settings.items()) for one in finalists}
    return found.table.select(
        "name", "strategy", "forced_error", "forced_error_low", "forced_error_high",
        "decision_time_s", "decision_time_s_low", "decision_time_s_high",
        is_chosen=pl.col("name") == best.label,
        settings=pl.col("name").replace_strict(words, return_dtype=pl.String),
    )  # fmt: skip


def _rounded(point: Mapping[str, Any]) -> dict[str, Any]:
    """Round numbers to ``DIGITS``: a setting is copied by people, and more digits make no difference."""
    return {
        field: float(f"{value:.{DIGITS}g}") if isinstance(value, float) else value
        for field, value in point.items()
    }


def by_criterion(standings: Standings, target: float) -> list[int]:
    """Return the numbers of the entries, the best first.

    Entries whose forced error is at most ``target`` come first, by decision time; the others follow, by forced error.
    """
    figures = [
        tuple(standings.interval(k, name).estimate for name in ("forced_error", "decision_time_s"))
        for k in range(len(standings.league.entries))
    ]
    return sorted(
        range(len(figures)),
        key=lambda k: (0, figures[k][1], k) if figures[k][0] <= target else (1, figures[k][0], k),
    )
