"""The answer of a league: which entry is best, what is certain of that, and whose robots are too confident.

An entry is a strategy with its settings. The reference is the entry with which all others are compared.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Final, cast

import polars as pl

from vibroswarm.core.numbers import Estimate, count, listed, number, percent, span, with_limits
from vibroswarm.league.belief_calibration import AS_PLAYED, COMMON, OWN
from vibroswarm.league.entries import GUESSING, default_strategies
from vibroswarm.league.fronts import LESS, NOT, OPEN, REACHES, guess_level, guesses
from vibroswarm.league.standings import Standings

CERTAIN: Final = 0.05
"""A difference is significant if its corrected p-value is below this."""


def answers(standings: Standings, tables: Mapping[str, pl.DataFrame]) -> tuple[str, ...]:
    """Write the sentences that answer which entry is best.

    Args:
        tables: as ``league_document`` describes them.
    """
    differences = tables["differences"]
    found = [
        *_fastest_at_each_error(tables["fronts"]),
        *_least_error_and_fastest(standings.table, tables["best"]),
    ]
    has_fronts = any(entry.aim is not None for entry in standings.league.entries)
    if differences.height and not has_fronts:  # single settings of unequal error compare nothing
        found += [_compared(differences), _floor_by_floor(tables["floor_differences"])]
    return (*found, *_guessing(standings), *_too_confident(tables.get("beliefs")))


def _fastest_at_each_error(fronts: pl.DataFrame) -> Iterator[str]:
    for (level,), at_level in fronts.group_by("level", maintain_order=True):
        reached = at_level.filter(reached=REACHES).sort("time_s")
        if reached.height < 2:
            continue
        group = reached.filter("in_group")
        slower = reached.filter(pl.col("in_group").not_())
        words = [
            f"At {percent(cast(float, level), 0)} forced error "
            + _group_words(group["strategy"], "the fastest is", span(group["time_s"], 0) + " s")
            + _alike(group, "strategy", "behind_s")
        ]
        if slower.height:
            behind = [
                f"{name} {number(by_s, 0, sign=True)} s"
                for name, by_s in slower.select("strategy", "behind_s").iter_rows()
            ]
            words.append(f"slower: {listed(behind)}")
        for kind, title in (
            (LESS, "err less along their whole fronts"),
            (OPEN, "inconclusive whether they reach it"),
            (NOT, "do not reach it"),
        ):
            names = at_level.filter(reached=kind)["strategy"]
            if len(names):
                words.append(f"{title}: {listed(names)}")
        yield "; ".join(words) + "."


def _group_words(names: Iterable[str], one: str, value: str) -> str:
    """Say who is best: ``the fastest is none (620 s)``, or who do not differ significantly."""
    first, *others = names
    if not others:
        return f"{one} {first} ({value})"
    return f"{listed([first, *others])} do not differ significantly ({value})"


def _alike(group: pl.DataFrame, name: str, behind: str) -> str:
    """Name those of the best that do not differ from the best in any run; empty if it is alone."""
    same = group.filter((pl.col(f"{behind}_low") == 0.0) & (pl.col(f"{behind}_high") == 0.0))[name]
    return f" (the same in all runs: {listed(same)})" if len(same) > 1 else ""


def _least_error_and_fastest(standings: pl.DataFrame, best: pl.DataFrame) -> Iterator[str]:
    for figure, start in (("forced_error", "Smallest forced error"), ("decision_time_s", "Fastest")):
        group = best.filter("in_group", figure=figure)
        if group.is_empty():
            continue
        first, *others = group["name"]
        row = standings.row(by_predicate=pl.col("name") == first, named=True)
        error, time = with_limits(Estimate.of(row, "forced_error"), "%"), number(row["decision_time_s"], 0)
        words = f"{start}: {first}, {error} in {time} s"
        if others:
            words += (
                f"; not significantly different from it: {listed(others)}{_alike(group, 'name', 'behind')}"
            )
        yield f"{words}."


def _guessing(standings: Standings) -> Iterator[str]:
    """Name the strategies that guess, and those that were left out for it."""
    entries = standings.league.entries
    best_of: dict[str, bool] = {}  # whether all entries of a strategy guess
    for place, entry in enumerate(entries):
        best_of[entry.strategy] = best_of.get(entry.strategy, True) and guesses(standings, place)
    if names := [name for name, all_guess in best_of.items() if all_guess]:
        level = percent(guess_level(standings.league.base), 0)
        yield (
            f"Not shown to do better than a guess (forced error below {level}), so never called fastest: "
            f"{listed(names)}."
        )
    if list(best_of) == default_strategies():
        yield f"Left out unless named in --strategy, because they guess on these floors: {listed(GUESSING)}."


def _compared(differences: pl.DataFrame) -> str:
    """Say which entries differ significantly from the reference in forced error or decision time."""
    names = differences["name"].unique(maintain_order=True)
    lists: dict[str, list[str]] = {}
    for name in names:
        error, time = _signs(differences.filter(name=name))
        if error * time < 0:
            lists.setdefault("faster but less accurate, or slower but more accurate", []).append(name)
        elif error + time:
            better = "faster or more accurate, no loss found"
            worse = "slower or less accurate, no gain found"
            lists.setdefault(better if error + time < 0 else worse, []).append(name)
    words = "; ".join(f"{kind}: {', '.join(found)}" for kind, found in sorted(lists.items()))
    return (
        f"Against {differences['reference'][0]} in decision time and forced error, at p < {CERTAIN} after Holm: "
        f"{words or 'no significant difference'}."
    )


def _signs(differences: pl.DataFrame) -> tuple[int, int]:
    """Return the signs of an entry's differences in forced error and in decision time; 0: not significant."""
    signs = {
        figure: 0 if p is None or p >= CERTAIN else 1 if difference > 0 else -1
        for figure, difference, p in differences.select("figure", "difference", "p_holm").iter_rows()
    }
    return signs["forced_error"], signs["decision_time_s"]


def _floor_by_floor(floors: pl.DataFrame) -> str:
    """Say on how many floors each entry errs significantly less, or more, than the reference.

    Args:
        floors: ``Standings.floor_differences``.
    """
    certain = floors.filter(pl.col("p_holm") < CERTAIN, figure="forced_error")
    parts = []
    for name in certain["name"].unique(maintain_order=True):
        found = certain.filter(name=name)["difference"]
        numbers = {"fewer": int((found < 0).sum()), "more": int((found > 0).sum())}
        parts.append(f"{name} {', '.join(f'{word} on {n}' for word, n in numbers.items() if n)}")
    tested = floors.select("pattern", "fill_ratio").unique().height
    return (
        f"Forced errors against {floors['reference'][0]} floor by floor, at p < {CERTAIN} after Holm over strategies "
        f"and {count(tested, 'floor')}: {'; '.join(parts) or 'no significant difference'}."
    )


def _too_confident(beliefs: pl.DataFrame | None) -> Iterable[str]:
    """Name the strategies whose robots are right less often than their confidence says, as they play in the league.

    That is the case, for each prior of the fill ratio, if the interval of the share right lies below that of the
    confidence.

    Args:
        beliefs: from ``belief_calibration``; None: not computed.
    """
    if beliefs is None or beliefs.is_empty():
        return
    too_confident = beliefs.filter(pl.col("right_high") < pl.col("confidence_low"), settings=AS_PLAYED)
    found = []
    for prior, words in ((OWN, "on floors from their own prior"), (COMMON, "on floors of independent tiles")):
        names = too_confident.filter(prior=prior)["name"]
        found.append(f"{words}: {', '.join(names) or 'none found'}")
    yield f"Robots that are right less often than their confidence says, {'; '.join(found)}."
