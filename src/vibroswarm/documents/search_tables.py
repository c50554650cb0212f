"""Tables of a search: scores on fresh runs, values, candidates, iterations and runs.

The believed score of a candidate is the one by which the search chose it; the true score is that on fresh runs, which
played no part in the choice (``search.validation``).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import polars as pl

from vibroswarm.core.numbers import Estimate, count, decimals_of
from vibroswarm.documents.search_words import (
    bound_of,
    labels_of,
    place_of,
    standing,
    value_text,
)
from vibroswarm.search.archive import Archive, Candidate
from vibroswarm.search.loop import Found
from vibroswarm.search.spec import Search
from vibroswarm.search.validation import Front, Scored, Truth
from vibroswarm.show.document import Column, Table, Tone
from vibroswarm.statistics.intervals import columns_of, plain

BEST: Final = 20
"""Number of candidates in the table of the best."""
LUCK_TONES: Final[dict[str, Tone]] = {
    "not significant": "good", "lucky": "bad", "unlucky": "fair", "inconclusive": "open", "not defined": "open",
    "too short": "open",
}  # fmt: skip
"""Tones of ``Truth.luck``."""
STANDING_TONES: Final[dict[str, Tone]] = {
    "better": "good",
    "worse": "bad",
    "not significant": "open",
    "the same": "open",
}
"""Tones of ``search_words.standing``."""
LIMIT_TONES: Final[dict[str, Tone]] = {"within": "good", "beyond": "bad", "not significantly": "open"}
"""Tones of comparisons with a limit, by the beginning of their text."""
PARTS: Final = {
    "decision_time_s": ("decision time, s", 1.0),
    "robot_error": ("wrong of those who decide, %", 100.0),
    "robots_undecided": ("undecided, %", 100.0),
}
"""Title and factor of each part of ``time_at_error``."""


def truth_tables(truth: Truth, believed_runs: int, cases: Sequence[str], unit: str) -> tuple[Table, ...]:
    """Tabulate the believed score, the true score and their difference, and what the true score consists of.

    Args:
        believed_runs: number of runs of the believed score. cases: names of the cases. unit: of the score.
    """
    return (_believed_and_true(truth, believed_runs, unit), *parts_of((truth.winner,), cases, unit))


def _believed_and_true(truth: Truth, believed_runs: int, unit: str) -> Table:
    """Tabulate the believed score, the true score, and the difference true - believed.

    The difference has the interval of the true score, shifted by the believed score, which is taken as exact.
    """
    score, believed = truth.winner.score, truth.believed
    shifted = Estimate(*(value - believed for value in score[:3]))
    rows = [
        {"what": "during the search (believed)", "score": plain(believed), "runs": believed_runs},
        {"what": "on fresh runs (true)", **columns_of("score", score), "runs": score.n},
        {
            "what": "difference",
            **columns_of("score", shifted),
            "share": plain(truth.difference),
            "luck": truth.luck,
        },
    ]
    columns = {
        "what": Column("score of the winner"),
        "score": Column("score", unit),
        "share": Column("of the true score", share=True, sign=True),
        "luck": Column("luck in the search", tones=LUCK_TONES),
    }
    frame = frame_of(rows, ("what", "score", "score_low", "score_high", "share", "runs", "luck"))
    caption = (
        "With 95 % intervals; the unit is the run. The difference takes the believed score as exact: luck may be "
        "selection bias or the error of that score."
    )
    return Table(frame, columns, caption, "truth")


def parts_of(scored: Sequence[Scored], cases: Sequence[str], unit: str) -> tuple[Table, ...]:
    """Tabulate the scores of sets of values in each case, and the parts of scores of ``time_at_error``.

    Args:
        cases: names of the cases. unit: of the scores.
    """
    in_cases = [
        {"name": one.name, "case": name, **columns_of("score", case)}
        for one in scored
        if one.cases
        for name, case in zip(cases, one.cases, strict=True)
    ]
    parts = [
        {
            "name": one.name,
            "part": title,
            **columns_of("value", Estimate(*(factor * value for value in part[:3]))),
            "against limit": one.near.get(name),
        }
        for one in scored
        for name, part in (one.parts or {}).items()
        for title, factor in [PARTS[name]]
    ]
    return (
        *([_case_table(in_cases, unit)] if in_cases else []),
        *([_part_table(parts, bool(in_cases))] if parts else []),
    )


def _case_table(rows: list[dict[str, Any]], unit: str) -> Table:
    columns = {
        "name": Column("score of"),
        "score": Column("score", unit),
    }
    return Table(frame_of(rows), columns, "In each case by itself, on fresh runs.", "cases", 2, folded=True)


def _part_table(rows: list[dict[str, Any]], in_cases: bool) -> Table:
    columns = {
        "name": Column("score of"),
        "value": Column(decimals=1),
        "against limit": Column(prose=True, tones=LIMIT_TONES),
    }
    worst = " Each in the case where it is worst." if in_cases else ""
    return Table(frame_of(rows), columns, f"What the score is made of.{worst}", "parts", names=2)


def against(truth: Truth, names: Sequence[str], unit: str) -> Table:
    """Tabulate the scores of ``truth.others`` (starts and other candidates) by their names, and winner - candidate."""
    rows = [
        {
            "other": name,
            **columns_of("score", other.score),
            **columns_of("difference", paired),
            "pairs": paired.n,
            "failed": other.failed,
            "standing": standing(truth, k),
        }
        for k, (name, other, paired) in enumerate(zip(names, truth.others, truth.against, strict=True))
    ]
    columns = {
        "other": Column("against"),
        "score": Column("its score", unit),
        "difference": Column("winner - this", unit, sign=True, strip=True),
        "failed": Column("failed runs", wide=True),
        "standing": Column("the winner is", tones=STANDING_TONES),
    }
    words = (
        "On the same fresh runs, in pairs: below 0 the winner costs less. Intervals by bootstrap over runs."
    )
    return Table(frame_of(rows), columns, words, "against")


def value_table(search: Search, values: Mapping[str, Any], others: Mapping[str, Mapping[str, Any]]) -> Table:
    """Tabulate the winner's values beside those of other candidates, with one row per field.

    The table also shows where the winner's value lies between the bounds of the field. A column of notes marks values
    at a bound and lists choices; it is left out if it is empty.

    Args:
        values: of the winner, by field. others: for the name of each other candidate its values by field.
    """
    rows: list[dict[str, Any]] = []
    # A column of a table has one type. If some field has choices, which may be texts, all values are written as text.
    write = value_text if any(d.choices for d in search.space) else float
    for d in search.space:
        others_here = {f"other {k}": other.get(d.name) for k, other in enumerate(others.values())}
        which = bound_of(d, values[d.name])
        choices = f"of {', '.join(map(str, d.choices))}" if d.choices else None
        rows.append({
            "field": d.name,
            "winner": write(values[d.name]),
            **{name: None if value is None else write(value) for name, value in others_here.items()},
            "low": None if d.choices else d.low,
            "high": None if d.choices else d.high,
            "place": None if d.choices else place_of(d, values[d.name]),
            "note": f"at the {which} bound" if which else choices,
        })  # fmt: skip
    columns = {f"other {k}": Column(name, mixed=True) for k, name in enumerate(others)}
    columns |= {
        "winner": Column(mixed=True),
        "low": Column("lower bound", mixed=True),
        "high": Column("upper bound", mixed=True),
        "place": Column("place between them", share=True, wide=True),
        "note": Column(tones={"at the": "fair"}),
    }
    frame = frame_of(rows)
    frame = frame.drop("note") if frame["note"].null_count() == frame.height else frame
    return Table(frame, columns, "Units are those in the names of the fields.", "values", folded=True)


def front_table(front: Front, names: Sequence[str]) -> Table:
    """Tabulate the candidates of a Pareto front: values of fields, believed and true scores.

    Args:
        names: of the fields.
    """
    frame = front.table.with_columns(
        stays=pl.Series(["stays" if member.stays else "beaten" for member in front.members])
    )
    columns = {name: Column(label.named, label.unit) for name, label in labels_of(names).items()}
    columns["stays"] = Column("on fresh runs", tones={"stays": "good", "beaten": "bad"})
    columns["failed"] = Column("failed runs", wide=True)
    columns["fresh runs"] = Column(wide=True)
    ordered = ["stays"]
    for name, unit in zip(front.names, front.units, strict=True):
        decimals = decimals_of(frame[f"{name}, believed"], 4)
        columns[f"{name}, believed"] = Column(f"{name}: believed", unit, decimals=decimals)
        ends = (f"{name}, true low", f"{name}, true high")
        columns[f"{name}, true"] = Column("true", unit, decimals=decimals, limits=ends)
        ordered += [f"{name}, {kind}" for kind in ("believed", "true", "true low", "true high")]
    caption = (
        f"Candidates on the Pareto front of the search, scored again on {count(front.runs, 'fresh run')} each; "
        "`stays`: still on the front there. Intervals of 95 %."
    )
    return Table(
        frame.select(*names, *ordered, "fresh runs", "failed"), columns, caption, "front", names=len(names)
    )


def best_table(found: Found) -> Table:
    """Tabulate the best candidates, at most ``BEST``: first those of the race, then those of the search before it.

    Candidates of the race are sorted by their estimate, since the runs of the race played no part in choosing them. The
    other candidates are sorted by estimate plus standard error, as a candidate with few runs may only look good.
    """
    archive, labels = found.archive, labels_of(found.search.space.names)
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
    scores = [row["score"] for row in rows]
    columns = {
        "key": Column("candidate"), "origin": Column("made by"), "error": Column("standard error"),
        "score": Column("score in the search", found.search.objectives[0].unit, decimals=decimals_of(scores, 4)),
    } | {name: Column(label.named, label.unit) for name, label in labels.items()}  # fmt: skip
    caption = "By score plus its standard error; candidates were selected by it, so they were partly lucky."
    if of_race:
        caption = (
            "First the finalists of the race, by score on runs that played no part in choosing them. Then the best of "
            "the search by score plus its standard error; they were selected by it, so they were partly lucky."
        )
    caption += f" {len(rows)} of {len(archive)} candidates; all are in `candidates.csv`."
    return Table(frame_of(rows), columns, caption, "best-candidates", names=2)


def history_of(found: Found) -> Table:
    """Tabulate the iterations of search and race: runs, scores, and the mean of each field over the candidates.

    The means are fractions of the bounds of the fields. In a race they are those of the best candidate.
    """
    names = found.search.space.names
    rows = [
        {
            "stage": stage, "iteration": iteration.number, "runs": iteration.runs, "best": plain(iteration.best),
            "mean": plain(iteration.mean), **dict(zip(names, iteration.mean_point, strict=True)),
        }
        for stage, history in (("search", found.history), ("race", found.race))
        for iteration in history
    ]  # fmt: skip
    columns = {"runs": Column("runs so far")}
    columns |= {name: Column(label.named, share=True) for name, label in labels_of(names).items()}
    caption = (
        "Scores during the search, and the mean of each field over the candidates of an iteration, in its bounds (of "
        "the race: of the best). More is in `history.csv`."
    )
    return Table(frame_of(rows), columns, caption, "history", names=2)


def account(found: Found, truth: Truth | None, front: Front | None) -> Table:
    """Tabulate by stage (search, race, fresh runs) how many runs were requested, were made, and failed.

    Of search and race, the requested runs are the budget, which may not be used up; a stage with neither budget nor
    candidates is left out.
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
    for scored in () if truth is None else (truth.winner, *truth.others):
        runs = scored.rows.shape[0] + scored.failed
        rows.append({"stage": f"fresh runs of the {scored.name}", "candidates": 1, "wanted": runs,
                     "runs": runs, "failed": scored.failed})  # fmt: skip
    if front is not None:
        members, failed = len(front.members), sum(member.failed for member in front.members)
        runs = front.runs * members
        rows.append({"stage": "fresh runs of the front", "candidates": members, "wanted": runs,
                     "runs": runs, "failed": failed})  # fmt: skip
    columns = {
        "wanted": Column("runs requested"),
        "runs": Column("runs made"),
        "failed": Column("of which failed"),
    }
    return Table(frame_of(rows), columns, name="runs", folded=True)


def failure_tables(archive: Archive) -> tuple[Table, ...]:
    """Tabulate the causes of failed runs, the cause that affected most candidates first; nothing if no run failed.

    All failed runs of a candidate are counted under the cause of its first failure, since only that one is saved.
    """
    by_cause: dict[str, list[Candidate]] = {}
    for c in archive.candidates:
        if c.failed:
            by_cause.setdefault(c.why or "not known", []).append(c)
    if not by_cause:
        return ()
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
    return (Table(frame_of(rows), {"why": Column(prose=True)}, caption, "failures", folded=True),)


def _stage(candidate: Candidate) -> str:
    of_race = candidate.origin in ("surface", "start") or candidate.origin.startswith("finalist ")
    return "race" if of_race else "search"


def frame_of(rows: Sequence[Mapping[str, Any]], columns: Sequence[str] = ()) -> pl.DataFrame:
    """Make a table of rows; a column with only missing values gets the type of numbers."""
    frame = pl.DataFrame(rows, infer_schema_length=None)
    frame = frame.select(columns) if columns else frame
    empty = [name for name, kind in frame.schema.items() if kind == pl.Null]
    return frame.with_columns(pl.col(name).cast(pl.Float64) for name in empty)
