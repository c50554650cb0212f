"""The answer to a study's question: for each pair of cells, what differs, whether it is significant, and confirmed.

A pair is a cell and its reference; every difference is cell - reference. A difference is significant if its p-value,
corrected over all comparisons of the study, is below 0.05. It is confirmed if the study's second block of runs, from
another seed, shows it too. A strategy that is faster and wrong more often is not called better: the pair is compared at
equal error as well (``analysis.forced_error``). ``documents.study_words`` writes answers in sentences.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from vibroswarm.analysis.cell_summary import CellSummary
from vibroswarm.analysis.figures import BY_COLUMN
from vibroswarm.analysis.forced_error import MatchedError
from vibroswarm.analysis.intervals import Interval, columns_of
from vibroswarm.analysis.paired import ESTIMATED
from vibroswarm.study.cell_comparison import Compared
from vibroswarm.study.spec import Cell

SIGNIFICANT: Final = 0.05
"""A difference is significant if its corrected p-value is below this."""
FIGURES: Final = ("decision_time_s", "right_share", "wrong_share", "undecided_share")
"""The figures of an answer."""


@dataclass(frozen=True)
class Effect:
    """The difference of one figure between a cell and its reference."""

    figure: str
    """One of ``FIGURES``, or of ``ESTIMATED``."""
    interval: Interval
    """Cell - reference: s, or a difference of shares."""
    p: float
    """p-value, corrected over all comparisons (Holm)."""
    significant: bool
    repeated: bool
    """Whether the figure was compared on the other seed too."""
    confirmed: bool
    """Whether the other seed shows the same difference."""

    @property
    def better(self) -> bool | None:
        """Whether the cell is better than its reference in this figure; None if the difference is not significant."""
        if not self.significant:
            return None
        # The direction is 1 if higher is better, else -1.
        return self.interval.estimate * BY_COLUMN[self.figure].better > 0


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
    effects: tuple[Effect, ...]
    """In the order of ``FIGURES`` or ``ESTIMATED``, one for each figure that was compared."""
    pairs: int
    """Number of runs that the first figure compares."""
    matched: MatchedError | None
    """The comparison at equal error; None if there is none."""

    @property
    def name(self) -> str:
        """``soft against none, random:0.48``."""
        return f"{self.first_name} against {self.reference_name}" + (f", {self.rest}" if self.rest else "")

    @property
    def faster_and_more_wrong(self) -> str | None:
        """Name of the cell that is significantly faster, and also wrong significantly more often; None if none is."""
        better = {effect.figure: effect.better for effect in self.effects}
        first_is_faster, first_errs_less = better.get("decision_time_s"), better.get("wrong_share")
        if first_is_faster is None or first_errs_less is None or first_is_faster == first_errs_less:
            return None
        return self.first_name if first_is_faster else self.reference_name

    def as_row(self) -> dict[str, float | int | str | None]:
        """Return the comparison at equal error as a flat row for a table; without it, only name and cell numbers.

        A difference has three columns: the estimate, and its limits in ``..._low`` and ``..._high``. A value that is
        not finite is None.
        """
        row: dict[str, float | int | str | None] = {
            "name": self.name, "cell": self.cell.number, "reference": self.reference.number,
        }  # fmt: skip
        found = self.matched
        if found is None:
            return row
        return row | {
            "error": found.error,
            "time_s": found.time_s,
            "runs": found.time_difference_s.n,
            **columns_of("time_difference_s", found.time_difference_s),
            **columns_of("error_difference", found.error_difference),
        }


def answers_of(
    compared: Sequence[Compared], matched: Mapping[tuple[int, int], MatchedError]
) -> tuple[Answer, ...]:
    """Return one answer for each pair of cells.

    Answers with equal ``Answer.rest`` (the varied values that cell and reference share) stand together, in the order
    in which the values of ``rest`` first appear. Within such a group, the largest difference in time comes first.

    Args:
        compared: all figures of all pairs (``cell_comparison.comparisons``); empty: there are no answers.
        matched: comparisons at equal error, by the numbers of cell and reference (``equal_error.at_equal_error``).
    """
    # For each pair, its comparisons by figure. A pair is given by cell, reference and compared field.
    by_pair: dict[tuple[int, int, str], dict[str, Compared]] = {}
    for one in compared:
        key = (one.cell.number, one.reference.number, one.field)
        by_pair.setdefault(key, {})[one.first.figure] = one
    found = [
        _answer(figures, matched.get((cell, reference))) for (cell, reference, _), figures in by_pair.items()
    ]
    rank_of_rest: dict[str, int] = {}  # the position at which each ``rest`` first appears
    for answer in found:
        rank_of_rest.setdefault(answer.rest, len(rank_of_rest))
    return tuple(sorted(found, key=lambda answer: (rank_of_rest[answer.rest], -_time_difference(answer))))


def _time_difference(answer: Answer) -> float:
    """Return the absolute difference in decision time, which is the first effect; 0 if it is undefined."""
    size = abs(answer.effects[0].interval.estimate)
    return 0.0 if math.isnan(size) else size


def _answer(figures: Mapping[str, Compared], matched: MatchedError | None) -> Answer:
    """Return the answer of one pair of cells.

    Args:
        figures: the pair's comparisons by figure, those of ``FIGURES`` or ``ESTIMATED`` among them.
        matched: its comparison at equal error, None if there is none.
    """
    # The comparison of the first figure. All figures of the pair have the same cells and names.
    one = next(iter(figures.values()))
    effects = tuple(_effect(figures[figure]) for figure in (*FIGURES, *ESTIMATED) if figure in figures)
    first_name, reference_name, rest = one.names
    return Answer(
        cell=one.cell,
        reference=one.reference,
        first_name=first_name,
        reference_name=reference_name,
        rest=rest,
        effects=effects,
        pairs=one.first.pairs,
        matched=matched,
    )


def _effect(one: Compared) -> Effect:
    return Effect(
        figure=one.first.figure,
        interval=one.first.difference,
        p=one.first.p_holm,
        significant=one.first.p_holm < SIGNIFICANT,
        repeated=one.replicate is not None,
        confirmed=one.replicate is not None and one.replicate.confirmed,
    )


def lacks_truth(figures: CellSummary) -> bool:
    """Return whether no answer is right in some runs of a cell: then its outcome is on what its swarms agreed."""
    return bool(figures.swarm_right.n < figures.runs)
