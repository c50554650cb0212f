"""The answer of a study: a sentence for each pair of cells or two values in all conditions, else a line a cell."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import groupby
from typing import Any, Final

from vibroswarm.core.numbers import count, number, p_value
from vibroswarm.report.format import Value, decimals_of, format_of, value_of, write_value
from vibroswarm.statistics.figures import BY_COLUMN, BY_NAME
from vibroswarm.statistics.paired import side
from vibroswarm.statistics.verdict import answers_of
from vibroswarm.study.comparison import Answer, Compared
from vibroswarm.study.summary import CellOutcome, Outcome

EFFECTS: Final = {
    "decision_time_s": ("faster", "slower"),
    "wrong_share": ("wrong less often", "wrong more often"),
    "estimate_error": ("more exact", "less exact"),
}
"""Figures of a sentence on a pair, with words for a lower and for a higher value."""
MOST_PAIRS: Final = 3
"""Most comparisons with a sentence each."""
MOST_LINES: Final = 12
"""Most lines on cells, or on two values in several conditions."""


def answer(outcome: Outcome) -> tuple[str, ...]:
    """Return sentences on comparisons, or on cells if none are compared."""
    answers = outcome.answers
    if not answers:
        lines, things = (
            [
                _cell_line(one, outcome.table.row(place, named=True))
                for place, one in enumerate(outcome.cells)
            ],
            "cell",
        )
    elif len(answers) <= MOST_PAIRS:
        return tuple(_pair_sentence(one) for one in answers)
    else:
        by_names = sorted(answers, key=lambda one: one.pair.names[:2])
        lines = [
            f"{first} against {second}: {_counted(list(same))}."
            for (first, second), same in groupby(by_names, key=lambda one: one.pair.names[:2])
        ]
        things = "comparison"
    more = len(lines) - MOST_LINES
    return tuple(
        [*lines[:MOST_LINES], f"... and {count(more, f'more {things}')}, below."] if more > 0 else lines
    )


def _cell_line(one: CellOutcome, row: dict[str, Any]) -> str:
    scenario = one.cell.scenario
    if scenario.task.asks_number:
        names = {"estimate_error": "", "estimate_coverage": "", "estimate_crps": ""}
        texts = [f"{BY_NAME[name].title} {_written(row, name)}" for name in names if row[name] is not None]
        return f"{one.cell.name}: {'; '.join(texts)}."
    outcomes = {"swarm_right": "right", "swarm_wrong": "wrong"}
    if one.figures["swarm_right"].n < one.runs:
        answers = answers_of(scenario)
        outcomes = {f"agreed_on_{place}": f"'{text}'" for place, text in enumerate(answers[:2])}
        outcomes |= {"agreed_on_other": "another answer"} if len(answers) > 2 else {}
    outcomes |= {"swarm_split": "split", "swarm_incomplete": "undecided"}
    texts = [f"{_written(row, name)} {text}" for name, text in outcomes.items() if row[name]]
    swarms = f"of {count(one.runs, 'swarm')} {', '.join(texts)}"
    return f"{one.cell.name}: {swarms}; decision time {_written(row, 'decision_time_s')}."


def _pair_sentence(one: Answer) -> str:
    first, second, where = one.pair.names
    effects = [effect for effect in one.effects if effect.paired.figure in EFFECTS and effect.is_defined]
    shown = [effect for effect in effects if effect.significant]
    text = f"{first} and {second}"
    for place, effect in enumerate(shown):
        differs = f"{_direction(effect)}{'' if place else f' than {second}'} by {_size(effect)}"
        link = ", but" if place and effect.better != shown[place - 1].better else " and"
        text = f"{text}{link} {differs}" if place else f"{first} is {differs}"
    rest = " and ".join(_not_shown(effect) for effect in effects if effect not in shown)
    none = f"{'; ' if shown else ': '}no difference shown in {rest}" if rest else ""
    return f"{text}{none}{f' ({where})' if where else ''}."


def _counted(answers: Sequence[Answer]) -> str:
    """Write in how many conditions a figure differs: ``faster in 9 of 9, by 5 to 187 s``."""
    effects = [effect for one in answers for effect in one.effects if effect.paired.figure in EFFECTS]
    texts = []
    for (_, direction), same in _grouped(effect for effect in effects if effect.significant):
        form = format_of(f"{same[0].paired.figure}_difference")
        sizes = sorted(abs(effect.paired.difference.estimate) * form.factor for effect in same)
        decimals = decimals_of(map(Value, sizes))
        low, high = number(sizes[0], decimals), number(sizes[-1], decimals)
        span = low if low == high else f"{low} to {high}"
        texts.append(f"{direction} in {len(same)} of {len(answers)}, by {span} {form.unit}".rstrip())
    return "; ".join(texts) or f"no difference shown in {count(len(answers), 'comparison')}"


def _grouped(effects: Iterable[Compared]) -> list[tuple[tuple[str, str], list[Compared]]]:
    groups: dict[tuple[str, str], list[Compared]] = {}
    for effect in effects:
        groups.setdefault((effect.paired.figure, _direction(effect)), []).append(effect)
    return list(groups.items())


def _direction(effect: Compared) -> str:
    return EFFECTS[effect.paired.figure][effect.paired.difference.estimate > 0]


def _size(effect: Compared) -> str:
    form, (estimate, low, high) = (
        format_of(f"{effect.paired.figure}_difference"),
        effect.paired.difference[:3],
    )
    values = (-estimate, -high, -low) if estimate < 0 else (estimate, low, high)
    return write_value(Value(*(form.factor * value for value in values)), form.unit)


def _not_shown(effect: Compared) -> str:
    """Write a difference that is not shown, with its p-value if its interval alone would show one."""
    form = format_of(f"{effect.paired.figure}_difference")
    values = Value(*(form.factor * value for value in effect.paired.difference[:3]))
    corrected = f", p = {p_value(effect.paired.p_holm)}" if side(effect.paired.difference) else ""
    return f"{BY_COLUMN[effect.paired.figure].title} ({write_value(values, form.unit, sign=True)}{corrected})"


def _written(row: dict[str, Any], name: str) -> str:
    return write_value(value_of(row, name), format_of(name).unit)
