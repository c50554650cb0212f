"""The report of a study: one page that is opened from disk, and its pictures as files with their numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Final

import polars as pl

from vibroswarm.csv_text import csv_bytes
from vibroswarm.files import whole_folder
from vibroswarm.page.report import (
    Column,
    Report,
    ReportPicture,
    ReportTable,
    Section,
    picture_of,
    write_report,
)
from vibroswarm.study.compare import comparison_table
from vibroswarm.study.outcome import Outcome
from vibroswarm.study.pictures import Named, pictures_of
from vibroswarm.study.references import References, reference_table

PICTURES: Final = "pictures"
MARKER: Final = "captions.csv"
"""The file by which the folder of pictures is known to be ours, and may be replaced."""
REPORT: Final = "report.html"

_SECTIONS: Final = (
    ("Outcome", ("outcomes", "decision_time_s", "belief_in_truth", "robots_right", "heat", "detection")),
    ("Decisions over time", ("incidence", "consensus", "belief")),
    ("Compared run by run", ("compared",)),
    ("Time against error", ("front",)),
    ("How the robots sampled", ("density",)),
)
"""Headings, and the beginnings of the names of their pictures."""

_SHARES: Final = (
    "swarm_right",
    "swarm_wrong",
    "swarm_split",
    "swarm_incomplete",
    "robots_right",
    "robots_undecided",
)


def write_pictures_and_report(
    outcome: Outcome,
    references: Sequence[References],
    folder: Path,
    style: str,
    tell: Callable[[float], None] | None = None,
) -> None:
    """Write ``pictures/`` (SVG, PDF, PNG, CSV) and ``report.html`` into a study's folder, each whole.

    Args:
        style: of the picture files; those of the page are its own. tell: called with the share done.
    """
    drawn, named = [], list(pictures_of(outcome))
    with whole_folder(folder / PICTURES, replace=True, marker=MARKER) as part:
        for done, one in enumerate(named):
            one.draw(style).write(part / one.name)
            drawn.append((one, picture_of(one.draw("page"), one.name)))
            if tell is not None:
                tell((done + 1) / len(named))
        rows = [(one.name, one.title, picture.caption) for one, picture in drawn]
        captions = pl.DataFrame(rows, schema=["name", "title", "caption"], orient="row")
        (part / MARKER).write_bytes(csv_bytes(captions))
    write_report(folder / REPORT, report_of(outcome, references, drawn))


def report_of(
    outcome: Outcome, references: Sequence[References], drawn: Iterable[tuple[Named, ReportPicture]]
) -> Report:
    """The report, from what was summed up and drawn."""
    pictures = list(drawn)
    sections = []
    for title, names in _SECTIONS:
        parts = [
            Section(one.title, parts=(picture,))
            for one, picture in pictures
            if one.name.startswith(names) and not (title != "Outcome" and one.name in _SECTIONS[0][1])
        ]
        text, tables = _words(title), _tables(title, outcome, references)
        if title == "Time against error":
            text += _said_of_known(references)
        if parts or tables:
            sections.append(Section(title, text, tuple(tables), tuple(parts)))
    sections.append(_decidability(outcome))
    study = outcome.result.study
    return Report(
        title=study.name or "Study",
        lead=_lead(outcome),
        warnings=tuple(outcome.warnings),
        sections=tuple(sections),
        details=_details(outcome),
    )


def _lead(outcome: Outcome) -> tuple[str, ...]:
    study, cells = outcome.result.study, outcome.cells
    runs = sorted({one.summary.runs for one in cells})
    each = f"{runs[0]:,}" if len(runs) == 1 else f"{runs[0]:,} to {runs[-1]:,}"
    varied = ", ".join(f"`{name}`" for name in study.varied) or "nothing"
    first = f"{len(cells)} cells of {each} runs each; varied: {varied}."
    how = (
        "Every figure stands with its 95 % interval. The unit is the run, since the robots of one run hear each other. "
        "A run or robot without a decision is shown as such, and counts in a mean time with its whole time."
    )
    return first, how


def _words(title: str) -> tuple[str, ...]:
    if title == "Compared run by run":
        return (
            "Cells of one seed have the same motion and noise run by run, so that differences are those of runs. "
            "Intervals by sign flips; p-values are corrected over all comparisons (Holm). `again` is the same on other "
            "seeds, with fresh motion and floors: a difference is confirmed only if both show it.",
            "A difference that is not shown to be there is not shown to be absent.",
        )
    if title == "Time against error":
        return (
            "Beside each strategy stand two references on the same samples: pooled counting (all bits at once in one "
            "place, at the strategy's own error), and what could be known from all bits with their places, by who "
            "knows the sensor and the fill ratio but not the side of the boundary, with a posterior error of 5 %.",
            "No rule on the same bits that is as sure in every run decides sooner, where floors are drawn as that "
            "prior has them. A strategy with another error is not held to it. For what could be known every second run "
            "is on a floor of the mirrored fill ratio, across the boundary: over both sides `known wrong` is to be "
            "expected at `known claimed`, the mean posterior error when it was known, somewhat less than 5 %.",
        )
    return ()


def _said_of_known(references: Sequence[References]) -> tuple[str, ...]:
    """Why there is no figure, or what it does not hold for: each sentence with the cells that it is of."""
    cells: dict[str, list[str]] = {}
    for one in references:
        for sentence in one.says:
            cells.setdefault(sentence, []).append(one.cell.name)
    return tuple(
        sentence if len(of) == len(references) else f"{', '.join(of)}: {sentence}"
        for sentence, of in cells.items()
    )


def _tables(title: str, outcome: Outcome, references: Sequence[References]) -> list[ReportTable]:
    if title == "Outcome":
        return [_outcome_table(outcome)]
    if title == "Compared run by run" and outcome.comparisons:
        return _comparison_tables(outcome)
    if title == "Time against error" and references:
        return [_reference_table(references)]
    if title == "How the robots sampled":
        return [_walk_table(outcome, references)]
    return []


def _outcome_table(outcome: Outcome) -> ReportTable:
    columns = {name: Column(name.replace("_", " "), percent=True) for name in _SHARES}
    columns |= {
        "decision_time_s": Column("decision time", "s"),
        "decision_time_s_low": Column("from", "s"),
        "decision_time_s_high": Column("to", "s"),
        "belief_in_truth": Column("belief in truth"),
        "icc_decision_time": Column("intra-run correlation of time", digits=2),
    }
    frame = outcome.table.select("name", "runs", *columns)
    caption = (
        "Shares by Wilson and bootstrap over runs; all limits are in the CSV of the study, `summary.csv`."
    )
    return ReportTable(frame, columns, caption, "outcome")


def _comparison_tables(outcome: Outcome) -> list[ReportTable]:
    """One a figure: differences of times and of shares have no common scale."""
    table = comparison_table(outcome.comparisons)
    wanted = ["name", "difference", "difference_low", "difference_high", "wins", "ties", "losses", "p_holm"]
    wanted += [name for name in ("again_difference", "confirmed") if name in table.columns]
    found = []
    for figure, words, percent in _COMPARED:
        unit = "" if percent else "s"
        heads = {"": "difference", "_low": "from", "_high": "to"}
        columns = {f"difference{end}": Column(head, unit, percent=percent) for end, head in heads.items()}
        columns |= {
            "again_difference": Column("again", unit, percent=percent),
            "p_holm": Column("p, corrected", digits=2),
        }
        rows = table.filter(pl.col("figure") == figure).select(wanted)
        found.append(ReportTable(rows, columns, f"{words}: first less second.", f"compared-{figure}"))
    return found


_COMPARED: Final = (
    ("decision_time_s", "Decision time", False),
    ("right_share", "Share of robots right", True),
    ("wrong_share", "Share of robots wrong", True),
    ("undecided_share", "Share of robots undecided", True),
)


def _reference_table(references: Sequence[References]) -> ReportTable:
    table = reference_table(list(references))
    limits = [name for name in table.columns if name.endswith(("_low", "_high"))]
    shares = ("strategy_error", "pooled_error", "known", "known_wrong", "known_claimed")
    columns = {name: Column(name.replace("_", " "), percent=True) for name in shares}
    shown = table.drop("cell", "lag_one", "packet_loss", *limits)
    runs = max(one.runs for one in references)
    caption = f"From {runs} runs a cell, made again from the seed; half of them tuned the pooled threshold."
    errors = [one.known.monte_carlo_error for one in references if one.known and one.known.how == "chains"]
    if errors:
        by_chains = max(
            one.known.runs.height for one in references if one.known and one.known.how == "chains"
        )
        caption += (
            f" What could be known: from {by_chains} of them where edges are felt or tiles or robots differ; there the "
            f"posterior is sampled, with a Monte Carlo error of at most {max(errors):.3f} at a decision."
        )
    return ReportTable(shown, {k: v for k, v in columns.items() if k in shown.columns}, caption, "references")


def _walk_table(outcome: Outcome, references: Sequence[References]) -> ReportTable:
    rows = []
    by_cell = {one.cell.number: one for one in references}
    for one in outcome.cells:
        row = {
            "name": one.cell.name,
            **{k: v for k, v in one.walk.items() if not k.endswith(("_low", "_high"))},
        }
        more = by_cell.get(one.cell.number)
        row["lag-1 correlation"] = None if more is None else more.as_row()["lag_one"]
        row["packet loss"] = None if more is None else more.as_row()["packet_loss"]
        rows.append(row)
    columns = {
        "avoid_per_sample_s": Column("avoidance per sample", "s"),
        "distance_m": Column("between samples", "m"),
        "spacing_s": Column("between samples", "s"),
        "ones": Column("read as vibrating", percent=True),
        "effective_samples": Column("effective number of looks at the floor"),
        "packet loss": Column("packet loss", percent=True),
    }
    return ReportTable(pl.DataFrame(rows, infer_schema_length=None), columns, "Means over runs.", "sampling")


def _decidability(outcome: Outcome) -> Section:
    rows = []
    for one in outcome.cells:
        found = one.decidable
        rows.append(
            {
                "name": one.cell.name,
                "can it be decided": found.verdict,
                "share of ones expected": found.share,
                "boundary": found.boundary,
                "readings are held against": found.tested,
                "threshold": found.threshold,
                "mends from": found.mending_low,
                "mends to": found.mending_high,
                "samples for 5 %": found.samples_needed,
            }
        )
    text = (
        "From the sensor's error rates, the floor and the boundary: which share of ones the swarm will see. If that "
        "lies on the wrong side of what readings are held against, more samples make the wrong answer surer. "
        "`samples` are independent ones.",
    )
    return Section("Can it be decided at all", text, (ReportTable(pl.DataFrame(rows), name="decidability"),))


def _details(outcome: Outcome) -> dict[str, str]:
    study = outcome.result.study
    made = outcome.result.store.made_by
    details = {"study": study.hash, "seed": str(study.seed), "engine": study.motion}
    if outcome.again is not None:
        details["second block"] = f"seed {outcome.again.study.seed}, {outcome.again.study.runs} runs a cell"
    for number, versions in enumerate(made):
        words = ", ".join(f"{name} {version}" for name, version in versions.items())
        details["made by" if len(made) == 1 else f"made by ({number + 1})"] = words
    details["again"] = (
        f"vibroswarm sweep '{outcome.result.store.folder}/study.toml' --out '{outcome.result.store.folder}'"
    )
    return details
