"""The document of a grid: the cell with the lowest score, and all cells.

The score of a cell on the runs by which the lowest cell was chosen is its believed score; the true score of the lowest
cell is that on fresh runs.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Final

import polars as pl

from vibroswarm.core.numbers import count, counts, decimals_of, listed, verb, with_limits
from vibroswarm.documents.cell_figures import figure_columns
from vibroswarm.documents.knowledge import told, versions_in_words
from vibroswarm.documents.search import captioned, commands, file_section, truth_section
from vibroswarm.documents.search_words import (
    DIFFERENT_VERSIONS,
    aim,
    best_sentence,
    labels_of,
    luck_warning,
    score_label,
    value_text,
    values_text,
)
from vibroswarm.optimize.grid import Nodes
from vibroswarm.optimize.search_files import file_text
from vibroswarm.optimize.validation import Truth
from vibroswarm.plots.heat import draw_heat
from vibroswarm.plots.labels import label_of
from vibroswarm.plots.picture import Picture
from vibroswarm.show.document import Column, Document, Figure, Section, Table, Text
from vibroswarm.simulation import versions
from vibroswarm.study.plan import plan_of

FIGURES: Final = {
    "score": "The score",
    "decision_time_s": "The decision time",
    "belief_in_truth": "The belief in the truth",
}
"""Titles of the figures of two varied fields, by the column that they show."""
CELLS: Final = figure_columns(("belief_in_truth", "runs")) | {
    "standing": Column("run by run", tones={"the lowest": "good", "not significant": "open"}),
}
"""Headings and formats of the columns of cells that have no unit of the score."""


def grid_document(
    nodes: Nodes, truth: Truth | None = None, made_by: Sequence[Mapping[str, str]] = ()
) -> Document:
    """Return the document of a grid.

    Args:
        truth: the score of the lowest cell on fresh runs, if it was determined.
        made_by: the versions of the programs that made the grid, one entry for each set of versions; by default the
            current ones.
    """
    grid, best = nodes.grid, nodes.best
    unit = grid.objective.unit
    # There is no table of cases: the lowest cell is a single scenario.
    scores = [] if truth is None else [truth_section(truth, best.scored.score.n, (), unit)]
    made_by = made_by or [versions()]
    return Document(
        title=grid.study.name or f"A grid, for the lowest {aim(grid.objective)}",
        answer=(_answer(nodes, truth),),
        knew=told(node.cell.scenario for node in nodes.nodes),
        warnings=tuple(_warnings(nodes, truth, made_by)),
        parts=(
            Text(_cells_in_words(nodes)),
            *scores,
            *_heat_maps_section(nodes),
            Section("The cells", (_cell_table(nodes),)),
            file_section(file_text(grid), "grid.toml"),
        ),
        made_by=_made_by(nodes, truth, made_by),
        data={"grid": nodes.table},
    )


def _answer(nodes: Nodes, truth: Truth | None) -> str:
    best, unit = nodes.best, nodes.grid.objective.unit
    if truth is not None:
        return best_sentence(best.cell.point, truth, unit)
    return f"Best: {values_text(best.cell.point)}. Score on its own runs: {with_limits(best.scored.score, unit)}."


def _cells_in_words(nodes: Nodes) -> str:
    varied = ", ".join(f"`{name}`" for name in nodes.grid.study.varied)
    runs = counts((node.scored.score.n for node in nodes.nodes), "run")
    return (
        f"{count(len(nodes.nodes), 'cell')} over {varied}, {runs} per cell, for the lowest "
        f"{aim(nodes.grid.objective)}. {_shared_motion_sentence(nodes)}"
    ).rstrip()


def _shared_motion_sentence(nodes: Nodes) -> str:
    # A group of the plan has the cells that share motion.
    is_shared = len(plan_of(nodes.grid.study).groups) == 1
    return "All cells replay one motion, so that they are compared run by run." if is_shared else ""


def _warnings(nodes: Nodes, truth: Truth | None, made_by: Sequence[Mapping[str, str]]) -> Iterator[str]:
    if truth is None:
        yield "The lowest cell was not scored on fresh runs: only the score on its own runs is shown."
    elif words := luck_warning(truth):
        yield words
    if others := sum(node.as_good for node in nodes.nodes if node is not nodes.best):
        yield (
            f"Beside the lowest cell, {others} of {len(nodes.nodes) - 1} {verb(others, 'are', 'is')} not significantly "
            "different from it. These runs do not show which of them is best."
        )
    if edges := _edges(nodes):
        yield f"The lowest cell lies at the edge of the grid: {listed(edges)}. Better values may lie beyond."
    if len(made_by) > 1:
        yield DIFFERENT_VERSIONS


def _edges(nodes: Nodes) -> list[str]:
    """Describe the fields in which the lowest cell is at the edge of the grid, such as "feedback η 750 (750 to 2500)".

    Only fields with at least three values, all of them numbers, are checked: of two values, each is at an edge.
    """
    edges = []
    best = nodes.best.cell.point
    for name, value in best.items():
        values = {node.cell.point.get(name) for node in nodes.nodes}
        numbers = sorted(v for v in values if isinstance(v, int | float) and not isinstance(v, bool))
        if len(numbers) == len(values) > 2 and value in (numbers[0], numbers[-1]):
            ends = f"{value_text(numbers[0])} to {value_text(numbers[-1])}"
            edges.append(f"{values_text({name: value})} ({ends})")
    return edges


def _cell_table(nodes: Nodes) -> Table:
    """Tabulate the cells: values, scores, how they compare with the lowest cell, and other figures."""
    unit, table = nodes.grid.objective.unit, nodes.table
    standing = [
        "the lowest" if node is nodes.best else "not significant" if node.as_good else "higher"
        for node in nodes.nodes
    ]
    varied = [name for name in nodes.grid.study.varied if name in table.columns]
    frame = table.with_columns(standing=pl.Series(standing)).select(
        *varied, pl.col("^score.*$"), "standing", pl.col("^above_best.*$"), "decision_time_s", "robots_wrong",
        "robots_undecided", "belief_in_truth", "runs",
    )  # fmt: skip
    decimals = decimals_of(table["score"], 4)
    columns = {name: Column(label.named, label.unit) for name, label in labels_of(varied).items()}
    columns |= {
        "score": Column("score", unit, decimals=decimals),
        "above_best": Column("above the lowest", unit, decimals=decimals, sign=True, wide=True),
        **CELLS,
    }
    return Table(
        frame,
        columns,
        "With 95 % intervals; those above the lowest hold together.",
        "grid",
        names=len(varied),
    )


def _heat_maps_section(nodes: Nodes) -> tuple[Section, ...]:
    if len(nodes.grid.study.varied) != 2:
        return ()
    figures = [
        Figure(
            f"grid-{name.replace('_', '-')}",
            captioned(
                lambda style, name=name: _draw(nodes, name, style),
                f" {_shared_motion_sentence(nodes)}".rstrip(),
            ),
            title,
            on_page="column",
        )
        for name, title in FIGURES.items()
    ]
    return (Section("The cells as pictures", tuple(figures), side_by_side=True),)


def _draw(nodes: Nodes, name: str, style: str) -> Picture:
    """Draw a column of the cells over the two varied fields: the first is x, the second y."""
    varied = nodes.grid.study.varied
    labels = {
        "score": score_label(nodes.grid.objective),
        "decision_time_s": "decision time (s)",
        "belief_in_truth": "belief in the truth",
    }
    x_label, y_label = (label_of(field).text for field in varied)
    return draw_heat(
        nodes.table.select(x=varied[0], y=varied[1], value=name, runs="runs"),
        x_label=x_label,
        y_label=y_label,
        label=labels[name],
        best="high" if name == "belief_in_truth" else "low",
        style=style,
    )


def _made_by(nodes: Nodes, truth: Truth | None, made_by: Sequence[Mapping[str, str]]) -> dict[str, str]:
    """Return what repeats a grid, and the commands for its lowest cell."""
    study = nodes.grid.study
    fresh = "" if truth is None else f" --fresh {truth.winner.score.n}"
    file = "grid.toml" if file_text(nodes.grid) else ""
    return {
        "study": study.hash,
        "seed": str(study.seed),
        "objective": nodes.grid.objective.words,
        "engine": study.motion,
        **versions_in_words(made_by),
        **commands(file, "paper", f" --method grid{fresh}"),
    }
