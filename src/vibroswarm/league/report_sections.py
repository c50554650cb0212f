"""Sections of a league's report on beliefs and on faulty robots."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import polars as pl

from vibroswarm.league.belief_calibration import AS_PLAYED, AT_95, COMMON, OWN
from vibroswarm.league.fault_curves import MARGIN, borne
from vibroswarm.plots.error_bars import draw_error_bars
from vibroswarm.report.html import Column, ReportTable, Section, picture_of

PERCENT: Final = Column(percent=True)
COLUMNS: Final = {"name": Column("entry"), **dict.fromkeys(("confidence", "right", "decided"), PERCENT)}
"""Headings and formats of the table of beliefs, by column."""


def belief_sentences(beliefs: pl.DataFrame | None) -> list[str]:
    """Write the sentence that names the strategies whose robots are right less often than their confidence says.

    A strategy is named, for each prior of the fill ratio, if its interval of the share right lies below its interval of
    the confidence. Only the settings with which it plays in the league count.

    Args:
        beliefs: table from ``belief_calibration``; None if it was not computed.
    Returns: a list of one sentence, or an empty list.
    """
    if beliefs is None or not beliefs.height:
        return []
    rows = beliefs.drop_nulls(["right_high", "confidence_low"])
    too_sure = pl.col("right_high") < pl.col("confidence_low")
    found = []
    for prior, words in ((OWN, "on floors from their own prior"), (COMMON, "on floors of independent tiles")):
        names = rows.filter((pl.col("prior") == prior) & (pl.col("settings") == AS_PLAYED) & too_sure)["name"]
        found.append(f"{words}: {', '.join(names) or 'none shown'}")
    return [f"Strategies whose robots are right less often than their confidence says, {'; '.join(found)}."]


def faults_section(curves: pl.DataFrame | None) -> tuple[Section, ...]:
    """Return two sections on faulty robots: the numbers tolerated with a picture for each kind, and all figures.

    Args:
        curves: table from ``fault_curves``; if it is None or empty, there are no sections.
    """
    if curves is None or not curves.height:
        return ()
    text = (
        "Forced error of the working robots of the smallest swarm when others are faulty, on random floors on both "
        "sides of 1/2; runs are paired. A strategy tolerates a fault if the 95 % interval of the rise lies below "
        f"{100 * MARGIN:.0f} points, for that number of faulty robots and all smaller ones."
    )
    parts: list[Any] = []
    for kind in curves["kind"].unique(maintain_order=True):
        words = kind.replace("_", " ")
        marks = curves.filter(pl.col("kind") == kind).select(
            x="name",
            series=pl.format("{} robots " + words, "faulty"),
            estimate="forced_error",
            low="forced_error_low",
            high="forced_error_high",
        )
        picture = draw_error_bars(
            marks, label="forced error of the others", percent=True, title=words.capitalize(), style="page"
        )
        parts.append(picture_of(picture, f"faults-{kind}"))
    table = borne(curves).rename({"borne": "faulty robots tolerated", "open": "more: inconclusive"})
    return (
        Section(
            "Faulty robots",
            text=(text,),
            parts=(ReportTable(table, {"name": Column("entry")}, name="borne"), *parts),
        ),
        Section(
            "Faulty robots, all figures",
            parts=(
                ReportTable(
                    curves, {"name": Column("entry"), "forced_error": PERCENT, "rise": PERCENT}, name="faults"
                ),
            ),
            folded=True,
        ),
    )


def beliefs_section(beliefs: pl.DataFrame | None) -> tuple[Section, ...]:
    """Return a tuple with the section that compares the robots' confidence with how often they are right.

    Args:
        beliefs: table from ``belief_calibration``; if it is None or empty, the tuple is empty.
    """
    if beliefs is None or not beliefs.height:
        return ()
    text = (
        "Robots that decided: their mean confidence, and the share of them that were right. Over floors as "
        "the strategy expects them (its own prior of the fill ratio), and over floors whose tiles vibrate "
        f"independently. '{AT_95}': at p_c = 0.95 and O_c = 0. Strategies without a belief are left out."
    )
    marks = [
        {"x": f"{row['name']}, {row['settings']}", "series": f"{name}, {row['prior']}"}
        | {to: row[f"{name}{end}"] for to, end in (("estimate", ""), ("low", "_low"), ("high", "_high"))}
        for row in beliefs.iter_rows(named=True)
        for name in ("confidence", "right")
    ]
    picture = draw_error_bars(
        pl.DataFrame(marks, infer_schema_length=None),
        label="robots that decided",
        interval="95 % jackknife interval over motions",
        percent=True,
        style="page",
    )
    table = pl.DataFrame(
        [
            {
                "name": row["name"],
                "settings": row["settings"],
                "prior": row["prior"],
                "confidence": row["confidence"],
                "confidence, 95 %": limits_text(row, "confidence", scale=100, form=".1f"),
                "right": row["right"],
                "right, 95 %": limits_text(row, "right", scale=100, form=".1f"),
                "decided": row["decided"],
            }
            for row in beliefs.iter_rows(named=True)
        ]
    )
    return (
        Section(
            "Belief and truth",
            text=(text,),
            parts=(
                picture_of(picture, "beliefs"),
                ReportTable(
                    table,
                    COLUMNS,
                    name="beliefs",
                ),
            ),
        ),
    )


def limits_text(row: Mapping[str, float], name: str, scale: float, form: str) -> str:
    """Write the limits of a figure, such as ``9.7 to 16.4``; a dash if there are none.

    Args:
        row: has the limits of the figure ``name`` in columns that end in ``_low`` and ``_high``.
        scale: factor of the limits. form: format of a number.
    """
    low, high = row[f"{name}_low"], row[f"{name}_high"]
    return "-" if low is None or high is None else f"{scale * low:{form}} to {scale * high:{form}}"
