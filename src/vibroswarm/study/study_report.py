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
from vibroswarm.study.baselines import References, reference_table
from vibroswarm.study.cell_comparison import comparison_table
from vibroswarm.study.pictures import NamedPicture, pictures_of
from vibroswarm.study.summary import Outcome

PICTURES: Final = "pictures"
MARKER: Final = "captions.csv"
"""The file by which the folder of pictures is known to be ours, and may be replaced."""
REPORT: Final = "report.html"

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

    outcomes = shown("outcomes", "decision_time_s", "belief_in_truth", "robots_right", "heat", "detection")
    sampling = (_walk_table(outcome, references),)
    compared = tuple(_comparison_tables(outcome)) if outcome.comparisons else ()
    reference_tables = (_reference_table(references),) if references else ()
    sections = [
        Section("Outcome", (), (_outcome_table(outcome),), outcomes),
        Section("Decisions over time", sections=shown("incidence", "consensus", "belief")),
        Section("Compared run by run", _COMPARISON_TEXT, compared, shown("compared")),
        Section(
            "Time against error",
            _REFERENCE_TEXT + _reference_notes(references),
            reference_tables,
            shown("front"),
        ),
        Section("How the robots sampled", (), sampling, shown("density")),
    ]
    study = outcome.result.study
    return Report(
        title=study.name or "Study",
        lead=_lead(outcome),
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
    """Write the introduction of a study's report."""
    study, cells = outcome.result.study, outcome.cells
    varied = ", ".join(f"`{name}`" for name in study.varied) or "nothing"
    runs = count_range(cell_outcome.summary.runs for cell_outcome in cells)
    return (
        f"{len(cells)} cells of {runs} runs each; varied: {varied}.",
        "Every figure has a 95 % interval. The unit is the run, since the robots of a run influence each other. A run "
        "or robot without a decision counts as undecided, and enters a mean time with the full length of the run.",
    )


_COMPARISON_TEXT: Final = (
    "Cells with one seed have the same motion and noise in each run, so they are compared in pairs of runs. "
    "Intervals are from sign flips; p-values are corrected over all comparisons (Holm). `again` repeats the comparison "
    "on other seeds, with fresh motion and floors: a difference is confirmed only if both show it.",
    "No significant difference is not evidence of no difference.",
)
_REFERENCE_TEXT: Final = (
    "Each strategy is compared with two references on the same samples: pooled counting (all bits in one place at "
    "once, at the strategy's own error), and what could be known from all bits and their positions, given the sensor "
    "and the fill ratio but not the side of the boundary, at a posterior error of 5 %.",
    "No rule that uses the same bits and is as sure in every run decides sooner, if floors are drawn from that prior. "
    "The bound does not apply to a strategy with another error. For what could be known, every second run is on a "
    "floor with the fill ratio mirrored across the boundary: over both sides the expected value of `known wrong` is "
    "`known claimed`, the mean posterior error at the time of knowing, which is slightly below 5 %.",
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
    """Tabulate the outcomes by cell."""
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
    """Tabulate each figure by itself: differences in times and in shares have no common scale."""
    table = comparison_table(outcome.comparisons)
    selected = ["name", "difference", "difference_low", "difference_high", "wins", "ties", "losses", "p_holm"]
    selected += [name for name in ("again_difference", "confirmed") if name in table.columns]
    tables = []
    for figure, words, percent in _COMPARED:
        unit = "" if percent else "s"
        heads = {"": "difference", "_low": "from", "_high": "to"}
        columns = {f"difference{end}": Column(head, unit, percent=percent) for end, head in heads.items()}
        columns |= {
            "again_difference": Column("again", unit, percent=percent),
            "p_holm": Column("p, corrected", digits=2),
        }
        rows = table.filter(pl.col("figure") == figure).select(selected)
        tables.append(ReportTable(rows, columns, f"{words}: first - second.", f"compared-{figure}"))
    return tables


_COMPARED: Final = (
    ("decision_time_s", "Decision time", False),
    ("right_share", "Share of robots right", True),
    ("wrong_share", "Share of robots wrong", True),
    ("undecided_share", "Share of robots undecided", True),
)


def _reference_table(references: Sequence[References]) -> ReportTable:
    """Tabulate the references by cell."""
    table = reference_table(list(references))
    limits = [name for name in table.columns if name.endswith(("_low", "_high"))]
    shares = ("strategy_error", "pooled_error", "known", "known_wrong", "known_claimed")
    columns = {name: Column(name.replace("_", " "), percent=True) for name in shares}
    figures = table.drop("cell", "lag_one", "packet_loss", *limits)
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
    return ReportTable(
        figures, {k: v for k, v in columns.items() if k in figures.columns}, caption, "references"
    )


def _walk_table(outcome: Outcome, references: Sequence[References]) -> ReportTable:
    """Tabulate how the robots sampled, by cell."""
    by_cell = {reference.cell.number: reference for reference in references}
    rows = []
    for cell_outcome in outcome.cells:
        means = {k: v for k, v in cell_outcome.walk.items() if not k.endswith(("_low", "_high"))}
        more = by_cell[cell_outcome.cell.number].as_row() if cell_outcome.cell.number in by_cell else {}
        correlation, loss = more.get("lag_one"), more.get("packet_loss")
        rows.append(
            {"name": cell_outcome.cell.name, **means, "lag-1 correlation": correlation, "packet loss": loss}
        )
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
    """Lay out whether each cell can be decided."""
    rows = [
        {
            "name": cell_outcome.cell.name,
            "can it be decided": cell_outcome.decidable.verdict,
            "share of ones expected": cell_outcome.decidable.share,
            "boundary": cell_outcome.decidable.boundary,
            "readings are held against": cell_outcome.decidable.tested,
            "threshold": cell_outcome.decidable.threshold,
            "mends from": cell_outcome.decidable.mending_low,
            "mends to": cell_outcome.decidable.mending_high,
            "samples for 5 %": cell_outcome.decidable.samples_needed,
        }
        for cell_outcome in outcome.cells
    ]
    text = (
        "The share of ones that the swarm will read, from the sensor's error rates, the floor and the boundary. If it "
        "lies on the wrong side of what readings are held against, more samples only make the wrong answer more "
        "certain. `samples` are independent ones.",
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
