"""Write the report of the reproduction: one page, figures as SVG and PDF, tables and numbers as CSV."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import polars as pl

from vibroswarm.core.atomic_io import whole_folder
from vibroswarm.core.tables import csv_bytes
from vibroswarm.paper.claims import CANNOT, CHECKED, VERDICTS, Claim, Decided, all_claims
from vibroswarm.paper.columns import COLUMNS, CONTROLS
from vibroswarm.paper.item import CLAIMS, Settings, TableView
from vibroswarm.paper.reproduce import ItemResult, Reproduction
from vibroswarm.plots import write_picture
from vibroswarm.report.html import Column, Report, ReportPicture, ReportTable, Section, write_report
from vibroswarm.simulation import versions

REPORT: Final = "report.html"
FIGURES, TABLES = "figures", "tables"
MARKER: Final = "index.csv"
ROWS_IN_SIGHT: Final = 12
"""Longer tables are folded below the pictures that show them."""
ROWS_WITHOUT_PICTURES: Final = 40
"""The same for items without pictures."""
ENOUGH: Final = 1000
"""Runs for which the margins were set."""
Progress = Callable[[float], None]


class DrawnPicture(NamedTuple):
    """A picture of the page."""

    title: str
    picture: ReportPicture
    folded: bool


def write_all(
    made: Reproduction, folder: Path, progress: Progress = lambda share: None, *, pictures: bool = True
) -> None:
    """Write ``figures/``, ``tables/`` and ``report.html`` into ``folder``, each whole or not at all."""
    decided = made.decided
    _write_tables(made, decided, folder / TABLES)
    drawn = _write_figures(made, folder / FIGURES, progress) if pictures else {}
    write_report(folder / REPORT, report_of(made, decided, drawn))


def command_of(settings: Settings, item: str | None = None) -> str:
    """Return the command that makes one item, or all."""
    words = ["vibroswarm reproduce"]
    words += [f"--only {item}"] if item else []
    words += [f"--runs {settings.runs}", f"--seed {settings.seed}"]
    words += [f"--columns {','.join(settings.columns)}"] if settings.columns != COLUMNS else []
    words += [f"--control {settings.control}"] if settings.control else []
    words += ["--recordings DIR"] if settings.recordings and item in (None, "calibration") else []
    return " ".join([*words, "--out DIR"])


def claims_table(
    decided: Sequence[Decided], items: Iterable[str] | None = None, kind: str | None = None
) -> pl.DataFrame:
    """Return one row per claim, one verdict per column; null where it is not asked or was not measured.

    Args:
        items: only claims of these items. kind: only claims or only checks.
    """
    requested = None if items is None else set(items)
    rows = []
    for claim in all_claims():
        of_claim = [verdict for verdict in decided if verdict.claim is claim]
        if (
            not of_claim
            or (requested is not None and claim.item not in requested)
            or kind not in (None, claim.kind)
        ):
            continue
        row: dict[str, str | None] = {"item": claim.item, "claim": claim.id, "kind": claim.kind}
        remark = f"; a control may well not turn it: {claim.no_control}" if claim.no_control else ""
        row |= {"says": claim.statement}
        row |= {"measured": claim.measured + remark, "holds if": claim.words}
        for column in COLUMNS:
            of_column = [verdict for verdict in of_claim if verdict.column == column]
            row[column] = _verdict_words(of_column[0]) if of_column else None
            row[f"{column}: ours"] = _value_words(of_column[0]) if of_column else None
        rows.append(row)
    each = (f"{column}{end}" for column in COLUMNS for end in ("", ": ours"))
    names = ("item", "claim", "kind", "says", "measured", "holds if", *each)
    return pl.DataFrame(rows, schema=dict.fromkeys(names, pl.String))


def _verdict_words(one: Decided) -> str:
    """Return verdict with the number of values in each state."""
    states = one.cells["holds"].to_list()
    if len(set(states)) == 1 and (one.verdict in ("reproduced", "passed", CANNOT) or len(states) == 1):
        return one.verdict
    words = {"holds": "hold", "fails": "fail", "open": "open", CANNOT: CANNOT}
    parts = [f"{states.count(name)} {word}" for name, word in words.items() if name in states]
    return f"{one.verdict} ({', '.join(parts)})"


def _value_words(one: Decided) -> str:
    """Return the value with its interval, or the range of several; reasons why others cannot be asked."""
    cells = one.cells
    reasons = cells["why"].drop_nulls().unique(maintain_order=True).to_list()
    estimated = cells.filter(pl.col("why").is_null(), pl.col("estimate").is_not_nan())
    known = [f"{_range_words(estimated, one.claim)} {one.claim.unit}"] if estimated.height else []
    return "; ".join(known + reasons) or "-"


def _range_words(cells: pl.DataFrame, claim: Claim) -> str:
    """Write the range of several estimates, or a single one with its interval if it has one."""
    values = [claim.scale * value for value in cells["estimate"]]
    decimals = _decimals(claim)
    if len(values) > 1:
        return f"{min(values):.{decimals}f} to {max(values):.{decimals}f}"
    low, high = cells.select("low", "high").row(0)
    limits = [f"{claim.scale * end:.{decimals}f}" for end in (low, high) if end is not None and low != high]
    return f"{values[0]:.{decimals}f}" + (f" [{', '.join(limits)}]" if len(limits) == 2 else "")


def _decimals(claim: Claim) -> int:
    """Return the decimals of a claim's values: one more than its margin or effect has, at least those of its unit.

    One fewer for times whose margin or effect is 10 s or more.
    """
    bound = claim.scale * (claim.margin if claim.margin is not None else claim.effect or 0.0)
    digits = len(f"{abs(bound):.6f}".rstrip("0").partition(".")[2]) + 1
    return max(digits if bound else 0, {"s": 0, "points": 1, "%": 1, "m": 4}.get(claim.unit, 3)) - (
        1 if claim.unit == "s" and abs(bound) >= 10 else 0
    )


def cells_table(decided: Sequence[Decided]) -> pl.DataFrame:
    """Return one row for each claim, column and value, with the interval that decided it."""
    frames = [
        verdict.cells.select(
            pl.lit(verdict.claim.id).alias("claim"), pl.lit(verdict.column).alias("column"), "cell",
            "estimate", "low", "high", "level", pl.lit(verdict.claim.words).alias("holds if"),
            pl.lit(verdict.claim.unit if verdict.claim.scale == 1.0 else "share").alias("unit"), "n", "holds", "why",
        )
        for verdict in decided
    ]  # fmt: skip
    return pl.concat(frames) if frames else pl.DataFrame()


def _write_tables(made: Reproduction, decided: Sequence[Decided], folder: Path) -> None:
    """Write all tables as CSV, with an index."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    with whole_folder(folder, replace=True, marker=MARKER) as part:
        rows = []
        named = [
            (f"{entry.item.name}-{name}" if name != entry.item.name else name, entry, frame)
            for entry in made.made
            for name, frame in entry.tables.items()
            if name != CLAIMS
        ]
        for name, entry, frame in named:
            (part / f"{name}.csv").write_bytes(csv_bytes(frame))
            rows.append((name, entry.item.title, command_of(made.settings, entry.item.name)))
        for name, frame in (("claims", claims_table(decided)), ("claims-measured", cells_table(decided))):
            (part / f"{name}.csv").write_bytes(csv_bytes(frame))
            rows.append((name, "Verdicts", command_of(made.settings)))
        index = pl.DataFrame(rows, schema=["name", "title", "command"], orient="row")
        (part / MARKER).write_bytes(csv_bytes(index))


def _write_figures(made: Reproduction, folder: Path, progress: Progress) -> dict[str, list[DrawnPicture]]:
    """Draw all pictures, write SVG, PDF and CSV, and return those of the page, by item."""
    by_item: dict[str, list[DrawnPicture]] = {}
    todo = [
        (entry, picture)
        for entry in made.made
        if entry.tables
        for picture in entry.item.pictures(entry.tables, made.settings)
    ]
    with whole_folder(folder, replace=True, marker=MARKER) as part:
        rows = []
        for done, (entry, picture) in enumerate(todo):
            drawn = picture.draw()
            write_picture(drawn.figure, drawn.numbers, part / picture.name, ("svg", "pdf"))
            report_picture = ReportPicture(drawn.svg(), drawn.caption, drawn.numbers, picture.name)
            by_item.setdefault(entry.item.name, []).append(
                DrawnPicture(picture.title, report_picture, picture.folded)
            )
            rows.append(
                (picture.name, picture.title, drawn.caption, command_of(made.settings, entry.item.name))
            )
            progress((done + 1) / len(todo))
        index = pl.DataFrame(
            rows, schema=dict.fromkeys(("name", "title", "caption", "command"), pl.String), orient="row"
        )
        (part / MARKER).write_bytes(csv_bytes(index))
    return by_item


def report_of(
    made: Reproduction, decided: Sequence[Decided], pictures: dict[str, list[DrawnPicture]]
) -> Report:
    """Build the report."""
    settings = made.settings
    sections = [_verdicts(decided, settings)]
    sections += [_item(entry, decided, pictures.get(entry.item.name, []), settings) for entry in made.made]
    warnings = [f"{entry.item.title}: skipped. {entry.skipped}" for entry in made.made if entry.skipped]
    if settings.control:
        warnings.insert(0, f"This is a negative control, not the reproduction: {CONTROLS[settings.control]}.")
    return Report(
        title="The paper, reproduced",
        lead=(
            "Does the paper's own model give what the paper says?",
            *_counts(decided),
            *few_runs(decided, settings),
            f"{settings.runs:,} runs per cell, seed {settings.seed}.",
            "Every number here was computed, except those called printed or published, which are the paper's. "
            "The caption of each table has the command that makes it; rows of cells have their own command "
            "in the CSV.",
        ),
        warnings=tuple(warnings),
        sections=tuple(sections),
        details={"command": command_of(settings), "seed": str(settings.seed), **versions()},
    )


def _counts(decided: Sequence[Decided]) -> list[str]:
    """Return the number of claims and checks by verdict, a sentence for each preset."""
    words = []
    for column in COLUMNS:
        of_column = [verdict for verdict in decided if verdict.column == column]
        verdicts = [verdict.verdict for verdict in of_column if verdict.claim.kind == "claim"]
        checks = [verdict.verdict for verdict in of_column if verdict.claim.kind == "check"]
        if verdicts:
            counted = ", ".join(f"{verdicts.count(v)} {v}" for v in VERDICTS if v in verdicts)
            words.append(f"Preset `{column}`: of {len(verdicts)} claims {counted}.")
        if checks:
            counted = ", ".join(f"{checks.count(v)} {v}" for v in _CHECKED if v in checks)
            before = f"{words.pop()} " if verdicts else ""
            words.append(f"{before}Checks: {counted}.")
    return words


def few_runs(decided: Sequence[Decided], settings: Settings) -> list[str]:
    """Return what to do where runs are too few to tell, in a sentence; none where there are ``ENOUGH``."""
    count = sum(one.verdict == "inconclusive" for one in decided)
    if not count or settings.runs >= ENOUGH:
        return []
    return [
        f"{count} verdicts are inconclusive: {settings.runs:,} runs are too few to tell; use --runs {ENOUGH}."
    ]


def _verdicts(decided: Sequence[Decided], settings: Settings) -> Section:
    """Return the section with the verdicts on all claims and checks."""
    tables = []
    for kind, name in (("claim", "claims"), ("check", "checks")):
        table = claims_table(decided, kind=kind).select("says", "holds if", *COLUMNS, "claim")
        table = table.select(*(_typeset(column) for column in table.columns))
        if kind == "claim" or not table.is_empty():
            tables.append(ReportTable(table, _CLAIMS, _CAPTIONS[kind].format(command_of(settings)), name))
    measured = cells_table(decided)
    if measured.height:
        measured = measured.with_columns(_typeset("holds if"))
    return Section(
        "Verdicts",
        text=(
            "A claim is reproduced if the whole interval of each of its values lies within the bounds set "
            "beforehand; not reproduced if none does and at least one lies wholly outside; in part if at least "
            "one lies within and at least one outside. It cannot be asked where the preset's floors or sensor do "
            "not allow the question, with the reason below. Otherwise it is inconclusive: more runs may settle it. "
            "Intervals are corrected for the number of claims of a column (Holm) and, except for 'reproduced', for "
            "the number of values of a claim.",
        ),
        parts=tuple(tables),
        sections=(
            Section(
                "Measured values of each claim",
                parts=(ReportTable(measured, _CELLS, "", "claims-measured", rows_up_to=1000),),
                folded=True,
            ),
        ),
    )


_CHECKED: Final = tuple(dict.fromkeys(CHECKED.values()))
_TONES: Final = {
    "reproduced": "good", "in part": "fair", "not reproduced": "bad", "inconclusive": "open", CANNOT: "open",
    "passed": "good", "failed": "bad", "open": "open",
}  # fmt: skip
_CAPTIONS: Final = {
    "claim": "Command: `{}`",
    "check": "Checks, which do not count as verdicts: constants of a preset, two numbers of the paper, one search, or "
    "ours against ours. Command: `{}`",
}
_CLAIMS: Final = {"says": Column(prose=True), "measured": Column(prose=True)} | {
    column: Column(tones=_TONES) for column in COLUMNS
}


def _typeset(column: str) -> pl.Expr:
    """Typeset text with true minus signs; a verdict starts a new line, the test of a claim does not wrap."""
    text = pl.col(column).str.replace_all(r"(^|\s|\[)-(\d)", "${1}\u2212${2}")
    if column in COLUMNS:
        return text.str.replace(r" \((.*)\)", "\n${1}")
    return text.str.replace_all(" ", "\u00a0") if column == "holds if" else text


_CELLS: Final = {
    "level": Column("level", digits=6), "low": Column("from"), "high": Column("to"),
    "holds": Column("value", tones={"holds": "good", "fails": "bad", "open": "open", CANNOT: "open"}),
    "why": Column("why not", prose=True),
}  # fmt: skip


def _item(
    one: ItemResult, decided: Sequence[Decided], pictures: Sequence[DrawnPicture], settings: Settings
) -> Section:
    """Return the section of one item."""
    title = f"{one.item.number}. {one.item.title}"
    if one.skipped:
        return Section(title, (*one.item.about, f"Skipped: {one.skipped}"))
    alone = f"Command: `{command_of(settings, one.item.name)}`."
    parts: list[ReportTable | ReportPicture] = []
    verdicts = claims_table(decided, [one.item.name])
    if not verdicts.is_empty():
        columns = [column for column in COLUMNS if verdicts[column].null_count() < verdicts.height]
        both = [pl.format("{}\n{}", column, f"{column}: ours").alias(column) for column in columns]
        shown_claims = verdicts.select("says", "measured", "holds if", *both)
        shown_claims = shown_claims.select(*(_typeset(name) for name in shown_claims.columns))
        caption = (
            f"Claims, with the measured value and its corrected interval, or the range of several. {alone}"
        )
        parts.append(ReportTable(shown_claims, _CLAIMS, caption, f"{one.item.name}-claims"))
    long: list[ReportTable] = []
    in_sight = ROWS_IN_SIGHT if pictures else ROWS_WITHOUT_PICTURES
    for place, view in enumerate(one.item.shown):
        table = _table(one, view, f"{one.item.name}-{place + 1}", alone)
        if table is not None:
            (long if table.frame.height > in_sight else parts).append(table)
    below = [Section(drawn.title, parts=(drawn.picture,)) for drawn in pictures if not drawn.folded]
    folded = tuple(Section(drawn.title, parts=(drawn.picture,)) for drawn in pictures if drawn.folded)
    if long:
        below.append(Section("All numbers", parts=tuple(long), folded=True))
    if folded:
        below.append(
            Section("Pictures of the other presets", sections=folded, folded=True, side_by_side=True)
        )
    return Section(title, one.item.about, tuple(parts), tuple(below), side_by_side=len(pictures) > 1)


def _table(one: ItemResult, shown: TableView, name: str, alone: str) -> ReportTable | None:
    """Return a table of an item with the commands that make it; None if it is empty."""
    frame = one.tables[shown.table]
    if frame.is_empty():
        return None
    caption = f"{shown.caption} {alone}"
    if "command" in frame.columns:
        caption += f" First row: `{frame['command'][0]}`."
    columns = [column for column in shown.columns if column in frame.columns]
    return ReportTable(frame.select(columns), shown.columns, caption, name)
