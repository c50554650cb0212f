"""What a reader of a search's page must know before believing it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

from vibroswarm.optimize.fronts import Front
from vibroswarm.optimize.loop import Found
from vibroswarm.optimize.page_tables import bound_of, other_names, standing
from vibroswarm.optimize.spec import Search
from vibroswarm.optimize.truth import TELLING, Truth
from vibroswarm.optimize.words import (
    failures_said,
    fresh_failures_said,
    interval_said,
    reasons,
    short_names,
    value_said,
)

ENOUGH: Final = 0.9
"""Share of the account of a search that is whole."""
WIDE: Final = 0.25
"""Share of the true score: where its limits are further away, fresh runs were too few."""


def warnings_of(
    found: Found, truth: Truth | None, front: Front | None, made_by: Sequence[Mapping[str, str]]
) -> list[str]:
    """All that hold, the gravest first."""
    told = [_unfinished(found), *_failures(found, truth, front)]
    if truth is not None:
        told += [
            luck_told(truth),
            *_nothing_found(found.search, truth),
            _at_bounds(found.search, found.values),
        ]
    elif front is not None:
        told.append(_front_luck(front))
    elif len(found.search.objectives) > 1:
        told.append("There is no front: no candidate has scores under all objectives.")
    else:
        told.append("The winner was not scored on fresh runs: here stands only what the search believed.")
    if len(made_by) > 1:
        told.append("Different versions made parts of it; as a whole it may not be repeatable.")
    return [text for text in told if text]


def _unfinished(found: Found) -> str:
    """A method may leave less than one step of its account over, and a failure may cost it some."""
    search = found.search
    wanted = search.search_runs + search.final_runs
    step = search.pso.runs_an_iteration if search.settings.method == "pso" else search.settings.evaluations
    if found.runs > min(wanted - step, ENOUGH * wanted):
        return ""
    return f"The search is not finished: {found.runs:,} of {wanted:,} runs."


def _failures(found: Found, truth: Truth | None, front: Front | None) -> list[str]:
    told = []
    if found.archive.failed:
        why = "; ".join(reasons(found.archive))
        told.append(f"{failures_said(found.archive.failed)}." + (f" Why: {why}" if why else ""))
    for scored in () if truth is None else (truth.winner, *truth.others):
        if said := fresh_failures_said(scored):
            told.append(f"{said}.")
    failed = 0 if front is None else sum(member.failed for member in front.members)
    if failed:
        told.append(f"{failed:,} fresh runs of the front's candidates FAILED and are in no figure.")
    return told


def luck_told(truth: Truth) -> str:
    """What the difference between believed and true is, or that what is true is hardly known; else empty."""
    if truth.luck != "none to be seen":
        return truth.words
    score = truth.winner.score
    if score.estimate == 0:
        return ""
    within = max(score.high - score.estimate, score.estimate - score.low) / abs(score.estimate)
    if within <= WIDE:
        return ""
    known = f"to within {100 * within:.0f} %" if math.isfinite(within) else "without limits"
    return (
        f"So few fresh runs do not tell much: what is true is known {known}. More of them (`--fresh`) tell more, and "
        "say whether the search believed too little."
    )


def _nothing_found(search: Search, truth: Truth) -> list[str]:
    told = []
    for k, name in enumerate(other_names(search, truth)[: len(search.starts)]):
        stands, less = standing(truth, k), interval_said(truth.against[k], sign=True)
        if stands == "the same":
            told.append(f"The winner is the {name} itself: nothing better was found.")
        elif stands == "not told apart":
            told.append(
                f"The winner is not told apart from the {name} (the winner less this {less}): nothing was found."
            )
        elif stands == "worse":
            told.append(f"The winner is worse than the {name} (the winner less this {less}).")
    return told


def _at_bounds(search: Search, values: Mapping[str, Any]) -> str:
    """Where a value lies at a bound, what is better may lie beyond."""
    short, told = short_names(search.space.names), []
    for d in search.space:
        if at := bound_of(d, values[d.name]):
            end = d.low if at == "lower" else d.high
            told.append(f"`{short[d.name]}` {value_said(values[d.name])} ({at} bound {end:g})")
    return (
        f"The winner lies at a bound of the space: {', '.join(told)}. What is better may lie beyond."
        if told
        else ""
    )


def _front_luck(front: Front) -> str:
    left = not all(member.stays for member in front.members)
    far = any(abs(share) > TELLING for share in front.too_little)
    return front.words if left or far else ""
