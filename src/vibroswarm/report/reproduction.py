"""The report of a reproduction: a verdict on each claim of the paper, then the tables and pictures of its items."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import polars as pl

from vibroswarm.core.numbers import count
from vibroswarm.paper.claims import VERDICTS, Decided
from vibroswarm.paper.item import Made
from vibroswarm.paper.reproduce import Reproduction
from vibroswarm.report.report import Figure, Report, Table, report
from vibroswarm.simulation import versions


@report.register
def of_reproduction(found: Reproduction) -> Report:
    """Return how many claims hold, the verdict on each, and all figures and tables."""
    settings, decided = found.settings, found.decided
    parts: dict[str, Table | Figure] = {
        "claims": Table(
            claims_table(decided), "Claims of the paper", "Value and limits, or the range of several."
        ),
        "claims-measured": Table(
            values_table(decided), "Measured values", titles={"why": "why not"}, folded=True
        ),
    }
    for made in found.made:
        parts |= _parts(made)
    return Report(
        title="The paper, reproduced",
        answer=tuple(_counted(column, decided) for column in settings.columns),
        parts=parts,
        setting=f"{count(settings.runs, 'run')} per cell, seed {settings.seed}",
        warnings=tuple(f"{made.item.name}: skipped, {made.skipped}" for made in found.made if made.skipped),
        made_by={"seed": str(settings.seed), **versions()},
    )


def _counted(column: str, decided: Sequence[Decided]) -> str:
    found = Counter(one.verdict for one in decided if one.column == column and not one.claim.check)
    texts = [f"{found[verdict]} {verdict}" for verdict in VERDICTS if found[verdict]]
    return f"Preset {column}: of {count(found.total(), 'claim')} {', '.join(texts)}."


def claims_table(decided: Sequence[Decided]) -> pl.DataFrame:
    """Return a row for each claim, with a verdict and the measured value in each column."""
    rows: dict[str, dict[str, str]] = {}
    for one in decided:
        claim, values = one.claim, one.values.filter(pl.col("state") != "cannot be asked")
        start = {"claim": claim.statement, "holds_if": _bounds(one), "id": claim.id}
        row = rows.setdefault(claim.id, start)
        row[one.column] = f"{one.verdict}: {_range(values)}" if values.height else one.verdict
    columns = dict.fromkeys(one.column for one in decided)
    table = pl.DataFrame(list(rows.values()), infer_schema_length=None)
    return table.select("claim", "holds_if", *columns, "id") if rows else table


def _bounds(one: Decided) -> str:
    low, high = one.claim.bounds
    text = (
        f"within ±{high:g}"
        if low == -high
        else f"at least {low:g}"
        if high == float("inf")
        else f"at most {high:g}"
    )
    return f"{text} {one.claim.unit}"


def _range(values: pl.DataFrame) -> str:
    if values.height > 1:
        least, most = values.select(pl.col("estimate").min(), most=pl.col("estimate").max()).row(0)
        return f"{least:.4g} to {most:.4g}"
    row = values.row(0, named=True)
    return f"{row['estimate']:.4g} [{row['estimate_low']:.4g}, {row['estimate_high']:.4g}]"


def values_table(decided: Sequence[Decided]) -> pl.DataFrame:
    """Return a row for each measured value of each claim in each column."""
    frames = [
        one.values.select(
            pl.lit(one.claim.id).alias("claim"),
            pl.lit(one.column).alias("column"),
            pl.lit(one.verdict).alias("verdict"),
            pl.all(),
            pl.lit(one.level).alias("level"),
            pl.lit(one.claim.unit).alias("unit"),
        )
        for one in decided
    ]
    return pl.concat(frames) if frames else pl.DataFrame()


def _parts(made: Made) -> dict[str, Table | Figure]:
    title, name = f"{made.item.number}. {made.item.title}", made.item.name
    pictures = {
        key: Figure(one.draw, f"{title}: {one.title}", folded=one.folded)
        for key, one in made.pictures.items()
    }
    tables = {
        key if key == name else f"{name}-{key}": Table(
            frame, title, made.item.about, folded=frame.height > 12
        )
        for key, frame in made.tables.items()
    }
    return {**pictures, **tables}
