"""Sentences about a study: its question, what each comparison of two cells says, its cells, and warnings.

    soft is faster than none, and wrong more often: 127 s faster [102, 153], 11.9 points more right [8.4, 15.5], 6.7
    points more wrong [3.9, 9.4].

Shares are shares of robots, and "points" are percentage points.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Final

import polars as pl

from vibroswarm.core.numbers import (
    Estimate,
    count,
    counts,
    listed,
    number,
    p_value,
    some,
    stated,
    stated_percent,
    verb,
    whole,
    with_limits,
)
from vibroswarm.documents.knowledge import setting as setting_of
from vibroswarm.scenario.fault_draws import fault_words
from vibroswarm.statistics.intervals import Interval
from vibroswarm.statistics.paired import side
from vibroswarm.statistics.sampling import blocked_words
from vibroswarm.statistics.verdict import answers_of as answers_in_words
from vibroswarm.study.cells import Cell
from vibroswarm.study.comparison import Answer, Compared
from vibroswarm.study.factors import fields_as_text
from vibroswarm.study.runs import Runs
from vibroswarm.study.summary import CellOutcome, Outcome

SHORT: Final = {
    "decision_time_s": "time",
    "right_share": "right",
    "wrong_share": "wrong",
    "undecided_share": "undecided",
    "estimate_error": "error",
    "estimate_crps": "CRPS",
}
"""Short names of the figures of an answer."""
_HIGHER_LOWER: Final = {
    "decision_time_s": ("slower", "faster"),
    "right_share": ("more right", "fewer right"),
    "wrong_share": ("more wrong", "fewer wrong"),
    "undecided_share": ("more undecided", "fewer undecided"),
    "estimate_error": ("more error", "less error"),
    "estimate_crps": ("more CRPS", "less CRPS"),
}
"""Words for a higher and for a lower value."""
_SCALES: Final = {"decision_time_s": (1, "s"), "estimate_error": (1, ""), "estimate_crps": (1, "")}
"""Factor and unit of figures that are no shares."""
MOST_NAMES: Final = 6
"""Cells, or the values of a field, are named if there are at most this many."""


def title_of(runs: Runs) -> str:
    """Return the study's name; without one, what it varies, the names of its selected cells, or their number."""
    cells = runs.cells
    if runs.name:
        return runs.name
    if values := _values_by_field(cells):
        return "; ".join(_values_in_words(name, each, "and") for name, each in values.items())
    return listed(cell.name for cell in cells) if len(cells) <= MOST_NAMES else count(len(cells), "cell")


def _values_by_field(cells: Sequence[Cell]) -> dict[str, list[str]]:
    """Return the values of each varied field, if the cells are all combinations of several fields; else nothing."""
    values = {
        name: list(dict.fromkeys(cell.texts.get(name, "") for cell in cells)) for name in cells[0].texts
    }
    varied = {name: each for name, each in values.items() if len(each) > 1}
    are_all = len(varied) > 1 and math.prod(map(len, varied.values())) == len(cells)
    return varied if are_all and max(map(len, varied.values())) <= MOST_NAMES else {}


def _values_in_words(field: str, values: Sequence[str], word: str) -> str:
    """Write values of a field: ``none, positive and soft``, ``robots 5 and 10``."""
    return fields_as_text({field: listed(values, word)})


def _cells_in_question(outcome: Outcome) -> str:
    """Name the cells that are compared: ``none or soft, for each of random:0.48 and random:0.40``."""
    cells = [one.cell for one in outcome.cells]
    values, compared = _values_by_field(cells), {one.pair.field for one in outcome.comparisons}
    if values and len(compared) == 1 and compared <= set(values):
        (field,) = compared
        rest = [_values_in_words(name, each, "and") for name, each in values.items() if name != field]
        return f"{_values_in_words(field, values[field], 'or')}, for each of {', and of '.join(rest)}"
    names = [cell.name for cell in cells]
    one_by_one = 1 < len(names) <= MOST_NAMES and not values
    return listed(names, "or") if one_by_one else title_of(outcome.runs)


def asks_numbers(outcome: Outcome) -> bool:
    """Return whether all cells ask for a number, so that no answer is right or wrong."""
    return all(one.cell.scenario.task.asks_number for one in outcome.cells)


def question(outcome: Outcome) -> str:
    """Write what the study asks: which cells are compared, in which setting, and in how many runs.

    Without comparisons, the text is no question: it names the cells, the setting and the runs.
    """
    cells = [one.cell for one in outcome.cells]
    # The setting is what all cells share: a varied field is not part of it, but of the cells' names.
    where = setting_of(cells[0].scenario, outcome.runs.varied)
    which = _cells_in_question(outcome)
    runs = counts((one.summary.runs for one in outcome.cells), "run")
    setting = f"{where}; {runs}" if where else runs
    if not outcome.comparisons:
        return f"{which}: {setting}{' each' * (len(cells) > 1)}, seed {outcome.runs.seed}."
    asks = "Which decides sooner"
    if any(one.summary.swarm_right.n for one in outcome.cells):
        asks += ", and which is wrong more often"
    if asks_numbers(outcome):
        asks = "Whose estimates are better"
    return f"{asks}: {which}? {setting[0].upper()}{setting[1:]} each, compared run by run."


def headline(answer: Answer) -> str:
    """Write which of two cells is faster and which is wrong more often, in a few words."""
    by_figure = {effect.paired.figure: effect for effect in answer.effects}
    if "estimate_error" in by_figure:
        exact = _comparative(by_figure["estimate_error"], "less exact", "more exact")
        return (
            f"{answer.pair.names[0]} and {answer.pair.names[1]}: no difference shown in the error of estimates"
            if exact is None
            else f"{answer.pair.names[0]} is {exact} than {answer.pair.names[1]}"
        )
    time = _comparative(by_figure["decision_time_s"], "slower", "faster")
    wrong = _comparative(by_figure["wrong_share"], "wrong more often", "wrong less often")
    first, reference = answer.pair.names[0], answer.pair.names[1]
    can_err = by_figure["wrong_share"].is_defined
    if time is None and wrong is None:
        return f"{first} and {reference}: no difference shown in time{' or wrong decisions' * can_err}"
    if time is None:
        return f"{first} is {wrong} than {reference}; no difference shown in time"
    if wrong is None:
        return f"{first} is {time} than {reference}" + "; no difference shown in wrong decisions" * can_err
    return f"{first} is {time} than {reference}, and {wrong}"


def _comparative(effect: Compared, if_higher: str, if_lower: str) -> str | None:
    if not effect.significant:
        return None
    return if_lower if effect.paired.difference.estimate < 0 else if_higher


def sentence(answer: Answer) -> str:
    """Write all significant differences; a second sentence lists the others."""
    shown = [effect for effect in answer.effects if effect.significant]
    others = [effect for effect in answer.effects if effect.is_defined and not effect.significant]
    where = f" ({answer.pair.names[2]})" if answer.pair.names[2] else ""
    if not shown:
        names = f"{answer.pair.names[0]} and {answer.pair.names[1]}"
        if not others:
            return f"{names}{where} cannot be compared: no difference between them is defined."
        return f"{names}{where}: no significant difference ({_differences(others)})."
    differences = ", ".join(_directed(effect.paired.figure, effect.paired.difference) for effect in shown)
    text = f"{headline(answer)}{where}: {differences}."
    return text + (f" Not significant: {_differences(others)}." if others else "")


def _directed(figure: str, difference: Interval) -> str:
    """Write the size of a difference, its direction in words, and its interval: ``127 s faster [102, 153]``.

    The difference must not be 0: the words would have no sense.
    """
    scale, unit = _SCALES.get(figure, (100, "points"))
    estimate, low, high = (scale * value for value in difference[:3])
    if_higher, if_lower = _HIGHER_LOWER[figure]
    decimals = _decimals(figure, difference)
    if estimate > 0:
        return with_limits(Estimate(estimate, low, high), f"{unit} {if_higher}".lstrip(), decimals)
    return with_limits(Estimate(-estimate, -high, -low), f"{unit} {if_lower}".lstrip(), decimals)


def _signed(figure: str, difference: Interval) -> str:
    """Write a difference with its sign, unit and interval: ``-127 s [-153, -102]``."""
    unit = _SCALES.get(figure, (100, "points"))[1]
    return with_limits(difference, unit, _decimals(figure, difference), sign=True)


def _decimals(figure: str, difference: Interval) -> int:
    """Return 0 of times if the estimate or a limit is 10.0 s or more, otherwise 1."""
    if figure.startswith("estimate"):
        return 4
    largest = max((abs(value) for value in difference[:3] if math.isfinite(value)), default=0.0)
    return 0 if figure == "decision_time_s" and largest >= 9.95 else 1


def _differences(effects: Iterable[Compared]) -> str:
    """List effects with short name and difference: ``time -127 s [-153, -102], wrong +6.7 points [3.9, 9.4]``.

    An interval is of one comparison; where it excludes 0, the p-value says why the difference is not significant.
    """
    return ", ".join(
        f"{SHORT[effect.paired.figure]} {_signed(effect.paired.figure, effect.paired.difference)}"
        f"{f', p = {p_value(effect.paired.p_holm)} after correction' if side(effect.paired.difference) else ''}"
        for effect in effects
    )


def lacks_truth(one: CellOutcome) -> bool:
    """Return whether no answer is right in some runs of a cell: then its outcome is on what its swarms agreed."""
    return bool(one.summary.swarm_right.n < one.summary.runs)


def cell_sentence(one: CellOutcome) -> str:
    """Write a cell's shares of right, wrong and undecided robots, and its decision time.

    Shares that are undefined are left out. If no answer is right in some runs, a second sentence says on what the
    swarms agreed.
    """
    figures = one.summary
    if one.cell.scenario.task.asks_number:
        return _estimates(one)
    shares = {
        "right": figures.robots_right,
        "wrong": figures.robots_wrong,
        "undecided": figures.robots_undecided,
    }
    words = [
        f"{with_limits(share, '%')} {word}"
        for word, share in shares.items()
        if not math.isnan(share.estimate)
    ]
    time = with_limits(figures.decision_time_s, "s", 0)
    agreement = f" {_agreement(one)}" if lacks_truth(one) else ""
    return f"{one.cell.name}: robots {', '.join(words)}; decision time {time}.{agreement}"


def _estimates(one: CellOutcome) -> str:
    """Write how good the estimates of a cell are."""
    figures = one.summary
    words = [f"error of estimates {with_limits(figures.estimate_error, '', 4)}"]
    if not math.isnan(figures.estimate_coverage.estimate):
        words.append(f"90 % intervals hold the true number in {with_limits(figures.estimate_coverage, '%')}")
        words.append(f"CRPS {with_limits(figures.estimate_crps, '', 4)}")
    return f"{one.cell.name}: {'; '.join(words)}."


def _agreement(one: CellOutcome) -> str:
    """Write on what the swarms of a cell agreed; and whether agreement lasted, if opinions may change."""
    figures = one.summary
    sides = answers_in_words(one.cell.scenario)
    lasted = ""
    if figures.agreement_lasted.n:
        lasted = f"; {with_limits(figures.agreement_lasted, '%')} of the agreements lasted to the end"
    shares = [figures.agreed_on_0, figures.agreed_on_1]
    if len(sides) > 2:
        sides, shares = (*sides[:2], "another answer"), [*shares, figures.agreed_on_other]
    agreed = ", ".join(
        f"on '{side}' in {with_limits(share, '%')}" + (" of the runs" if number == 0 else "")
        for number, (side, share) in enumerate(zip(sides, shares, strict=False))
    )
    return (
        f"Swarms agreed {agreed}; {with_limits(figures.swarm_split, '%')} split, "
        f"{with_limits(figures.swarm_incomplete, '%')} incomplete{lasted}."
    )


def warnings_of(outcome: Outcome) -> list[str]:
    """Write what may invalidate the figures, such as failed or missing runs; empty if all is well."""
    cells = outcome.cells
    floors = _each_once((_floor_words(one), one.decidable.says) for one in cells if one.decidable.is_warning)
    # Without how many observations there were at most, which differs from cell to cell.
    unreached = _each_once(
        (one.cell.name, f"{one.unreached.partition(';')[0]}.") for one in cells if one.unreached
    )
    failed = _each_once(
        (one.cell.name, failed_words(one.failed, one.summary.runs)) for one in cells if one.failed.height
    )
    blocked = _each_once(
        (one.cell.name, words) for one in cells if (words := blocked_words(one.walk["blocked_share"]))
    )
    faulty = _each_once((one.cell.name, _fault_words(one)) for one in cells if one.cell.scenario.faults.kinds)
    every = (
        *floors, *unreached, *failed, *blocked, *faulty, *_missing_runs(outcome), *_store_warnings(outcome),
        _imprecise(outcome),
    )  # fmt: skip
    return list(filter(None, every))


def _each_once(warnings: Iterable[tuple[str, str]]) -> list[str]:
    """Write each text once, after the names of all that it warns of; those beyond ``MOST_NAMES`` texts are counted."""
    names: dict[str, dict[str, None]] = {}  # by text, each once
    for name, text in warnings:
        names.setdefault(text, {})[name] = None
    lines = [f"{some([*each], MOST_NAMES)}: {text}" for text, each in names.items()]
    left = len(lines) - MOST_NAMES
    return (
        [*lines[:MOST_NAMES], f"... and {count(left, 'more warning')} of this kind."] if left > 0 else lines
    )


def _floor_words(one: CellOutcome) -> str:
    """Name the floor and the sensor's threshold, if it has one, of a cell: its decidability depends on them."""
    scenario = one.cell.scenario
    threshold = one.decidable.threshold
    return f"floor {scenario.floor.source}" + (
        "" if threshold is None else f", threshold {stated(threshold)}"
    )


def failed_words(failed: pl.DataFrame, runs: int) -> str:
    """Write how many runs of a cell failed, with time and cause of the first.

    Args:
        failed: run, time_s and reason, at least one. runs: number of all runs of the cell.
    """
    first = failed.row(0, named=True)
    return (
        f"{whole(failed.height)} of {count(runs, 'run')} failed in the source of motion; the robots have "
        f"stood still since and count as undecided (run {first['run']} at {number(first['time_s'], digits=4)} s: "
        f"{first['reason']})."
    )


def _fault_words(one: CellOutcome) -> str:
    """Write that robots with a fault count like the others: they may be why no swarm is right."""
    faults = listed([fault_words(kind) for kind in one.cell.scenario.faults.kinds])
    return f"faulty robots ({faults}) count like the others; judged_tables (Python) leaves them out."


def _missing_runs(outcome: Outcome) -> list[str]:
    """Write which runs are missing."""
    words = []
    if outcome.without_runs:
        words.append(
            f"there are no runs of {some([cell.name for cell in outcome.without_runs], MOST_NAMES)}."
        )
    cells = outcome.runs.cell_table
    lost = int((cells["wanted"] - cells["there"]).sum())
    if lost:
        words.append(
            f"{whole(lost)} of {count(int(cells['wanted'].sum()), 'run')} {verb(lost, 'are', 'is')} missing; "
            "run the same command again."
        )
    return words


def _store_warnings(outcome: Outcome) -> list[str]:
    store = outcome.runs.store
    different = "runs were made by different versions of the software; they may not be repeatable as a whole."
    return [
        *(f"a damaged file was left out: {path.name}" for path in store.damaged),
        different if len(store.made_by) > 1 else "",
    ]


def _imprecise(outcome: Outcome) -> str:
    """Write of how many cells the figure with the wanted precision is not precise enough after the most runs."""
    until = outcome.runs.until
    if until is None:
        return ""
    # A group is settled as a whole; some of its cells may be precise enough.
    imprecise = [
        one
        for one in outcome.cells
        if one.settled is not None
        and not one.settled.reached
        and not until.reached(one.summary.figures[until.figure], one.cell.scenario.run.t_end_s)
    ]
    if not imprecise:
        return ""
    return (
        f"in {len(imprecise)} of {count(len(outcome.cells), 'cell')} {until.figure} is not known to "
        f"{stated_percent(until.half_width)} after {count(until.max_runs, 'run')}, the most that were allowed: "
        "limits are wider, or rare runs could move it further."
    )
