"""The reports of a search (the winner or the Pareto front, and was it luck?), and of a sensitivity."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import partial
from typing import Final

import polars as pl

from vibroswarm.core.numbers import count, number
from vibroswarm.plots.picture import Picture
from vibroswarm.plots.search import draw_parameters, draw_search
from vibroswarm.report.format import Value, write_value
from vibroswarm.report.report import Figure, Report, Table, report
from vibroswarm.search.loop import Found
from vibroswarm.search.searched import Searched, candidate_table, history_table
from vibroswarm.search.sensitivity import Sensitivity
from vibroswarm.search.validation import Scored, Truth
from vibroswarm.simulation import versions
from vibroswarm.statistics.intervals import Interval, columns_of, plain

BEST: Final = 10
"""Candidates in the table of the best."""
FIELDS_UP_TO: Final = 8
"""Fields that a picture can distinguish."""
AT_A_BOUND: Final = 0.01
"""Distance from a bound, as a share of the range, at which a winner lies at it."""


@report.register
def of_search(searched: Searched) -> Report:
    """Return what a search found, and its score on fresh runs."""
    found, truth, front = searched.found, searched.truth, searched.front
    search = found.search
    aims = " and ".join(objective.words for objective in search.objectives)
    parts: dict[str, Table | Figure] = {}
    answer = [f"No candidate has a score for {aims}."]
    if truth is not None:
        answer = list(_answer(found, truth))
        parts |= _tables(found, truth)
    if front is not None:
        stay = f"{front['stays'].sum()} of {front.height}"
        answer = [f"{stay} candidates stay on the Pareto front of {aims} on fresh runs."]
        caption = "Believed scores, and those on fresh runs with 95 % limits."
        parts["front"] = Table(front, "The front", caption)
    if found.history and len(search.space.names) <= FIELDS_UP_TO:
        parts["scores"] = Figure(partial(_scores, found, truth), "How the scores fell")
        parts["parameters"] = Figure(partial(_parameters, found), "Where in their bounds the candidates lay")
    best = candidate_table(found).sort("score", nulls_last=True).head(BEST)
    parts["best_candidates"] = Table(
        best, f"The best {best.height} candidates by believed score", folded=True
    )
    parts["iterations"] = Table(history_table(found).select("stage", "iteration", "runs", "best", "mean", "best_key"),
                             "Iteration by iteration", folded=True)  # fmt: skip
    return Report(
        title=search.study.name or f"A search for the lowest {aims}",
        answer=tuple(answer),
        parts=parts,
        setting=f"{search.settings.method} over {count(len(search.space.names), 'field')}, "
        f"{count(len(found.archive), 'candidate')} in {count(found.archive.runs, 'run')}, "
        f"{count(len(search.study.cells), 'case')}",
        warnings=tuple(_warnings(found, truth)),
        made_by={
            "search": search.hash,
            "seed": str(search.study.seed),
            "engine": search.study.motion,
            **versions(),
        },
    )


def _answer(found: Found, truth: Truth) -> Iterator[str]:
    unit = found.search.objectives[0].unit
    values = ", ".join(
        f"{name.rpartition('.')[2]} {plain_text(value)}" for name, value in found.values.items()
    )
    yield f"Best: {values}; score {_written(truth.winner.score, unit)} on fresh runs."
    for other, less in zip(truth.others, truth.against, strict=True):
        if other.name == "start":
            verdict = (
                "no different from"
                if less.low <= 0 <= less.high
                else "better than"
                if less.high < 0
                else "worse than"
            )
            yield f"It is {verdict} the start: difference {_written(less, unit)}."
    bias = truth.bias
    if not math.isfinite(bias.high - bias.low):
        yield "Too few runs to tell whether the winner was lucky in the search."
    elif bias.low <= 0 <= bias.high:
        yield "No sign of selection bias: the score in the search does not differ from that on fresh runs."
    else:
        side = "low" if bias.low > 0 else "high"
        yield f"The score in the search was too {side} by {_written(bias, unit)}: quote the one on fresh runs."


def plain_text(value: object) -> str:
    """Write a value of a field."""
    return number(value, digits=4) if isinstance(value, float) else str(value)


def _written(interval: Interval, unit: str) -> str:
    return write_value(Value(*interval[:3]), unit)


def _tables(found: Found, truth: Truth) -> dict[str, Table | Figure]:
    sets = (truth.winner, *truth.others)
    rows = [_row(one, less) for one, less in zip(sets, (None, *truth.against), strict=True)]
    values = [{"parameters": one.name, **one.values} for one in sets]
    return {
        "truth": Table(
            pl.DataFrame(rows, infer_schema_length=None), "Scores on fresh runs",
            "With 95 % limits; differences: the winner minus this one, run by run.",
        ),
        "bias": Table(
            pl.DataFrame([{"believed": truth.believed, **columns_of("true", truth.winner.score),
                           **columns_of("bias", truth.bias)}]),
            "Believed and true score of the winner",
        ),
        "values": Table(pl.DataFrame(values, infer_schema_length=None), "Values"),
    }  # fmt: skip


def _row(one: Scored, less: Interval | None) -> dict[str, object]:
    row = {"parameters": one.name, **columns_of("score", one.score)}
    for name, part in one.parts.items():
        row |= columns_of(name, part)
    return (
        row
        | columns_of("difference", less or [None] * 3)
        | {"runs": one.score.n, "failed": one.figures.failed}
    )


def _warnings(found: Found, truth: Truth | None) -> Iterator[str]:
    archive = found.archive
    if archive.failed:
        why = next(one.why for one in archive.candidates if one.failed)
        left_out = "their scores are of the other runs" if archive.drops_failed else "they cannot win"
        candidates = count(sum(one.failed > 0 for one in archive.candidates), "candidate")
        yield f"{count(archive.failed, 'run')} of {candidates} failed; {left_out}. The first: {why}"
    if truth is not None:
        shares: Sequence[float] = archive[found.best].point.tolist()
        ranges = zip(found.search.space, shares, strict=True)
        at = [d.name for d, u in ranges if not d.choices and min(u, 1 - u) < AT_A_BOUND]
        if at:
            yield f"The best lies at a bound of {', '.join(at)}; a wider range may hold a better one."


def _scores(found: Found, truth: Truth | None) -> Picture:
    objective, history = found.search.objectives[0], found.history
    scores = pl.DataFrame(
        [(one.number, plain(one.best), plain(one.mean)) for one in history],
        schema={"iteration": pl.Int64, "best": pl.Float64, "mean": pl.Float64},
        orient="row",
    )
    rows = [(one.number, k, plain(score)) for one in history for k, score in enumerate(one.personal)]
    personal = pl.DataFrame(rows, schema=["iteration", "particle", "score"], orient="row") if rows else None
    label = f"{objective.words} ({objective.unit})" if objective.unit else objective.words
    true = None if truth is None else truth.winner.score.estimate
    return draw_search(scores, personal, label=label, true=true)


def _parameters(found: Found) -> Picture:
    rows = [
        (one.number, name, share)
        for one in found.history
        for name, share in zip(found.search.space.names, one.mean_point, strict=True)
    ]
    return draw_parameters(pl.DataFrame(rows, schema=["iteration", "series", "share"], orient="row"))


@report.register
def of_sensitivity(found: Sensitivity) -> Report:
    """Return which fields of a search matter."""
    table = found.table
    known = table.filter(pl.col("total").is_not_null())
    first = (
        f"{known['field'][0]} matters most"
        if known.height
        else "No effect is larger than the noise of the runs"
    )
    return Report(
        title="Sensitivity",
        answer=(
            f"{first}; noise of the runs is {100 * found.noise_share:.0f} % of the variance of the means.",
        ),
        parts={
            "sensitivity": Table(
                table,
                "Sobol indices",
                "Shares of the variance of the mean cost: with all interactions, and alone; 95 % bootstrap limits.",
                {"total": "with interactions", "first": "alone"},
            )
        },
        setting=f"{found.points} points of {found.replicates} runs",
        made_by=versions(),
    )
