"""The tables of ``vibroswarm detect`` in the terminal."""

from __future__ import annotations

from textwrap import fill

import polars as pl

from vibroswarm.scenario import Scenario

WIDTH = 100


def say_detection(
    need: pl.DataFrame, told: pl.DataFrame, scenario: Scenario, error: float, false_alarms: float
) -> None:
    """Print which floors are distinguished and when, then every cell.

    Args:
        need, told: of ``analysis.detection.needed`` and ``pairs``. error, false_alarms: as wanted.
    """
    boundary, t_end_s = scenario.decision.decision_boundary, scenario.run.t_end_s
    wanted = f"at most {100 * error:g} % misses and {100 * false_alarms:g} % false alarms"
    if told.is_empty():
        print(
            f"No floors on both sides of {100 * boundary:g} %: no pair of misses and false alarms to report."
        )
    else:
        print(f"Does more than {100 * boundary:g} % vibrate? With {wanted} (upper limits, 95 %):")
        print()
        print(f"{'fill ratio':>10} {'robots':>7}   found within   without false alarms on floors up to")
        for row in _best(told).iter_rows(named=True):
            print(_pair(row, t_end_s))
    print()
    print(
        f"{'fill ratio':>10} {'robots':>7} {'runs':>6}   {'missed':<22} {'false alarms':<22} {'needed':<14} clear until"
    )
    for row in need.iter_rows(named=True):
        needs = "-" if row["missed"] is None else _time(row["needed_s"], t_end_s)
        print(
            f"{row['fill_ratio']:>10.4g} {row['robots']:>7} {row['runs']:>6}   "
            f"{_share(row['missed'], row['missed_high']):<22} "
            f"{_share(row['false_alarm'], row['false_alarm_high']):<22} {needs:<14} {_clear(row)}"
        )
    notes = (
        f"Missed: no right consensus by {t_end_s:g} s; undecided counts. False alarm: a wrong consensus on 'more'. "
        "In brackets the upper limit (95 %, Wilson over runs), which has to lie below what is wanted. Needed: when "
        "that of the misses does; clear until: how long that of the false alarms does. Each limit holds by itself."
    )
    print(fill(notes, WIDTH))


def _best(told: pl.DataFrame) -> pl.DataFrame:
    """For each floor above and number of robots, the fullest floor below that it is distinguished from."""
    reached = pl.col("time_s").is_not_null()
    return (
        told.sort("fill_ratio", "robots", reached, "fill_ratio_below", descending=[False, False, True, True])
        .group_by("fill_ratio", "robots", maintain_order=True)
        .first()
    )


def _pair(row: dict[str, float | None], t_end_s: float) -> str:
    start = f"{row['fill_ratio']:>10.4g} {row['robots']:>7}   "
    if row["time_s"] is None:
        return f"{start}not by {t_end_s:g} s with so few misses and false alarms"
    fewest = "  (fewest robots)" if row["fewest"] else ""
    return f"{start}{_time(row['time_s'], t_end_s):<14} {row['fill_ratio_below']:.4g}{fewest}"


def _share(share: float | None, high: float | None) -> str:
    return "-" if share is None or high is None else f"{100 * share:5.1f} % (below {100 * high:.1f} %)"


def _time(time_s: float | None, t_end_s: float) -> str:
    return f"not by {t_end_s:g} s" if time_s is None else f"{time_s:.0f} s"


def _clear(row: dict[str, float | None]) -> str:
    if row["false_alarm"] is None:
        return "-"
    until_s = row["clear_until_s"]
    if until_s is None:
        return "the end"
    return f"{until_s:.0f} s" if until_s > 0 else "never"
