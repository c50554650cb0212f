"""The report of a study: one HTML page that is opened from disk, and its pictures as files with their data.

The first screen has the question and an answer for each pair of cells. Then come tables and pictures: outcomes,
decisions over time, comparisons, comparisons at equal error, references, how robots sampled, and decidability.
"""

from __future__ import annotations

import itertools
import shlex
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Final

import polars as pl

from vibroswarm.core.atomic_io import whole_folder
from vibroswarm.core.tables import csv_bytes
from vibroswarm.report.html import (
    Column,
    Report,
    ReportPicture,
    ReportTable,
    Section,
    picture_of,
    write_report,
)
from vibroswarm.report.parts import ReportAnswer, ReportEffect
from vibroswarm.show.markup import minus_signs
from vibroswarm.study.answers import EFFECTS, Answer, cell_sentences, lacks_truth, title
from vibroswarm.study.baselines import References, reference_table
from vibroswarm.study.cell_comparison import comparison_table
from vibroswarm.study.pictures import NamedPicture, pictures_of
from vibroswarm.study.summary import Outcome

PICTURES: Final = "pictures"
"""Name of the folder of pictures, inside the study's folder."""
MARKER: Final = "captions.csv"
"""A folder of pictures that contains this file was written here, and may be replaced."""
REPORT: Final = "report.html"
"""Name of the page."""
MOST_SENTENCES: Final = 6
"""Most cells with a sentence on the first screen, if no cells are compared."""


def _limits(name: str) -> tuple[str, str]:
    """Return the names of the columns with the limits of a figure."""
    return (f"{name}_low", f"{name}_high")


_SHARES: Final = {
    "robots_right": "robots right",
    "robots_wrong": "robots wrong",
    "robots_undecided": "robots undecided",
    "forced_error": "forced error",
    "swarm_right": "swarms right",
    "swarm_wrong": "swarms wrong",
}
"""Shares in the table of outcomes, with their headings."""


def write_pictures_and_report(
    outcome: Outcome,
    references: Sequence[References],
    folder: Path,
    style: str | None,
    progress: Callable[[float], None] | None = None,
) -> None:
    """Write ``report.html`` and the folder ``pictures`` (SVG, PDF, PNG, CSV) into a study's folder, each atomically.

    Args:
        style: of the picture files, which are not written if it is None; the page has its pictures in any case, drawn
            in the style ``page``.
        progress: called with the share of pictures done.
    """
    named = list(pictures_of(outcome))
    steps = len(named) * (1 if style is None else 2)
    done = itertools.count(1)

    def one_more() -> None:
        if progress is not None:
            progress(next(done) / steps)

    drawn = []
    for picture in named:
        drawn.append((picture, picture_of(picture.draw(style="page"), picture.name)))
        one_more()
    if style is not None:
        with whole_folder(folder / PICTURES, replace=True, marker=MARKER) as part:
            for picture in named:
                picture.draw(style=style).write(part / picture.name)
                one_more()
            rows = [(picture.name, picture.title, of_page.caption) for picture, of_page in drawn]
            captions = pl.DataFrame(rows, schema=["name", "title", "caption"], orient="row")
            (part / MARKER).write_bytes(csv_bytes(captions))
    write_report(folder / REPORT, report_of(outcome, references, drawn))


def report_of(
    outcome: Outcome, references: Sequence[References], drawn: Iterable[tuple[NamedPicture, ReportPicture]]
) -> Report:
    """Lay out the report; a section without tables and pictures is left out.

    Args:
        references: of ``baselines.references_of``, may be empty.
        drawn: the study's pictures (``pictures.pictures_of``), each with its drawing in the style of the page.
    """
    pictures = list(drawn)

    def shown(*kinds: str) -> tuple[Section, ...]:
        """Return a section for each picture whose name, up to the first hyphen, is one of ``kinds``."""
        return tuple(
            Section(named_picture.title, parts=(picture,))
            for named_picture, picture in pictures
            if named_picture.name.partition("-")[0] in kinds
        )

    figures = ("decision_time_s", "belief_in_truth", "robots_right", "robots_wrong")
    outcomes = shown("outcomes", *figures, "heat", "detection")
    sampling = (_walk_table(outcome, references),)
    compared = tuple(_comparison_tables(outcome)) if outcome.comparisons else ()
    matched = any(answer.matched is not None for answer in outcome.answers)
    equal = (_equal_error_table(outcome.answers),) if matched else ()
    reference_tables = (_reference_table(references),) if references else ()
    sections = [
        Section("Outcome", parts=(_outcome_table(outcome), *_agreement_tables(outcome)), sections=outcomes),
        Section("Decisions over time", sections=shown("incidence", "consensus", "belief")),
        Section("Compared run by run", text=_COMPARISON_TEXT, parts=compared, sections=shown("compared")),
        Section("At equal error", text=_EQUAL_ERROR_TEXT, parts=equal),
        Section(
            "Time against error",
            text=_REFERENCE_TEXT + _reference_notes(references),
            parts=reference_tables,
            sections=shown("front"),
        ),
        Section("How the robots sampled", parts=sampling, sections=shown("density")),
    ]
    return Report(
        title=title(outcome.result),
        lead=_lead(outcome),
        answers=tuple(map(answer_of, outcome.answers)),
        warnings=tuple(outcome.warnings),
        sections=(
            *(section for section in sections if section.parts or section.sections),
            _decidability(outcome),
        ),
        details=_details(outcome),
    )


def count_range(counts: Iterable[int]) -> str:
    """Write the range of numbers of runs, at least one: ``1,000`` if all are equal, else ``100 to 1,000``."""
    ordered = sorted(counts)
    low, high = ordered[0], ordered[-1]
    return f"{low:,}" if low == high else f"{low:,} to {high:,}"


def _lead(outcome: Outcome) -> tuple[str, ...]:
    """Return notes and the study's question; if no cells are compared, also a sentence about each of the first."""
    if outcome.answers:
        return (*outcome.notes, outcome.question)
    return (
        *outcome.notes,
        outcome.question,
        *(minus_signs(words) for words in cell_sentences(outcome.cells[:MOST_SENTENCES])),
    )


def answer_of(answer: Answer) -> ReportAnswer:
    """Convert an answer to the form that the first screen of the report shows."""
    # Tone (which sets the colour) and verdict, by ``Effect.better``.
    tones = {None: ("open", "not significant"), True: ("good", "better"), False: ("bad", "worse")}
    effects = []
    for effect in answer.effects:
        # "-127 s [-153, -102]" is divided into "-127 s" and "-153, -102]".
        number, _, limits = effect.number.partition(" [")
        tone, verdict = tones[effect.better]
        short_name, _, _ = EFFECTS[effect.figure]
        effects.append(
            ReportEffect(
                title=short_name,
                number=number,
                limits=f"[{limits}" if limits else "",
                estimate=effect.interval.estimate,
                low=effect.interval.low,
                high=effect.interval.high,
                tone=tone,
                words=verdict,
            )
        )
    rest = f" ({answer.rest})" if answer.rest else ""
    return ReportAnswer(
        headline=f"{answer.headline}{rest}",
        sentence=answer.sentence,
        aside=answer.at_equal_error,
        effects=tuple(effects),
    )


_COMPARISON_TEXT: Final = (
    "Cells with one seed have the same motion and noise in each run, so they are compared in pairs of runs. "
    "Intervals are from sign flips; p-values are corrected over all comparisons (Holm). Each is repeated on other "
    "seeds, with fresh motion and floors: a difference is confirmed only if both show it.",
    "No significant difference is not evidence of no difference.",
)
_REFERENCE_TEXT: Final = (
    "Each strategy is compared with two references on the same samples: pooled counting (all bits in one place at "
    "once, wrong as often as the strategy), and what could be known from all bits and their positions, given the "
    "sensor and the fill ratio but not the side of the boundary, at a posterior error of 5 %.",
    "No rule that uses the same bits and is as sure in every run decides sooner, if floors are drawn from that prior. "
    "The bound does not apply to a strategy that is wrong more or less often. For what could be known, every second "
    "run is on a floor with the fill ratio mirrored across the boundary: over both sides the expected share known and "
    "wrong is the mean posterior error at the time of knowing, which is slightly below 5 %.",
)


def _reference_notes(references: Sequence[References]) -> tuple[str, ...]:
    """Return the notes of the references, each once; a note that does not apply to all cells names its cells first."""
    cells: dict[str, list[str]] = {}  # names of the cells with each note
    for reference in references:
        for sentence in reference.says:
            cells.setdefault(sentence, []).append(reference.cell.name)
    return tuple(
        sentence if len(names) == len(references) else f"{', '.join(names)}: {sentence}"
        for sentence, names in cells.items()
    )


def _outcome_table(outcome: Outcome) -> ReportTable:
    """Tabulate decision time, shares and belief of each cell, with their intervals and the numbers of runs."""
    columns = {name: Column(words, percent=True, limits=_limits(name)) for name, words in _SHARES.items()}
    columns |= {
        "decision_time_s": Column("decision time", "s", decimals=0, limits=_limits("decision_time_s")),
        "belief_in_truth": Column("belief in the truth", decimals=3, limits=_limits("belief_in_truth")),
    }
    order = ["decision_time_s", *_SHARES, "belief_in_truth"]
    counts = ["runs", *(["failed_runs"] if outcome.has_failed_runs else [])]
    figures = [column for name in order for column in (name, *_limits(name))]
    return ReportTable(
        outcome.table.select("name", *counts, *figures),
        {"name": Column("cell"), "failed_runs": Column("failed runs"), **columns},
        caption=_OUTCOME_TEXT,
        name="outcome",
    )


_AGREEMENTS: Final = {
    "agreed_on_0": "agreed on 0 (less)",
    "agreed_on_1": "agreed on 1 (more)",
    "swarm_split": "split",
    "swarm_incomplete": "incomplete",
    "agreement_lasted": "lasted",
}
"""Shares of runs in the table of agreements, with their headings."""


def _agreement_tables(outcome: Outcome) -> list[ReportTable]:
    """Return a table of what the swarms agreed on, of the cells with runs in which no answer is right; [] if none."""
    lacking = [
        cell_outcome.cell.number for cell_outcome in outcome.cells if lacks_truth(cell_outcome.summary)
    ]
    if not lacking:
        return []
    columns = {name: Column(words, percent=True, limits=_limits(name)) for name, words in _AGREEMENTS.items()}
    columns["consensus_time_s"] = Column("agreement", "s", decimals=0, limits=_limits("consensus_time_s"))
    figures = [column for name in columns for column in (name, *_limits(name))]
    rows = outcome.table.filter(pl.col("cell").is_in(lacking)).select("name", "runs", *figures)
    caption = (
        "Runs without a right answer: on what their swarms agreed, as a share of all runs; 95 % intervals over runs. "
        "Lasted: share of the agreements that held at the end, where opinions may change (a dash: decisions are "
        "final). Runs without agreement count with their whole time."
    )
    return [ReportTable(rows, {"name": Column("cell"), **columns}, caption=caption, name="agreement")]


_OUTCOME_TEXT: Final = (
    "In brackets: 95 % intervals over runs, since the robots of a run influence each other. A robot without a decision "
    "counts as undecided, and with the full length of the run in the mean time. Forced error: robots wrong, or "
    "undecided and leaning to the wrong side at the end. Belief in the truth: the probability that a robot gives the "
    "right answer when it decides, or at its last sample; not a share of right decisions. Under feedback it is an "
    "opinion: it counts what robots concluded as if it were readings. Swarms right: all robots of the run are. "
    "`summary.csv` has all figures."
)


def _comparison_tables(outcome: Outcome) -> list[ReportTable]:
    """Return one table per figure of ``_COMPARED``, since differences in time and in shares have no common unit.

    The belief in the truth is compared too, but has no table in the report.

    A study may have a second block of runs, from another seed. If there is one, a row also has the difference in the
    second block, and whether it confirms the difference in the study's own runs.
    """
    table = comparison_table(outcome.comparisons)
    if "confirmed" in table.columns:
        words = pl.when("confirmed").then(pl.lit("confirmed")).otherwise(pl.lit("not confirmed"))
        table = table.with_columns(confirmed=words)
    again = ("again_difference", *_limits("again_difference"))  # the difference in the second block
    selected = ["name", "difference", *_limits("difference"), "p_holm"]
    selected += [name for name in (*again, "confirmed") if name in table.columns]
    selected += ["wins", "ties", "losses"]
    tables = []
    for figure, words_of_figure, is_share in _COMPARED:
        unit, decimals = ("points", 1) if is_share else ("s", 0)
        columns = {
            name: Column(title, unit, percent=is_share, decimals=decimals, limits=_limits(name))
            for name, title in (("difference", "difference"), ("again_difference", "on other seeds"))
            if name in table.columns
        }
        columns |= {
            "name": Column("compared"),
            "p_holm": Column("p, corrected", p_value=True),
            "confirmed": Column("difference is", tones={"confirmed": "good", "not confirmed": "open"}),
            "wins": Column("runs better"),
            "ties": Column("equal"),
            "losses": Column("worse"),
        }
        rows = table.filter(pl.col("figure") == figure).select(selected)
        caption = f"{words_of_figure}: first - second."
        tables.append(ReportTable(rows, columns, caption=caption, name=f"compared-{figure}"))
    return tables


def _equal_error_table(answers: Sequence[Answer]) -> ReportTable:
    """Tabulate the comparisons at equal error and at equal time.

    Args:
        answers: those without such a comparison (``Answer.matched``) are left out; at least one must have it.
    """
    frame = pl.DataFrame([a.as_row() for a in answers if a.matched is not None], infer_schema_length=None)
    columns = {
        "name": Column("compared"),
        "error": Column("at the forced error", percent=True),
        "time_difference_s": Column(
            "difference in time", "s", decimals=0, limits=_limits("time_difference_s")
        ),
        "time_s": Column("at the time", "s", decimals=0),
        "error_difference": Column(
            "difference in forced error", "points", percent=True, limits=_limits("error_difference")
        ),
    }
    shown = frame.select(
        "name",
        "error",
        "time_difference_s",
        *_limits("time_difference_s"),
        "time_s",
        "error_difference",
        *_limits("error_difference"),
        "runs",
    )
    return ReportTable(shown, columns, caption="First - second.", name="equal-error")


_EQUAL_ERROR_TEXT: Final = (
    "Every strategy becomes faster if it may err more. Here both are compared along what they reach with their own "
    "settings (credible threshold and minimum of observations, for most), replayed on the same runs: the time at which "
    "each reaches the error of the one that errs more as it was run, and the error of each at that one's time.",
    "Error is the forced error: robots wrong, or undecided and leaning to the wrong side. Limits are those of a "
    "bootstrap over runs. A dash: a strategy does not reach there.",
)


_COMPARED: Final = (
    ("decision_time_s", "Decision time", False),
    ("right_share", "Share of robots right", True),
    ("wrong_share", "Share of robots wrong", True),
    ("undecided_share", "Share of robots undecided", True),
    ("forced_error", "Forced error", True),
)
"""Figures of the tables of comparisons: name, words for the caption, and whether the figure is a share."""


_REFERENCE_COLUMNS: Final = {
    "strategy_time_s": Column("strategy: time", "s", decimals=0, limits=_limits("strategy_time_s")),
    "strategy_error": Column("strategy: wrong", percent=True, limits=_limits("strategy_error")),
    "pooled_time_s": Column("pooled counting: time", "s", decimals=0, limits=_limits("pooled_time_s")),
    "pooled_error": Column("pooled counting: wrong", percent=True, limits=_limits("pooled_error")),
    "slower_than_pooled_s": Column(
        "strategy - pooled counting", "s", decimals=0, limits=_limits("slower_than_pooled_s")
    ),
    "known_time_s": Column("could be known: time", "s", decimals=0, limits=_limits("known_time_s")),
    "known": Column("known by the end", percent=True, limits=_limits("known")),
    "known_wrong": Column("known and wrong", percent=True, limits=_limits("known_wrong")),
    "known_claimed": Column("posterior error when known", percent=True, limits=_limits("known_claimed")),
}
"""Columns of the table of references, with their headings."""


def _reference_table(references: Sequence[References]) -> ReportTable:
    """Tabulate the references, at least one, by cell.

    The caption gives the number of runs from which they are computed. Cells with few stored runs have fewer; the
    caption then gives the largest number.
    """
    table = reference_table(list(references))
    # A reference that is missing in all cells has no column in the table.
    names = [name for name in _REFERENCE_COLUMNS if name in table.columns]
    figures = table.select("name", *(column for name in names for column in (name, *_limits(name))))
    runs = max(reference.runs for reference in references)
    caption = (
        f"From {runs} runs per cell, simulated again from the seed; half of them tuned the pooled threshold."
    )
    columns = {"name": Column("cell"), **{name: _REFERENCE_COLUMNS[name] for name in names}}
    return ReportTable(figures, columns, caption=caption, name="references")


def _walk_table(outcome: Outcome, references: Sequence[References]) -> ReportTable:
    """Tabulate how the robots of each cell sampled: means over runs, without intervals.

    The correlation of consecutive bits and the packet loss are known only for cells with references, whose runs were
    simulated again; for other cells they are empty.
    """
    by_cell = {reference.cell.number: reference for reference in references}
    rows = []
    for cell_outcome in outcome.cells:
        means = {k: v for k, v in cell_outcome.walk.items() if not k.endswith(("_low", "_high"))}  # no limits
        reference = by_cell.get(cell_outcome.cell.number)
        of_reference = {} if reference is None else reference.as_row()
        correlation, loss = of_reference.get("lag_one"), of_reference.get("packet_loss")
        rows.append(
            {"cell": cell_outcome.cell.name, **means, "lag-1 correlation": correlation, "packet loss": loss}
        )
    columns = {
        "avoid_per_sample_s": Column("avoidance per sample", "s"),
        "distance_m": Column("distance between samples", "m"),
        "spacing_s": Column("time between samples", "s"),
        "ones": Column("read as vibrating", percent=True),
        "effective_samples": Column("effective number of independent samples"),
        "packet loss": Column("packet loss", percent=True),
    }
    frame = pl.DataFrame(rows, infer_schema_length=None)
    return ReportTable(frame, columns, caption="Means over runs.", name="sampling")


def _decidability(outcome: Outcome) -> Section:
    """Lay out a table of whether each cell can be decided at all (``analysis.decidability``)."""
    rows = [
        {
            "cell": cell_outcome.cell.name,
            "can it be decided": cell_outcome.decidable.verdict,
            "share of ones expected": cell_outcome.decidable.share,
            "boundary": cell_outcome.decidable.boundary,
            "robots compare it with": cell_outcome.decidable.tested,
            "sensor threshold": cell_outcome.decidable.threshold,
            # The thresholds of the sensor with which the robots would decide rightly; None: none, or not computed.
            "decidable for thresholds from": cell_outcome.decidable.mending_low,
            "to": cell_outcome.decidable.mending_high,
            "samples needed for 5 % wrong": cell_outcome.decidable.samples_needed,
        }
        for cell_outcome in outcome.cells
    ]
    text = (
        "The share of ones that the swarm will read, from the sensor's error rates, the floor and the boundary. If it "
        "lies on the wrong side of what robots compare it with, more samples only make the wrong answer more "
        "certain. Samples needed are independent ones.",
    )
    table = ReportTable(pl.DataFrame(rows), name="decidability")
    return Section("Can it be decided at all", text=text, parts=(table,))


def versions_in_words(made_by: Sequence[Mapping[str, str]]) -> dict[str, str]:
    """Return details of a report: the versions that made a result, numbered if there are several.

    Args:
        made_by: the different ``simulation.versions``, which have the version of each part of the software.
    """
    return {
        "made by" if len(made_by) == 1 else f"made by ({number})": ", ".join(
            f"{name} {version}" for name, version in versions.items()
        )
        for number, versions in enumerate(made_by, start=1)
    }


def _details(outcome: Outcome) -> dict[str, str]:
    """Return the details of the report: hash, seeds, source of motion, versions, and the command that repeats it."""
    study, folder = outcome.result.study, outcome.result.store.folder
    details = {"study": study.hash, "seed": str(study.seed), "engine": study.motion}
    if outcome.replicate is not None:  # the runs from another seed, with which differences are confirmed
        second = outcome.replicate.study
        details["second block"] = f"seed {second.seed}, {second.runs} runs per cell"
    details |= versions_in_words(outcome.result.store.made_by)
    return details | {
        "again": shlex.join(["vibroswarm", "sweep", f"{folder}/study.toml", "--out", f"{folder}"])
    }
