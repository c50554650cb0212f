"""The document of a study: what its comparisons say, its cells, and how they came to decide.

The answer is a sentence for each pair of cells, or for each cell if none are compared. Then come the differences, the
outcome of the cells, decisions over time, comparisons, how robots sampled, and decidability.
"""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Final, NamedTuple

import polars as pl

from vibroswarm.core.numbers import count, counts, number, percent, stated, stated_percent
from vibroswarm.documents.cell_figures import MAP_CAPTION, column_of, figure_columns, with_limits_of
from vibroswarm.documents.knowledge import told, versions_in_words
from vibroswarm.documents.study_figures import (
    comparison_figures,
    front_figures,
    not_drawn,
    outcome_figures,
    sampling_figures,
    time_figures,
)
from vibroswarm.documents.study_words import (
    SHORT,
    asks_numbers,
    cell_sentence,
    lacks_truth,
    question,
    sentence,
    title_of,
    warnings_of,
)
from vibroswarm.show.document import (
    Column,
    Document,
    Part,
    Section,
    Table,
    Text,
    if_any,
    limits_of,
)
from vibroswarm.statistics.answers_over_time import JUDGED
from vibroswarm.statistics.figures import BY_COLUMN, ESTIMATES, FIGURES, RunFigure
from vibroswarm.statistics.intervals import columns_of
from vibroswarm.statistics.map_figures import MAPPED, keeps_map
from vibroswarm.statistics.paired import ESTIMATED
from vibroswarm.statistics.reports_over_time import report_heading
from vibroswarm.statistics.verdict import answers_of
from vibroswarm.study.comparison import SIGNIFICANT, Answer
from vibroswarm.study.summary import CellOutcome, Outcome

MOST_SENTENCES: Final = 12
"""Most comparisons, or cells, that are described in sentences; and most rows of differences on the first screen."""


def study_document(outcome: Outcome) -> Document:
    """Return what a study says."""
    head, compared = _differences_parts(outcome)
    tables = outcome.tables
    sections = (
        _outcome_section(outcome),
        Section("Decisions over time", tuple(time_figures(outcome)), wide=True),
        Section(
            "Compared run by run",
            (*compared, *if_any(tables.get("comparisons"), partial(_compared_parts, outcome))),
        ),
        Section("Time against error", tuple(front_figures(outcome)), wide=True),
        Section(
            "How the robots sampled",
            (_sampling_table(outcome), *sampling_figures(outcome)),
            wide=True,
        ),
        Section("Can it be decided at all", _decidability_parts(outcome), wide=True),
    )
    return Document(
        title=title_of(outcome.runs),
        answer=_answer(outcome),
        knew=told(one.cell.scenario for one in outcome.cells),
        warnings=tuple(warnings_of(outcome)),
        parts=(Text(question(outcome)), *head, *sections),
        made_by=_made_by(outcome),
        data=_tables_for_json(outcome),
    )


def _against(answer: Answer) -> str:
    """Name a comparison: ``soft against none, random:0.48``."""
    first, reference, rest = answer.pair.names
    return f"{first} against {reference}" + (f", {rest}" if rest else "")


def _answer(outcome: Outcome, most: int = MOST_SENTENCES) -> tuple[str, ...]:
    """Return sentences on the first ``most`` comparisons, or on the first cells if a study compares none.

    If comparisons or cells are left out, a last sentence states their number.
    """
    described: list[Answer | CellOutcome] = [*outcome.answers] or [*outcome.cells]
    lines = [
        cell_sentence(one) if isinstance(one, CellOutcome) else sentence(one)
        for number, one in enumerate(described)
        if number < most
    ]
    left = len(described) - min(len(described), most)
    what = "more comparison" if outcome.answers else "more cell"
    return (*lines, f"... and {count(int(left), what)}, below." if left else "")


def _differences_parts(outcome: Outcome) -> tuple[list[Part], list[Part]]:
    """Return the first parts of the document, and those with which the comparisons begin.

    The table of differences is among the first, unless it is too long for the first screen.
    """
    tables: list[Part] = [_differences_table(outcome.answers)] if outcome.answers else []
    is_short = len(outcome.answers) <= MOST_SENTENCES
    return (tables, []) if is_short else ([], tables)


def _differences_table(answers: Sequence[Answer]) -> Table:
    """Tabulate the differences of each pair of cells, one row each."""
    rows = []
    for answer in answers:
        row: dict[str, Any] = {"name": _against(answer)}
        for effect in answer.effects:
            if effect.is_defined:
                row |= columns_of(effect.paired.figure, effect.paired.difference)
        better = {True: [], False: [], None: []}  # type: dict[bool | None, list[str]]
        for effect in answer.effects:
            better[effect.better].append(SHORT[effect.paired.figure])
        row |= {"better": ", ".join(better[True]) or None, "worse": ", ".join(better[False]) or None}
        rows.append(row)
    frame = pl.DataFrame(
        rows, infer_schema_length=None, schema_overrides={"better": pl.String, "worse": pl.String}
    )
    columns = {
        "name": Column("compared"),
        **{name: Column(SHORT[name], decimals=4, sign=True, strip=True) for name in ESTIMATED},
        "decision_time_s": Column("time", "s", decimals=0, sign=True, strip=True),
        **{
            name: Column(SHORT[name], "points", share=True, sign=True, strip=True)
            for name in ("right_share", "wrong_share", "undecided_share")
        },
        "better": Column("better in", tones={"": "good"}),
        "worse": Column("worse in", tones={"": "bad"}),
    }
    has_shares = any(name in columns and columns[name].share for name in frame.columns)
    points = "; points: percentage points of robots" * has_shares
    caption = (
        f"Differences run by run, first - second, with 95 % intervals{points}. "
        f"Better and worse: p < {stated(SIGNIFICANT)}, corrected over all comparisons (Holm). No significant "
        "difference is not evidence of no difference."
    )
    ordered = frame.select(with_limits_of(columns, frame.columns))
    return Table(ordered, columns, caption=caption, name="differences")


_SHOWN: Final = ("swarm_right", "swarm_wrong", "robots_undecided", "decision_time_s")
"""Figures in the table of outcomes that a terminal prints unasked."""
_OUTCOME: Final = (
    *("swarm_right", "swarm_wrong", "swarm_split", "swarm_incomplete"),
    *("robots_right", "robots_wrong", "robots_undecided", "decision_time_s"),
    *(figure.name for figure in FIGURES if figure.compared),
)
"""Figures in the table of outcomes, the first place of a name counting: cells are compared by some of them."""
_OUTCOME_WORDS: Final = (
    "Swarms right: all robots of the run are. Split: robots decided differently; incomplete: a robot did not decide. "
    "Forced error: robots wrong, or undecided and leaning to the wrong side at the end. Belief in the truth: the "
    "probability that a robot gives the right answer when it decides, or at its last sample; not a share of right "
    "decisions. Under feedback it is an opinion: it counts what robots concluded as if it were readings."
)
_ESTIMATE_WORDS: Final = (
    "Error: mean distance of the robots' estimates from the true number at the end. CRPS: the same for the estimate "
    "and its spread (a normal distribution); lower if a robot is sure and right."
)
_INTERVAL_WORDS: Final = (
    "Intervals are over runs, since the robots of a run influence each other. `summary.csv` has all figures."
)


def _outcome_section(outcome: Outcome) -> Section:
    words = _ESTIMATE_WORDS if asks_numbers(outcome) else _OUTCOME_WORDS
    parts = (
        _outcome_table(outcome),
        *_tables_of_some_cells(outcome),
        *if_any(outcome.reported, _reported_parts),
        Text(_levels(outcome)),
        Section("What these figures are", (Text(f"{words} {_INTERVAL_WORDS}"),), wide=True),
        Section("Figures left out", (Text(not_drawn(outcome)),), wide=True),
        *outcome_figures(outcome),
    )
    return Section("Outcome", parts)


def _outcome_table(outcome: Outcome) -> Table:
    """Tabulate decision time, shares and belief of each cell."""
    runs = counts((one.summary.runs for one in outcome.cells), "run")
    ends = sorted({one.summary.t_end_s for one in outcome.cells})
    whole = f"{number(ends[0])} s" if len(ends) == 1 else "the whole run"
    figures, shown = _figures_of(outcome)
    if until := outcome.runs.until:  # its interval is what was asked for
        figures, shown = (*figures, until.figure), (*shown, until.figure)
    names = dict.fromkeys(["runs", *(["failed_runs"] if outcome.has_failed_runs else []), *figures])
    rows = outcome.table.select("name", *with_limits_of(_given(names, outcome.table), outcome.table.columns))
    wide = [name for name in ("runs", *figures) if name not in shown]
    columns = {"name": Column("cell"), **figure_columns(wide)}
    caption = f"{runs} per cell; in brackets 95 % intervals over runs (Wilson, t)."
    if "decision_time_s" in names:
        caption += f" Undecided robots count as {whole}."
    return Table(rows, columns, caption=caption, name="outcome")


def _given(names: Iterable[str], table: pl.DataFrame) -> list[str]:
    """Return the columns that have values: no swarm is right, for example, where no answer is."""
    return [name for name in names if table[name].null_count() < table.height]


def _figures_of(outcome: Outcome) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the figures of the table of outcomes, and those that a terminal prints unasked.

    Where tasks ask for numbers, they are those of estimates; where some do, these come after the others.
    """
    if asks_numbers(outcome):
        return ("estimate", *ESTIMATES), ESTIMATES
    some = any(one.cell.scenario.task.asks_number for one in outcome.cells)
    return (*_OUTCOME, *ESTIMATES) if some else _OUTCOME, _SHOWN


class _SomeCells(NamedTuple):
    """A table of figures that only some cells have."""

    name: str
    has_them: Callable[[CellOutcome], bool]
    figures: tuple[str, ...]
    caption: str


_AGREED_ON: Final = ("agreed_on_0", "agreed_on_1")


def _agrees(one: CellOutcome, *, many: bool) -> bool:
    """Return whether it counts on what the swarms of a cell agreed, of two answers or of ``many``."""
    scenario = one.cell.scenario
    is_asked = lacks_truth(one) and not scenario.task.asks_number
    return is_asked and (len(answers_of(scenario)) > 2) == many


_LASTED: Final = " Lasted: share of the agreements that held at the end, where opinions may change."
_OF_SOME_CELLS: Final = (
    *(
        _SomeCells(
            name,
            has_them,
            (*agreed_on, "swarm_split", "swarm_incomplete", "agreement_lasted", "consensus_time_s"),
            "Runs without a right answer: on what their swarms agreed, as a share of all runs; 95 % intervals over "
            "runs. Runs without agreement count with their whole time.",
        )
        for name, has_them, agreed_on in (
            ("agreement", lambda one: _agrees(one, many=False), _AGREED_ON),
            ("agreement of many", lambda one: _agrees(one, many=True), (*_AGREED_ON, "agreed_on_other")),
        )
    ),
    _SomeCells(
        "change",
        lambda one: one.cell.scenario.change.is_given,
        JUDGED,
        "The floor changes: shares right at the decision and over time, and the delay until the swarm answered again "
        "after a change of the truth, at most to the next change or the end of the run. Where each robot is asked "
        "again, these count robots, not swarms. All other figures refer to the floor at the end, and count robots with "
        "faults. 95 % intervals over runs.",
    ),
    _SomeCells(
        "maps",
        lambda one: keeps_map(one.cell.scenario),
        MAPPED,
        MAP_CAPTION,
    ),
)


def _tables_of_some_cells(outcome: Outcome) -> list[Table]:
    tables = []
    for kind in _OF_SOME_CELLS:
        cells = [one.cell.number for one in outcome.cells if kind.has_them(one)]
        of_cells = outcome.table.filter(pl.col("cell").is_in(cells))
        if given := _given(kind.figures, of_cells):
            rows = of_cells.select("name", "runs", *with_limits_of(given, of_cells.columns))
            columns = {"name": Column("cell"), **figure_columns(("runs",))}
            caption = kind.caption + (_LASTED if "agreement_lasted" in given else "")
            tables.append(Table(rows, columns, caption=caption, name=kind.name))
    return tables


def _reported_parts(table: pl.DataFrame) -> list[Part]:
    """Tabulate what robots reported at the end (``Outcome.reported``)."""
    is_array = pl.col("index").max().over("cell", "report") > 0
    place = pl.when(is_array).then(pl.col("index").cast(pl.String)).otherwise(pl.lit(""))
    headings = [report_heading(*each) for each in table.select("report", place, "unit").iter_rows()]
    rows = table.with_columns(report=pl.Series(headings)).select(
        "name", "report", "runs", *with_limits_of(("value", "error"), table.columns)
    )
    if rows["error"].null_count() == rows.height:
        rows = rows.drop("error", *limits_of("error"))
    columns = {
        "name": Column("cell"),
        "runs": Column("runs", wide=True),
        "value": Column("mean at the end"),
        "error": Column("error"),
    }
    caption = (
        "What robots reported, mean over robots at the end of a run. Error: mean distance from the number that the "
        "task asks for, of reports that estimate it. 95 % intervals over runs."
    )
    return [Table(rows, columns, caption=caption, name="reported", names=2)]


def _levels(outcome: Outcome) -> str:
    """Write the levels of the intervals of the figure with the wanted precision; empty without one.

    Intervals are computed several times (looks), and the study ends when one is narrow enough. So that the last one
    holds at the study's level (95 %), the interval of each look has a higher level.
    """
    until = outcome.runs.until
    levels = {one.settled.level for one in outcome.cells if one.settled}
    if until is None or not levels:
        return ""
    shown = " to ".join(percent(level, 2) for level in sorted({min(levels), max(levels)}))
    return (
        f"Intervals of {until.figure} are at {shown}, corrected for repeated looks: they hold at "
        f"{stated_percent(until.level)}."
    )


_COMPARED_WORDS: Final = (
    "Cells with one seed have the same motion and noise in each run, so they are compared in pairs of runs. Intervals "
    "are Student's, and allow for rare differences that did not occur; p-values are corrected over all "
    "comparisons (Holm)."
)


def _compared_parts(outcome: Outcome, table: pl.DataFrame) -> list[Part]:
    """Return how comparisons are made, a table for each figure, and their figures."""
    figures = table.drop_nulls("difference")["figure"].unique(maintain_order=True)
    tables = tuple(_compared_table(table, BY_COLUMN[figure]) for figure in figures)
    return [
        Section("How they compare", (Text(_COMPARED_WORDS), *tables), wide=True),
        *comparison_figures(outcome.comparisons),
    ]


def _compared_table(table: pl.DataFrame, figure: RunFigure) -> Table:
    """Tabulate the differences of a figure."""
    of_cell = column_of(figure)
    unit, decimals = ("points", 1) if figure.is_share else (figure.unit, of_cell.decimals)
    columns = {
        "name": Column("compared"),
        "difference": replace(of_cell, title="difference", unit=unit, decimals=decimals, sign=True),
        "p_holm": Column("p, corrected", p_value=True),
        "wins": Column("runs better"),
        "ties": Column("equal"),
        "losses": Column("worse"),
    }
    rows = (
        table.filter(figure=figure.by_run)
        .drop_nulls("difference")
        .select(with_limits_of(columns, table.columns))
    )
    caption = f"{figure.title[0].upper()}{figure.title[1:]}: first - second."
    return Table(rows, columns, caption=caption, name=f"compared-{figure.by_run}", folded=True)


def _sampling_table(outcome: Outcome) -> Table:
    """Tabulate how the robots of each cell sampled."""
    rows = [
        {
            "name": one.cell.name,
            **{k: v for k, v in one.walk.items() if not k.endswith(("_low", "_high"))},
        }
        for one in outcome.cells
    ]
    of_two = all(one.cell.scenario.sensor.kinds == 2 for one in outcome.cells)
    columns = {
        "name": Column("cell"),
        "avoid_per_sample_s": Column("avoidance per sample", "s"),
        "distance_m": Column("distance between samples", "m"),
        "spacing_s": Column("time between samples", "s"),
        "ones": Column("read as vibrating" if of_two else "read as kind 1", share=True),
        "effective_samples": Column("effective number of independent samples"),
    }
    frame = pl.DataFrame(rows, infer_schema_length=None)
    return Table(frame, columns, caption="Means over runs.", name="sampling")


_DECIDABILITY: Final = (
    "The share of ones that the swarm will read, from the sensor's error rates, the floor and the boundary. If it lies "
    "on the wrong side of what robots compare it with, more samples only make the wrong answer more certain. Samples "
    "needed are independent ones."
)


def _decidability_parts(outcome: Outcome) -> tuple[Part, ...]:
    if all(one.decidable.verdict == "not assessed" for one in outcome.cells):
        return ()
    columns = {
        "name": Column("cell"),
        "verdict": Column("can it be decided"),
        "share": Column("share of ones expected", share=True),
        "boundary": Column("boundary", share=True),
        "tested": Column("robots compare it with", share=True),
        "threshold": Column("sensor threshold"),
        "samples_needed": Column("samples needed for 5 % wrong"),
    }
    table = Table(_decidable(outcome).select(list(columns)), columns, name="decidability")
    return Text(_DECIDABILITY), table


def _decidable(outcome: Outcome) -> pl.DataFrame:
    rows = [
        {"cell": one.cell.number, "name": one.cell.name, **one.decidable.as_dict()} for one in outcome.cells
    ]
    return pl.DataFrame(rows, infer_schema_length=None)


def _made_by(outcome: Outcome) -> Mapping[str, str]:
    """Return hash, seed, source of motion, versions, and the command that repeats the study."""
    runs = outcome.runs
    made_by = {"seed": str(runs.seed), "engine": runs.motion} | versions_in_words(runs.store.made_by)
    if runs.folder is None:
        return made_by
    again = ["vibroswarm", "evaluate", f"{runs.folder}/study.toml", "--out", f"{runs.folder}"]
    return made_by | {"again": shlex.join(again)}


def _tables_for_json(outcome: Outcome) -> dict[str, pl.DataFrame]:
    data = {"cells": outcome.runs.cell_table, "decidability": _decidable(outcome), **outcome.tables}
    if settled := [
        {"cell": one.cell.number, "name": one.cell.name, **one.settled._asdict()}
        for one in outcome.cells
        if one.settled is not None
    ]:
        data["precision"] = pl.DataFrame(settled)
    return data
