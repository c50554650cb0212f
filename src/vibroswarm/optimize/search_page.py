"""Lay out the page of a search: warnings first, then results, then how it was made.

    warnings        failed runs, luck, a start that is not beaten, a winner at a bound
    three numbers   believed, true on fresh runs, the difference; then the winner, the starts, and their values
    the search      pictures, the best candidates, what was run, the search's file

With several objectives the front replaces the three numbers.
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
from vibroswarm.study.study_report import versions_in_words

ENOUGH: Final = 0.9
"""Share of the budget from which a search counts as finished."""
WIDE: Final = 0.25
"""Relative half-width of the true score's interval above which there are too few fresh runs."""


def warnings_of(
    found: Found, truth: Truth | None, front: Front | None, made_by: Sequence[Mapping[str, str]]
) -> list[str]:
    """List the warnings that apply, the most serious first."""
    words = [_unfinished(found), *_failures(found, truth, front)]
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


def _unfinished(found: Found) -> str:
    """Warn if a search is unfinished; less than one step may remain, or a few runs after a failure."""
    search = found.search
    budget = search.search_runs + search.final_runs
    step = search.pso.runs_an_iteration if search.settings.method == "pso" else search.settings.evaluations
    if found.runs > min(budget - step, ENOUGH * budget):
        return ""
    return f"The search is not finished: {found.runs:,} of {budget:,} runs."


def _failures(found: Found, truth: Truth | None, front: Front | None) -> list[str]:
    """List the warnings about failed runs."""
    words = []
    if found.archive.failed:
        causes = "; ".join(reasons(found.archive))
        words.append(f"{failures_in(found.archive)}." + (f" Why: {causes}" if causes else ""))
    for scored in () if truth is None else (truth.winner, *truth.others):
        if fresh_failures := fresh_failures_said(scored):
            words.append(f"{fresh_failures}.")
    failed = 0 if front is None else sum(member.failed for member in front.members)
    if failed:
        words.append(f"{failed:,} fresh runs of the front's candidates FAILED and are in no figure.")
    return words


def luck_words(truth: Truth) -> str:
    """Explain the difference between believed and true score, or warn of too few fresh runs; else empty."""
    if truth.luck != "not significant":
        return truth.words
    score = truth.winner.score
    if score.estimate == 0:
        return ""
    within = max(score.high - score.estimate, score.estimate - score.low) / abs(score.estimate)
    if within <= WIDE:
        return ""
    known = f"to within {100 * within:.0f} %" if math.isfinite(within) else "without limits"
    return (
        f"Too few validation runs: the true score is known {known}. Raise `--fresh` to see whether the believed score "
        "is too low."
    )


def _nothing_found(search: Search, truth: Truth) -> list[str]:
    """List the warnings that the winner is not better than the starts."""
    words: list[str] = []
    if truth.too_short:
        return words
    for k, name in enumerate(other_names(search, truth)[: len(search.starts)]):
        stands, less = standing(truth, k), interval_said(truth.against[k], sign=True)
        if stands == "the same":
            words.append(f"The winner is the {name} itself: nothing better was found.")
        elif stands == "not significant":
            words.append(
                f"The winner does not differ significantly from the {name} (winner - {name}: {less}): "
                "nothing was found."
            )
        elif stands == "worse":
            words.append(f"The winner is worse than the {name} (winner - {name}: {less}).")
    return words


def _at_bounds(search: Search, values: Mapping[str, Any]) -> str:
    """Warn if a value of the winner lies at a bound, since better values may lie beyond."""
    short, words = short_names(search.space.names), []
    for d in search.space:
        if at := bound_of(d, values[d.name]):
            end = d.low if at == "lower" else d.high
            words.append(f"`{short[d.name]}` {value_said(values[d.name])} ({at} bound {end:g})")
    return (
        f"The winner lies at a bound of the space: {', '.join(words)}. Better values may lie beyond."
        if words
        else ""
    )


def _front_luck(front: Front) -> str:
    left = not all(member.stays for member in front.members)
    biased = any(abs(share) > TELLING for share in front.too_little)
    return front.words if left or biased else ""


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
        found: the search. truth: of its winner. front: with several objectives.
        pictures: in the style of the page, by name; may be empty.
        made_by: versions of what made it; several where others began it.
    """
    drawn = {name: _shown(name, picture, found, truth, front) for name, picture in pictures.items()}
    sections = [] if truth is None else _truth_sections(found, truth)
    sections += [] if front is None else [_front_section(found, front, drawn)]
    sections += [_winner_section(found, truth)] if front is None else []
    sections.append(_search_section(found, [drawn[n] for n in ("scores", "parameters") if n in drawn]))
    sections.append(_runs_section(found, truth, front))
    text = file_text(found.search)
    if text:
        sections.append(Section("The search file", (), (ReportCode(text, "search.toml"),), folded=True))
    return Report(
        title=found.search.study.name or f"A search for the lowest {_aims(found.search)}",
        lead=(*_lead(found, truth, front), QUOTE),
        warnings=tuple(warnings_of(found, truth, front, made_by)),
        sections=tuple(sections),
        details=_details(found.search, bool(text), made_by),
    )


def truth_parts(truth: Truth, believed_runs: int, cases: Sequence[str], unit: str) -> tuple[ReportTable, ...]:
    """Tabulate the three numbers, then the score by case and its parts, if there are any."""
    more = (tables.case_table(truth.winner, cases, unit), tables.part_table(truth.winner))
    return tables.believed_and_true(truth, believed_runs, unit), *(
        table for table in more if table is not None
    )


def file_text(search: Search | Grid) -> str:
    """Write a search or a grid as TOML; empty if its cost is a function, which a file cannot hold."""
    try:
        return search.to_toml()
    except InputError:
        return ""


def best_words(values: dict[str, Any], truth: Truth, unit: str) -> str:
    """Summarise a winner: its values, its true score, and the score that the search believed."""
    unit, score = f" {unit}".rstrip(), truth.winner.score
    return (
        f"Best: {winner_words(values)}. True, on {score.n:,} fresh runs: {interval_said(score)}{unit}; "
        f"believed score: {truth.believed:.4g}{unit}."
    )


def _lead(found: Found, truth: Truth | None, front: Front | None) -> Iterable[str]:
    """Write the introduction of a search's page."""
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
    """Say against which starts the winner is better; warnings say of the others that it is not."""
    for k, name in enumerate(other_names(search, truth)):
        if standing(truth, k) == "better":
            less = interval_said(truth.against[k], sign=True)
            yield f"It costs less than the {name}, run by run on the same fresh runs (winner - {name}: {less})."


def _aims(search: Search) -> str:
    return " and ".join(objective.words for objective in search.objectives)


def _truth_sections(found: Found, truth: Truth) -> list[Section]:
    """Lay out believed and true scores, and the comparison with the starts."""
    search = found.search
    cases = [cell.name for cell in search.cases]
    parts = truth_parts(truth, found.archive[found.best].count, cases, search.objectives[0].unit)
    three = Section("Believed and true", (truth.words,), parts)
    if not truth.others:
        return [three]
    return [three, Section("Against the start", (), (tables.against_table(search, truth),))]


def _winner_section(found: Found, truth: Truth | None) -> Section:
    """Lay out the winner's values with commands to run and compare it."""
    search = found.search
    others: dict[str, Mapping[str, Any]] = {}
    if truth is not None:
        named = tables.other_names(search, truth)
        others = {name: other.values for name, other in zip(named, truth.others, strict=True)}
    starts = [start for start in search.to_values()["start"] if isinstance(start, str)]
    file = "search.toml" if file_text(search) else ""
    values = tables.value_table(search, found.values, others)
    return Section("The winner's values", (IN_FOLDER,), (values, commands(file, (starts or ["paper"])[0])))


def commands(file: str, against: str) -> ReportCode:
    """Show the commands that run ``best.toml``, and that compare it if the search is in a file."""
    text = "# one run\nvibroswarm run --scenario best.toml"
    if file:
        text += "\n# scored once more on other runs, in pairs, twice"
        text += f"\nvibroswarm optimize {file} --check best.toml --against {against}"
    return ReportCode(text, "commands")


def _front_section(found: Found, front: Front, drawn: Mapping[str, ReportPicture]) -> Section:
    """Lay out the Pareto front with believed and true scores."""
    names = [*found.search.space.names]
    frame = front.table.with_columns(
        stays=pl.Series(["stays" if m.stays else "beaten" for m in front.members])
    )
    short = short_names(names)
    columns = {name: Column(end, digits=6) for name, end in short.items()}
    columns["stays"] = Column("on fresh runs", tones={"stays": "good", "beaten": "bad"})
    column_names = ["stays"]
    for name, unit in zip(front.names, front.units, strict=True):
        words = {"believed": f"{name}: believed", "true": "true", "true low": "from", "true high": "to"}
        columns |= {f"{name}, {kind}": Column(title, unit, 4) for kind, title in words.items()}
        column_names += [f"{name}, {kind}" for kind in words]
    frame = frame.select(*column_names, *names, "fresh runs", "failed")
    caption = (
        f"Candidates on the Pareto front of the search, scored again on {front.runs:,} fresh runs "
        "each; `stays`: still on the front there. Intervals of 95 %."
    )
    pictures = tuple(Section(TITLES[n], parts=(drawn[n],)) for n in ("true-front",) if n in drawn)
    first = found.search.objectives[0].words
    text = (
        front.words,
        f"`best.toml` is the best candidate of the search by {first} alone. To run another one, set its values: "
        "`vibroswarm run --scenario best.toml --set FIELD=VALUE`, in this folder.",
    )
    return Section("The front", text, (ReportTable(frame, columns, caption, "front"),), pictures)


def _search_section(found: Found, pictures: Sequence[ReportPicture]) -> Section:
    """Lay out pictures, best candidates and iterations of the search."""
    below = [Section(TITLES[picture.name], parts=(picture,)) for picture in pictures]
    if len(found.search.objectives) == 1:
        title = f"The best {min(tables.BEST, len(found.archive))} candidates"
        below.append(Section(title, parts=(tables.best_table(found),), folded=True))
    below.append(Section("Iteration by iteration", parts=(tables.history_of(found),), folded=True))
    return Section("How the search went", sections=tuple(below), side_by_side=len(pictures) > 1)


def _runs_section(found: Found, truth: Truth | None, front: Front | None) -> Section:
    """Lay out the use of the budget and the failures."""
    fresh = []
    if truth is not None:
        fresh = [(s.name, 1, s.rows.shape[0], s.failed) for s in (truth.winner, *truth.others)]
    if front is not None:
        count, failed = len(front.members), sum(member.failed for member in front.members)
        fresh.append(("front", count, front.runs * count - failed, failed))
    failures = tables.failure_table(found.archive)
    parts = (tables.account(found, fresh), *(() if failures is None else (failures,)))
    text = (f"{found.runs:,} runs by the search; {failures_in(found.archive)}.",)
    return Section("Runs", text, parts)


def _shown(
    name: str, picture: Picture, found: Found, truth: Truth | None, front: Front | None
) -> ReportPicture:
    """Add to a picture's caption from which runs it is drawn."""
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
    """Return hash, seed, method, versions and commands of a search."""
    details = {
        "search": search.hash, "seed": str(search.seed), "method": search.settings.method,
        "engine": search.study.motion, **versions_in_words(made_by),
    }  # fmt: skip
    if has_file:
        details["to repeat, in this folder"] = "vibroswarm optimize search.toml --out ."
    return details
