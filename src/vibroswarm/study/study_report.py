"""The report of a study: one page that is opened from disk, and its pictures as files with their numbers."""

from __future__ import annotations

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
from vibroswarm.report.markup import minus_signs
from vibroswarm.report.parts import ReportAnswer, ReportEffect
from vibroswarm.study.answers import EFFECTS, Answer, cell_sentences, title
from vibroswarm.study.baselines import References, reference_table
from vibroswarm.study.cell_comparison import comparison_table
from vibroswarm.study.pictures import NamedPicture, pictures_of
from vibroswarm.study.summary import Outcome

PICTURES: Final = "pictures"
MARKER: Final = "captions.csv"
"""The file by which the folder of pictures is known to be ours, and may be replaced."""
REPORT: Final = "report.html"
MOST_SENTENCES: Final = 6
"""Cells of the first screen, where none are compared."""


def _limits(name: str) -> tuple[str, str]:
    return (f"{name}_low", f"{name}_high")


_SHARES: Final = {
    "robots_right": "robots right",
    "robots_wrong": "robots wrong",
    "robots_undecided": "robots undecided",
    "forced_error": "forced error",
    "swarm_right": "swarms right",
    "swarm_wrong": "swarms wrong",
}
"""Shares of the first table."""


def write_pictures_and_report(
    outcome: Outcome,
    references: Sequence[References],
    folder: Path,
    style: str,
    progress: Callable[[float], None] | None = None,
) -> None:
    """Write ``pictures/`` (SVG, PDF, PNG, CSV) and ``report.html`` into a study's folder, each whole.

    Args:
        style: of the picture files; those of the page are its own. progress: called with the share done.
    """
    drawn, named = [], list(pictures_of(outcome))
    with whole_folder(folder / PICTURES, replace=True, marker=MARKER) as part:
        for done, named_picture in enumerate(named):
            named_picture.draw(style=style).write(part / named_picture.name)
            drawn.append((named_picture, picture_of(named_picture.draw(style="page"), named_picture.name)))
            if progress is not None:
                progress((done + 1) / len(named))
        rows = [
            (named_picture.name, named_picture.title, picture.caption) for named_picture, picture in drawn
        ]
        captions = pl.DataFrame(rows, schema=["name", "title", "caption"], orient="row")
        (part / MARKER).write_bytes(csv_bytes(captions))
    write_report(folder / REPORT, report_of(outcome, references, drawn))


def report_of(
    outcome: Outcome, references: Sequence[References], drawn: Iterable[tuple[NamedPicture, ReportPicture]]
) -> Report:
    """Lay out the report from figures and pictures."""
    pictures = list(drawn)

    def shown(*kinds: str) -> tuple[Section, ...]:
        """Pictures whose file names begin with one of these words."""
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
        Section("Outcome", (), (_outcome_table(outcome),), outcomes),
        Section("Decisions over time", sections=shown("incidence", "consensus", "belief")),
        Section("Compared run by run", _COMPARISON_TEXT, compared, shown("compared")),
        Section("At equal error", _EQUAL_ERROR_TEXT, equal),
        Section(
            "Time against error",
            _REFERENCE_TEXT + _reference_notes(references),
            reference_tables,
            shown("front"),
        ),
        Section("How the robots sampled", (), sampling, shown("density")),
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
    """Write how many runs cells have: ``1,000``, or ``100 to 1,000``."""
    ordered = sorted(counts)
    low, high = ordered[0], ordered[-1]
    return f"{low:,}" if low == high else f"{low:,} to {high:,}"


def _lead(outcome: Outcome) -> tuple[str, ...]:
    """Write the study's question; if no cells are compared, also one sentence about each of the first cells."""
    if outcome.answers:
        return (outcome.question,)
    return (
        outcome.question,
        *(minus_signs(words) for words in cell_sentences(outcome.cells[:MOST_SENTENCES])),
    )


def answer_of(answer: Answer) -> ReportAnswer:
    """Convert an answer to the form that the first screen of the report shows."""
    effects = []
    for effect in answer.effects:
        number, _, limits = effect.number.partition(" [")
        better = effect.better
        effects.append(
            ReportEffect(
                EFFECTS[effect.figure][0],
                number,
                f"[{limits}" if limits else "",
                *effect.interval[:3],
                "open" if better is None else "good" if better else "bad",
                "not significant" if better is None else "better" if better else "worse",
            )
        )
    rest = f" ({answer.rest})" if answer.rest else ""
    return ReportAnswer(f"{answer.headline}{rest}", answer.sentence, answer.at_equal_error, tuple(effects))


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
    """List why figures are missing or limited, each sentence once with the cells it applies to."""
    cells: dict[str, list[str]] = {}
    for reference in references:
        for sentence in reference.says:
            cells.setdefault(sentence, []).append(reference.cell.name)
    return tuple(
        sentence if len(names) == len(references) else f"{', '.join(names)}: {sentence}"
        for sentence, names in cells.items()
    )


def _outcome_table(outcome: Outcome) -> ReportTable:
    """Tabulate the outcomes by cell, each with its limits."""
    columns = {name: Column(words, percent=True, limits=_limits(name)) for name, words in _SHARES.items()}
    columns |= {
        "decision_time_s": Column("decision time", "s", decimals=0, limits=_limits("decision_time_s")),
        "belief_in_truth": Column("belief in the truth", decimals=3, limits=_limits("belief_in_truth")),
    }
    order = ["decision_time_s", *_SHARES, "belief_in_truth"]
    counts = ["runs", *(["failed_runs"] if outcome.has_failed_runs else [])]
    frame = outcome.table.select("name", *counts, *(end for name in order for end in (name, *_limits(name))))
    return ReportTable(
        frame,
        {"name": Column("cell"), "failed_runs": Column("failed runs"), **columns},
        _OUTCOME_TEXT,
        "outcome",
    )


_OUTCOME_TEXT: Final = (
    "In brackets: 95 % intervals over runs, since the robots of a run influence each other. A robot without a decision "
    "counts as undecided, and with the full length of the run in the mean time. Forced error: robots wrong, or "
    "undecided and leaning to the wrong side at the end. Belief in the truth: the probability that a robot gives the "
    "right answer when it decides, or at its last sample; not a share of right decisions. Under feedback it is an "
    "opinion: it counts what robots concluded as if it were readings. Swarms right: all robots of the run are. "
    "`summary.csv` has all figures."
)


def _comparison_tables(outcome: Outcome) -> list[ReportTable]:
    """Return one table per compared figure, since differences in time and in shares have no common scale."""
    table = comparison_table(outcome.comparisons)
    if "confirmed" in table.columns:
        words = pl.when("confirmed").then(pl.lit("confirmed")).otherwise(pl.lit("not confirmed"))
        table = table.with_columns(confirmed=words)
    again = ("again_difference", *_limits("again_difference"))
    selected = ["name", "difference", *_limits("difference"), "p_holm"]
    selected += [name for name in (*again, "confirmed") if name in table.columns]
    selected += ["wins", "ties", "losses"]
    tables = []
    for figure, words_of_figure, share in _COMPARED:
        unit, decimals = ("points", 1) if share else ("s", 0)
        columns = {
            name: Column(title, unit, percent=share, decimals=decimals, limits=_limits(name))
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
        tables.append(ReportTable(rows, columns, f"{words_of_figure}: first - second.", f"compared-{figure}"))
    return tables


def _equal_error_table(answers: Sequence[Answer]) -> ReportTable:
    """Tabulate the comparisons at equal error."""
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
    order = [
        "name",
        "error",
        "time_difference_s",
        *_limits("time_difference_s"),
        "time_s",
        "error_difference",
    ]
    return ReportTable(
        frame.select(*order, *_limits("error_difference"), "runs"), columns, "First - second.", "equal-error"
    )


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


def _reference_table(references: Sequence[References]) -> ReportTable:
    """Tabulate the references by cell."""
    table = reference_table(list(references))
    names = [name for name in _REFERENCE_COLUMNS if name in table.columns]
    figures = table.select("name", *(end for name in names for end in (name, *_limits(name))))
    runs = max(reference.runs for reference in references)
    caption = (
        f"From {runs} runs per cell, simulated again from the seed; half of them tuned the pooled threshold."
    )
    chains = [
        reference.known for reference in references if reference.known and reference.known.how == "chains"
    ]
    if chains:
        runs, error = max(k.runs.height for k in chains), max(k.monte_carlo_error for k in chains)
        caption += (
            f" What could be known: from {runs} of them if robots sense across tile edges or tiles or robots differ; "
            f"there the posterior is sampled, with a Monte Carlo error of at most {error:.3f} at a decision."
        )
    columns = {"name": Column("cell"), **{name: _REFERENCE_COLUMNS[name] for name in names}}
    return ReportTable(figures, columns, caption, "references")


def _walk_table(outcome: Outcome, references: Sequence[References]) -> ReportTable:
    """Tabulate how the robots sampled, by cell."""
    by_cell = {reference.cell.number: reference for reference in references}
    rows = []
    for cell_outcome in outcome.cells:
        means = {k: v for k, v in cell_outcome.walk.items() if not k.endswith(("_low", "_high"))}
        more = by_cell[cell_outcome.cell.number].as_row() if cell_outcome.cell.number in by_cell else {}
        correlation, loss = more.get("lag_one"), more.get("packet_loss")
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
    return ReportTable(pl.DataFrame(rows, infer_schema_length=None), columns, "Means over runs.", "sampling")


def _decidability(outcome: Outcome) -> Section:
    """Lay out whether each cell can be decided."""
    rows = [
        {
            "cell": cell_outcome.cell.name,
            "can it be decided": cell_outcome.decidable.verdict,
            "share of ones expected": cell_outcome.decidable.share,
            "boundary": cell_outcome.decidable.boundary,
            "robots compare it with": cell_outcome.decidable.tested,
            "sensor threshold": cell_outcome.decidable.threshold,
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
    return Section("Can it be decided at all", text, (ReportTable(pl.DataFrame(rows), name="decidability"),))


def versions_in_words(made_by: Sequence[Mapping[str, str]]) -> dict[str, str]:
    """Return the versions of what made a result, as details of a report."""
    return {
        "made by" if len(made_by) == 1 else f"made by ({number})": ", ".join(
            f"{name} {version}" for name, version in versions.items()
        )
        for number, versions in enumerate(made_by, start=1)
    }


def _details(outcome: Outcome) -> dict[str, str]:
    """Return hash, seed, engine, versions and commands of a study."""
    study, folder = outcome.result.study, outcome.result.store.folder
    details = {"study": study.hash, "seed": str(study.seed), "engine": study.motion}
    if outcome.replicate is not None:
        second = outcome.replicate.study
        details["second block"] = f"seed {second.seed}, {second.runs} runs per cell"
    details |= versions_in_words(outcome.result.store.made_by)
    return details | {"again": f"vibroswarm sweep '{folder}/study.toml' --out '{folder}'"}
