"""Compare cells in pairs that differ in a single field, or in the label and the fields that it stands for.

Of strategies all pairs are compared, of other words the first value, or the reference that the user names, with the
others. A numeric field is compared only if nothing else varies and it has few values: many make a curve. Floors are
not, since the user of a swarm does not choose them. P-values are corrected over all comparisons of a study.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Final, NamedTuple

import polars as pl

from vibroswarm.errors import check_choice
from vibroswarm.statistics.figures import BY_COLUMN
from vibroswarm.statistics.paired import COMPARED, ESTIMATED, Paired, compare, holm
from vibroswarm.study.cells import LABEL, Cell
from vibroswarm.study.runs import Runs
from vibroswarm.study.spec import SOURCE

STRATEGY: Final = "strategy.name"
"""The field of which every two values are compared."""
SIGNIFICANT: Final = 0.05
"""A difference is significant if its corrected p-value is below this."""
FIGURES: Final = ("decision_time_s", "right_share", "wrong_share", "undecided_share")
"""The figures of an answer."""
MOST_VALUES: Final = 8
"""A field with more values makes a curve and is not compared value by value."""
MOST_PAIRS: Final = 200
"""If a study has more pairs, none is compared."""


class Pair(NamedTuple):
    """A cell and its reference, which differ in a field."""

    cell: Cell
    reference: Cell
    field: str

    @property
    def names(self) -> tuple[str, str, str]:
        """What both are called (value of the field, or name of the cell), and the values that they share, as text."""
        rest = self.cell.text_of(k for k in self.cell.point if k != self.field)
        first, reference = (cell.text_of([self.field]) or "-" for cell in (self.cell, self.reference))
        if self.field == LABEL or first == reference:
            return self.cell.name, self.reference.name, ""
        return first, reference, rest

    @property
    def name(self) -> str:
        """The name of the comparison: ``soft - none (random:0.48)``."""
        first, reference, rest = self.names
        return f"{first} - {reference}" + (f" ({rest})" if rest else "")


@dataclass(frozen=True)
class Compared:
    """One figure compared between a cell and its reference."""

    pair: Pair
    paired: Paired
    """The comparison: cell - reference."""

    @property
    def is_defined(self) -> bool:
        """Whether there is a difference: none is right or wrong where no answer is."""
        return not math.isnan(self.paired.difference.estimate)

    @property
    def significant(self) -> bool:
        """Whether the p-value, corrected over all comparisons of the study (Holm), is below ``SIGNIFICANT``."""
        return self.paired.p_holm < SIGNIFICANT

    @property
    def better(self) -> bool | None:
        """Whether the cell is better than its reference in this figure; None if the difference is not significant."""
        if not self.significant:
            return None
        return self.paired.difference.estimate * BY_COLUMN[self.paired.figure].better > 0


class Answer(NamedTuple):
    """What the comparison of a pair says."""

    pair: Pair
    effects: tuple[Compared, ...]
    """In the order of ``FIGURES`` or ``ESTIMATED``, one for each figure that was compared."""


def pairs_of(cells: Sequence[Cell], reference: str | None = None) -> list[Pair]:
    """List the pairs of cells, of equal ones the first; none if there are more than ``MOST_PAIRS``."""
    names, first_of, pairs = _compared_fields(cells), dict[str, Cell](), list[Pair]()
    if reference is not None:
        check_choice(reference, "--reference", {c.texts[k] for c in cells for k in names if k in c.texts})
    for cell in cells:
        first_of.setdefault(_key(cell, ()), cell)
    for name in names:
        fields = _fields_of_labels(cells) if name == LABEL else {name}
        groups: dict[str, list[Cell]] = {}  # cells that are equal in all other fields
        for cell in first_of.values():
            groups.setdefault(_key(cell, fields), []).append(cell)
        for group in groups.values():
            pairs += _pairs_in(group, name, cells, reference, STRATEGY in fields and reference is None)
    return pairs if len(pairs) <= MOST_PAIRS else []


def _pairs_in(
    group: Sequence[Cell], name: str, cells: Sequence[Cell], reference: str | None, every: bool
) -> Iterator[Pair]:
    if reference in {cell.texts.get(name) for cell in cells}:
        # Without a reference, this is the cell that does not set the field.
        references = [cell for cell in group if cell.texts.get(name) == reference]
    else:
        value = cells[0].point.get(name)
        references = [cell for cell in group if name == LABEL or cell.point.get(name) == value]
    for index, cell in enumerate(group):
        for other in group[:index] if every else references[:1]:
            if other is not cell:
                yield Pair(cell, other, name)


def _compared_fields(cells: Sequence[Cell]) -> list[str]:
    """List the fields whose values are compared pairwise."""
    values = {name: {repr(cell.point.get(name)) for cell in cells} for cell in cells for name in cell.point}
    differing = [name for name, each in values.items() if len(each) > 1]
    few = [name for name in differing if len(values[name]) <= MOST_VALUES and name not in (SOURCE, LABEL)]
    labels = _fields_of_labels(cells) if LABEL in values else set()
    words = [name for name in few if isinstance(cells[0].point.get(name), str | bool) and name not in labels]
    if labels:
        return [LABEL, *words]
    return words or (few if len(differing) == 1 else [])


def _fields_of_labels(cells: Sequence[Cell]) -> set[str]:
    """Return ``label`` and the fields that a label stands for: all cells with a label have the same value."""
    names = {name for cell in cells for name in cell.point}
    labels = {cell.point.get(LABEL) for cell in cells}
    pairs = {name: {repr((c.point.get(LABEL), c.point.get(name))) for c in cells} for name in names}
    return {name for name, each in pairs.items() if len(each) == len(labels)}


def _key(cell: Cell, without: Sequence[str] | set[str]) -> str:
    return repr(sorted((k, repr(v)) for k, v in cell.point.items() if k not in without))


def comparisons(runs: Runs, reference: str | None = None) -> list[Compared]:
    """Compare all pairs of cells in all figures, pair by pair; p-values are corrected over all (Holm)."""
    pairs = [pair for pair in pairs_of(runs.cells, reference) if all(runs.there[c.number] for c in pair[:2])]
    if not pairs:
        return []
    cells = list({cell.number: cell for pair in pairs for cell in pair[:2]}.values())
    tables = {
        cell.number: own
        for block in runs.select(cells).blocks()
        for cell, own in runs.by_cell(*COMPARED, *ESTIMATED, cells=block)
    }
    found = []
    for pair in pairs:
        asks_number = all(cell.scenario.task.asks_number for cell in pair[:2])
        figures = ESTIMATED if asks_number else COMPARED
        own, other = (tables[cell.number] for cell in pair[:2])
        if not own.join(other, on="run", how="semi").is_empty():  # parts of a study may have no run in common
            found += [Compared(pair, one) for one in compare(own, other, figures)]
    corrected = holm([one.paired.p_value for one in found])
    return [
        replace(one, paired=replace(one.paired, p_holm=p)) for one, p in zip(found, corrected, strict=True)
    ]


def comparison_table(compared: Sequence[Compared]) -> pl.DataFrame:
    """Tabulate comparisons, one row per pair of cells and figure; without comparisons the table has no columns."""
    rows = [
        {"name": pair.name, "cell": pair.cell.number, "reference": pair.reference.number, **paired.as_row()}
        for pair, paired in ((one.pair, one.paired) for one in compared)
    ]
    return pl.DataFrame(rows, infer_schema_length=None)


def answers_of(compared: Sequence[Compared]) -> tuple[Answer, ...]:
    """Return one answer for each pair of cells, of comparisons in the order of ``comparisons``."""
    answers = []
    for pair, of_pair in groupby(compared, key=lambda one: one.pair):
        figures = {one.paired.figure: one for one in of_pair}
        effects = (figures[name] for name in (*FIGURES, *ESTIMATED) if name in figures)
        answers.append(Answer(pair, tuple(effects)))
    return tuple(answers)
