"""Compare cells in pairs, run by run.

A pair is a cell and its reference, which differ in a single field, or in the label and the fields that the label stands
for. Every two strategies are compared, also every two labels that set the strategy. In another field, each value is
compared with the field's first value. The user may name a reference: a value with which the other values of its field
are compared instead.

The compared fields are those whose values are words: strategies, presets, labels and the like. A numeric field is
compared only if no other field is varied and it has few values, since many values make a curve. The floor is never
compared, since it is not a choice of the user of a swarm. The p-values are corrected over all comparisons of a study.

An ``Answer`` says of a pair what differs, as cell - reference. A difference is significant if its p-value,
corrected over all comparisons of the study, is below 0.05. ``documents.study_words`` writes answers in sentences.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Final

import polars as pl

from vibroswarm.analysis.cell_summary import CellSummary
from vibroswarm.analysis.figures import BY_COLUMN
from vibroswarm.analysis.paired import COMPARED, ESTIMATED, Paired, compare, holm
from vibroswarm.errors import InputError, check_choice
from vibroswarm.study.factors import LABEL, flat
from vibroswarm.study.spec import SOURCE, Cell, Study
from vibroswarm.study.study_result import StudyResult

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
KEPT: Final = 3
"""Number of cells whose figures are cached."""


@dataclass(frozen=True)
class Compared:
    """One figure compared between a cell and its reference."""

    cell: Cell
    reference: Cell
    field: str
    """The compared field. They are equal in all others, except in fields that the label sets if this is ``label``."""
    paired: Paired
    """The comparison: cell - reference."""

    @property
    def name(self) -> str:
        """The name of the comparison: ``soft - none (random:0.48)``."""
        first, reference, rest = self.names
        return f"{first} - {reference}" + (f" ({rest})" if rest else "")

    @property
    def names(self) -> tuple[str, str, str]:
        """What the cell and its reference are called here, and the varied values that they share, as text.

        Each cell is called by its value of the compared field (``-`` if the cell does not set it). If the values are
        labels, or are written the same, the names of the cells are used instead. A cell's name includes the shared
        values, so the third text is then empty.
        """
        rest = self.cell.words_of(k for k in self.cell.point if k != self.field)
        first, reference = (cell.words_of([self.field]) or "-" for cell in (self.cell, self.reference))
        if self.field == LABEL or first == reference:
            return self.cell.name, self.reference.name, ""
        return first, reference, rest

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
        # The direction is 1 if higher is better, else -1.
        return self.paired.difference.estimate * BY_COLUMN[self.paired.figure].better > 0

    def as_row(self) -> dict[str, Any]:
        """Return a flat row for a table."""
        cells = {"name": self.name, "cell": self.cell.number, "reference": self.reference.number}
        return cells | self.paired.as_row()


def pairs_of(study: Study, reference: str | None = None) -> list[tuple[Cell, Cell, str]]:
    """List the pairs of a study: cell, its reference, and the compared field.

    The two cells of a pair are equal in all other fields, except for fields that labels set if the compared field is
    ``label``. Of several cells with equal points, only the first is compared.

    Args:
        reference: a value of a compared field, or a label, as text. In the field that has this value, cells are
            compared with the cell of this value; in any other field, with the cell of the field's first value. If
            ``reference`` is None, every two strategies (or labels, if they set the strategy) are compared. In other
            fields, cells are then compared with the cell that does not set the field; if all cells of the study set it,
            with the cell of its first value.
    Returns: the pairs; a field gives none for a cell if no cell is equal in all other fields and has the value to
        compare with. An empty list if there are more than ``MOST_PAIRS`` pairs.
    Raises:
        InputError: no compared field has this value.
    """
    if reference is not None:
        _check_reference(study, reference)
    by_point: dict[str, Cell] = {}
    for cell in study.cells:
        by_point.setdefault(_key(cell.point), cell)  # the first of several cells with equal points
    pairs = []
    for name in _compared_fields(study):
        # Cells with different labels may also differ in the fields that the labels stand for.
        fields = _fields_of_labels(study) if name == LABEL else {name}
        groups: dict[str, list[Cell]] = {}  # cells that are equal in all other fields
        for cell in by_point.values():
            groups.setdefault(_key({k: v for k, v in cell.point.items() if k not in fields}), []).append(cell)
        # A cell that does not set the field has None here. So if no reference is given, such a cell is the reference.
        is_reference_here = reference in {cell.words.get(name) for cell in study.cells}
        all_pairs = STRATEGY in fields and reference is None
        for group in groups.values():
            if is_reference_here:
                references = [cell for cell in group if cell.words.get(name) == reference]
            elif name == LABEL:
                # The first cell of a group is of the list's first table; it becomes the reference.
                references = group
            else:
                first_value = study.cells[0].point.get(name)
                references = [cell for cell in group if cell.point.get(name) == first_value]
            for index, cell in enumerate(group):
                # All pairs: each cell with every earlier cell. Otherwise: each cell with the group's one reference.
                others = group[:index] if all_pairs else references[:1]
                pairs += [(cell, other, name) for other in others if other is not cell]
    return pairs if len(pairs) <= MOST_PAIRS else []


def _check_reference(study: Study, reference: str) -> None:
    """Raise InputError if no compared field has this value."""
    fields = _compared_fields(study)
    values = list(dict.fromkeys(cell.words[k] for cell in study.cells for k in fields if k in cell.words))
    if not values:
        raise InputError("this study compares no cells; remove it", field="--reference")
    check_choice(reference, "--reference", values)


def _compared_fields(study: Study) -> list[str]:
    """List the fields whose values are compared pairwise.

    These are labels and the fields whose values are words, except fields that a label sets. If there are no such
    fields, and a single field is varied, that field is compared; but not if it is the floor, or if it has more than
    ``MOST_VALUES`` values. Otherwise the list is empty.
    """
    if LABEL in study.varied:
        fields = [name for name in _word_fields(study) if name not in _fields_of_labels(study)]
        return [LABEL, *fields]
    if words := _word_fields(study):
        return words
    # A field that is listed as varied may have the same value in all cells; such a field does not count.
    counts = {name: len({repr(cell.point.get(name)) for cell in study.cells}) for name in study.varied}
    differing = [name for name, count in counts.items() if count > 1]
    comparable = [name for name in differing if counts[name] <= MOST_VALUES and name != SOURCE]
    return comparable if len(differing) == 1 else []


def _word_fields(study: Study) -> list[str]:
    """List the varied fields with 2 to ``MOST_VALUES`` values that are words, or true and false.

    If some cells do not set a field, that counts as one more value. The floor and labels are left out. The value in the
    first cell stands for the kind of a field's values; a field that the first cell does not set is left out.
    """
    fields = []
    for name in study.varied:
        count = len({repr(cell.point.get(name)) for cell in study.cells})
        is_of_words = isinstance(study.cells[0].point.get(name), str | bool)
        if name not in (SOURCE, LABEL) and 1 < count <= MOST_VALUES and is_of_words:
            fields.append(name)
    return fields


def _fields_of_labels(study: Study) -> set[str]:
    """Return ``label`` and the fields that the ``list`` block sets: a label stands for the values of these fields."""
    return {LABEL} | {name for entry in study.vary.get("list", ()) for name in flat(entry)}


def compared_columns(figures: pl.DataFrame) -> pl.DataFrame:
    """Return the columns of ``figures.run_figures`` in which cells are compared, and the runs."""
    return figures.select("run", *dict.fromkeys((*COMPARED, *ESTIMATED)))


def comparisons(
    result: StudyResult, reference: str | None = None, known: Mapping[int, pl.DataFrame] | None = None
) -> list[Compared]:
    """Compare all pairs of the selected cells in all figures, with p-values corrected over all comparisons (Holm).

    A pair whose cells have no run in common is left out.

    Args:
        reference: as of ``pairs_of``.
        known: ``compared_columns`` of some cells of ``result``, by number, which are not computed again.
    Returns: the comparisons pair by pair; those of a pair in the order of ``analysis.paired.COMPARED``, or of its
        ``ESTIMATED`` where the task asks for a number.
    """
    given = known or {}

    @lru_cache(maxsize=KEPT)  # pairs share a reference
    def figures_of(number: int) -> pl.DataFrame:
        return given[number] if number in given else compared_columns(result.figures(number))

    entries = [
        (cell, other, name, paired)
        for cell, other, name in pairs_of(result.study, reference)
        if {cell.number, other.number} <= set(result.selected)
        for paired in _pair(cell, other, figures_of(cell.number), figures_of(other.number))
    ]
    corrected = holm([paired.p_value for *_, paired in entries])
    return [
        Compared(cell, other, name, replace(paired, p_holm=p))
        for (cell, other, name, paired), p in zip(entries, corrected, strict=True)
    ]


def _pair(cell: Cell, reference: Cell, own: pl.DataFrame, others: pl.DataFrame) -> Sequence[Paired]:
    """Compare two cells in all figures: ``compared_columns`` of both; nothing if they have no run in common."""
    if own.join(others, on="run", how="semi").is_empty():
        return ()
    asks_number = cell.scenario.task.asks_number and reference.scenario.task.asks_number
    return compare(own, others, ESTIMATED if asks_number else COMPARED)


def comparison_table(compared: Sequence[Compared]) -> pl.DataFrame:
    """Tabulate comparisons, one row per pair of cells and figure; without comparisons the table has no columns."""
    return pl.DataFrame([comparison.as_row() for comparison in compared], infer_schema_length=None)


def _key(point: dict[str, Any]) -> str:
    """Return a text that is equal for equal points, whatever the order of their fields."""
    return repr(sorted((k, repr(v)) for k, v in point.items()))


@dataclass(frozen=True)
class Answer:
    """What a comparison of a cell with its reference says."""

    cell: Cell
    reference: Cell
    first_name: str
    """What the cell is called in this comparison."""
    reference_name: str
    """What its reference is called."""
    rest: str
    """The varied values that both cells share, as text."""
    effects: tuple[Compared, ...]
    """In the order of ``FIGURES`` or ``ESTIMATED``, one for each figure that was compared."""

    @property
    def name(self) -> str:
        """``soft against none, random:0.48``."""
        return f"{self.first_name} against {self.reference_name}" + (f", {self.rest}" if self.rest else "")


def answers_of(compared: Sequence[Compared]) -> tuple[Answer, ...]:
    """Return one answer for each pair of cells.

    Answers with equal ``Answer.rest`` (the varied values that cell and reference share) stand together, in the order
    in which the values of ``rest`` first appear. Within such a group, the largest difference in time comes first.

    Args:
        compared: all figures of all pairs (``comparisons``); empty: there are no answers.
    """
    # For each pair, its comparisons by figure. A pair is given by cell, reference and compared field.
    by_pair: dict[tuple[int, int, str], dict[str, Compared]] = {}
    for one in compared:
        key = (one.cell.number, one.reference.number, one.field)
        by_pair.setdefault(key, {})[one.paired.figure] = one
    found = [_answer(figures) for figures in by_pair.values()]
    rank_of_rest: dict[str, int] = {}  # the position at which each ``rest`` first appears
    for answer in found:
        rank_of_rest.setdefault(answer.rest, len(rank_of_rest))
    return tuple(sorted(found, key=lambda answer: (rank_of_rest[answer.rest], -_time_difference(answer))))


def _time_difference(answer: Answer) -> float:
    """Return the absolute difference in decision time, which is the first effect; 0 if it is undefined."""
    size = abs(answer.effects[0].paired.difference.estimate)
    return 0.0 if math.isnan(size) else size


def _answer(figures: Mapping[str, Compared]) -> Answer:
    """Return the answer of one pair of cells.

    Args:
        figures: the pair's comparisons by figure, those of ``FIGURES`` or ``ESTIMATED`` among them.
    """
    # The comparison of the first figure. All figures of the pair have the same cells and names.
    one = next(iter(figures.values()))
    effects = tuple(figures[figure] for figure in (*FIGURES, *ESTIMATED) if figure in figures)
    first_name, reference_name, rest = one.names
    return Answer(
        cell=one.cell,
        reference=one.reference,
        first_name=first_name,
        reference_name=reference_name,
        rest=rest,
        effects=effects,
    )


def lacks_truth(figures: CellSummary) -> bool:
    """Return whether no answer is right in some runs of a cell: then its outcome is on what its swarms agreed."""
    return bool(figures.swarm_right.n < figures.runs)
