"""Lay out the HTML page of a search: warnings first, then results, then how it was made.

    warnings        failed runs, luck, a start that is not beaten, a winner at a bound
    three numbers   believed, true on fresh runs, the difference; then the winner, the starts, and their values
    the search      pictures, the best candidates, what was run, the search's file

The believed score of the winner is the one by which the search chose it, the true score that on fresh runs, which
played no part in the choice (see ``validation``). A start is a given point that is compared with the winner. With
several objectives the Pareto front replaces the three numbers.

Most functions take the same arguments: ``found``, the result of the search; ``truth``, the winner and the starts on
fresh runs, None if they were not scored; ``front``, the Pareto front on fresh runs, None with a single objective, or if
no candidate has a score under every objective; ``made_by``, the versions of the programs that made the search, several
entries if other versions began it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

import polars as pl

from vibroswarm.errors import InputError
from vibroswarm.optimize import search_tables as tables
from vibroswarm.optimize.grid import Grid
from vibroswarm.optimize.loop import Found
from vibroswarm.optimize.search_tables import (
    bound_of,
    failures_in,
    fresh_failures_said,
    interval_said,
    other_names,
    reasons,
    short_names,
    standing,
    value_said,
    winner_words,
)
from vibroswarm.optimize.spec import Search
from vibroswarm.optimize.validation import TELLING, Front, Truth
from vibroswarm.plots import Picture
from vibroswarm.report.html import Column, Report, ReportCode, ReportPicture, ReportTable, Section, picture_of
from vibroswarm.show.made_by import versions_in_words

ENOUGH: Final = 0.9
"""Share of the budget from which a search counts as finished."""
WIDE: Final = 0.25
"""Relative half-width of the true score's interval above which there are too few fresh runs."""


def warnings_of(
    found: Found, truth: Truth | None, front: Front | None, made_by: Sequence[Mapping[str, str]]
) -> list[str]:
    """List the warnings that apply to a search, as sentences, the most serious first."""
    words = [*found.notes, *warnings_of_runs(found, truth, front)]
    if truth is not None:
        words += [
            luck_words(truth),
            *_nothing_found(found.search, truth),
            _at_bounds(found.search, found.values),
        ]
    elif front is not None:
        words.append(_front_luck(front))
    elif len(found.search.objectives) > 1:
        words.append("There is no front: no candidate has scores under all objectives.")
    else:
        words.append("The winner was not scored on fresh runs: this page shows only believed scores.")
    if len(made_by) > 1:
        words.append("Different versions made parts of it; as a whole it may not be repeatable.")
    return [text for text in words if text]


def warnings_of_runs(found: Found, truth: Truth | None, front: Front | None) -> list[str]:
    """List the warnings about runs that are missing or failed; see ``warnings_of``."""
    return [text for text in (_unfinished(found), *_failures(found, truth, front)) if text]


def _unfinished(found: Found) -> str:
    """Return a warning if a search is unfinished, else an empty text.

    A search counts as finished if the runs that are left of its budget are fewer than those of one step, or fewer than
    a tenth of the budget: a method cannot always use its last runs.
    """
    search = found.search
    budget = search.search_runs + search.final_runs
    step = search.pso.runs_an_iteration if search.settings.method == "pso" else search.settings.evaluations
    # fewer runs are left than a step takes, or fewer than a tenth of the budget
    if found.runs > min(budget - step, ENOUGH * budget):
        return ""
    return f"The search is not finished: {found.runs:,} of {budget:,} runs."


def _failures(found: Found, truth: Truth | None, front: Front | None) -> list[str]:
    """List the warnings about failed runs: in the search, and on fresh runs of the winner, the starts and the front."""
    words = []
    if found.archive.failed:
        causes = "; ".join(reasons(found.archive))
        words.append(f"{failures_in(found.archive)}." + (f" Why: {causes}" if causes else ""))
    scored_fresh = () if truth is None else (truth.winner, *truth.others)
    for scored in scored_fresh:
        if fresh_failures := fresh_failures_said(scored):
            words.append(f"{fresh_failures}.")
    failed = 0 if front is None else sum(member.failed for member in front.members)
    if failed:
        words.append(f"{failed:,} fresh runs of the front's candidates FAILED and are in no figure.")
    return words


def luck_words(truth: Truth) -> str:
    """Return a warning about the difference between the believed and the true score, or an empty text.

    If ``truth.luck`` is anything but "not significant", the warning is its sentence ``truth.words``: the scores differ
    significantly, or cannot be compared. Otherwise there is a warning only if the interval of the true score is too
    wide, relative to the score, to show a difference.
    """
    if truth.luck != "not significant":
        return truth.words
    score = truth.winner.score
    if score.estimate == 0:  # a relative width is not defined
        return ""
    # relative half-width of the interval, on its wider side
    within = max(score.high - score.estimate, score.estimate - score.low) / abs(score.estimate)
    if within <= WIDE:
        return ""
    known = f"to within {100 * within:.0f} %" if math.isfinite(within) else "without limits"
    return (
        f"Too few validation runs: the true score is known {known}. Raise `--fresh` to see whether the believed score "
        "is too low."
    )


def _nothing_found(search: Search, truth: Truth) -> list[str]:
    """List a warning for each start that the winner does not significantly beat.

    The list is empty for a swarm whose particles never moved; ``luck_words`` then says so.
    """
    words: list[str] = []
    if truth.too_short:
        return words
    names = other_names(search, truth)[: len(search.starts)]  # the starts are the first of the others
    for k, name in enumerate(names):
        comparison, difference = standing(truth, k), interval_said(truth.against[k], sign=True)
        if comparison == "the same":
            words.append(f"The winner is the {name} itself: nothing better was found.")
        elif comparison == "not significant":
            words.append(
                f"The winner does not differ significantly from the {name} (winner - {name}: {difference}): "
                "nothing was found."
            )
        elif comparison == "worse":
            words.append(f"The winner is worse than the {name} (winner - {name}: {difference}).")
    return words


def _at_bounds(search: Search, values: Mapping[str, Any]) -> str:
    """Return a warning if a value of the winner lies at a bound of the space, else an empty text.

    ``values`` are the winner's values by field.
    """
    short, words = short_names(search.space.names), []
    for dimension in search.space:
        value = values[dimension.name]
        if which := bound_of(dimension, value):  # "lower", "upper", or empty
            bound = dimension.low if which == "lower" else dimension.high
            words.append(f"`{short[dimension.name]}` {value_said(value)} ({which} bound {bound:g})")
    return (
        f"The winner lies at a bound of the space: {', '.join(words)}. Better values may lie beyond."
        if words
        else ""
    )


def _front_luck(front: Front) -> str:
    """Return the summary of the front, as a warning, if fresh runs do not confirm the front; else an empty text.

    The front is not confirmed if a candidate of the search's front is not on the front that the scores on fresh runs
    make, or if the believed scores of an objective are biased. They count as biased if the median over the candidates
    of ``(true - believed) / abs(true)`` is above ``TELLING`` or below ``-TELLING``.
    """
    some_left = not all(member.stays for member in front.members)
    # The property ``too_little`` holds this median for each objective.
    is_biased = any(abs(relative_bias) > TELLING for relative_bias in front.too_little)
    return front.words if some_left or is_biased else ""


QUOTE: Final = (
    "Quote the true score with its interval, not the believed one: the candidate that looks best of many was partly "
    "lucky, and fresh runs played no part in the choice."
)
IN_FOLDER: Final = "It is saved as `best.toml`; run the commands below in its folder."
TITLES: Final = {
    "scores": "How the scores fell",
    "parameters": "Where in their bounds the candidates lay",
    "true-front": "The front on fresh runs",
}


def search_page(
    found: Found,
    truth: Truth | None,
    front: Front | None,
    pictures: Mapping[str, Picture],
    made_by: Sequence[Mapping[str, str]],
) -> Report:
    """Lay out the page of a search.

    Args:
        found: the search and its result. truth: the winner and the starts on fresh runs, if they were scored.
        front: the Pareto front on fresh runs, with several objectives.
        pictures: by name (see ``TITLES``), drawn in the style of the page; may be empty.
        made_by: the versions of the programs that made the search, several entries if other versions began it.
    """
    drawn = {name: _shown(name, picture, found, truth, front) for name, picture in pictures.items()}
    sections = [] if truth is None else _truth_sections(found, truth)
    sections += [] if front is None else [_front_section(found, front, drawn)]
    # With a front no single candidate wins; the section of the front describes how to run one of its candidates.
    sections += [_winner_section(found, truth)] if front is None else []
    # the pictures over the iterations; that of the front stands in its own section
    sections.append(_search_section(found, [drawn[n] for n in ("scores", "parameters") if n in drawn]))
    sections.append(_runs_section(found, truth, front))
    text = file_text(found.search)
    if text:
        sections.append(
            Section("The search file", parts=(ReportCode(text, name="search.toml"),), folded=True)
        )
    return Report(
        title=found.search.study.name or f"A search for the lowest {_aims(found.search)}",
        lead=(*_lead(found, truth, front), QUOTE),
        warnings=tuple(warnings_of(found, truth, front, made_by)),
        sections=tuple(sections),
        details=_details(found.search, bool(text), made_by),
    )


def truth_parts(truth: Truth, believed_runs: int, cases: Sequence[str], unit: str) -> tuple[ReportTable, ...]:
    """Tabulate the believed score, the true score and their difference, and what the true score consists of.

    Args:
        truth: the scores. believed_runs: number of runs of the believed score. cases: names of the cases.
        unit: of the score.
    Returns:
        The table of the three numbers; if there are several cases, a table with the true score in each case; for the
        cost ``time_at_error``, a table of the parts of the true score.
    """
    three_numbers = tables.believed_and_true(truth, believed_runs, unit)
    further = (tables.case_table(truth.winner, cases, unit), tables.part_table(truth.winner))
    return three_numbers, *(table for table in further if table is not None)


def file_text(search: Search | Grid) -> str:
    """Return a search or a grid as TOML; the text is empty if a file cannot hold it.

    This is so if its cost is a function, or if the study of a grid has no block "grid".
    """
    try:
        return search.to_toml()
    except InputError:
        return ""


def best_words(values: dict[str, Any], truth: Truth, unit: str) -> str:
    """Summarise a winner in two sentences: its ``values`` by field, its true score, and its believed score.

    ``unit`` is the unit of the scores, empty if they have none.
    """
    space_and_unit, score = f" {unit}" if unit else "", truth.winner.score
    return (
        f"Best: {winner_words(values)}. True, on {score.n:,} fresh runs: {interval_said(score)}{space_and_unit}; "
        f"believed score: {truth.believed:.4g}{space_and_unit}."
    )


def _lead(found: Found, truth: Truth | None, front: Front | None) -> Iterable[str]:
    """Write the introduction of a search's page, one entry per paragraph."""
    search, archive = found.search, found.archive
    cases = f", each in {len(search.cases)} cases" if len(search.cases) > 1 else ""
    yield (
        f"`{search.settings.method}` over {search.space.size} fields, for the lowest {_aims(search)}: {len(archive):,} "
        f"candidates in {found.runs:,} runs{cases}; {failures_in(archive)}."
    )
    if truth is not None:
        yield best_words(found.values, truth, search.objectives[0].unit)
        yield from _against_words(search, truth)
    if front is not None:
        yield f"{len(front.members)} candidates are on the Pareto front of {' and '.join(front.names)}."


def _against_words(search: Search, truth: Truth) -> Iterable[str]:
    """Write a sentence for each start or other candidate that the winner significantly beats.

    The warnings name the starts that the winner does not beat.
    """
    for k, name in enumerate(other_names(search, truth)):
        if standing(truth, k) == "better":
            difference = interval_said(truth.against[k], sign=True)
            yield f"It costs less than the {name}, run by run on the same fresh runs (winner - {name}: {difference})."


def _aims(search: Search) -> str:
    return " and ".join(objective.words for objective in search.objectives)


def _truth_sections(found: Found, truth: Truth) -> list[Section]:
    """Lay out the believed and the true score of the winner, and its comparison with the starts and other values.

    The comparison is left out if only the winner was scored on fresh runs.
    """
    search = found.search
    cases = [cell.name for cell in search.cases]
    parts = truth_parts(truth, found.archive[found.best].count, cases, search.objectives[0].unit)
    scores = Section("Believed and true", text=(truth.words,), parts=parts)
    if not truth.others:
        return [scores]
    return [scores, Section("Against the start", parts=(tables.against_table(search, truth),))]


def _winner_section(found: Found, truth: Truth | None) -> Section:
    """Lay out the winner's values beside those of the starts, with commands to run the winner and compare it.

    The command compares the winner with the first start that is a preset or, without such a start, with the preset
    "paper".
    """
    search = found.search
    others: dict[str, Mapping[str, Any]] = {}  # values of each start or other candidate, by its name
    if truth is not None:
        named = tables.other_names(search, truth)
        others = {name: other.values for name, other in zip(named, truth.others, strict=True)}
    # a start is the name of a preset, or a table of values
    presets = [start for start in search.to_values()["start"] if isinstance(start, str)]
    against = presets[0] if presets else "paper"
    file = "search.toml" if file_text(search) else ""
    values = tables.value_table(search, found.values, others)
    return Section("The winner's values", text=(IN_FOLDER,), parts=(values, commands(file, against)))


def commands(file: str, against: str) -> ReportCode:
    """Show the command that runs the winner's scenario ``best.toml``, and the one that compares it with a preset.

    Args:
        file: the file of the search or grid. If it is empty, the second command is left out, since it needs the file.
        against: the preset with which the winner is compared.
    """
    text = "# one run\nvibroswarm run --scenario best.toml"
    if file:
        text += "\n# scored once more on other runs, in pairs, twice"
        text += f"\nvibroswarm optimize {file} --check best.toml --against {against}"
    return ReportCode(text, name="commands")


def _front_section(found: Found, front: Front, drawn: Mapping[str, ReportPicture]) -> Section:
    """Lay out the Pareto front: its believed and true scores as a table, and its picture.

    ``drawn`` has the pictures of the page by name; the section has no picture if that of the front is not among them.
    """
    names = [*found.search.space.names]
    frame = front.table.with_columns(
        stays=pl.Series(["stays" if m.stays else "beaten" for m in front.members])
    )
    short = short_names(names)
    columns = {name: Column(end, digits=6) for name, end in short.items()}
    columns["stays"] = Column("on fresh runs", tones={"stays": "good", "beaten": "bad"})
    column_names = ["stays"]
    # ``front.table`` has four columns for each objective, named "OBJECTIVE, believed" and so on
    for name, unit in zip(front.names, front.units, strict=True):
        words = {"believed": f"{name}: believed", "true": "true", "true low": "from", "true high": "to"}
        columns |= {f"{name}, {kind}": Column(title, unit, digits=4) for kind, title in words.items()}
        column_names += [f"{name}, {kind}" for kind in words]
    frame = frame.select(*column_names, *names, "fresh runs", "failed")
    caption = (
        f"Candidates on the Pareto front of the search, scored again on {front.runs:,} fresh runs "
        "each; `stays`: still on the front there. Intervals of 95 %."
    )
    name = "true-front"
    pictures = (Section(TITLES[name], parts=(drawn[name],)),) if name in drawn else ()
    first = found.search.objectives[0].words
    text = (
        front.words,
        f"`best.toml` is the best candidate of the search by {first} alone. To run another one, set its values: "
        "`vibroswarm run --scenario best.toml --set FIELD=VALUE`, in this folder.",
    )
    table = ReportTable(frame, columns, caption=caption, name="front")
    return Section("The front", text=text, parts=(table,), sections=pictures)


def _search_section(found: Found, pictures: Sequence[ReportPicture]) -> Section:
    """Lay out ``pictures`` of the iterations, a table of the best candidates, and a table of the iterations.

    With several objectives the best candidates are left out, since they are those of the front.
    """
    below = [Section(TITLES[picture.name], parts=(picture,)) for picture in pictures]
    if len(found.search.objectives) == 1:
        title = f"The best {min(tables.BEST, len(found.archive))} candidates"
        below.append(Section(title, parts=(tables.best_table(found),), folded=True))
    below.append(Section("Iteration by iteration", parts=(tables.history_of(found),), folded=True))
    return Section("How the search went", sections=tuple(below), side_by_side=len(pictures) > 1)


def _runs_section(found: Found, truth: Truth | None, front: Front | None) -> Section:
    """Lay out how many runs the search, the race and the fresh runs took, and why runs failed."""
    fresh = []  # (name, candidates, succeeded runs, failed runs) of each set of fresh runs, see ``tables.account``
    if truth is not None:
        fresh = [(s.name, 1, s.rows.shape[0], s.failed) for s in (truth.winner, *truth.others)]
    if front is not None:
        count, failed = len(front.members), sum(member.failed for member in front.members)
        fresh.append(("front", count, front.runs * count - failed, failed))
    failures = tables.failure_table(found.archive)
    parts = (tables.account(found, fresh), *(() if failures is None else (failures,)))
    text = (f"{found.runs:,} runs by the search; {failures_in(found.archive)}.",)
    return Section("Runs", text=text, parts=parts)


def _shown(
    name: str, picture: Picture, found: Found, truth: Truth | None, front: Front | None
) -> ReportPicture:
    """Prepare a picture for the page, and add to its caption from which runs it is drawn.

    ``name`` is "scores", "parameters" or "true-front".
    """
    shown = picture_of(picture, name)
    more = ""
    if name == "true-front" and front is not None:
        more = f" From {front.runs:,} fresh runs of each candidate."
    elif found.history:
        runs = found.history[-1].runs
        race = " before the race" if found.race else ""
        more = f" From the {runs:,} runs of the search{race}."
        if name == "scores" and truth is not None:
            more += f" The line across: {truth.winner.score.n:,} fresh runs."
    return replace(shown, caption=f"{shown.caption}{more}")


def _details(search: Search, has_file: bool, made_by: Sequence[Mapping[str, str]]) -> dict[str, str]:
    """Return the details at the end of the page by name.

    These are hash, seed, method, source of motion (as "engine"), versions, and the command to repeat the search. The
    command is left out unless the search ``has_file``: a search whose cost is a function has none.
    """
    details = {
        "search": search.hash, "seed": str(search.seed), "method": search.settings.method,
        "engine": search.study.motion, **versions_in_words(made_by),
    }  # fmt: skip
    if has_file:
        details["to repeat, in this folder"] = "vibroswarm optimize search.toml --out ."
    return details
