"""Lay out the page of a grid: its lowest cell and the true score, the cells as heat maps and as a table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import polars as pl

from vibroswarm.optimize.grid import Nodes
from vibroswarm.optimize.search_page import (
    IN_FOLDER,
    QUOTE,
    best_words,
    commands,
    file_text,
    luck_words,
    truth_parts,
)
from vibroswarm.optimize.search_tables import GRID_LUCK, short_names, value_said, values_said
from vibroswarm.optimize.validation import Truth
from vibroswarm.plots import Picture
from vibroswarm.report.html import Column, Report, ReportCode, ReportPicture, ReportTable, Section, picture_of
from vibroswarm.study.plan import plan_of
from vibroswarm.study.study_report import count_range, versions_in_words

TITLES: Final = {
    "grid-score": "The score",
    "grid-decision-time-s": "The decision time",
    "grid-belief-in-truth": "The belief in the truth",
}
CELL_TONES: Final = {"the lowest": "good", "not significant": "open"}
ROWS_IN_SIGHT: Final = 12
"""Longer tables are folded if pictures show the same numbers."""


def grid_page(
    nodes: Nodes, truth: Truth | None, pictures: Mapping[str, Picture], made_by: Sequence[Mapping[str, str]]
) -> Report:
    """Lay out the page of a grid.

    Args:
        nodes: its cells. truth: of the lowest. pictures: in the style of the page; may be empty.
        made_by: versions of what made it.
    """
    grid, best = nodes.grid, nodes.best
    unit = grid.objective.unit
    sections = []
    if truth is not None:
        parts = truth_parts(truth, best.scored.score.n, (), unit)
        sections.append(Section("Believed and true", (truth.words,), parts))
    words = (f"The lowest: {values_said(best.cell.point)}. {IN_FOLDER}",)
    file = "grid.toml" if file_text(grid) else ""
    sections.append(Section("The lowest cell", words, (commands(file, "paper"),)))
    drawn = [
        Section(TITLES[name], parts=(_shown(name, picture, nodes),)) for name, picture in pictures.items()
    ]
    if drawn:
        sections.append(Section("The cells as pictures", sections=tuple(drawn), side_by_side=len(drawn) > 1))
    folded = bool(drawn) and len(nodes.nodes) > ROWS_IN_SIGHT
    sections.append(Section("The cells in numbers", (), (_cell_table(nodes),), folded=folded))
    if text := file_text(grid):
        sections.append(Section("The grid's file", (), (ReportCode(text, "grid.toml"),), folded=True))
    return Report(
        title=grid.study.name or f"A grid, for the lowest {grid.objective.words}",
        lead=_lead(nodes, truth),
        warnings=tuple(_warnings(nodes, truth, made_by)),
        sections=tuple(sections),
        details=_details(nodes, truth, made_by),
    )


def _lead(nodes: Nodes, truth: Truth | None) -> tuple[str, ...]:
    """Write the introduction of a grid's page."""
    grid = nodes.grid
    varied = ", ".join(f"`{name}`" for name in grid.study.varied)
    aim = f"for the lowest {grid.objective.words}"
    runs = count_range(node.scored.score.n for node in nodes.nodes)
    first = f"{len(nodes.nodes)} cells over {varied}, {runs} runs per cell, {aim}."
    if truth is None:
        return first, QUOTE
    return first, best_words(nodes.best.cell.point, truth, grid.objective.unit), QUOTE


def _warnings(nodes: Nodes, truth: Truth | None, made_by: Sequence[Mapping[str, str]]) -> list[str]:
    """List the warnings that apply to a grid."""
    words = []
    if truth is None:
        words.append(
            "The lowest cell was not scored on fresh runs: this page shows only the score on its own runs."
        )
    elif warning := luck_words(truth):
        words.append(warning)
    others = sum(node.as_good for node in nodes.nodes if node is not nodes.best)
    if others:
        words.append(f"Beside the lowest cell, {others} of {len(nodes.nodes) - 1} are {GRID_LUCK}")
    if edges := _edges(nodes):
        words.append(
            f"The lowest cell lies at the edge of the grid: {', '.join(edges)}. Better values may lie beyond."
        )
    if len(made_by) > 1:
        words.append("Different versions made parts of it; as a whole it may not be repeatable.")
    return words


def _edges(nodes: Nodes) -> list[str]:
    """List the numeric fields in which the lowest cell is at the edge of the grid."""
    edges = []
    best = nodes.best.cell.point
    short = short_names(list(best))
    for name, value in best.items():
        values = {node.cell.point.get(name) for node in nodes.nodes}
        numbers = sorted(v for v in values if isinstance(v, int | float) and not isinstance(v, bool))
        if len(numbers) == len(values) > 2 and value in (numbers[0], numbers[-1]):
            ends = f"{value_said(numbers[0])} to {value_said(numbers[-1])}"
            edges.append(f"`{short[name]}` {value_said(value)} ({ends})")
    return edges


def _cell_table(nodes: Nodes) -> ReportTable:
    """Tabulate the cells with scores and their standing against the lowest."""
    unit, table = nodes.grid.objective.unit, nodes.table
    standing = [
        "the lowest" if node is nodes.best else "not significant" if node.as_good else "higher"
        for node in nodes.nodes
    ]
    varied = [name for name in nodes.grid.study.varied if name in table.columns]
    column_names = [*varied, "score", "score_low", "score_high", "standing", "above_best", "above_best_low"]
    column_names += [
        "above_best_high",
        "decision_time_s",
        "robots_wrong",
        "robots_undecided",
        "belief_in_truth",
        "runs",
    ]
    columns = {name: Column(end, digits=6) for name, end in short_names(varied).items()}
    columns |= {
        "score": Column("score", unit, 4), "score_low": Column("from", unit, 4),
        "score_high": Column("to", unit, 4), "standing": Column("run by run", tones=CELL_TONES),
        "above_best": Column("above the lowest", unit), "above_best_low": Column("from", unit),
        "above_best_high": Column("to", unit), "decision_time_s": Column("decision time", "s"),
        "robots_wrong": Column("robots wrong", percent=True),
        "robots_undecided": Column("robots undecided", percent=True),
        "belief_in_truth": Column("belief in the truth"),
    }  # fmt: skip
    caption = f"With 95 % intervals. {_shared(nodes)}".strip()
    return ReportTable(
        table.with_columns(standing=pl.Series(standing)).select(column_names), columns, caption, "grid"
    )


def _shown(name: str, picture: Picture, nodes: Nodes) -> ReportPicture:
    shown = picture_of(picture, name)
    return replace(shown, caption=f"{shown.caption} {_shared(nodes)}".strip())


def _shared(nodes: Nodes) -> str:
    """Write that cells share motion, if they do."""
    if len(plan_of(nodes.grid.study).groups) > 1:
        return ""
    return "All cells replay one motion, so that they are compared run by run."


def _details(nodes: Nodes, truth: Truth | None, made_by: Sequence[Mapping[str, str]]) -> dict[str, str]:
    """Return hash, seed, engine, versions and commands of a grid."""
    study = nodes.grid.study
    details = {
        "study": study.hash,
        "seed": str(study.seed),
        "engine": study.motion,
        **versions_in_words(made_by),
    }
    if file_text(nodes.grid):
        fresh = "" if truth is None else f" --fresh {truth.winner.score.n}"
        details["to repeat, in this folder"] = f"vibroswarm optimize grid.toml --method grid{fresh} --out ."
    return details
