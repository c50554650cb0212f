"""Find settings for the strategies of a league: for each strategy, those on its front of time against forced error.

No contestant sets a bar. Each strategy is tuned for the same forced errors (``AIMS``), whatever others reach, and for
the least that it can reach. There is no error up to which a setting passes and beyond which it fails: such a bar would
be met half of the time by a setting whose error equals it. Instead, the settings of a strategy are points (decision
time, forced error), and the convex hull below them is its front: every point of it can be reached by a swarm that draws
one of two settings for each run.

| name | symbol | equation |
|---|---|---|
| front | T(e) | convex hull of the points below, piecewise linear |
| price of error at an aim a | s | slope of the hull's piece at a: seconds that one unit of error costs |
| rank of setting k at a | - | T_k + s E_k, the smallest first; of the two ends of the piece, the one nearer to a |
| chosen at a | - | both ends of the piece, so that the front can be read there |

There are three rounds, each with fresh motion and floors, so that luck in one round does not help in the next:

1. ``points`` settings **for each tuned field** of a strategy, spread evenly over its space (Sobol sequence), with
   ``runs`` runs each;
2. the best settings at each aim, half as many new ones around them, and the default, with twice as many runs.
   A strategy that has the fields of another one that is tuned, and more (soft feedback has those of no feedback), is
   also tried with what was chosen for that one: otherwise more fields would be a handicap;
3. the best ``FINALISTS`` at each aim, and the default again, with sixteen times as many runs. These runs choose.

The chosen settings are still partly lucky in the third round. So report their figures from a league whose seed is that
of no round, never from the tuning.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl
import tomli_w

from vibroswarm.core.numbers import count, listed, rounded
from vibroswarm.errors import InputError, check_kind, check_known_keys, in_file
from vibroswarm.inference.outcomes import Array
from vibroswarm.league.entries import AIM, Entry, LeagueFloor, entries_of, read_settings, shipped
from vibroswarm.league.standings import League, Standings
from vibroswarm.scenario.scenario import Scenario, field_types
from vibroswarm.statistics.fronts import front_of
from vibroswarm.study.factors import bounds_of, points_of

AIMS: Final = (0.01, 0.02, 0.03, 0.05, 0.07, 0.10, 0.12, 0.14, 0.16, 0.18, 0.20, 0.25)
"""Forced errors that settings are searched for."""
FINALISTS: Final = 3
"""Settings of a round that enter the next, for each aim."""
OWN: Final = 4
"""Settings of a strategy that are combined with those of another whose fields it has."""
DIGITS: Final = 3
"""Significant digits of settings."""
ROUNDS: Final = (1, 2, 16)
"""Runs of each round, relative to the first. The last has many: on the steep part of a front an error of one point is
worth 100 s."""
APART: Final = 0.004
"""Least difference between the forced errors of chosen settings."""
REACH: Final = 0.25
"""Width of the box around a setting from which the second round draws, relative to the bounds of each field."""


@dataclass(frozen=True)
class Tuned:
    """Result of a tuning."""

    settings: Mapping[str, Sequence[Mapping[str, Any]]]
    """For each strategy its chosen settings by field, by rising forced error, which ``AIM`` has."""
    table: pl.DataFrame
    """All settings of the third round, one row each: name, strategy, is_chosen, forced_error and decision_time_s with
    limits, settings as text."""
    how: str = ""
    """How they were found, in one sentence."""

    def to_toml(self) -> str:
        """Return the text of a file of settings for a league; the comment at its top says how they were found."""
        text = tomli_w.dumps(
            {name: [dict(one) for one in settings] for name, settings in self.settings.items()}
        )
        return f"# {self.how}\n# {AIM}: of these settings, in the last round.\n\n{text}"


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


def read_spaces(path: Path) -> dict[str, dict[str, Any]]:
    """Read search spaces by strategy from a file in TOML, as ``spaces`` returns them.

    Raises:
        InputError: the file cannot be read, or has an unknown field or wrong bounds.
    """
    found = read_settings(path)
    with in_file(path):
        for name, space in found.items():
            check_kind(space, dict, name, "the table of a strategy's fields, such as [none]")
            check_known_keys(space, name, field_types())
            if ranges := _ranges(space):
                points_of({"sobol": {"points": 1, "seed": 1, **ranges}})
    return found


def tune(
    base: Scenario,
    strategies: Sequence[str],
    floors: Sequence[LeagueFloor],
    robots: Sequence[int],
    *,
    space_of: Mapping[str, Mapping[str, Any]] | None = None,
    points: int = 48,
    runs: int = 20,
    seed: int = 101,
    progress: Callable[[float], None] = lambda share: None,
    folder: Path | None = None,
    **how: Any,
) -> Tuned:
    """Tune each strategy in three rounds.

    Args:
        base: scenario with all fields that strategies do not set.
        strategies: names of the strategies to tune. floors, robots: floors and swarm sizes of all rounds.
        space_of: search space by strategy: for each field its bounds, or a value that all settings share; by default
            ``spaces()``. points: settings in the first round for each field that is tuned. runs: of each setting, floor
            and size in the first round.
        seed: of the first round; the others have seed + 1 and seed + 2. progress: called before each strategy with
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
            raise InputError(
                f"no space to search for '{entry.strategy}'; give one in a file (--spaces; in Python: space_of)",
                field="strategy",
            )
    settings: dict[str, list[dict[str, Any]]] = {}
    tables = []

    def play(part: str, number: int, entries: Sequence[Entry]) -> Standings:
        """Play entries with the runs and seed of a round, from 0; runs are saved in the subfolder ``part``."""
        league = League(
            base,
            tuple(entries),
            tuple(floors),
            tuple(robots),
            runs=runs * ROUNDS[number],
            seed=seed + number,
        )
        return league.play(None if folder is None else folder / part, **how)

    # Those with fewer fields first, in whatever order they are named: others begin with what was chosen for them.
    by_fields = sorted(tuned, key=lambda entry: len(_ranges(known_spaces[entry.strategy])))
    for done, entry in enumerate(by_fields):
        progress(done / len(tuned))  # share of the strategies that are tuned
        space = known_spaces[entry.strategy]
        candidates, default = _candidates(entry, space, points, seed)
        best = _best(play(f"{done}-first", 0, candidates), FINALISTS)
        around = _around(best, space, points, seed + 1)
        nearer = [*best, *around, *_borrowed(best, _chosen_within(space, known_spaces, settings)), default]
        finalists = _numbered([*_best(play(f"{done}-second", 1, _numbered(nearer)), FINALISTS), default])
        found = play(f"{done}-third", 2, finalists)
        chosen = chosen_along(*_figures(found))
        errors = [found.interval(place, "forced_error").estimate for place in chosen]
        settings[entry.strategy] = [
            {AIM: round(error, DIGITS), **finalists[place].settings}
            for place, error in zip(chosen, errors, strict=True)
        ]
        tables.append(_table(found, chosen))
    progress(1.0)
    in_order = {entry.strategy: settings[entry.strategy] for entry in tuned}
    return Tuned(in_order, pl.concat(tables), _found_by(points, runs, len(floors), robots, seed))


def _found_by(points: int, runs: int, floors: int, robots: Sequence[int], seed: int) -> str:
    """Say in one sentence how settings were found, from the arguments of ``tune`` and the number of floors."""
    return (
        f"{count(points, 'setting')} for each tuned field of a strategy with {count(runs, 'run')} of each of "
        f"{count(floors, 'floor')} and swarms of {listed(map(str, robots))}; then, with {ROUNDS[1] * runs} fresh "
        f"runs, the best {FINALISTS} for each forced error and half as many new ones around them; then the best "
        f"{FINALISTS} with {ROUNDS[2] * runs} fresh runs (seeds {seed} to {seed + 2})."
    )


def _best(found: Standings, most: int) -> list[Entry]:
    """Return the best ``most`` entries for each aim, each entry once."""
    of_aims = ranked_for_aims(*_figures(found))
    places = dict.fromkeys(place for ranked in of_aims.values() for place in ranked[:most])
    return [found.league.entries[place] for place in places]


def _figures(found: Standings) -> tuple[Array, Array]:
    """Return the decision time and the forced error of each entry, (entries,) each."""
    entries = range(len(found.league.entries))
    time_s, error = (
        np.array([found.interval(k, name).estimate for k in entries])
        for name in ("decision_time_s", "forced_error")
    )
    return time_s, error


def chosen_along(time_s: Array, error: Array, aims: Sequence[float] = AIMS) -> list[int]:
    """Return the indices of the settings that are chosen: by rising error, those that the front needs at the aims.

    They are the least error and, for each aim, both ends of the hull's piece there. Of settings whose errors differ by
    less than ``APART``, the one with the least error is chosen.

    Args:
        time_s, error: of each setting, (settings,) each, without nan. aims: forced errors, rising.
    """
    hull = hull_of(time_s, error)[::-1]  # from the least error on
    needed = {0} | {k for aim in aims for k in _piece_at(aim, error[hull])}
    chosen: list[int] = []
    for place in hull[sorted(needed)]:
        if not chosen or error[place] >= error[chosen[-1]] + APART:
            chosen.append(int(place))
    return chosen


def _piece_at(aim: float, error: Array) -> tuple[int, ...]:
    """Return the ends of a front's piece at an aim: none below its least error, the last piece beyond its end."""
    if aim < error[0]:
        return ()
    upper = min(max(int(np.searchsorted(error, aim)), 1), error.size - 1)
    return max(upper - 1, 0), upper


def ranked_for_aims(time_s: Array, error: Array, aims: Sequence[float] = AIMS) -> dict[float, list[int]]:
    """Rank settings for each aim that their front reaches, and for the least error, see the head of this module.

    Args:
        time_s, error: of each setting, (settings,) each, without nan. aims: forced errors, rising.
    Returns: for 0 (the least error) and for each aim from the least error on, the indices of all settings, the best
        first.
    """
    hull = hull_of(time_s, error)[::-1]  # from the least error on
    ranked = {0.0: [int(k) for k in np.lexsort((time_s, error))]}
    for aim in aims:
        piece = _piece_at(aim, error[hull])
        if not piece:
            continue
        ends = hull[list(piece)]
        rise = error[ends[1]] - error[ends[0]]
        price = (time_s[ends[0]] - time_s[ends[1]]) / rise if rise > 0.0 else 0.0
        # Both ends have the same rank; the nearer one is first, whatever rounding does.
        nearest_end = min(ends, key=lambda k: abs(error[k] - aim))
        by_rank = np.lexsort((np.abs(error - aim), time_s + price * error))
        ranked[aim] = [int(nearest_end), *(int(k) for k in by_rank if k != nearest_end)]
    return ranked


def hull_of(time_s: Array, error: Array) -> Array:
    """Return the indices of the settings on the lower convex hull of (time, error), by rising time and falling error.

    Args:
        time_s, error: of each setting, (settings,) each.
    """
    front = front_of(time_s, error)
    # A point of the front may be that of several settings; the first of them is taken.
    places = [int(np.flatnonzero((time_s == t) & (error == e))[0]) for t, e in zip(*front, strict=True)]
    hull: list[int] = []
    for place in places:
        while len(hull) > 1 and _is_above(hull[-2], hull[-1], place, time_s, error):
            hull.pop()
        hull.append(place)
    return np.array(hull)


def _is_above(first: int, middle: int, last: int, time_s: Array, error: Array) -> bool:
    """Return whether the middle one of three points, by rising time, lies on or above the line of the others."""
    rise = (error[last] - error[first]) * (time_s[middle] - time_s[first])
    return bool((error[middle] - error[first]) * (time_s[last] - time_s[first]) >= rise)


def _ranges(space: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """Return the bounds of the fields of a search space that are tuned; the other fields have one value."""
    return {field: given for field, given in space.items() if isinstance(given, Mapping)}


def _candidates(entry: Entry, space: Mapping[str, Any], points: int, seed: int) -> tuple[list[Entry], Entry]:
    """Draw the settings of a strategy for the first round.

    Args:
        entry: without settings. space: bounds of each tuned field, and the value of any other. points: per tuned field.
    Returns: one entry per drawn setting, or a single one if no field is tuned; and one with only the fixed fields.
    """
    ranges = _ranges(space)
    fixed = replace(entry, settings={field: given for field, given in space.items() if field not in ranges})
    drawn = _drawn(fixed, ranges, points * len(ranges), seed) if ranges else [fixed]
    return _numbered(drawn), replace(fixed, label=f"{entry.strategy} by default")


def _drawn(entry: Entry, ranges: Mapping[str, Any], points: int, seed: int) -> list[Entry]:
    """Draw settings between bounds, which replace those of an entry."""
    drawn = points_of({"sobol": {"points": points, "seed": seed, **ranges}})
    return [replace(entry, settings={**entry.settings, **_rounded(point, ranges)}) for point in drawn]


def _around(centres: Sequence[Entry], space: Mapping[str, Any], points: int, seed: int) -> list[Entry]:
    """Draw settings in a box around each of some settings, half as many in all as the first round has.

    Args:
        centres: entries of one strategy. space, points, seed: see ``_candidates``.
    """
    ranges = _ranges(space)
    if not ranges:
        return []
    each = max(1, points * len(ranges) // (2 * len(centres)))
    return [
        one
        for number, centre in enumerate(centres)
        for one in _drawn(centre, _box(centre.settings, ranges), each, seed + number)
    ]


def _chosen_within(
    space: Mapping[str, Any],
    spaces_of: Mapping[str, Mapping[str, Any]],
    settings: Mapping[str, Sequence[Any]],
) -> list[dict[str, Any]]:
    """Return the settings that were chosen for strategies whose tuned fields are some of those of a space.

    Args:
        space: search space. spaces_of: those of all strategies. settings: what was chosen so far, as in ``Tuned``.
    """
    own = set(_ranges(space))
    return [
        {field: one[field] for field in _ranges(spaces_of[name]) if field in one}
        for name, chosen in settings.items()
        if set(_ranges(spaces_of[name])) < own
        for one in chosen
    ]


def _borrowed(best: Sequence[Entry], chosen: Sequence[Mapping[str, Any]]) -> list[Entry]:
    """Return entries of the best settings along the front, with what was chosen for other strategies."""
    own = best[:: max(1, len(best) // OWN)][:OWN]
    return [replace(one, settings={**one.settings, **other}) for other in chosen for one in own]


def _box(centre: Mapping[str, Any], ranges: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """Return the bounds of a box around a setting, within the given bounds and as wide as ``REACH`` says."""
    box = {}
    for field, given in ranges.items():
        low, high, scale, is_whole = bounds_of(given, field)
        if scale == "log":
            step = (high / low) ** (REACH / 2)
            near = max(low, centre[field] / step), min(high, centre[field] * step)
        else:
            step = (high - low) * REACH / 2
            near = max(low, centre[field] - step), min(high, centre[field] + step)
        if is_whole:
            near = math.floor(near[0]), math.ceil(near[1])
        box[field] = {**given, "from": near[0], "to": near[1]}
    return box


def _numbered(entries: Sequence[Entry]) -> list[Entry]:
    """Return the entries with different settings, labelled with the strategy and a number."""
    different: list[Entry] = []
    for entry in entries:
        if not any(entry.settings == other.settings for other in different):
            different.append(replace(entry, label=f"{entry.strategy} {len(different)}"))
    return different


def _table(found: Standings, chosen: Sequence[int]) -> pl.DataFrame:
    """Return the figures of the finalists of a strategy, with their settings as text: rows of ``Tuned.table``.

    Args:
        found: standings of the third round. chosen: the indices of its chosen entries.
    """
    entries = found.league.entries
    words = {one.label: ", ".join(f"{k} = {v}" for k, v in one.settings.items()) for one in entries}
    return found.table.select(
        "name", "strategy", pl.col("name").is_in([entries[k].label for k in chosen]).alias("is_chosen"),
        "forced_error", "forced_error_low", "forced_error_high",
        "decision_time_s", "decision_time_s_low", "decision_time_s_high",
        settings=pl.col("name").replace_strict(words, return_dtype=pl.String),
    )  # fmt: skip


def _rounded(point: Mapping[str, Any], ranges: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Round the floats of a setting to ``DIGITS`` significant digits, within the bounds of their fields.

    Settings are read and copied by people, and further digits make no difference to the results.
    """
    settings: dict[str, Any] = {}
    for field, value in point.items():
        settings[field] = value
        if isinstance(value, float):
            low, high = float(ranges[field]["from"]), float(ranges[field]["to"])
            settings[field] = min(max(rounded(value, DIGITS), low), high)
    return settings
