"""Build the tables of a search's page, and the phrases that the page and the terminal share.

Functions whose names end in ``_said`` or ``_words`` return a value as text. Believed scores are those by which a search
chose its winner; true scores are those on fresh runs, which played no part in the choice (see ``validation``).

Functions whose names end in ``_table`` return a table of the page. Its columns are described by ``Column``: heading,
unit, number of digits, and ``tones``, the colours of cells by the beginning of their text.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import polars as pl

from vibroswarm.analysis.intervals import Interval, plain
from vibroswarm.optimize.archive import Archive, Candidate
from vibroswarm.optimize.loop import Found
from vibroswarm.optimize.space import Dimension
from vibroswarm.optimize.spec import Search
from vibroswarm.optimize.validation import Scored, Truth
from vibroswarm.plots.labels import label_of
from vibroswarm.plots.layout import number
from vibroswarm.report.html import Column, ReportTable

REASONS: Final = 3
"""Number of reasons that are shown; ``result.json`` has more."""
GRID_LUCK: Final = "not significantly different from it. Which of them is lowest is luck."
"""Completes a sentence about the other cells of a grid."""


def failures_said(failed: int, *, dropped: bool = False) -> str:
    """Write how many runs of a search failed, and what that means for the candidates of these runs.

    Args:
        failed: number of failed runs. dropped: whether failed runs are left out of the scores, as in the paper's
            program.
    """
    if not failed:
        return "none failed"
    if dropped:
        return (
            f"{failed:,} runs FAILED and are dropped: scores are of the other runs, as in the paper's program"
        )
    return f"{failed:,} runs FAILED; a candidate with a failed run cannot win"


def failures_in(archive: Archive) -> str:
    """Write how many runs of the candidates in ``archive`` failed, and what that means for them."""
    return failures_said(archive.failed, dropped=archive.drops_failed)


def fresh_failures_said(scored: Scored) -> str:
    """Write how many fresh runs of one set of values failed; empty if none did."""
    if not scored.failed:
        return ""
    return f"{scored.failed:,} fresh runs of the {scored.name} FAILED and are in no figure"


def reasons(archive: Archive) -> list[str]:
    """List distinct reasons why runs failed in alphabetical order, at most ``REASONS``."""
    return sorted({c.why for c in archive.candidates if c.why})[:REASONS]


def value_said(value: Any) -> str:
    """Write a value of a field as text: a float with up to six significant digits, any other value in full."""
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def values_said(values: dict[str, Any]) -> str:
    """Write values by the last parts of their fields' names: ``eta 1500, kappa 2``."""
    return ", ".join(f"{name.rpartition('.')[2]} {value_said(value)}" for name, value in values.items())


def winner_words(values: Mapping[str, Any]) -> str:
    """Write a winner's values in words, such as ``sample interval τ 4750 ms``.

    ``values`` are given by the full names of the fields. A float has up to four significant digits, or all digits
    before the point; the file ``best.toml`` has all.
    """
    phrases = []
    for name, value in values.items():
        label, text = label_of(name), number(value, 4) if isinstance(value, float) else str(value)
        phrases.append(" ".join(part for part in (label.words, label.symbol, text, label.unit) if part))
    return ", ".join(phrases)


def short_names(names: Sequence[str]) -> dict[str, str]:
    """Map full names of fields to their last parts; a name whose last part occurs twice keeps its full form."""
    last = [name.rpartition(".")[2] for name in names]
    return {name: end if last.count(end) == 1 else name for name, end in zip(names, last, strict=True)}


def interval_said(value: Interval, *, sign: bool = False) -> str:
    """Write an interval as ``16.9 [14.6, 19.3]``, or as ``-`` if the estimate is nan.

    With ``sign``, numbers above 0 get a plus, as is usual for differences.
    """
    if math.isnan(value.estimate):
        return "-"
    plus = "+" if sign else ""
    return f"{value.estimate:{plus}.4g} [{value.low:{plus}.4g}, {value.high:{plus}.4g}]"


BEST: Final = 20
"""Number of candidates in the table of the best."""
EDGE: Final = 0.01
"""A value closer to a bound than this fraction of the range lies at it."""
LUCK_TONES: Final = {
    "not significant": "good", "lucky": "bad", "unlucky": "fair", "inconclusive": "open", "not defined": "open",
    "too short": "open",
}  # fmt: skip
"""Colours of the column "luck of the choice", by its text; see ``Truth.luck``."""
STANDING_TONES: Final = {"better": "good", "worse": "bad", "not significant": "open", "the same": "open"}
"""Colours of the column "the winner is", by its text; see ``standing``."""
LIMIT_TONES: Final = {"within": "good", "beyond": "bad", "not significantly": "open"}
"""Colours of the column "against its limit", by the beginning of its text."""
PARTS: Final = {
    "decision_time_s": ("decision time, s", False),
    "robot_error": ("wrong of those who decide, %", True),
    "robots_undecided": ("undecided, %", True),
}
"""Of each part of ``time_at_error``: its title, and whether it is shown in percent."""


def believed_and_true(truth: Truth, believed_runs: int, unit: str) -> ReportTable:
    """Tabulate the score that the search believed, the true score, and the difference true - believed.

    ``believed_runs`` is the number of runs of the believed score. The difference has the interval of the true score,
    shifted by the believed score, which is taken as exact.
    """
    score, believed = truth.winner.score, truth.believed
    rows = [
        {"what": "believed by the search", "score": plain(believed), "low": None, "high": None,
         "runs": believed_runs, "luck": None},
        {"what": "true, on fresh runs", **_limits(score), "runs": score.n, "luck": None},
        {"what": "the difference", "score": plain(score.estimate - believed), "low": plain(score.low - believed),
         "high": plain(score.high - believed), "runs": None, "luck": truth.luck},
    ]  # fmt: skip
    columns = {
        "what": Column("of the winner"), "score": Column("score", unit, digits=4, limits=("low", "high")),
        "luck": Column("luck of the choice", tones=LUCK_TONES),
    }  # fmt: skip
    return ReportTable(
        _frame(rows), columns, caption="With 95 % intervals; the unit is the run.", name="truth"
    )


def case_table(scored: Scored, names: Sequence[str], unit: str) -> ReportTable | None:
    """Tabulate the winner's score in each case; return None if there is one case only.

    ``names`` are those of the cases, in the order of ``scored.cases``.
    """
    if not scored.cases:
        return None
    rows = [{"case": name, **_limits(case)} for name, case in zip(names, scored.cases, strict=True)]
    columns = {
        "score": Column("score", unit, digits=4, limits=("low", "high")),
    }
    return ReportTable(
        _frame(rows), columns, caption="The winner in each case by itself, on fresh runs.", name="cases"
    )


def part_table(scored: Scored) -> ReportTable | None:
    """Tabulate the parts of a score of ``time_at_error``, each with its interval and compared with its limit.

    Shares are shown in percent. For other costs the result is None.
    """
    if scored.parts is None:
        return None
    rows = []
    for name, value in scored.parts.items():
        words, in_percent = PARTS[name]
        factor = 100.0 if in_percent else 1.0
        rows.append({"part": words, "value": plain(factor * value.estimate), "low": plain(factor * value.low),
                     "high": plain(factor * value.high), "says": scored.near.get(name)})  # fmt: skip
    columns = {
        "value": Column(limits=("low", "high")),
        "says": Column("against its limit", prose=True, tones=LIMIT_TONES),
    }  # fmt: skip
    worst = " Each in the case where it is worst." if scored.cases else ""
    return ReportTable(
        _frame(rows), columns, caption=f"What the winner's score is made of.{worst}", name="parts"
    )


def standing(truth: Truth, place: int) -> str:
    """Compare the winner, run by run, with the start or other candidate at index ``place`` of ``truth.others``.

    Returns:
        "better" if the winner costs significantly less, "worse" if it costs significantly more, else
        "not significant"; "the same" if both have the same values.
    """
    other, paired = truth.others[place], truth.against[place]
    if other.values == truth.winner.values:
        return "the same"
    return "better" if paired.high < 0 else "worse" if paired.low > 0 else "not significant"


def other_names(search: Search, truth: Truth) -> list[str]:
    """Return the names of ``truth.others``, in the same order: first the starts, then other requested values.

    The name of a start that is a preset has the preset in brackets.
    """
    starts = search.to_values()["start"]  # each is the name of a preset, or a table of values
    return [
        f"{other.name} ({starts[k]})" if k < len(starts) and isinstance(starts[k], str) else other.name
        for k, other in enumerate(truth.others)
    ]


def against_table(search: Search, truth: Truth) -> ReportTable:
    """Tabulate the starts and other candidates of ``truth.others``: the score of each, and winner - candidate."""
    unit = search.objectives[0].unit
    rows = [
        {
            "other": name, **_limits(other.score), "less": plain(paired.estimate), "less_low": plain(paired.low),
            "less_high": plain(paired.high), "pairs": paired.n, "standing": standing(truth, k),
        }
        for k, (name, other, paired) in enumerate(
            zip(other_names(search, truth), truth.others, truth.against, strict=True)
        )
    ]  # fmt: skip
    columns = {
        "other": Column("against"), "score": Column("its score", unit, digits=4, limits=("low", "high")),
        "less": Column("winner - this", unit, digits=4, limits=("less_low", "less_high")),
        "standing": Column("the winner is", tones=STANDING_TONES),
    }  # fmt: skip
    caption = (
        "On the same fresh runs, in pairs: below 0 the winner costs less. Intervals by bootstrap over runs."
    )
    return ReportTable(_frame(rows), columns, caption=caption, name="against")


def place_of(dimension: Dimension, value: Any) -> float:
    """Return the position of a number between its bounds, on the scale of the field, as a fraction from 0 to 1.

    A value that rounding put beyond a bound, which ``Dimension.share`` would refuse, counts as lying at the bound. The
    dimension must be a range, not a list of choices.
    """
    return dimension.share(min(max(value, dimension.low), dimension.high))


def bound_of(dimension: Dimension, value: Any) -> str:
    """Return "lower" or "upper" if a value lies at that bound of its field, else an empty text."""
    if dimension.choices:  # a list of values has no bounds
        return ""
    share = place_of(dimension, value)
    return "lower" if share <= EDGE else "upper" if share >= 1.0 - EDGE else ""


def value_table(
    search: Search, values: Mapping[str, Any], others: Mapping[str, Mapping[str, Any]]
) -> ReportTable:
    """Tabulate the winner's values beside those of other candidates, with one row per field.

    The table also shows where the winner's value lies between the bounds of the field. A column of notes marks values
    at a bound and lists choices; it is left out if it is empty.

    Args:
        search: defines the fields. values: of the winner, by field. others: for the name of each other candidate its
            values by field.
    """
    rows: list[dict[str, Any]] = []
    # A column of a table has one type. If some field has choices, which may be texts, all values are written as text.
    plain_numbers = not any(d.choices for d in search.space)
    for d in search.space:
        by_candidate = {"winner": values[d.name]} | {
            f"other {k}": other.get(d.name) for k, other in enumerate(others.values())
        }
        row: dict[str, Any] = {"field": d.name}
        row |= {k: _shown(v, plain_numbers) for k, v in by_candidate.items()}
        row |= {"low": None if d.choices else d.low, "high": None if d.choices else d.high}
        row["place"] = None if d.choices else place_of(d, values[d.name])
        which = bound_of(d, values[d.name])  # "lower", "upper", or empty
        if which:
            row["note"] = f"at the {which} bound"
        else:
            row["note"] = f"of {', '.join(map(str, d.choices))}" if d.choices else None
        rows.append(row)
    columns = {
        "low": Column("lower bound", digits=6), "high": Column("upper bound", digits=6),
        "place": Column("place between them", percent=True), "note": Column("", tones={"at the": "fair"}),
    }  # fmt: skip
    columns["winner"] = Column(digits=6)
    columns |= {f"other {k}": Column(name, digits=6) for k, name in enumerate(others)}
    frame = _frame(rows)
    frame = frame.drop("note") if frame["note"].null_count() == frame.height else frame
    return ReportTable(frame, columns, caption="Units are those in the names of the fields.", name="values")


def best_table(found: Found) -> ReportTable:
    """Tabulate the best candidates, at most ``BEST``: first those of the race, then those of the search before it.

    Candidates of the race are sorted by their estimate, since the runs of the race played no part in choosing them. The
    other candidates are sorted by estimate plus standard error, as a candidate with few runs may only look good.
    """
    archive, short = found.archive, short_names(found.search.space.names)
    order = archive.in_order()  # by estimate plus standard error
    of_race = sorted(
        (k for k in order if _stage(archive[k]) == "race"), key=lambda k: (archive.estimate(k)[0], k)
    )
    rows = []
    for key in [*of_race, *(k for k in order if _stage(archive[k]) == "search")][:BEST]:
        c = archive[key]
        estimate, error = archive.estimate(key)
        rows.append({
            "key": str(key), "origin": f"{c.origin}, the winner" if key == found.best else c.origin,
            "score": plain(estimate), "error": plain(error), "runs": c.count, "failed": c.failed, **c.values,
        })  # fmt: skip
    columns = {
        "key": Column("candidate"), "origin": Column("made by"), "error": Column("standard error"),
        "score": Column("score in the search", found.search.objectives[0].unit, digits=4),
    } | {name: Column(end, digits=5) for name, end in short.items()}  # fmt: skip
    caption = "By score plus its standard error; candidates were selected by it, so they were partly lucky."
    if of_race:
        caption = (
            "First the finalists of the race, by score on runs that played no part in choosing them. Then the best of "
            "the search by score plus its standard error; they were selected by it, so they were partly lucky."
        )
    caption += f" {len(rows)} of {len(archive)} candidates; all are in `candidates.csv`."
    return ReportTable(_frame(rows), columns, caption=caption, name="best-candidates")


def history_of(found: Found) -> ReportTable:
    """Tabulate the iterations of search and race: runs, scores, and the mean of each field over the candidates.

    The means are fractions of the bounds of the fields. In a race they are those of the best candidate.
    """
    rows = []
    names = found.search.space.names
    for stage, history in (("search", found.history), ("race", found.race)):
        for iteration in history:
            row: dict[str, Any] = {"stage": stage, "iteration": iteration.number, "runs": iteration.runs}
            row |= {"best": plain(iteration.best), "mean": plain(iteration.mean)}
            rows.append(row | dict(zip(names, iteration.mean_point, strict=True)))
    short = short_names(found.search.space.names)
    columns = {"runs": Column("runs so far"), "best": Column(digits=4), "mean": Column(digits=4)}
    columns |= {name: Column(end, percent=True) for name, end in short.items()}
    caption = (
        "Scores as the search believed them, and the mean of each field over the candidates of an iteration, in its "
        "bounds (of the race: of the best). More is in `history.csv`."
    )
    return ReportTable(_frame(rows), columns, caption=caption, name="history")


def account(found: Found, fresh: Sequence[tuple[str, int, int, int]]) -> ReportTable:
    """Tabulate by stage (search, race, fresh runs) how many runs were requested, were made, and failed.

    Of search and race, the requested runs are the budget, which may not be used up; a stage with neither budget nor
    candidates is left out. ``fresh`` has an entry for each set of fresh runs: (name, number of candidates, succeeded
    runs, failed runs).
    """
    search = found.search
    budgets = {"search": search.search_runs, "race": search.final_runs}
    rows: list[dict[str, Any]] = []
    for stage, budget in budgets.items():
        in_stage = [c for c in found.archive.candidates if _stage(c) == stage]
        if in_stage or budget:
            runs, failed = sum(c.count for c in in_stage), sum(c.failed for c in in_stage)
            rows.append({"stage": stage, "candidates": len(in_stage), "wanted": budget,
                         "runs": runs, "failed": failed})  # fmt: skip
    for name, candidates, succeeded, failed in fresh:
        runs = succeeded + failed
        rows.append({"stage": f"fresh runs of the {name}", "candidates": candidates, "wanted": runs,
                     "runs": runs, "failed": failed})  # fmt: skip
    columns = {
        "wanted": Column("runs asked for"),
        "runs": Column("runs made"),
        "failed": Column("of which failed"),
    }
    return ReportTable(_frame(rows), columns, name="runs")


def failure_table(archive: Archive) -> ReportTable | None:
    """Tabulate the causes of failed runs, the cause that affected most candidates first; None if no run failed.

    All failed runs of a candidate are counted under the cause of its first failure, since only that one is saved.
    """
    by_cause: dict[str, list[Candidate]] = {}
    for c in archive.candidates:
        if c.failed:
            by_cause.setdefault(c.why or "not known", []).append(c)
    if not by_cause:
        return None
    rows = [
        {
            "why": cause,
            "runs": sum(c.failed for c in candidates),
            "candidates": len(candidates),
            "the first": candidates[0].origin,
        }
        for cause, candidates in sorted(by_cause.items(), key=lambda item: (-len(item[1]), item[0]))
    ]
    result = "their scores are of the other runs" if archive.drops_failed else "none of them could win"
    caption = f"Why runs failed, by the first reason of each candidate; {result}."
    return ReportTable(_frame(rows), {"why": Column(prose=True)}, caption=caption, name="failures")


def _shown(value: Any, as_number: bool) -> float | str | None:
    """Return a value for a table: as a number if ``as_number``, else as text; None stays None."""
    if value is None:
        return None
    return float(value) if as_number else value_said(value)


def _stage(candidate: Candidate) -> str:
    """Return the stage in which a candidate ran, "race" or "search".

    Candidates that were added for the race have the origin "finalist KEY", "surface" or "start". Starts that the method
    itself proposes have the origin of the method, such as "pso 1".
    """
    of_race = candidate.origin in ("surface", "start") or candidate.origin.startswith("finalist ")
    return "race" if of_race else "search"


def _limits(value: Interval) -> dict[str, float | None]:
    """Return the columns ``score``, ``low`` and ``high`` of an interval; None where it is not finite."""
    return {"score": plain(value.estimate), "low": plain(value.low), "high": plain(value.high)}


def _frame(rows: Sequence[Mapping[str, Any]]) -> pl.DataFrame:
    """Make a table of rows; a column with only missing values gets the type of numbers, which a report can format."""
    frame = pl.DataFrame(rows, infer_schema_length=None)
    empty = [name for name, kind in frame.schema.items() if kind == pl.Null]
    return frame.with_columns(pl.col(name).cast(pl.Float64) for name in empty)
