"""Sentences on searches and grids: values of fields, failed runs, and reasons not to trust a result.

The believed score of a candidate is the one by which the search chose it; the true score is that on fresh runs, which
played no part in the choice (``search.validation``).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from vibroswarm.core.numbers import count, listed, number, percent, whole, with_limits
from vibroswarm.plots.labels import Label, label_of
from vibroswarm.search.archive import Archive
from vibroswarm.search.loop import Found
from vibroswarm.search.objective import AIMS, Objective
from vibroswarm.search.space import Dimension
from vibroswarm.search.spec import Search
from vibroswarm.search.validation import TELLING, Front, Truth
from vibroswarm.statistics.figures import BY_NAME
from vibroswarm.study.factors import value_as_text

ENOUGH: Final = 0.9
"""Share of the budget from which a search counts as finished."""
WIDE: Final = 0.25
"""Relative half-width of the true score's interval above which there are too few fresh runs."""
EDGE: Final = 0.01
"""A value closer to a bound than this fraction of the range lies at it."""
REASONS: Final = 3
"""Number of reasons for failed runs in a warning; a table has all."""
DIFFERENT_VERSIONS: Final = "Different versions made parts of it; as a whole it may not be repeatable."


def value_text(value: Any) -> str:
    """Write a value of a field: a float with up to six significant digits, any other value in full."""
    return number(value, digits=6) if isinstance(value, float) else str(value)


def values_text(values: Mapping[str, Any]) -> str:
    """Write values of fields in words, such as ``sample interval τ 4750 ms``.

    A float has up to four significant digits, or all digits before the point; the file ``best.toml`` has all.

    Args:
        values: by the full names of the fields.
    """
    return ", ".join(label_of(name).of(value_as_text(value, 4)) for name, value in values.items())


def labels_of(names: Sequence[str]) -> dict[str, Label]:
    """Return the labels of fields, which pictures have too; fields with the same label keep their full names."""
    labels = [label_of(name) for name in names]
    return {
        name: one if labels.count(one) == 1 else Label(name) for name, one in zip(names, labels, strict=True)
    }


def bound_of(dimension: Dimension, value: Any) -> str:
    """Return "lower" or "upper" if a value lies at that bound of its field, else an empty text."""
    if dimension.choices:  # a list of values has no bounds
        return ""
    share = place_of(dimension, value)
    return "lower" if share <= EDGE else "upper" if share >= 1.0 - EDGE else ""


def place_of(dimension: Dimension, value: Any) -> float:
    """Return the position of a number between its bounds, on the scale of the field, as a fraction from 0 to 1.

    A value that rounding put beyond a bound, which ``Dimension.share`` would refuse, counts as lying at the bound. The
    dimension must be a range, not a list of choices.
    """
    return dimension.share(min(max(value, dimension.low), dimension.high))


OF_THE_PAPER: Final = {
    "intended": "cost as intended",
    "printed": "cost as printed",
    "authors_code": "cost of the authors' code",
}
"""The paper's cost in its three forms, by the name of the objective."""


def called(objective: Objective) -> str:
    """Name an objective in a sentence."""
    name = objective.name.replace("_", " ")
    return objective.words.replace(name, OF_THE_PAPER.get(objective.name, name), 1)


def aim(objective: Objective) -> str:
    """Write what an objective minimises, and its unit."""
    return f"{called(objective)} ({objective.unit})" if objective.unit else called(objective)


def score_label(objective: Objective) -> str:
    """Label an axis of scores: what they are, and their unit."""
    words = called(objective) if objective.name in OF_THE_PAPER else f"cost ({objective.words})"
    return f"{words}, {objective.unit}" if objective.unit else words


SCORES: Final = {
    "intended": "the paper's cost as its text defines it: the sum over robots of (1 + the estimate's error in tiles) x "
    "(time / T_end if right, 5 if wrong, 1 if undecided)",
    "printed": "the paper's cost as printed, in which the estimate's error hardly counts",
    "authors_code": "the paper's cost as its program computed it: the sum over robots of (the estimate's error in "
    "tiles) x (time / T_end if right, 5 if wrong, 3 if undecided)",
    "decision_time": "the mean decision time over robots; undecided counts as T_end",
    "errors": "the mean over robots of time / T_end if right, and of what a false alarm, a miss or no decision costs",
    "expected_time_to_right": "the expected time to a right consensus if runs without one are repeated",
    "time_at_error": "the mean decision time, plus a penalty for more errors or undecided robots than wanted",
}
"""What a cost is, by its name; the others are figures (``statistics.figures``)."""


def score_sentence(objective: Objective) -> str:
    """Say what a score is, its unit, and which way is better."""
    of = f" ({objective.statistic.replace('+', ' + ')} over runs)" if objective.name not in AIMS else ""
    unit = f"in {objective.unit}" if objective.unit else "without a unit"
    name = objective.name
    what = f"your cost {name}" if objective.function else SCORES.get(name) or BY_NAME[name].title
    return f"Score: {what}{of}; {unit}, lower is better."


def aims(search: Search) -> str:
    """Write what a search minimises, with units."""
    return listed(map(aim, search.objectives))


def other_names(search: Search, truth: Truth) -> list[str]:
    """Return the names of ``truth.others``, in the same order: first the starts, then other requested values.

    The name of a start that is a preset has the preset in brackets.
    """
    starts = search.to_values()["start"]  # each is the name of a preset, or a table of values
    return [
        f"{other.name} ({starts[k]})" if k < len(starts) and isinstance(starts[k], str) else other.name
        for k, other in enumerate(truth.others)
    ]


def standing(truth: Truth, place: int) -> str:
    """Compare the winner, run by run, with the start or other candidate at index ``place`` of ``truth.others``.

    Returns: "better" if the winner costs significantly less, "worse" if it costs significantly more, else
        "not significant"; "the same" if both have the same values.
    """
    other, paired = truth.others[place], truth.against[place]
    if other.values == truth.winner.values:
        return "the same"
    return "better" if paired.high < 0 else "worse" if paired.low > 0 else "not significant"


def failures_in(archive: Archive) -> str:
    """Write how many runs of the candidates in ``archive`` failed, and what that means for them."""
    if not archive.failed:
        return "none failed"
    failed = f"{count(archive.failed, 'run')} FAILED"
    if archive.drops_failed:
        return f"{failed} and dropped: scores are of the other runs, as in the paper's program"
    return f"{failed}; a candidate with a failed run cannot win"


def best_sentence(values: Mapping[str, Any], truth: Truth, unit: str) -> str:
    """Write a winner's values, its true score, and its believed score.

    Args:
        values: by field. unit: of the scores; empty: none.
    """
    score = truth.winner.score
    believed = f"{number(truth.believed)} {unit}".rstrip()
    return (
        f"Best: {values_text(values)}. True score, on {count(score.n, 'fresh run')}: {with_limits(score, unit)}; "
        f"believed score: {believed}."
    )


def warnings_of(
    found: Found, truth: Truth | None, front: Front | None, made_by: Sequence[Mapping[str, str]]
) -> tuple[str, ...]:
    """Return the reasons not to trust a search, the most serious first; the arguments of ``search_document``."""
    words = [_unfinished(found), *_warnings_of_failed_runs(found, truth, front)]
    if truth is not None:
        words += [
            luck_warning(truth),
            *_not_beaten(found.search, truth),
            _warning_of_bounds(found.search, found.values),
        ]
    elif front is not None:
        words.append(front_warning(front))
    elif found.front:
        words.append("The front was not scored on fresh runs: only believed scores are shown.")
    elif len(found.search.objectives) > 1:
        words.append("There is no front: no candidate has scores under all objectives.")
    else:
        words.append("The winner was not scored on fresh runs: only believed scores are shown.")
    words.append(DIFFERENT_VERSIONS if len(made_by) > 1 else "")
    return tuple(words)


def _unfinished(found: Found) -> str:
    """Warn of an unfinished search.

    A search counts as finished if the runs that are left of its budget are fewer than those of one step, or fewer than
    a tenth of the budget: a method cannot always use its last runs.
    """
    search = found.search
    budget = search.search_runs + search.final_runs
    step = search.pso.runs_an_iteration if search.settings.method == "pso" else search.settings.evaluations
    if found.runs > min(budget - step, ENOUGH * budget):
        return ""
    return f"The search is not finished: {whole(found.runs)} of {count(budget, 'run')}."


def _warnings_of_failed_runs(found: Found, truth: Truth | None, front: Front | None) -> Iterator[str]:
    if found.archive.failed:
        causes = "; ".join(sorted({c.why for c in found.archive.candidates if c.why})[:REASONS])
        yield f"{failures_in(found.archive)}." + (f" Why: {causes}" if causes else "")
    for scored in () if truth is None else (truth.winner, *truth.others):
        if scored.failed:
            yield f"{count(scored.failed, 'fresh run')} of the {scored.name} FAILED (in no figure)."
    if failed := 0 if front is None else sum(member.failed for member in front.members):
        yield f"{count(failed, 'fresh run')} of the front's candidates FAILED (in no figure)."


def luck_warning(truth: Truth) -> str:
    """Warn of a difference between the believed and the true score, or of too few fresh runs to see one."""
    if truth.luck != "not significant":
        return truth.words
    score = truth.winner.score
    if score.estimate == 0:  # a relative width is not defined
        return ""
    # relative half-width of the interval, on its wider side
    within = max(score.high - score.estimate, score.estimate - score.low) / abs(score.estimate)
    if within <= WIDE:
        return ""
    known = f"to within {percent(within, 0)}" if math.isfinite(within) else "without limits"
    return (
        f"Too few validation runs: the true score is known {known}. Raise `--fresh` to see whether the believed score "
        "is too low."
    )


def _not_beaten(search: Search, truth: Truth) -> Iterator[str]:
    """Warn of each start that the winner does not significantly beat.

    There is no warning for a swarm whose particles never moved, of which ``luck_warning`` says so.
    """
    names = other_names(search, truth)[: len(search.starts)]  # the starts are the first of the others
    for k, name in enumerate(() if truth.too_short else names):
        comparison, difference = standing(truth, k), with_limits(truth.against[k], sign=True)
        if comparison == "the same":
            yield f"The winner is the {name} itself: nothing better was found."
        elif comparison == "not significant":
            yield (
                f"The winner does not differ significantly from the {name} (winner - {name}: {difference}): "
                "nothing was found."
            )
        elif comparison == "worse":
            yield f"The winner is worse than the {name} (winner - {name}: {difference})."


def beaten(search: Search, truth: Truth) -> Iterator[str]:
    """Write a sentence for each start or other candidate that the winner significantly beats."""
    for k, name in enumerate(other_names(search, truth)):
        if standing(truth, k) == "better":
            difference = with_limits(truth.against[k], sign=True)
            yield f"It costs less than the {name}, run by run on the same fresh runs (winner - {name}: {difference})."


def _warning_of_bounds(search: Search, values: Mapping[str, Any]) -> str:
    words = []
    for dimension in search.space:
        value = values[dimension.name]
        if which := bound_of(dimension, value):
            bound = dimension.low if which == "lower" else dimension.high
            words.append(f"{values_text({dimension.name: value})} ({which} bound {value_text(float(bound))})")
    return (
        f"The winner lies at a bound of the space: {', '.join(words)}. Better values may lie beyond."
        if words
        else ""
    )


def front_warning(front: Front) -> str:
    """Warn of a front that fresh runs do not confirm: a candidate leaves it, or scores are off by ``TELLING``."""
    is_left = not all(member.stays for member in front.members)
    is_biased = any(abs(share) > TELLING for share in front.too_little)
    return front.words if is_left or is_biased else ""
