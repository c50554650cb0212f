"""What ``vibroswarm detect`` prints."""

from __future__ import annotations

import polars as pl

from vibroswarm.cli.output import print_line, print_paragraph, print_table
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.study.detection_report import answer, best


def print_detection(
    need: pl.DataFrame, distinguished: pl.DataFrame, scenario: Scenario, error: float, false_alarms: float
) -> None:
    """Print which floors are distinguished and when, then every cell.

    Args:
        need, distinguished: from ``analysis.detection.needed`` and ``pairs``.
        error, false_alarms: tolerated probabilities.
    """
    t_end_s = scenario.run.t_end_s
    asked, *found = answer(distinguished, scenario, error, false_alarms)
    for sentence in (asked, *found):
        print_paragraph(sentence)
    print_line()
    if distinguished.height:
        print_table(
            ["fill ratio", "robots", "found within", "without false alarms on floors up to", ""],
            [_pair(row, t_end_s) for row in best(distinguished).iter_rows(named=True)],
            names=2,
            texts=0,
        )
    print_line()
    print_table(
        ["fill ratio", "robots", "runs", "missed, %", "false alarms, %", "needed", "clear until"],
        [
            [
                f"{row['fill_ratio']:.4g}",
                row["robots"],
                row["runs"],
                _share(row["missed"], row["missed_high"]),
                _share(row["false_alarm"], row["false_alarm_high"]),
                "-" if row["missed"] is None else _time(row["needed_s"], t_end_s),
                _clear(row),
            ]
            for row in need.iter_rows(named=True)
        ],
        names=2,
        texts=0,
        more=("runs",),
    )
    print_paragraph(
        f"Missed: no right consensus by {t_end_s:g} s; undecided counts. False alarm: a wrong consensus on 'more'. "
        "In brackets the upper limit (95 %, Wilson over runs), which must be below the tolerated probability. Needed: "
        "when that of misses falls below it; clear until: how long that of false alarms stays below it. Each limit "
        "holds separately."
    )


def _pair(row: dict[str, float | None], t_end_s: float) -> list[object]:
    start: list[object] = [f"{row['fill_ratio']:.4g}", row["robots"], _time(row["time_s"], t_end_s)]
    if row["time_s"] is None:
        return [*start, "-", ""]
    return [*start, f"{row['fill_ratio_below']:.4g}", "(fewest robots)" if row["fewest"] else ""]


def _share(share: float | None, high: float | None) -> str:
    return "-" if share is None or high is None else f"{100 * share:.1f} (below {100 * high:.1f})"


def _time(time_s: float | None, t_end_s: float) -> str:
    return f"not by {t_end_s:g} s" if time_s is None else f"{time_s:.0f} s"


def _clear(row: dict[str, float | None]) -> str:
    """Format the time until which false alarms are rare enough."""
    if row["false_alarm"] is None:
        return "-"
    until_s = row["clear_until_s"]
    if until_s is None:
        return "the end"
    return f"{until_s:.0f} s" if until_s > 0 else "never"
