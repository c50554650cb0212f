"""What a notebook shows of a reproduction."""

from __future__ import annotations

from collections import Counter

from vibroswarm.notebook.elements import card, paragraph, table
from vibroswarm.notebook.views import view_of
from vibroswarm.paper.claims import Claim, Decided
from vibroswarm.paper.reproduce import Reproduction
from vibroswarm.paper.reproduction_report import claims_table


@view_of.register
def _reproduction(value: Reproduction) -> str:
    """Show the verdict on each claim, and what was skipped."""
    decided = value.decided
    counts = Counter(one.verdict for one in decided)
    columns = [name for name in value.settings.columns if any(one.column == name for one in decided)]
    body = [
        [row["item"], row["says"], *(row[name] or "-" for name in columns)]
        for row in claims_table(decided).iter_rows(named=True)
    ]
    skipped = [f"{one.item.name}: {one.skipped}" for one in value.made if one.skipped]
    return card(
        "Reproduction",
        paragraph(f"{value.settings.runs:,} runs of each cell, seed {value.settings.seed}"),
        paragraph(", ".join(f"{count} {verdict}" for verdict, count in counts.most_common())),
        table(["item", "claim", *columns], body, texts=2 + len(columns)),
        paragraph(f"Skipped: {'; '.join(skipped)}") if skipped else "",
    )


@view_of.register
def _claim(value: Claim) -> str:
    return card(value.id, paragraph(value.statement), paragraph(f"Holds if {value.words}."))


@view_of.register
def _decided(value: Decided) -> str:
    return card(
        value.claim.id, paragraph(value.claim.statement), paragraph(f"{value.column}: {value.verdict}")
    )
