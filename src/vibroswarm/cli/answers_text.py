"""The answer of a study as text: what was asked, a sentence for each comparison, and its differences side by side."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from vibroswarm.cli.output import print_paragraph, print_table

if TYPE_CHECKING:
    from vibroswarm.study.summary import Outcome

MOST_SENTENCES: Final = 12
NOTES: Final = (
    "Differences run by run: the first minus the second, 95 % sign-flip intervals; right, wrong and undecided in "
    "percentage points of robots; * p < 0.05, corrected over all comparisons (Holm). No significant difference is not "
    "evidence of no difference."
)


def print_answers(outcome: Outcome) -> None:
    """Print what was asked and the answer, then an empty line."""
    print_paragraph(outcome.question)
    print()
    for sentence in answer_lines(outcome):
        print_paragraph(sentence)
    print()


def answer_lines(outcome: Outcome) -> list[str]:
    """Return a sentence for each comparison, or for each cell where none are compared."""
    from vibroswarm.study.answers import cell_sentences

    if not outcome.answers:
        lines = cell_sentences(outcome.cells[:MOST_SENTENCES])
        left = len(outcome.cells) - len(lines)
        return lines + ([f"... and {left} more cells."] if left else [])
    lines = []
    for answer in outcome.answers[:MOST_SENTENCES]:
        lines += [answer.sentence, *([answer.at_equal_error] if answer.at_equal_error else [])]
    left = len(outcome.answers) - MOST_SENTENCES
    return lines + ([f"... and {left} more comparisons, below."] if left > 0 else [])


def print_effects(outcome: Outcome) -> None:
    """Print the differences of each comparison side by side: time, right, wrong and undecided."""
    if not outcome.answers:
        return
    rows = []
    for answer in outcome.answers:
        effects = [effect.number + ("*" if effect.significant else "") for effect in answer.effects]
        rows.append([answer.name, *(text.replace(" points", "") for text in effects)])
    print_table(["compared", "time", "right", "wrong", "undecided"], rows)
    print_paragraph(NOTES)
