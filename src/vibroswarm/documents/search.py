"""The documents of a search (the winner or the Pareto front, and was it luck?), of a sensitivity, of a comparison.

The believed score of a candidate is the one by which the search chose it; the true score is that on fresh runs, which
played no part in the choice (``search.validation``). A start is a given point that is compared with the winner.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

import polars as pl

from vibroswarm.core.numbers import Estimate, count, count_of, listed, number, percent, whole, with_limits
from vibroswarm.documents.knowledge import told, versions_in_words
from vibroswarm.documents.search_tables import (
    BEST,
    account,
    against,
    best_table,
    failure_tables,
    frame_of,
    front_table,
    history_of,
    truth_tables,
    value_table,
)
from vibroswarm.documents.search_words import (
    aims,
    beaten,
    best_sentence,
    called,
    failures_in,
    front_warning,
    other_names,
    score_label,
    score_sentence,
    values_text,
    warnings_of,
)
from vibroswarm.plots.front import draw_front
from vibroswarm.plots.labels import setting_words
from vibroswarm.plots.picture import Picture
from vibroswarm.plots.search import draw_parameters, draw_search
from vibroswarm.plots.style import SERIES_UP_TO
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.search.loop import Found
from vibroswarm.search.search_files import file_text
from vibroswarm.search.sensitivity import Sensitivity
from vibroswarm.search.spec import Search
from vibroswarm.search.validation import MIN_FRESH_RUNS, Front, Truth
from vibroswarm.show.document import Column, Document, Figure, Part, Section, Table, Text
from vibroswarm.simulation import versions
from vibroswarm.statistics.intervals import columns_of, plain

QUOTE: Final = (
    "Quote the true score with its interval: the candidate that looks best of many was partly lucky, and fresh runs "
    "played no part in the choice."
)


def search_document(
    found: Found,
    truth: Truth | None = None,
    front: Front | None = None,
    made_by: Sequence[Mapping[str, str]] = (),
) -> Document:
    """Return the document of a search.

    Args:
        truth: the winner and the starts on fresh runs, if they were scored.
        front: the Pareto front on fresh runs, with several objectives.
        made_by: the versions of the programs that made the search, several entries if other versions began it; by
            default the current ones.
    """
    search = found.search
    made_by = made_by or [versions()]
    sections = [
        *_truth_sections(found, truth),
        *([] if front is None else [_front_section(found, front)]),
        # With a front no single candidate wins.
        *([] if found.front else [_values_section(found, truth)]),
        _history_section(found, truth),
        Section("Runs", (account(found, truth, front), *failure_tables(found.archive))),
        file_section(file_text(search), "search.toml"),
    ]
    return Document(
        title=search.study.name or f"A search for the lowest {aims(search)}",
        answer=tuple(_answer(found, truth, front)),
        knew=told(_scenarios_shown(found, truth)),
        warnings=warnings_of(found, truth, front, made_by),
        parts=(
            Text(_what_was_searched(found)),
            *(Text(score_sentence(one)) for one in search.objectives),
            *sections,
        ),
        made_by=_made_by(search, made_by),
    )


def plan_sentences(search: Search) -> Iterator[str]:
    """Say what a search will do: its method, fields, runs and score."""
    # the runs of the method, those of the race between the best candidates, and those that validate the winner
    runs, fresh = search.search_runs + search.final_runs, search.settings.fresh
    judged = "the best and the starts" if search.starts else "the best"
    validation = f"{count(fresh * (1 + len(search.starts)), 'fresh run')} to validate {judged}"
    if len(search.objectives) > 1:
        validation = f"{fresh} fresh runs to validate the front, at least {MIN_FRESH_RUNS} of each candidate"
    yield (
        f"{search.settings.method_name}: {count(search.space.size, 'field')}, for the lowest {aims(search)}; "
        f"{count(runs, 'run')}, and {validation}; seed {search.seed}"
    )
    yield from map(score_sentence, search.objectives)


def _answer(found: Found, truth: Truth | None, front: Front | None) -> Iterator[str]:
    search = found.search
    if truth is not None:
        yield best_sentence(found.values, truth, search.objectives[0].unit)
        yield from beaten(search, truth)
    elif front is not None:
        yield f"{count(len(front.members), 'candidate')} on the Pareto front of {listed(front.names)}."
        if not front_warning(front):
            yield front.words
    elif found.front:
        yield f"Candidates on the front: {len(found.front)}. Next: front_of(found)."
    else:
        unit = search.objectives[0].unit
        yield (
            f"Best: {values_text(found.values)}. Believed score: {number(found.believed)} {unit}".rstrip()
            + "."
        )


def _scenarios_shown(found: Found, truth: Truth | None) -> Iterator[Scenario]:
    others = () if truth is None else truth.others
    shown = [
        found.values,
        *(found.archive[key].values for key in found.front),
        *(other.values for other in others),
    ]
    for case in found.search.cases:
        yield from (case.scenario.with_values(values) for values in shown)


def _what_was_searched(found: Found) -> str:
    search = found.search
    cases = f", each in {len(search.cases)} cases" if len(search.cases) > 1 else ""
    return (
        f"`{search.settings.method_name}` over {count(search.space.size, 'field')}, for the lowest {aims(search)}: "
        f"{count(len(found.archive), 'candidate')} in {count(found.runs, 'run')}{cases}; {failures_in(found.archive)}."
    )


def _truth_sections(found: Found, truth: Truth | None) -> Iterator[Section]:
    """Yield the scores of the winner, and its comparison with the starts and other values if there are any."""
    if truth is None:
        return
    search = found.search
    cases = [cell.name for cell in search.cases]
    yield truth_section(truth, found.archive[found.best].count, cases, search.objectives[0].unit)
    if truth.others:
        others = against(truth, other_names(search, truth), search.objectives[0].unit)
        yield Section("Against the start", (others,))


def truth_section(truth: Truth, believed_runs: int, cases: Sequence[str], unit: str) -> Section:
    """Return the section with the believed and the true score.

    Args:
        believed_runs: number of runs of the believed score. cases: names of the cases. unit: of the score.
    """
    words = [Text(truth.words)] if truth.luck == "not significant" else []  # otherwise they are a warning
    tables = truth_tables(truth, believed_runs, cases, unit)
    return Section("Believed and true", (*words, *tables, Text(QUOTE, "aside")))


def _values_section(found: Found, truth: Truth | None) -> Section:
    search = found.search
    named = [] if truth is None else zip(other_names(search, truth), truth.others, strict=True)
    return Section(
        "The winner's values", (value_table(search, found.values, {name: one.values for name, one in named}),)
    )


def _front_section(found: Found, front: Front) -> Section:
    """Return the section with the Pareto front: believed and true scores, and a figure of two objectives."""
    first = called(found.search.objectives[0])
    words = (
        f"`best.toml` is the best candidate of the search by {first} alone. To run another one, set its values: "
        "`vibroswarm run --scenario best.toml --set FIELD=VALUE`, in the folder of the search."
    )
    parts: list[Part] = [front_table(front, found.search.space.names), Text(words, "aside")]
    if len(front.names) == 2:
        more = f" From {count(front.runs, 'fresh run')} of each candidate."
        draw = captioned(lambda style: _draw_front(front, style), more)
        parts.append(Figure("true-front", draw, "The front on fresh runs"))
    return Section("The front", tuple(parts))


def _history_section(found: Found, truth: Truth | None) -> Section:
    """Return the section with the figures and the table of the iterations, and the best candidates.

    With several objectives the best candidates are left out, since they are those of the front. There are no figures if
    the space has more fields than a figure can distinguish.
    """
    figures: list[Figure] = []
    if found.history and found.search.space.size <= SERIES_UP_TO:
        race = " before the race" if found.race else ""
        more = f" From the {count(found.history[-1].runs, 'run')} of the search{race}."
        line = f" The line across: {count(truth.winner.score.n, 'fresh run')}." if truth else ""
        scores = captioned(lambda style: _draw_scores(found, truth, style), more + line)
        parameters = captioned(lambda style: _draw_parameters(found, style), more)
        figures = [
            Figure("scores", scores, "How the scores fell", on_page="column"),
            Figure("parameters", parameters, "Where in their bounds the candidates lay", on_page="column"),
        ]
    title = f"The best {min(BEST, len(found.archive))} candidates"
    best = (best_table(found),) if len(found.search.objectives) == 1 else ()
    tables = (
        Section(title, best, folded=True),
        Section("Iteration by iteration", (history_of(found),), folded=True),
    )
    return Section("How the search went", (*figures, *tables), side_by_side=True)


def file_section(text: str, name: str) -> Section:
    """Return the section with the file of a search or grid; it is empty if there is no text."""
    return Section(f"The file {name}", (Text(text, "code"),), folded=True)


def captioned(draw: Any, more: str) -> Any:
    """Return a function that draws a picture and adds to its caption from which runs it is."""

    def drawn(style: str) -> Picture:
        picture: Picture = draw(style)
        return replace(picture, caption=f"{picture.caption}{more}")

    return drawn


def _draw_scores(found: Found, truth: Truth | None, style: str) -> Picture:
    """Draw best and mean score of each iteration, the personal bests of a swarm, and the true score as a line."""
    objective, history = found.search.objectives[0], found.history
    scores = pl.DataFrame(
        [(one.number, plain(one.best), plain(one.mean)) for one in history],
        schema={"iteration": pl.Int64, "best": pl.Float64, "mean": pl.Float64},
        orient="row",
    )
    rows = [(one.number, k, plain(score)) for one in history for k, score in enumerate(one.personal)]
    personal = pl.DataFrame(rows, schema=["iteration", "particle", "score"], orient="row") if rows else None
    true = None if truth is None else truth.winner.score.estimate
    return draw_search(scores, personal, label=score_label(objective), true=true, style=style)


def _draw_parameters(found: Found, style: str) -> Picture:
    shares = [
        (iteration.number, name, share)
        for iteration in found.history
        for name, share in zip(found.search.space.names, iteration.mean_point, strict=True)
    ]
    return draw_parameters(
        pl.DataFrame(shares, schema=["iteration", "series", "share"], orient="row"), style=style
    )


def _draw_front(front: Front, style: str) -> Picture:
    """Draw the scores on fresh runs of a front of two objectives; ``draw_front`` calls them time and error."""
    rows = [
        {
            "name": ", ".join(setting_words(name, value) for name, value in member.values.items()),
            **columns_of("time", first), **columns_of("error", second), "front": member.stays,
        }
        for member in front.members
        for first, second in [member.true]  # the scores under both objectives
    ]  # fmt: skip
    first_label, second_label = (
        f"{name} ({unit})" if unit else name for name, unit in zip(front.names, front.units, strict=True)
    )
    return draw_front(frame_of(rows), time_label=first_label, error_label=second_label, style=style)


def _made_by(search: Search, made_by: Sequence[Mapping[str, str]]) -> dict[str, str]:
    # A start is the name of a preset, or a table of values.
    presets = [start for start in search.to_values()["start"] if isinstance(start, str)]
    file = "search.toml" if file_text(search) else ""
    return {
        "search": search.hash,
        "seed": str(search.seed),
        "method": search.settings.method_name,
        "objective": aims(search),
        "engine": search.study.motion,
        **versions_in_words(made_by),
        **commands(file, presets[0] if presets else "paper"),
    }


def commands(file: str, against: str) -> dict[str, str]:
    """Return the commands that run ``best.toml``, compare it with a preset on other runs, and repeat the search.

    Args:
        file: the file of the search; if it is empty, only the first command is returned: the others need it.
        against: the preset.
    """
    run = {"one run of the best, in this folder": "vibroswarm run --scenario best.toml"}
    check = f"vibroswarm evaluate best.toml {against}"
    more = {
        "compared with a preset, run by run": check,
        "to repeat, in this folder": f"vibroswarm optimize {file} --out .",
    }
    return run | (more if file else {})


def search_state_document(about: dict[str, Any], *, is_validated: bool) -> Document:
    """Return the state of a search's folder.

    Args:
        about: the content of the folder, as ``steps.held`` returns it. is_validated: whether the folder has results.
    """
    done, wanted = count_of(about["runs_there"], about["runs_wanted"], "run"), count(about["steps"], "step")
    resume = "Not validated on fresh runs yet; run the same optimize command to resume."
    return Document(
        title="Search",
        answer=(
            f"Search in {about['folder']}: {about['method']}, {listed(about['objectives'])}, seed {about['seed']}.",
            f"Done: {done}, in {wanted}; {whole(about['runs_failed'])} failed.",
            f"Fields: {', '.join(about['fields'])}.",
            "" if is_validated else resume,
        ),
    )


def sensitivity_document(found: Sensitivity) -> Document:
    """Return the document of the Sobol indices of the fields of a search."""
    frame = pl.DataFrame([vars(index) for index in found.fields])
    columns = {
        "name": Column("field"),
        "total": Column("with interactions", decimals=2),
        "first": Column("alone", decimals=2),
    }
    caption = "Shares of the variance of the mean cost over the space (Sobol indices), with 95 % bootstrap intervals."
    shown = frame.select("name", "total", "total_low", "total_high", "first", "first_low", "first_high")
    made = pl.DataFrame({
        "points": [found.points], "replicates": [found.replicates], "runs": [found.runs],
        "noise_share": [found.noise_share],
    })  # fmt: skip
    words = (
        f"{count(found.runs, 'run')} at {count(found.points, 'point')}, {found.replicates} each; "
        f"none failed. Noise of the runs, {percent(found.noise_share, 0)} of the variance of the "
        "points' mean costs, is removed."
    )
    return Document(
        title="Sensitivity",
        answer=tuple(_effects(found)),
        parts=(Table(shown, columns, caption, "fields"), Text(words, "aside")),
        data={"fields": frame, "design": made},
    )


def _effects(found: Sensitivity) -> Iterator[str]:
    """Name the field that matters most, and those without significant effect."""
    most = found.fields[0]
    if math.isnan(most.total):
        yield "No effect can be estimated: the noise of the runs is as large as all effects, or the cost does not vary."
        return
    if most.total_low > 0:
        share = with_limits(Estimate(most.total, most.total_low, most.total_high), decimals=2)
        yield f"Largest effect on the cost: {most.name}, {share} of the variance with its interactions."
    # `not ... > 0` also holds for nan, which the limits are if the noise of the runs hides all effects.
    if without_effect := [index.name for index in found.fields if not index.total_low > 0]:
        yield (
            f"No significant effect: {', '.join(without_effect)}. Four times the --budget makes intervals half as wide."
        )
