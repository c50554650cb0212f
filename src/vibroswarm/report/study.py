"""The report of a study: its answer, the figures of its cells, their differences, and how they came to decide."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any, Final

import polars as pl

from vibroswarm.core.numbers import count, counts, listed, some, stated, stated_percent
from vibroswarm.report.format import Value, format_of, write_value
from vibroswarm.report.knowledge import known_beyond, setting, versions_by_name
from vibroswarm.report.report import Figure, Report, Table, report
from vibroswarm.report.study_answer import answer
from vibroswarm.report.study_pictures import pictures
from vibroswarm.scenario.fault_draws import fault_words
from vibroswarm.search.validation import CellScores
from vibroswarm.statistics.figures import BY_COLUMN, ESTIMATES
from vibroswarm.statistics.map_figures import MAPPED
from vibroswarm.statistics.over_time import JUDGED
from vibroswarm.statistics.sampling import blocked_words
from vibroswarm.statistics.verdict import answers_of
from vibroswarm.study.batch import WALK
from vibroswarm.study.cells import LABEL
from vibroswarm.study.comparison import Compared
from vibroswarm.study.options import warnings_of
from vibroswarm.study.runs import Runs
from vibroswarm.study.summary import Outcome, outcome_of

FEW_CELLS: Final = 4
"""Most cells that stand side by side, with a row for each figure."""
MOST_PAIRS: Final = 12
"""Most comparisons whose differences are not folded."""
MOST_NAMES: Final = 6
"""Most cells that a title or a warning names."""
OUTCOMES: Final = ("swarm_right", "swarm_wrong", "swarm_split", "swarm_incomplete")
AGREED: Final = ("agreed_on_0", "agreed_on_1", "agreed_on_other")
DECISIONS: Final = (
    *("decision_time_s", "robots_right", "robots_wrong", "robots_undecided"),
    *("belief_in_truth", "forced_error"),
)
MARKS: Final = " ● better, ✕ worse: p < 0.05, corrected over all comparisons (Holm)."


@report.register
def of_runs(runs: Runs, **options: Any) -> Report:
    """Return what the runs of a study say."""
    return of_study(outcome_of(runs), **options)


@report.register
def of_study(outcome: Outcome, scores: CellScores | None = None) -> Report:
    """Return what a study says, and the scores of its cells under a cost."""
    runs, names = outcome.runs, _figures(outcome)
    parts: dict[str, Table | Figure] = {
        **({} if scores is None else {"scores": _scores(scores)}),
        **dict(_outcome_tables(outcome, names)),
        **dict(pictures(outcome)),
        **dict(_folded_tables(outcome)),
    }
    each = counts((one.runs for one in outcome.cells), "run")
    each_cell = " each" if len(outcome.cells) > 1 else ""
    return Report(
        title=runs.name or _title(outcome),
        answer=answer(outcome) if scores is None else (_best(scores), *answer(outcome)),
        parts=parts,
        setting=f"{setting(outcome.cells[0].cell.scenario, runs.varied)}; {each}{each_cell}, seed {runs.seed}",
        warnings=tuple(_warnings(outcome)),
        made_by={
            "seed": str(runs.seed),
            "source of motion": runs.motion,
            **versions_by_name(runs.store.made_by),  # type: ignore[arg-type]
        },
    )


def _best(scores: CellScores) -> str:
    words, fresh = scores.objective.words, write_value(Value(*scores.fresh[:3]), scores.objective.unit)
    ties = int(scores.table["best_group"].sum()) - 1
    return f"Lowest {words}: {scores.best.name}, {fresh} on fresh runs; {count(ties, 'other')} tie."


def _scores(scores: CellScores) -> Table:
    table, unit = scores.table, scores.objective.unit
    shown = table.select("name", *table.columns[table.columns.index("score") :])
    titles = {
        "name": "cell",
        "score": f"score{f', {unit}' if unit else ''}",
        "best_group": "ties with the lowest",
    }
    titles["above_best"] = "above the lowest"
    caption = "With 95 % intervals; those above the lowest hold together."
    return Table(shown, "Scores", caption, titles)


def _title(outcome: Outcome) -> str:
    names = [one.cell.name for one in outcome.cells]
    if len(names) <= MOST_NAMES:
        return listed(names)
    fields = [format_of(field).title for field in outcome.runs.varied]
    return f"{count(len(names), 'cell')}: {listed(fields)}"


def _figures(outcome: Outcome) -> list[str]:
    scenarios = [one.cell.scenario for one in outcome.cells]
    asks_numbers = [scenario.task.asks_number for scenario in scenarios]
    lacks_truth = any(one.figures["swarm_right"].n < one.runs for one in outcome.cells)
    names = [
        *(() if all(asks_numbers) else (*OUTCOMES, *DECISIONS)),
        *((*AGREED, "agreement_lasted") if lacks_truth and not all(asks_numbers) else ()),
        *(("estimate", *ESTIMATES) if any(asks_numbers) else ()),
        *(JUDGED if any(scenario.change.is_given for scenario in scenarios) else ()),
        *MAPPED,
        *((outcome.runs.until.figure,) if outcome.runs.until else ()),
    ]
    return [name for name in dict.fromkeys(names) if outcome.table[name].null_count() < len(scenarios)]


def _outcome_tables(outcome: Outcome, names: Sequence[str]) -> Iterator[tuple[str, Table]]:
    few, one_pair = len(outcome.cells) <= FEW_CELLS, len(outcome.answers) == 1
    ends = {stated(one.t_end_s) for one in outcome.cells}
    whole = f"{ends.pop()} s" if len(ends) == 1 else "the whole run"
    caption = "Means over runs with 95 % intervals."
    if "decision_time_s" in names:
        caption += f" Undecided robots count as {whole}."
    if few:
        differences = _by_figure(outcome.comparisons) if one_pair else None
        caption += f" Differences are run by run, those of percentages in points.{MARKS}" * one_pair
        yield "outcome", _side_by_side(outcome, names, differences, caption)
    else:
        yield "outcome", _cell_by_cell(outcome, names, caption)
    if outcome.answers and not (few and one_pair):
        caption = f"First - second, run by run, with 95 % intervals.{MARKS}"
        folded = len(outcome.answers) > MOST_PAIRS
        yield (
            "differences",
            Table(_pair_by_pair(outcome), "Differences", caption, {"name": "compared"}, folded),
        )


def _side_by_side(
    outcome: Outcome, names: Sequence[str], differences: pl.DataFrame | None, caption: str
) -> Table:
    cells = outcome.table.to_dicts()
    rows = [
        {
            "figure": name,
            **{
                f"{cell['name']}{end}": cell[f"{name}{end}"]
                for cell in cells
                for end in ("", "_low", "_high")
            },
        }
        for name in names
    ]
    frame = pl.DataFrame(rows, infer_schema_length=None)
    known = known_beyond([one.cell.scenario for one in outcome.cells])
    titles = {"figure": "", **_answer_titles(outcome)}
    titles |= {
        cell["name"]: f"{cell['name']} ({text})" for cell, text in zip(cells, known, strict=True) if text
    }
    if differences is not None:
        frame = frame.join(differences, on="figure", how="left", maintain_order="left")
        titles["difference"] = outcome.answers[0].pair.name
    if any(known):
        caption += " In brackets: what only these robots know."
    return Table(frame, "Outcome", caption, titles)


def _cell_by_cell(outcome: Outcome, names: Sequence[str], caption: str) -> Table:
    shown = [
        *("swarm_right", "swarm_wrong", "robots_undecided", "decision_time_s"),
        *(*AGREED[:2], *ESTIMATES, "right_time_share", "answer_delay_s", "map_brier"),
    ]
    columns = [f"{name}{end}" for name in shown if name in names for end in ("", "_low", "_high")]
    varied = outcome.runs.varied
    fields = ["name"] if LABEL in varied or not varied else varied
    known = pl.Series("knows", known_beyond([one.cell.scenario for one in outcome.cells]))
    table = outcome.table.with_columns(known)
    knows = ["knows"] if any(known) else []
    titles = {"name": "cell", **_answer_titles(outcome)}
    return Table(table.select(*fields, *knows, *columns), "Outcome", caption, titles)


def _answer_titles(outcome: Outcome) -> dict[str, str]:
    """Return headings of what swarms agreed on in the words of the task, if all cells have the same answers."""
    answers = {answers_of(one.cell.scenario)[:2] for one in outcome.cells}
    if len(answers) > 1:
        return {}
    return {name: f"agreed on: {text}" for name, text in zip(AGREED, answers.pop(), strict=False)}


def _by_figure(comparisons: Iterable[Compared]) -> pl.DataFrame:
    rows = [
        {"figure": BY_COLUMN[one.paired.figure].name, **_difference(one), "p_holm": one.paired.p_holm}
        for one in comparisons
        if one.is_defined
    ]
    return pl.DataFrame(rows, infer_schema_length=None, schema_overrides={"difference_verdict": pl.String})


def _difference(one: Compared, prefix: str = "") -> dict[str, Any]:
    verdict = {True: "better", False: "worse", None: None}[one.better]
    low, high = one.paired.difference.low, one.paired.difference.high
    values = {"": one.paired.difference.estimate, "_low": low, "_high": high, "_verdict": verdict}
    return {f"{prefix}difference{end}": value for end, value in values.items()}


def _pair_by_pair(outcome: Outcome) -> pl.DataFrame:
    rows: list[dict[str, Any]] = []
    for one in outcome.answers:
        row: dict[str, Any] = {"name": one.pair.name}
        for effect in one.effects:
            if effect.is_defined:
                row |= _difference(effect, f"{effect.paired.figure}_")
        rows.append(row)
    return pl.DataFrame(rows, infer_schema_length=None)


def _folded_tables(outcome: Outcome) -> Iterator[tuple[str, Table]]:
    tables = outcome.tables
    if "comparisons" in tables:
        compared = (
            tables["comparisons"]
            .drop("cell", "reference", "level")
            .rename({"wins": "better", "ties": "equal", "losses": "worse", "p_value": "p"})
        )
        caption = "better, equal, worse: number of runs. p (Holm): corrected over all comparisons."
        yield "comparisons", Table(compared, "All comparisons", caption, folded=True)
    if "reported" in tables:
        caption = "Means over robots at the end of a run; error: distance from the number that is asked for."
        yield "reported", Table(tables["reported"].drop("cell"), "What robots reported", caption, folded=True)
    walked = [f"{name}{end}" for name in WALK for end in ("", "_low", "_high") if name in outcome.table]
    sampling = outcome.table.select("name", *walked)
    yield "sampling", Table(sampling, "How the robots sampled", "Means over runs.", folded=True)
    decidable = [
        {
            "name": one.cell.name,
            "verdict": one.decidable.verdict,
            "ones_expected_share": one.decidable.share,
            "boundary_tested_share": one.decidable.tested,
            "samples_needed": one.decidable.samples_needed,
        }
        for one in outcome.cells
    ]
    frame = pl.DataFrame(decidable, infer_schema_length=None)
    caption = "Whether the share of ones that is expected lies on the right side of the boundary it is tested against."
    yield "decidability", Table(frame, "Can it be decided at all", caption, folded=True)
    caption = "Forced error: robots that are wrong, or would be if they had to decide at the end. Belief in the truth: "
    caption += "the probability that a robot gives to the right answer, at its decision or last sample."
    yield "summary", Table(tables["summary"], "All figures", caption, _answer_titles(outcome), folded=True)


def _warnings(outcome: Outcome) -> Iterator[str]:
    runs = outcome.runs
    if outcome.missing:
        yield f"{count(outcome.missing, 'run')} missing; repeat the command to add them."
    if len(runs.store.made_by) > 1:
        yield "Runs were made by different versions of the software; last digits may differ."
    cells: dict[str, list[str]] = {}
    for one in outcome.cells:
        for text in _cell_warnings(one):
            cells.setdefault(text, []).append(one.cell.name)
    for text, names in list(cells.items())[:MOST_NAMES]:
        yield text if len(names) == len(outcome.cells) else f"{some(names, MOST_NAMES)}: {text}"
    until = runs.until
    if until is not None and any(one.settled and not one.settled.reached for one in outcome.cells):
        yield f"{until.figure} is not known to {stated_percent(until.half_width)} after {count(until.max_runs, 'run')}."


def _cell_warnings(one: Any) -> Iterator[str]:
    scenario = one.cell.scenario
    if one.failed.height:
        first = one.failed.row(0, named=True)
        yield (
            f"{count(one.failed.height, 'run')} failed in the source of motion, and count as undecided "
            f"(run {first['run']}: {first['reason']})."
        )
    if one.decidable.is_warning:
        yield one.decidable.says
    if one.unreached:
        yield f"{one.unreached.partition(';')[0]}."
    if blocked := blocked_words(one.walk["blocked_share"]):
        yield blocked
    if kinds := scenario.faults.kinds:
        yield f"Faulty robots ({listed(map(fault_words, kinds))}) count like the others."
    yield from (f"{text}." for text in warnings_of(scenario))
