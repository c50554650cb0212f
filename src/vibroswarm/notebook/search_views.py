"""What a notebook shows of a search, of its scores on fresh runs, and of a comparison of scenarios."""

from __future__ import annotations

from vibroswarm.notebook.elements import card, paragraph, rows, table
from vibroswarm.notebook.records import frame
from vibroswarm.notebook.views import picture_image, view_of
from vibroswarm.optimize.loop import Found
from vibroswarm.optimize.scenario_comparison import Checked
from vibroswarm.optimize.search_page import warnings_of
from vibroswarm.optimize.search_report import pictures
from vibroswarm.optimize.search_tables import interval_said, value_said
from vibroswarm.optimize.validation import Front, Scored, Truth


@view_of.register
def _found(value: Found) -> str:
    """Show the winner's values with their bounds, warnings, and how the scores fell."""
    objective = value.search.objectives[0]
    head = (
        f"{value.search.settings.method} over {value.search.space.size} fields, for the lowest {objective.words}: "
        f"{len(value.archive):,} candidates in {value.runs:,} runs. Believed score of the winner: "
        f"{value.believed:.4g} {objective.unit}".rstrip()
    )
    values = value.values
    body = [[d.name, value_said(values[d.name]), f"{d.low:g}", f"{d.high:g}"] for d in value.search.space]
    parts = [paragraph(head), table(["field", "winner", "lowest", "highest"], body)]
    if len(value.front) > 1:
        parts.append(paragraph(f"{len(value.front)} candidates are on the front; next: front_of(found)."))
    parts += [paragraph(text) for text in warnings_of(value, None, None, []) if "fresh runs" in text]
    if value.history:
        parts.append(picture_image(pictures(value, None)["scores"], 420))
    return card("Search", *parts, paragraph("Next: truth_of(found), write_report(found, folder)"))


@view_of.register
def _truth(value: Truth) -> str:
    """Show the believed and the true score, and the differences from the starts."""
    score = value.winner.score
    numbers = {
        "believed score": f"{value.believed:.4g}",
        "true score": f"{interval_said(score)} ({score.n:,} fresh runs)",
    }
    numbers |= {
        f"winner - {other.name}": interval_said(less, sign=True)
        for other, less in zip(value.others, value.against, strict=True)
    }
    return card("Score on fresh runs", paragraph(value.words), rows(numbers))


@view_of.register
def _scored(value: Scored) -> str:
    return card(value.name, rows({"score": interval_said(value.score), **value.values}))


@view_of.register
def _front(value: Front) -> str:
    return card("Pareto front", paragraph(value.words), frame(value.table))


@view_of.register
def _checked(value: Checked) -> str:
    """Show which of two scenarios is better, and both blocks of seeds."""
    numbers = {
        value.first.name: interval_said(value.first.score),
        value.second.name: interval_said(value.second.score),
        "difference": interval_said(value.difference, sign=True),
        "difference on other seeds": interval_said(value.replicate, sign=True),
    }
    return card(value.objective.words, paragraph(value.says), rows(numbers))
