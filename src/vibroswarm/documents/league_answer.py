"""The answer of a league: which entry is best, what is certain of that, and whose robots are too confident.

An entry is a strategy with its settings. The reference is the entry with which all others are compared.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Final

import polars as pl

from vibroswarm.league.belief_calibration import AS_PLAYED, COMMON, OWN
from vibroswarm.show.numbers import Estimate, number, with_limits

CERTAIN: Final = 0.05
"""A difference is significant if its corrected p-value is below this."""


def answers(standings: pl.DataFrame, tables: Mapping[str, pl.DataFrame]) -> tuple[str, ...]:
    """Write the sentences that answer which entry is best.

    Args:
        standings: ``Standings.table``, by rising forced error. tables: as ``league_document`` describes them.
    """
    differences = tables["differences"]
    found = [_best(standings)]
    if differences.height:
        found += [_compared(differences), _floor_by_floor(tables["floor_differences"])]
    return (*found, *_fastest_front(tables["fronts"]), *_too_confident(tables.get("beliefs")))


def _best(standings: pl.DataFrame) -> str:
    least = standings.row(0, named=True)
    fastest = standings.sort("decision_time_s").row(0, named=True)
    return (
        f"Smallest forced error: {least['name']}, {_error(least)}; it decides after {_time(least)}. "
        f"Fastest: {fastest['name']}, {_time(fastest)}; its forced error is {_error(fastest)}."
    )


def _error(row: Mapping[str, Any]) -> str:
    return with_limits(Estimate.of(row, "forced_error"), "%")


def _time(row: Mapping[str, Any], name: str = "decision_time_s") -> str:
    return f"{number(row[name], 0)} s"


def _compared(differences: pl.DataFrame) -> str:
    """Say which entries differ significantly from the reference in forced error or decision time."""
    names = differences["name"].unique(maintain_order=True)
    lists: dict[str, list[str]] = {}
    for name in names:
        error, time = _signs(differences.filter(pl.col("name") == name))
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
    certain = floors.filter((pl.col("figure") == "forced_error") & (pl.col("p_holm") < CERTAIN))
    parts = []
    for name in certain["name"].unique(maintain_order=True):
        found = certain.filter(pl.col("name") == name)["difference"]
        numbers = {"fewer": int((found < 0).sum()), "more": int((found > 0).sum())}
        parts.append(f"{name} {', '.join(f'{word} on {n}' for word, n in numbers.items() if n)}")
    count = floors.select("pattern", "fill_ratio").unique().height
    return (
        f"Forced errors against {floors['reference'][0]} floor by floor, at p < {CERTAIN} after Holm over strategies "
        f"and {count} floors: {'; '.join(parts) or 'no significant difference'}."
    )


def _fastest_front(fronts: pl.DataFrame) -> Iterable[str]:
    """Name the strategy that reaches the reference's error first, if a front has several entries."""
    reaching = fronts.filter((pl.col("points") > 1) & pl.col("time_at_equal_error_s").is_not_null())
    if reaching.height:
        best = reaching.sort("time_at_equal_error_s").row(0, named=True)
        time, reference = (_time(best, name) for name in ("time_at_equal_error_s", "reference_time_s"))
        is_faster = best["time_at_equal_error_s"] < best["reference_time_s"]
        words = (
            f"the fastest front is that of {best['strategy']}: {time}, against"
            if is_faster
            else "no front beats"
        )
        yield f"At the forced error of {best['reference']}, {words} {reference}."


def _too_confident(beliefs: pl.DataFrame | None) -> Iterable[str]:
    """Name the strategies whose robots are right less often than their confidence says, as they play in the league.

    That is the case, for each prior of the fill ratio, if the interval of the share right lies below that of the
    confidence.

    Args:
        beliefs: from ``belief_calibration``; None: not computed.
    """
    if beliefs is None or beliefs.is_empty():
        return
    too_confident = beliefs.filter(
        pl.col("settings") == AS_PLAYED, pl.col("right_high") < pl.col("confidence_low")
    )
    found = []
    for prior, words in ((OWN, "on floors from their own prior"), (COMMON, "on floors of independent tiles")):
        names = too_confident.filter(pl.col("prior") == prior)["name"]
        found.append(f"{words}: {', '.join(names) or 'none found'}")
    yield f"Robots that are right less often than their confidence says, {'; '.join(found)}."
