"""Tables of the reproduction as a whole: verdicts on claims, measured values, and all tables as CSV files.

A column of the reproduction is a preset. A claim has one or more measured values in a column (``Decided.cells``), each
of which holds, fails, is open or cannot be asked (``claims``).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final

import polars as pl

from vibroswarm.core.atomic_io import whole_folder, write_files
from vibroswarm.core.numbers import MISSING, Estimate, span, stated, verb, with_limits
from vibroswarm.core.tables import csv_bytes
from vibroswarm.paper.claims import CANNOT, Claim, Decided, all_claims
from vibroswarm.paper.columns import COLUMNS
from vibroswarm.paper.item import CLAIMS, Settings
from vibroswarm.paper.items import all_items
from vibroswarm.paper.reproduce import Reproduction

TABLES: Final = "tables"
"""Folder of the tables."""
MARKER: Final = "index.csv"
"""Index of a folder of tables; it marks folders that may be replaced."""


def command_of(settings: Settings, *items: str) -> str:
    """Return the command line that makes some items, or all items.

    Args:
        settings: options of the reproduction. items: names of the items; none: all items.
    """
    words = ["vibroswarm reproduce"]
    words += [f"--only {' '.join(items)}"] if items else []
    words += [f"--runs {settings.runs}", f"--seed {settings.seed}"]
    words += [f"--columns {','.join(settings.columns)}"] if settings.columns != COLUMNS else []
    # Only this item needs the recordings.
    recorded = not items or "calibration" in items
    words += ["--recordings DIR"] if settings.recordings and recorded else []
    return " ".join([*words, "--out DIR"])


def command_of_all(made: Reproduction) -> str:
    """Return the command line that makes all items of a reproduction, which may be some of the paper's only.

    The verdicts depend on them too: intervals are corrected for the number of claims.
    """
    names = [entry.item.name for entry in made.made]
    return command_of(made.settings, *(names if len(names) < len(all_items()) else ()))


def claims_table(
    decided: Sequence[Decided], items: Iterable[str] | None = None, kind: str | None = None
) -> pl.DataFrame:
    """Return one row per claim that has a verdict in at least one column of the reproduction.

    For each column of the reproduction the row has the verdict, under "COLUMN: ours" the measured value in words, and
    under "COLUMN: why not" why some values cannot be asked. These are null if the claim has no verdict in this column:
    it was not measured, or it is not about this column.

    Args:
        decided: verdicts on claims of ``all_claims``; verdicts on other claims are not listed.
        items: names of the items whose claims are listed; None: all.
        kind: "claim" or "check", the kind that is listed; None: both.
    """
    requested = None if items is None else set(items)
    rows = []
    for claim in all_claims():
        of_claim = [verdict for verdict in decided if verdict.claim is claim]
        if (
            not of_claim
            or (requested is not None and claim.item not in requested)
            or kind not in (None, claim.kind)
        ):
            continue
        row: dict[str, str | None] = {
            "item": claim.item, "claim": claim.id, "kind": claim.kind, "says": claim.statement,
            "measured": claim.measured, "holds if": claim.words,
        }  # fmt: skip
        for one in of_claim:
            row |= {one.column: _verdict_words(one), f"{one.column}: ours": _value_words(one)}
            row |= {f"{one.column}: why not": _reasons(one)}
        rows.append(row)
    each = (f"{column}{end}" for column in COLUMNS for end in ("", ": ours", ": why not"))
    names = ("item", "claim", "kind", "says", "measured", "holds if", *each)
    return pl.DataFrame(rows, schema=dict.fromkeys(names, pl.String))


def _verdict_words(one: Decided) -> str:
    """Return the verdict in words, followed by the number of values in each state, such as "2 hold, 1 open".

    The numbers are left out if there is only one value, or if all values have the same state and the verdict shows
    which state it is.
    """
    states = one.cells["holds"].to_list()
    if len(set(states)) == 1 and (one.verdict in ("reproduced", "passed", CANNOT) or len(states) == 1):
        return one.verdict
    words = {"holds": "hold", "fails": "fail", "open": "open", CANNOT: CANNOT}
    numbers = {name: states.count(name) for name in words if name in states}
    parts = [f"{n} {verb(n, words[name], name)}" for name, n in numbers.items()]
    return f"{one.verdict} ({', '.join(parts)})"


def _value_words(one: Decided) -> str:
    """Return the measured value in words: one value with its interval, the range of several values, or "-"."""
    estimated = one.cells.filter(pl.col("why").is_null(), pl.col("estimate").is_not_nan())
    return f"{_range_words(estimated, one.claim)} {one.claim.unit}" if estimated.height else MISSING


def _reasons(one: Decided) -> str | None:
    """Return why some values cannot be asked; None if all can."""
    return "; ".join(one.cells["why"].drop_nulls().unique(maintain_order=True)) or None


def _range_words(cells: pl.DataFrame, claim: Claim) -> str:
    """Return the range of several estimates, or one estimate with its interval, which an exact value does not have.

    Args:
        cells: rows of ``Decided.cells`` with an estimate, at least one. claim: gives the unit and decimals.
    """
    decimals = _decimals(claim)
    if cells.height > 1:
        return span((claim.scale * value for value in cells["estimate"]), decimals)
    estimate, low, high = cells.select("estimate", "low", "high").row(0)
    is_known = None not in (low, high) and low != high  # infinite limits are None
    ends = (claim.scale * low, claim.scale * high) if is_known else (math.nan, math.nan)
    return with_limits(Estimate(claim.scale * estimate, *ends), decimals=decimals)


def _decimals(claim: Claim) -> int:
    """Return the number of decimals with which a claim's values are printed.

    The number is one more than the claim's margin or effect has, and at least the usual number for the claim's unit. A
    time with a margin or effect of 10 s or more has one decimal fewer than this.
    """
    bound = claim.scale * claim.bound
    # Decimals of the bound, without zeros at the end, plus one.
    of_bound = len(stated(abs(bound)).partition(".")[2]) + 1 if bound else 0
    # Usual decimals of each unit; 3 for all other units, such as beliefs.
    of_unit = {"s": 0, "points": 1, "%": 1, "m": 4}.get(claim.unit, 3)
    is_long_time = claim.unit == "s" and abs(bound) >= 10
    return max(of_bound, of_unit) - (1 if is_long_time else 0)


def cells_table(decided: Sequence[Decided]) -> pl.DataFrame:
    """Return one row for each measured value of each claim in each column, with the interval that decided it.

    Values are not scaled for printing, so percentages are shares, as the column ``unit`` says. Without verdicts the
    table has no columns.
    """
    frames = [
        verdict.cells.select(
            pl.lit(verdict.claim.id).alias("claim"), pl.lit(verdict.column).alias("column"), "cell",
            "estimate", "low", "high", "level", pl.lit(verdict.claim.words).alias("holds if"),
            pl.lit(verdict.claim.unit if verdict.claim.scale == 1.0 else "share").alias("unit"), "n", "holds", "why",
        )
        for verdict in decided
    ]  # fmt: skip
    return pl.concat(frames) if frames else pl.DataFrame()


def write_tables(made: Reproduction, folder: Path) -> None:
    """Write the tables of all items and of the verdicts as CSV, with an index of names, titles and commands.

    A file is named ITEM-TABLE.csv, or ITEM.csv if the table has the name of the item. An earlier folder of tables is
    replaced as a whole.
    """
    decided, command = made.decided, command_of_all(made)
    tables = [
        (
            name if name == entry.item.name else f"{entry.item.name}-{name}",
            entry.item.title,
            command_of(made.settings, entry.item.name),
            frame,
        )
        for entry in made.made
        for name, frame in entry.tables.items()
        if name != CLAIMS
    ]
    tables.append(("claims", "Verdicts", command, claims_table(decided)))
    tables.append(("claims-measured", "Verdicts", command, cells_table(decided)))
    index = pl.DataFrame([table[:3] for table in tables], schema=["name", "title", "command"], orient="row")
    contents = {f"{name}.csv": csv_bytes(frame) for name, _, _, frame in tables}
    folder.parent.mkdir(parents=True, exist_ok=True)
    with whole_folder(folder, replace=True, marker=MARKER) as part:
        write_files(part, {**contents, MARKER: csv_bytes(index)})
