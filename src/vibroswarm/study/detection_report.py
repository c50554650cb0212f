"""The page of the command ``detect``: which fill ratios are recognised, by how many robots, and how soon.

A floor is *missed* in a run without a right consensus. A *false alarm* is a wrong consensus on "more" on a floor with a
fill ratio below the boundary. A floor above the boundary is *distinguished* from a floor below it at a time when misses
of the one and false alarms on the other are both rare enough; it is *recognised* if it is distinguished from some floor
below (``analysis.detection``).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import polars as pl

from vibroswarm.analysis.true_places import true_places_notes
from vibroswarm.plots.curves import draw_detection
from vibroswarm.plots.picture import Picture
from vibroswarm.report.html import Column, Report, ReportTable, Section, picture_of
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import versions

MOST_CURVES: Final = 8
"""Most numbers of robots with a picture of their own."""


def best(distinguished: pl.DataFrame) -> pl.DataFrame:
    """Select one row for each floor above the boundary and number of robots: the hardest pair they distinguish.

    Of the floors below the boundary that the robots distinguish from the floor above, the row has the one with the
    highest fill ratio. If they distinguish none by the end, the row has the floor below the boundary with the highest
    fill ratio, and null in ``time_s``.

    Args:
        distinguished: table of ``analysis.detection.pairs``; the result has its columns.
    """
    is_distinguished = pl.col("time_s").is_not_null()
    # Distinguished pairs come first, and among them the highest fill ratio below the boundary.
    return (
        distinguished.sort(
            "fill_ratio",
            "robots",
            is_distinguished,
            "fill_ratio_below",
            descending=[False, False, True, True],
        )
        .group_by("fill_ratio", "robots", maintain_order=True)
        .first()
    )


def answer(distinguished: pl.DataFrame, scenario: Scenario, error: float, false_alarms: float) -> list[str]:
    """Return notes, the question, and for each number of robots a sentence on the fill ratios that they recognise.

    A sentence names, of the recognised fill ratios above the boundary, the nearest to the boundary and the farthest
    from it; then the fill ratios that are not recognised by the end. If all floors are on one side of the boundary,
    one sentence says so instead.

    Args:
        distinguished: table of ``analysis.detection.pairs``. scenario: of the runs behind the table.
        error, false_alarms: tolerated probabilities of a miss and of a false alarm.
    """
    boundary, t_end_s = scenario.decision.decision_boundary, scenario.run.t_end_s
    notes = true_places_notes([scenario])
    question = (
        f"Does more than {100 * boundary:g} % vibrate? With at most {100 * error:g} % misses and "
        f"{100 * false_alarms:g} % false alarms (upper limits, 95 %)."
    )
    if distinguished.is_empty():
        return [
            *notes,
            question,
            f"All floors are on one side of {100 * boundary:g} %: no pairs of misses and false alarms.",
        ]
    sentences = [*notes, question]
    for (robots,), rows in best(distinguished).group_by("robots", maintain_order=True):
        who = f"{robots} robots find" if robots != 1 else "1 robot finds"
        found = rows.filter(pl.col("time_s").is_not_null()).sort("fill_ratio")
        if found.is_empty():
            sentences.append(f"{who} none of these floors within {t_end_s:g} s.")
            continue
        nearest, farthest = found.row(0, named=True), found.row(-1, named=True)
        sentence = (
            f"{who} a fill ratio of {nearest['fill_ratio']:.4g} within {nearest['time_s']:.0f} s, without false "
            f"alarms on floors up to {nearest['fill_ratio_below']:.4g}"
        )
        if farthest["fill_ratio"] != nearest["fill_ratio"]:
            sentence += f"; {farthest['fill_ratio']:.4g} within {farthest['time_s']:.0f} s"
        missed = rows.filter(pl.col("time_s").is_null())["fill_ratio"].sort().to_list()
        if missed:
            sentence += f"; not {', '.join(f'{fill:.4g}' for fill in missed)} by {t_end_s:g} s"
        sentences.append(f"{sentence}.")
    return sentences


def pictures_of(
    curve: pl.DataFrame, boundary: float, tolerated: float, style: str = "column"
) -> Iterator[tuple[str, Picture]]:
    """Yield names and pictures of misses against the fill ratio: one per number of robots, and one of all numbers.

    A picture of one number of robots has a line for each time; only the ``MOST_CURVES`` smallest numbers have one. If
    there are several numbers, the last picture has a line for each of them, with the misses at the latest time. Nothing
    is yielded if no share of misses is known.

    Args:
        curve: table of ``analysis.detection.detection_curve``. boundary: of the fill ratio.
        tolerated: tolerated probability of a miss. style: of the pictures.
    """
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
    """Draw misses against the fill ratio, one line for each value of the expression ``series``.

    Lines are in the order in which their values first appear in ``part``, so that 900 s comes before 1200 s, which it
    would not in the order of the text. Within a line, points are in the order of the fill ratio.

    Args:
        part: rows of ``analysis.detection.detection_curve``, sorted by robots, fill ratio and time as there.
        boundary: of the fill ratio. tolerated: tolerated probability of a miss. style, title: of the picture.
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
    *,
    with_pictures: bool = True,
) -> Report:
    """Lay out the page.

    Args:
        tables: by name, results of ``analysis.detection``: ``detection`` (``detection_curve``), ``needed``, ``pairs``.
        scenario, seed: those of the runs behind the tables, in which floor and number of robots vary.
        error, false_alarms: tolerated probabilities. warnings: shown first. with_pictures: whether to draw pictures.
    """
    lead = answer(tables["pairs"], scenario, error, false_alarms)
    boundary = scenario.decision.decision_boundary
    drawn_pictures = pictures_of(tables["detection"], boundary, error, "page") if with_pictures else ()
    sections = tuple(
        Section(
            "By time" if name != "detection-robots" else "By robots, at the end",
            parts=(picture_of(drawn, name),),
        )
        for name, drawn in drawn_pictures
    )
    # There are no pairs, and no table of them, if all floors are on one side of the boundary.
    pairs = best(tables["pairs"]) if tables["pairs"].height else tables["pairs"]
    table = ReportTable(pairs, _PAIRS, caption="A dash: not by the end.", name="pairs")
    parts = (table,) if pairs.height else ()
    needed = ReportTable(tables["needed"], _NEEDED, name="needed")
    return Report(
        title="How many robots, and how much time?",
        lead=tuple(lead),
        warnings=tuple(warnings),
        sections=(
            Section("Which floors are told apart", text=_TEXT, parts=parts, sections=sections),
            Section("Every floor", parts=(needed,)),
        ),
        details={"scenario": scenario.hash, "seed": str(seed), **versions()},
    )


_TEXT: Final = (
    "Missed: no right consensus by then; undecided counts. False alarm: a wrong consensus on 'more'. Upper limits "
    "(95 %, Wilson over runs) must be below what is tolerated, so that with few runs nothing is enough. Each holds "
    "separately.",
)
"""Paragraphs above the table of pairs."""
_PAIRS: Final = {
    "fill_ratio": Column("fill ratio", decimals=2),
    "fill_ratio_below": Column("without false alarms on floors up to", decimals=2),
    "robots": Column("robots"),
    "time_s": Column("found within", "s", decimals=0),
    "fewest": Column("fewest robots"),
}
"""Columns of the table of pairs (a floor above the boundary and one below), with their headings."""
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
"""Columns of the table of all floors, with their headings."""
