"""Lay out the HTML page of a grid: the cell with the lowest score, and all cells as heat maps and as a table.

The score of a cell on the runs by which the lowest cell was chosen is its believed score. ``Truth`` holds the score of
the lowest cell on fresh runs, the true score.
"""

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
from vibroswarm.show.made_by import versions_in_words
from vibroswarm.show.numbers import counts
from vibroswarm.study.plan import plan_of

TITLES: Final = {
    "grid-score": "The score",
    "grid-decision-time-s": "The decision time",
    "grid-belief-in-truth": "The belief in the truth",
}
"""Titles of pictures by their names."""
CELL_TONES: Final = {"the lowest": "good", "not significant": "open"}
"""Colours of the column "run by run", by its text."""
ROWS_IN_SIGHT: Final = 12
"""Longer tables are folded if pictures show the same numbers."""


def grid_page(
    nodes: Nodes, truth: Truth | None, pictures: Mapping[str, Picture], made_by: Sequence[Mapping[str, str]]
) -> Report:
    """Lay out the page of a grid.

    Args:
        nodes: the scored cells. truth: the score of the lowest cell on fresh runs, if it was determined.
        pictures: by name (see ``TITLES``), drawn in the style of the page; may be empty.
        made_by: the versions of the programs that made the grid, one entry for each set of versions.
    """
    grid, best = nodes.grid, nodes.best
    unit = grid.objective.unit
    sections = []
    if truth is not None:
        # There is no table of cases: the lowest cell is a single scenario.
        parts = truth_parts(truth, best.scored.score.n, cases=(), unit=unit)
        sections.append(Section("Believed and true", text=(truth.words,), parts=parts))
    # the text of the section about the lowest cell
    words = (f"The lowest: {values_said(best.cell.point)}. {IN_FOLDER}",)
    text = file_text(grid)
    file = "grid.toml" if text else ""
    sections.append(Section("The lowest cell", text=words, parts=(commands(file, against="paper"),)))
    drawn = [
        Section(TITLES[name], parts=(_shown(name, picture, nodes),)) for name, picture in pictures.items()
    ]
    if drawn:
        sections.append(Section("The cells as pictures", sections=tuple(drawn), side_by_side=len(drawn) > 1))
    folded = bool(drawn) and len(nodes.nodes) > ROWS_IN_SIGHT
    sections.append(Section("The cells in numbers", parts=(_cell_table(nodes),), folded=folded))
    if text:
        sections.append(Section("The grid's file", parts=(ReportCode(text, name="grid.toml"),), folded=True))
    return Report(
        title=grid.study.name or f"A grid, for the lowest {grid.objective.words}",
        lead=_lead(nodes, truth),
        warnings=tuple(_warnings(nodes, truth, made_by)),
        sections=tuple(sections),
        details=_details(nodes, truth, made_by),
    )


def _lead(nodes: Nodes, truth: Truth | None) -> tuple[str, ...]:
    """Write the introduction of a grid's page, one entry per paragraph.

    ``truth`` is the score of the lowest cell on fresh runs; if it is None, the paragraph about the lowest cell is left
    out.
    """
    grid = nodes.grid
    varied = ", ".join(f"`{name}`" for name in grid.study.varied)
    aim = f"for the lowest {grid.objective.words}"
    runs = counts((node.scored.score.n for node in nodes.nodes), "run")
    first = f"{len(nodes.nodes)} cells over {varied}, {runs} per cell, {aim}."
    if truth is None:
        return *nodes.notes, first, QUOTE
    return *nodes.notes, first, best_words(nodes.best.cell.point, truth, grid.objective.unit), QUOTE


def _warnings(nodes: Nodes, truth: Truth | None, made_by: Sequence[Mapping[str, str]]) -> list[str]:
    """List the warnings that apply to a grid, for its page.

    Args:
        nodes: the scored cells. truth: the score of the lowest cell on fresh runs, None if it was not computed.
        made_by: the versions of the programs that made the grid, one entry for each set of versions.
    """
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
    """Describe the fields in which the lowest cell is at the edge of the grid, such as "`eta` 750 (750 to 2500)".

    Only fields with at least three values, all of them numbers, are checked: of two values, each is at an edge.
    """
    edges = []
    best = nodes.best.cell.point  # values of the varied fields by name
    short = short_names(list(best))
    for name, value in best.items():
        values = {node.cell.point.get(name) for node in nodes.nodes}
        numbers = sorted(v for v in values if isinstance(v, int | float) and not isinstance(v, bool))
        all_numbers = len(numbers) == len(values)
        if all_numbers and len(values) > 2 and value in (numbers[0], numbers[-1]):
            ends = f"{value_said(numbers[0])} to {value_said(numbers[-1])}"
            edges.append(f"`{short[name]}` {value_said(value)} ({ends})")
    return edges


def _cell_table(nodes: Nodes) -> ReportTable:
    """Tabulate the cells: values, scores, how they compare with the lowest cell, and other figures.

    The column ``standing`` says of each cell whether it is the lowest, not significantly higher, or higher.
    """
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
        "score": Column("score", unit, digits=4), "score_low": Column("from", unit, digits=4),
        "score_high": Column("to", unit, digits=4), "standing": Column("run by run", tones=CELL_TONES),
        "above_best": Column("above the lowest", unit), "above_best_low": Column("from", unit),
        "above_best_high": Column("to", unit), "decision_time_s": Column("decision time", "s"),
        "robots_wrong": Column("robots wrong", percent=True),
        "robots_undecided": Column("robots undecided", percent=True),
        "belief_in_truth": Column("belief in the truth"),
    }  # fmt: skip
    caption = f"With 95 % intervals. {_shared(nodes)}".strip()
    return ReportTable(
        table.with_columns(standing=pl.Series(standing)).select(column_names),
        columns,
        caption=caption,
        name="grid",
    )


def _shown(name: str, picture: Picture, nodes: Nodes) -> ReportPicture:
    """Prepare a picture for the page; its caption also says whether the cells share motion."""
    shown = picture_of(picture, name)
    return replace(shown, caption=f"{shown.caption} {_shared(nodes)}".strip())


def _shared(nodes: Nodes) -> str:
    """Return the sentence which says that all cells share motion, or an empty text if they do not."""
    # A group of the plan has the cells that share motion.
    if len(plan_of(nodes.grid.study).groups) > 1:
        return ""
    return "All cells replay one motion, so that they are compared run by run."


def _details(nodes: Nodes, truth: Truth | None, made_by: Sequence[Mapping[str, str]]) -> dict[str, str]:
    """Return the details at the end of the page by name: hash, seed, engine, versions and the command to repeat it.

    The command is left out if the grid has no file: its cost is a function, or its study varies no fields in a grid.
    """
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
