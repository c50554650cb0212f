"""The page of ``detect``: which floors are told from the boundary, by how many robots, and how soon."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import polars as pl

from vibroswarm.plots.curves import draw_detection
from vibroswarm.plots.picture import Picture
from vibroswarm.report.html import Column, Report, ReportTable, Section, picture_of
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import versions

MOST_CURVES: Final = 8


def best(distinguished: pl.DataFrame) -> pl.DataFrame:
    """Select, for each floor above the boundary and number of robots, the fullest floor below that is distinguished.

    If none is distinguished by the end, the row is that of the fullest floor below, with null in ``time_s``.

    Args:
        distinguished: of ``analysis.detection.pairs``.
    """
    reached = pl.col("time_s").is_not_null()
    return (
        distinguished.sort(
            "fill_ratio", "robots", reached, "fill_ratio_below", descending=[False, False, True, True]
        )
        .group_by("fill_ratio", "robots", maintain_order=True)
        .first()
    )


def answer(distinguished: pl.DataFrame, scenario: Scenario, error: float, false_alarms: float) -> list[str]:
    """Say what was asked, and for each number of robots the floors nearest to the boundary that they tell apart.

    Args:
        distinguished: of ``analysis.detection.pairs``. error, false_alarms: tolerated probabilities.
    """
    boundary, t_end_s = scenario.decision.decision_boundary, scenario.run.t_end_s
    asked = (
        f"Does more than {100 * boundary:g} % vibrate? With at most {100 * error:g} % misses and "
        f"{100 * false_alarms:g} % false alarms (upper limits, 95 %)."
    )
    if distinguished.is_empty():
        return [
            asked,
            f"All floors are on one side of {100 * boundary:g} %: no pairs of misses and false alarms.",
        ]
    sentences = [asked]
    for (robots,), rows in best(distinguished).group_by("robots", maintain_order=True):
        who = f"{robots} robot{'s' * (robots != 1)}"
        found = rows.filter(pl.col("time_s").is_not_null()).sort("fill_ratio")
        if found.is_empty():
            sentences.append(f"{who} find none of these floors within {t_end_s:g} s.")
            continue
        nearest, easiest = found.row(0, named=True), found.row(-1, named=True)
        sentence = (
            f"{who} find a fill ratio of {nearest['fill_ratio']:.4g} within {nearest['time_s']:.0f} s, without false "
            f"alarms on floors up to {nearest['fill_ratio_below']:.4g}"
        )
        if easiest["fill_ratio"] != nearest["fill_ratio"]:
            sentence += f"; {easiest['fill_ratio']:.4g} within {easiest['time_s']:.0f} s"
        missed = rows.filter(pl.col("time_s").is_null())["fill_ratio"].sort().to_list()
        if missed:
            sentence += f"; not {', '.join(f'{fill:.4g}' for fill in missed)} by {t_end_s:g} s"
        sentences.append(f"{sentence}.")
    return sentences


def pictures_of(
    curve: pl.DataFrame, boundary: float, tolerated: float, style: str = "column"
) -> Iterator[tuple[str, Picture]]:
    """Yield names and pictures, from ``analysis.detection.detection_curve``."""
    drawable = curve.filter(pl.col("missed").is_not_null())
    if drawable.is_empty():
        return
    for robots in drawable["robots"].unique().sort().to_list()[:MOST_CURVES]:
        part = drawable.filter(pl.col("robots") == robots)
        series = pl.format("{} s", pl.col("horizon_s").round(0).cast(pl.Int64))
        title = f"{robots} robots" if robots != 1 else "1 robot"
        yield f"detection-{robots}-robots", _draw(part, series, boundary, tolerated, style, title)
    if drawable["robots"].n_unique() > 1:
        part = drawable.filter(pl.col("horizon_s") == pl.col("horizon_s").max())
        yield (
            "detection-robots",
            _draw(part, pl.format("{} robots", "robots"), boundary, tolerated, style, ""),
        )


def _draw(
    part: pl.DataFrame, series: pl.Expr, boundary: float, tolerated: float, style: str, title: str
) -> Picture:
    """Draw misses against the fill ratio, one line for each series."""
    frame = part.select(
        "fill_ratio", "missed", "runs", low="missed_low", high="missed_high", series=series
    ).sort("series", "fill_ratio", maintain_order=True)
    order = part.select(series=series)["series"].unique(maintain_order=True)
    rank = pl.col("series").replace_strict(order.to_list(), range(order.len()), return_dtype=pl.Int64)
    return draw_detection(
        frame.sort(rank, maintain_order=True),
        boundary=boundary,
        tolerated=tolerated,
        title=title,
        style=style,
    )


def report_of(
    tables: dict[str, pl.DataFrame],
    scenario: Scenario,
    seed: int,
    error: float,
    false_alarms: float,
    warnings: Sequence[str] = (),
) -> Report:
    """Lay out the page.

    Args:
        tables: detection, needed and pairs, of ``analysis.detection``. scenario, seed: of which they are; floors and
            robots vary. error, false_alarms: tolerated probabilities. warnings: shown first.
    """
    asked, *found = answer(tables["pairs"], scenario, error, false_alarms)
    pictures = tuple(
        Section(
            "By time" if name != "detection-robots" else "By robots, at the end",
            parts=(picture_of(drawn, name),),
        )
        for name, drawn in pictures_of(
            tables["detection"], scenario.decision.decision_boundary, error, "page"
        )
    )
    pairs = best(tables["pairs"]) if tables["pairs"].height else tables["pairs"]
    parts = (ReportTable(pairs, _PAIRS, "A dash: not by the end.", "pairs"),) if pairs.height else ()
    return Report(
        "How many robots, and how much time?",
        (asked, *found),
        tuple(warnings),
        (
            Section("Which floors are told apart", _TEXT, parts, pictures),
            Section("Every floor", (), (ReportTable(tables["needed"], _NEEDED, name="needed"),)),
        ),
        {"scenario": scenario.hash, "seed": str(seed), **versions()},
    )


_TEXT: Final = (
    "Missed: no right consensus by then; undecided counts. False alarm: a wrong consensus on 'more'. Upper limits "
    "(95 %, Wilson over runs) must be below what is tolerated, so that with few runs nothing is enough. Each holds "
    "separately.",
)
_PAIRS: Final = {
    "fill_ratio": Column("fill ratio", decimals=2),
    "fill_ratio_below": Column("without false alarms on floors up to", decimals=2),
    "robots": Column("robots"),
    "time_s": Column("found within", "s", decimals=0),
    "fewest": Column("fewest robots"),
}
_NEEDED: Final = {
    "fill_ratio": Column("fill ratio", decimals=2),
    "truth": Column("more than the boundary (1: yes)"),
    "needed_s": Column("time needed", "s", decimals=0),
    "missed": Column("missed at the end", percent=True),
    "missed_high": Column("upper limit", percent=True),
    "fewest": Column("fewest robots"),
    "false_alarm": Column("false alarms at the end", percent=True),
    "false_alarm_high": Column("upper limit", percent=True),
    "clear_until_s": Column("clear until (dash: the end)", "s", decimals=0),
}
