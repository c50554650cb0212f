"""The page of a search: one file that is opened from disk, from what must be known first down to how it was made.

    warnings        failed runs, luck, a start that is not beaten, a winner at a bound
    three numbers   believed, true on fresh runs, the difference; then the winner beside the starts, and its values
    the search      pictures, the best candidates, what was run, the search's file

With several objectives the front takes the place of the three numbers.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

import polars as pl

from vibroswarm.errors import InputError
from vibroswarm.optimize import page_tables as tables
from vibroswarm.optimize.fronts import Front
from vibroswarm.optimize.grid import Grid
from vibroswarm.optimize.loop import Found
from vibroswarm.optimize.page_warnings import warnings_of
from vibroswarm.optimize.spec import Search
from vibroswarm.optimize.truth import Truth
from vibroswarm.optimize.words import failures_said, interval_said, short_names, values_said
from vibroswarm.page.report import (
    Column,
    Report,
    ReportCode,
    ReportPicture,
    ReportTable,
    Section,
    picture_of,
)
from vibroswarm.plots import Picture

QUOTE: Final = (
    "Quote what is true on fresh runs, with its interval, and not what the search believed: of many candidates the one "
    "that looks best was partly lucky, and fresh runs played no part in any choice."
)
IN_FOLDER: Final = "It is kept as `best.toml`; the commands below are said in its folder."
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
    """What came of a search, as a page.

    Args:
        found: the search. truth: of its winner. front: with several objectives.
        pictures: as they are to stand on the page, by name; may be none.
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
        sections.append(Section("The search's file", (), (ReportCode(text, "search.toml"),), folded=True))
    return Report(
        title=found.search.study.name or f"A search for the lowest {_aims(found.search)}",
        lead=(*_lead(found, truth, front), QUOTE),
        warnings=tuple(warnings_of(found, truth, front, made_by)),
        sections=tuple(sections),
        details=_details(found.search, bool(text), made_by),
    )


def truth_parts(truth: Truth, believed_runs: int, cases: Sequence[str], unit: str) -> tuple[ReportTable, ...]:
    """The three numbers, then the score by case and what it is made of, where there is such."""
    more = (tables.case_table(truth.winner, cases, unit), tables.part_table(truth.winner))
    return tables.believed_and_true(truth, believed_runs, unit), *(one for one in more if one is not None)


def made_details(made_by: Sequence[Mapping[str, str]]) -> dict[str, str]:
    """Versions, for the end of a page."""
    return {
        "made by" if len(made_by) == 1 else f"made by ({k + 1})": ", ".join(
            f"{n} {v}" for n, v in one.items()
        )
        for k, one in enumerate(made_by)
    }


def file_text(search: Search | Grid) -> str:
    """A search or a grid as TOML; empty where its cost is a function, which no file holds."""
    try:
        return search.to_toml()
    except InputError:
        return ""


def best_said(values: dict[str, Any], truth: Truth, unit: str) -> str:
    """A winner with its values, what is true of it, and what was believed, in one sentence or two."""
    unit, score = f" {unit}".rstrip(), truth.winner.score
    return (
        f"Best: {values_said(values)}. True, on {score.n:,} fresh runs: {interval_said(score)}{unit}; "
        f"the search believed {truth.believed:.4g}{unit}."
    )


def _lead(found: Found, truth: Truth | None, front: Front | None) -> Iterable[str]:
    search, archive = found.search, found.archive
    cases = f", each in {len(search.cases)} cases" if len(search.cases) > 1 else ""
    yield (
        f"`{search.settings.method}` over {search.space.size} fields, for the lowest {_aims(search)}: {len(archive):,} "
        f"candidates in {found.runs:,} runs{cases}; {failures_said(archive.failed)}."
    )
    if truth is not None:
        yield best_said(found.values, truth, search.objectives[0].unit)
    if front is not None:
        yield f"{len(front.members)} candidates are beaten by none in all of {' and '.join(front.names)}."


def _aims(search: Search) -> str:
    return " and ".join(objective.words for objective in search.objectives)


def _truth_sections(found: Found, truth: Truth) -> list[Section]:
    search = found.search
    cases = [cell.name for cell in search.cases]
    parts = truth_parts(truth, found.archive[found.best].count, cases, search.objectives[0].unit)
    three = Section("Believed and true", (truth.words,), parts)
    if not truth.others:
        return [three]
    return [three, Section("Against the start", (), (tables.against_table(search, truth),))]


def _winner_section(found: Found, truth: Truth | None) -> Section:
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
    """How ``best.toml`` is run, and scored against another where the search is in a file."""
    text = "# one run\nvibroswarm run --scenario best.toml"
    if file:
        text += "\n# scored once more on other runs, in pairs, twice"
        text += f"\nvibroswarm optimize {file} --check best.toml --against {against}"
    return ReportCode(text, "commands")


def _front_section(found: Found, front: Front, drawn: Mapping[str, ReportPicture]) -> Section:
    names = [*found.search.space.names]
    frame = front.table.with_columns(
        stays=pl.Series(["stays" if m.stays else "beaten" for m in front.members])
    )
    short = short_names(names)
    columns = {name: Column(end, digits=6) for name, end in short.items()}
    columns["stays"] = Column("on fresh runs", tones={"stays": "good", "beaten": "bad"})
    shown = ["stays"]
    for name, unit in zip(front.names, front.units, strict=True):
        words = {"believed": f"{name}: believed", "true": "true", "true low": "from", "true high": "to"}
        columns |= {f"{name}, {kind}": Column(title, unit, 4) for kind, title in words.items()}
        shown += [f"{name}, {kind}" for kind in words]
    frame = frame.select(*shown, *names, "fresh runs", "failed")
    caption = (
        f"Candidates that no other beat in all objectives in the search, scored again on {front.runs:,} fresh runs "
        "each; `stays`: nor is it beaten there. Intervals of 95 %."
    )
    pictures = tuple(Section(TITLES[n], parts=(drawn[n],)) for n in ("true-front",) if n in drawn)
    first = found.search.objectives[0].words
    text = (
        front.words,
        f"`best.toml` is what the search has for the best by {first} alone. Any other is run with its values in the "
        "place of those: `vibroswarm run --scenario best.toml --set FIELD=VALUE`, in this folder.",
    )
    return Section("The front", text, (ReportTable(frame, columns, caption, "front"),), pictures)


def _search_section(found: Found, pictures: Sequence[ReportPicture]) -> Section:
    below = [Section(TITLES[picture.name], parts=(picture,)) for picture in pictures]
    if len(found.search.objectives) == 1:
        title = f"The best {min(tables.BEST, len(found.archive))} candidates"
        below.append(Section(title, parts=(tables.best_table(found),), folded=True))
    below.append(Section("Iteration by iteration", parts=(tables.history_of(found),), folded=True))
    return Section("How the search went", sections=tuple(below), side_by_side=len(pictures) > 1)


def _runs_section(found: Found, truth: Truth | None, front: Front | None) -> Section:
    fresh = []
    if truth is not None:
        fresh = [(s.name, 1, s.rows.shape[0], s.failed) for s in (truth.winner, *truth.others)]
    if front is not None:
        count, failed = len(front.members), sum(member.failed for member in front.members)
        fresh.append(("front", count, front.runs * count - failed, failed))
    why = tables.failure_table(found.archive)
    parts = (tables.account(found, fresh), *(() if why is None else (why,)))
    text = (f"{found.runs:,} runs by the search; {failures_said(found.archive.failed)}.",)
    return Section("What came of the runs", text, parts)


def _shown(
    name: str, picture: Picture, found: Found, truth: Truth | None, front: Front | None
) -> ReportPicture:
    """A picture with the runs that it is drawn from in its caption."""
    one = picture_of(picture, name)
    more = ""
    if name == "true-front" and front is not None:
        more = f" From {front.runs:,} fresh runs of each candidate."
    elif found.history:
        runs = found.history[-1].runs
        race = " before the race" if found.race else ""
        more = f" From the {runs:,} runs of the search{race}."
        if name == "scores" and truth is not None:
            more += f" The line across: {truth.winner.score.n:,} fresh runs."
    return replace(one, caption=f"{one.caption}{more}")


def _details(search: Search, has_file: bool, made_by: Sequence[Mapping[str, str]]) -> dict[str, str]:
    details = {
        "search": search.hash, "seed": str(search.seed), "method": search.settings.method,
        "engine": search.study.motion, **made_details(made_by),
    }  # fmt: skip
    if has_file:
        details["again, said in this folder"] = "vibroswarm optimize search.toml --out ."
    return details
