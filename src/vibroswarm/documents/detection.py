"""The document of ``detect``: which fill ratios are recognised, by how many robots, and how soon.

A floor is *missed* in a run without a right consensus. A *false alarm* is a wrong consensus on "more" on a floor with a
fill ratio below the boundary. A floor above the boundary is *distinguished* from a floor below it at a time when misses
of the one and false alarms on the other are both rare enough; it is *found* if it is distinguished from some floor
below (``statistics.detection``).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Final

import polars as pl

from vibroswarm.core.numbers import (
    count,
    decimals_of,
    drawn_of,
    few_decimals_of,
    listed,
    number,
    stated,
    stated_percent,
)
from vibroswarm.documents.cell_figures import map_table, with_limits_of
from vibroswarm.documents.knowledge import told
from vibroswarm.plots.curves import draw_detection
from vibroswarm.plots.picture import Picture
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.show.document import Column, Document, Figure, Section, Table, Text, if_any
from vibroswarm.simulation import versions
from vibroswarm.study.detection import Detection

MOST_CURVES: Final = 8
"""Most numbers of robots with a figure of their own."""
FEW_WRONG: Final = 1 / 3
"""Runs are called few if less than this share of the tolerated errors may occur in them."""


def detection_document(detection: Detection) -> Document:
    """Return which floors robots find, and how soon."""
    tables, scenario, seed = detection.tables, detection.scenario, detection.seed
    found, needed, curve = hardest(tables["pairs"]), tables["needed"], tables["detection"]
    return Document(
        title="How many robots, and how much time?",
        answer=_answer(found, scenario, detection),
        knew=told([scenario]),
        warnings=detection.warnings,
        parts=(
            Text(_setting_of(needed, scenario)),
            *if_any(found, lambda _: [_hardest_pairs_table(found, scenario, detection)]),
            Section("Every floor", (_needed_table(needed, scenario), Text(_MEANING))),
            *if_any(tables.get("maps"), _maps),
            Section("Misses against the fill ratio", tuple(_figures(curve, scenario, detection))),
            Section(
                "All numbers",
                (_curve_table(curve), *if_any(tables["pairs"], lambda pairs: [_pairs_table(pairs)])),
                folded=True,
            ),
        ),
        made_by={"scenario": scenario.hash, "seed": str(seed), **versions()},
    )


def hardest(pairs: pl.DataFrame) -> pl.DataFrame:
    """Select one row for each floor above the boundary and number of robots: the hardest pair they distinguish.

    Of the floors below the boundary that the robots distinguish from the floor above, the row has the one with the
    highest fill ratio. If they distinguish none by the end, ``time_s``, ``fill_ratio_below`` and ``fewest`` are null.

    Args:
        pairs: table of ``statistics.detection.pairs``; the result has its columns.
    """
    is_found = pl.col("time_s").is_not_null()
    # Distinguished pairs come first, and among them the highest fill ratio below the boundary.
    chosen = (
        pairs.sort(
            "fill_ratio", "robots", is_found, "fill_ratio_below", descending=[False, False, True, True]
        )
        .group_by("fill_ratio", "robots", maintain_order=True)
        .first()
    )
    return chosen.with_columns(
        pl.when(is_found).then(name).alias(name) for name in ("fill_ratio_below", "fewest")
    )


def _answer(found: pl.DataFrame, scenario: Scenario, tolerated: Detection) -> tuple[str, ...]:
    """Return a sentence for each number of robots on the fill ratios that they find."""
    boundary, t_end_s = scenario.decision.decision_boundary, scenario.run.t_end_s
    if found.is_empty():
        return (
            f"All floors are on one side of {stated_percent(boundary)}: no pairs of misses and false alarms.",
        )
    if tolerated.runs < tolerated.runs_needed:
        return (
            f"Too few runs to say: {count(tolerated.runs, 'run')} cannot show {_tolerated_in_words(tolerated)}, even "
            f"if nothing is wrong; at least {tolerated.runs_needed} of each fill ratio and number of robots can "
            "(--runs).",
        )
    least, (missed, alarms) = min(tolerated.error, tolerated.false_alarms), tolerated.most_wrong
    few: tuple[str, ...] = ()
    if found["time_s"].has_nulls() and min(missed, alarms) < FEW_WRONG * least * tolerated.runs:
        few = (
            f"Of {count(tolerated.runs, 'run')} of each floor, at most {missed} may be missed, and at most {alarms} be "
            "false alarms; with more runs (--runs), more floors may be found.",
        )
    sentences = tuple(
        _sentence(
            f"{count(robots, 'robot')} with strategy {scenario.strategy.name}",
            robots == 1,
            rows,
            t_end_s,
            tolerated,
        )
        for (robots,), rows in found.group_by("robots", maintain_order=True)
    )
    return sentences + few


def _seconds(time_s: float) -> str:
    return f"{number(time_s, few_decimals_of([time_s]))} s"


def _sentence(who: str, is_one: bool, rows: pl.DataFrame, t_end_s: float, tolerated: Detection) -> str:
    """Name the found fill ratio nearest to the boundary, that farthest from it, and those that are not found."""
    who = f"{who} {'finds' if is_one else 'find'}"
    found = rows.filter(pl.col("time_s").is_not_null()).sort("fill_ratio")
    missed = rows.filter(pl.col("time_s").is_null())["fill_ratio"].sort().to_list()
    if found.is_empty():
        return f"{who} none of these floors within {stated(t_end_s)} s."
    nearest, farthest = found.row(0, named=True), found.row(-1, named=True)
    sentence = (
        f"{who} {stated_percent(nearest['fill_ratio'])} vibrating within {_seconds(nearest['time_s'])}, with "
        f"{_tolerated_in_words(tolerated)} on floors up to {stated_percent(nearest['fill_ratio_below'])}"
    )
    if farthest["fill_ratio"] != nearest["fill_ratio"]:
        sentence += f"; {stated_percent(farthest['fill_ratio'])} within {_seconds(farthest['time_s'])}"
    if missed:
        sentence += f"; not {listed(map(stated_percent, missed))} by {stated(t_end_s)} s"
    return f"{sentence}."


def _tolerated_in_words(tolerated: Detection) -> str:
    misses, alarms = stated_percent(tolerated.error), stated_percent(tolerated.false_alarms)
    return f"at most {misses} misses, and at most {alarms} false alarms"


def _setting_of(needed: pl.DataFrame, scenario: Scenario) -> str:
    runs = count(int(needed["runs"].min()), "run")  # type: ignore[arg-type]
    return (
        f"Does more than {stated_percent(scenario.decision.decision_boundary)} vibrate? Strategy "
        f"{scenario.strategy.name}, random floors, up to {stated(scenario.run.t_end_s)} s; {runs} of each fill ratio "
        "and number of robots."
    )


_MEANING: Final = (
    "Missed: no right consensus by then; undecided counts. False alarm: a wrong consensus on 'more'. The upper limits "
    "(95 %, Wilson over runs) must be below what is tolerated; too few runs cannot show that. Time needed: when the "
    "upper limit of misses falls below it. Clear until: how long that of false alarms stays below it. Each limit is "
    "95 % by itself."
)


def _fill_format(frame: pl.DataFrame, *names: str) -> Column:
    values = [100 * value for name in names for value in frame[name].drop_nulls()]
    return Column("fill ratio", share=True, decimals=decimals_of((round(value, 6) for value in values), 4))


def _hardest_pairs_table(found: pl.DataFrame, scenario: Scenario, tolerated: Detection) -> Table:
    fills = _fill_format(found, "fill_ratio", "fill_ratio_below")
    columns = {
        "fill_ratio": fills,
        "robots": Column("robots"),
        "time_s": Column("found within", "s", decimals=0),
        "fill_ratio_below": replace(
            fills, title=f"at most {stated_percent(tolerated.false_alarms)} false alarms on floors up to"
        ),
        "fewest": Column("fewest robots"),
    }
    return Table(
        found.select(*columns),
        columns,
        caption=f"Floors above the boundary. A dash: not by {stated(scenario.run.t_end_s)} s.",
        name="found",
        names=2,
    )


def _needed_table(needed: pl.DataFrame, scenario: Scenario) -> Table:
    """Tabulate misses and false alarms at the end, and the times that follow."""
    t_end_s = scenario.run.t_end_s
    is_below = pl.col("truth") == 0
    rows = needed.with_columns(
        # null: false alarms are rare enough in the whole run
        clear_until_s=pl.when(is_below).then(pl.col("clear_until_s").fill_null(t_end_s)),
        truth=pl.col("truth") == 1,
    )
    columns = {
        "fill_ratio": _fill_format(rows, "fill_ratio"),
        "robots": Column("robots"),
        "truth": Column("above the boundary", wide=True),
        "runs": Column("runs", wide=True),
        "missed": Column("missed", share=True),
        "missed_high": Column("upper limit", share=True),
        "needed_s": Column("time needed", "s", decimals=0),
        "fewest": Column("fewest robots", wide=True),
        "false_alarm": Column("false alarms", share=True),
        "false_alarm_high": Column("upper limit", share=True),
        "clear_until_s": Column("clear until", "s", decimals=0),
    }
    return Table(
        rows.select(*columns),
        columns,
        caption=f"Misses and false alarms by {stated(t_end_s)} s. A dash: not by then; false alarms are on floors "
        "below the boundary only.",
        name="needed",
        names=2,
    )


def _maps(maps: pl.DataFrame) -> tuple[Section, ...]:
    names = {"fill_ratio": _fill_format(maps, "fill_ratio"), "robots": Column("robots")}
    return (Section("Maps", (map_table(maps, names),)),)


def _pairs_table(pairs: pl.DataFrame) -> Table:
    fills = _fill_format(pairs, "fill_ratio", "fill_ratio_below")
    columns = {
        "fill_ratio": fills,
        "fill_ratio_below": replace(fills, title="distinguished from"),
        "robots": Column("robots"),
        "time_s": Column("from", "s", decimals=0),
        "fewest": Column("fewest robots"),
    }
    return Table(
        pairs,
        columns,
        caption="All pairs of a floor above the boundary and one below it. A dash: not distinguished by the end.",
        name="pairs",
        names=3,
    )


def _curve_table(curve: pl.DataFrame) -> Table:
    titles = {
        "missed": "missed",
        "wrong": "wrong",
        "false_alarm": "false alarms",
        "robots_missed": "robots: missed",
        "robots_wrong": "robots: wrong",
        "robots_false_alarm": "robots: false alarms",
    }
    columns = {
        "fill_ratio": _fill_format(curve, "fill_ratio"),
        "robots": Column("robots"),
        "horizon_s": Column("time", "s", decimals=0),
        **{name: Column(title, share=True) for name, title in titles.items()},
        "truth": Column("answer that is right"),
        "runs": Column("runs"),
    }
    return Table(
        curve.select(with_limits_of(columns, curve.columns)),
        columns,
        caption="Shares of runs, and of robots, by several times; 95 % intervals.",
        name="detection",
        names=3,
    )


def _figures(curve: pl.DataFrame, scenario: Scenario, tolerated: Detection) -> Iterator[Figure]:
    """Yield figures of misses against the fill ratio: one per number of robots, and one of all numbers.

    A figure of one number of robots has a line for each time; only the ``MOST_CURVES`` smallest numbers have one. If
    there are several numbers, the last figure has a line for each of them, with the misses at the latest time. Nothing
    is yielded if no share of misses is known.
    """
    drawable = curve.filter(pl.col("missed").is_not_null())
    boundary = scenario.decision.decision_boundary

    def figure(name: str, part: pl.DataFrame, series: pl.Expr, title: str) -> Figure:
        return Figure(name, partial(_draw, part, series, boundary, tolerated.error, title), title)

    numbers = drawable["robots"].unique().sort().to_list()
    some = drawn_of(MOST_CURVES, len(numbers), "swarm")
    for robots in numbers[:MOST_CURVES]:
        times = pl.format("{} s", pl.col("horizon_s").round(0).cast(pl.Int64))
        part = drawable.filter(robots=robots)
        yield figure(f"detection-{robots}-robots", part, times, f"{count(robots, 'robot')}{some}")
    if len(numbers) > 1:
        part = drawable.filter(pl.col("horizon_s") == pl.col("horizon_s").max())
        words = [count(robots, "robot") for robots in numbers]
        named = pl.col("robots").replace_strict(numbers, words, return_dtype=pl.String)
        yield figure("detection-robots", part, named, "By robots, at the end")


def _draw(
    part: pl.DataFrame, series: pl.Expr, boundary: float, tolerated: float, title: str, style: str
) -> Picture:
    """Draw misses against the fill ratio, one line for each value of the expression ``series``.

    Lines are in the order in which their values first appear in ``part``, so that 900 s comes before 1200 s, which it
    would not in the order of the text. Within a line, points are in the order of the fill ratio.

    Args:
        part: rows of ``statistics.detection.detection_curve``, sorted by robots, fill ratio and time as there.
        boundary: of the fill ratio. tolerated: tolerated probability of a miss. title: of a picture in a file; a page
            has it above the picture.
    """
    frame = part.select(
        "fill_ratio", "missed", "runs", low="missed_low", high="missed_high", series=series
    ).sort("series", "fill_ratio", maintain_order=True)
    order = part.select(series=series)["series"].unique(maintain_order=True)
    rank = pl.col("series").replace_strict(order.to_list(), range(order.len()), return_dtype=pl.Int64)
    return draw_detection(
        frame.sort(rank, maintain_order=True),
        boundary=boundary,
        tolerated=tolerated,
        percent=True,
        title="" if style == "page" else title,
        style=style,
    )
