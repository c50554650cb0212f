"""Write the report of the reproduction: one page, tables and numbers as CSV, on request figures as SVG and PDF.

A column of the reproduction is a preset. A claim has one or more measured values in a column (``Decided.cells``), each
of which holds, fails, is open or cannot be asked (``claims``).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import polars as pl

from vibroswarm.core.atomic_io import remove_folder, whole_folder
from vibroswarm.core.tables import csv_bytes
from vibroswarm.paper.claims import CANNOT, CHECKED, VERDICTS, Claim, Decided, all_claims
from vibroswarm.paper.columns import COLUMNS, CONTROLS
from vibroswarm.paper.item import CLAIMS, Settings, TableView
from vibroswarm.paper.reproduce import ItemResult, Reproduction
from vibroswarm.plots import write_picture
from vibroswarm.report.html import Column, Report, ReportPicture, ReportTable, Section, write_report
from vibroswarm.simulation import versions

REPORT: Final = "report.html"
"""File of the page."""
FIGURES, TABLES = "figures", "tables"
"""Folders of the pictures and of the tables."""
MARKER: Final = "index.csv"
"""Index of a folder of figures or tables; it marks folders that may be replaced."""
ROWS_IN_SIGHT: Final = 12
"""Tables with more rows are folded, below the pictures of the same item."""
ROWS_WITHOUT_PICTURES: Final = 40
"""In items without pictures, tables with more rows are folded."""
ENOUGH: Final = 1000
"""Number of runs that the claims' margins were set for."""
Progress = Callable[[float], None]


class DrawnPicture(NamedTuple):
    """A picture of the page, and whether it is shown folded."""

    title: str
    picture: ReportPicture
    folded: bool


def write_all(
    made: Reproduction,
    folder: Path,
    progress: Progress = lambda share: None,
    *,
    pictures: bool = True,
    picture_files: bool = False,
) -> None:
    """Write ``tables/``, ``report.html`` and on request ``figures/`` into ``folder``, each whole or not at all.

    Args:
        made: results of the reproduction. folder: folder to write into.
        progress: called with the share of the pictures that is drawn, 0 to 1.
        pictures: whether the page has pictures.
        picture_files: whether the pictures are written as files, into ``figures/``. If not, an existing ``figures/`` is
            removed, since its pictures may be of other settings.
    """
    decided = made.decided
    _write_tables(made, decided, folder / TABLES)
    drawn: dict[str, list[DrawnPicture]] = {}
    if picture_files:
        with whole_folder(folder / FIGURES, replace=True, marker=MARKER) as part:
            drawn = _draw(made, progress, part)
    elif pictures:
        drawn = _draw(made, progress)
    if (
        not picture_files and (folder / FIGURES / MARKER).is_file()
    ):  # only a folder that this function has written
        remove_folder(folder / FIGURES)
    write_report(folder / REPORT, report_of(made, decided, drawn))


def command_of(settings: Settings, item: str | None = None) -> str:
    """Return the command line that makes one item, or all items.

    Args:
        settings: options of the reproduction. item: name of the item; None: all items.
    """
    words = ["vibroswarm reproduce"]
    words += [f"--only {item}"] if item else []
    words += [f"--runs {settings.runs}", f"--seed {settings.seed}"]
    words += [f"--columns {','.join(settings.columns)}"] if settings.columns != COLUMNS else []
    words += [f"--control {settings.control}"] if settings.control else []
    # Only these items need the recordings.
    recorded = item in (None, "calibration", "unseen-session")
    words += ["--recordings DIR"] if settings.recordings and recorded else []
    return " ".join([*words, "--out DIR"])


def claims_table(
    decided: Sequence[Decided], items: Iterable[str] | None = None, kind: str | None = None
) -> pl.DataFrame:
    """Return one row per claim that has a verdict in at least one column of the reproduction.

    For each column of the reproduction the row has the verdict and, under "COLUMN: ours", the measured value in words.
    The verdict and the value are null if the claim has no verdict in this column: it was not measured, or it is not
    about this column.

    Args:
        decided: verdicts on claims of ``all_claims``; verdicts on other claims are not listed.
        items: names of the items whose claims are listed; None: all.
        kind: "claim" or "check", the kind that is listed; None: both.
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
        remark = (
            f"; a negative control need not change the verdict: {claim.no_control}"
            if claim.no_control
            else ""
        )
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
    """Return the verdict in words, followed by the number of values in each state, such as "2 hold, 1 open".

    The numbers are left out if there is only one value, or if all values have the same state and the verdict shows
    which state it is.
    """
    states = one.cells["holds"].to_list()
    if len(set(states)) == 1 and (one.verdict in ("reproduced", "passed", CANNOT) or len(states) == 1):
        return one.verdict
    words = {"holds": "hold", "fails": "fail", "open": "open", CANNOT: CANNOT}
    parts = [f"{states.count(name)} {word}" for name, word in words.items() if name in states]
    return f"{one.verdict} ({', '.join(parts)})"


def _value_words(one: Decided) -> str:
    """Return the measured value in words: one value with its interval, or the range of several values.

    The reasons why some values cannot be asked follow. The result is "-" if there is neither a value nor a reason.
    """
    cells = one.cells
    reasons = cells["why"].drop_nulls().unique(maintain_order=True).to_list()
    estimated = cells.filter(pl.col("why").is_null(), pl.col("estimate").is_not_nan())
    known = [f"{_range_words(estimated, one.claim)} {one.claim.unit}"] if estimated.height else []
    return "; ".join(known + reasons) or "-"


def _range_words(cells: pl.DataFrame, claim: Claim) -> str:
    """Return the range of several estimates, or one estimate with its interval, in words.

    The interval is left out if one of its limits is infinite, or if it has no width.

    Args:
        cells: rows of ``Decided.cells`` with an estimate, at least one. claim: gives the unit and decimals.
    """
    values = [claim.scale * value for value in cells["estimate"]]
    decimals = _decimals(claim)
    if len(values) > 1:
        return f"{min(values):.{decimals}f} to {max(values):.{decimals}f}"
    low, high = cells.select("low", "high").row(0)
    # Infinite limits are None in ``Decided.cells``. The limits of an exact value are equal.
    limits = [f"{claim.scale * end:.{decimals}f}" for end in (low, high) if end is not None and low != high]
    return f"{values[0]:.{decimals}f}" + (f" [{', '.join(limits)}]" if len(limits) == 2 else "")


def _decimals(claim: Claim) -> int:
    """Return the number of decimals with which a claim's values are printed.

    The number is one more than the claim's margin or effect has, and at least the usual number for the claim's unit. A
    time with a margin or effect of 10 s or more has one decimal fewer than this.
    """
    bound = claim.scale * (claim.margin if claim.margin is not None else claim.effect or 0.0)
    # Decimals of the bound, without zeros at the end, plus one.
    of_bound = len(f"{abs(bound):.6f}".rstrip("0").partition(".")[2]) + 1 if bound else 0
    # Usual decimals of each unit; 3 for all other units, such as beliefs.
    of_unit = {"s": 0, "points": 1, "%": 1, "m": 4}.get(claim.unit, 3)
    is_long_time = claim.unit == "s" and abs(bound) >= 10
    return max(of_bound, of_unit) - (1 if is_long_time else 0)


def cells_table(decided: Sequence[Decided]) -> pl.DataFrame:
    """Return one row for each measured value of each claim in each column, with the interval that decided it.

    Values are not scaled for printing, so percentages are shares, as the column ``unit`` says. Without verdicts the
    table has no columns.
    """
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
    """Write the tables of all items and of the verdicts as CSV, with an index of names, titles and commands.

    A file is named ITEM-TABLE.csv, or ITEM.csv if the table has the name of the item.
    """
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


def _draw(
    made: Reproduction, progress: Progress, folder: Path | None = None
) -> dict[str, list[DrawnPicture]]:
    """Draw all pictures, and return them for the page, by item name.

    Args:
        made: results of the reproduction. progress: called with the share of the pictures that is drawn, 0 to 1.
        folder: where to write them as SVG, PDF and CSV, with an index; None to write no files.
    """
    by_item: dict[str, list[DrawnPicture]] = {}
    todo = [
        (entry, picture)
        for entry in made.made
        if entry.tables
        for picture in entry.item.pictures(entry.tables, made.settings)
    ]
    rows = []
    for done, (entry, picture) in enumerate(todo):
        drawn = picture.draw()
        # The page comes first: each time that a figure is written, its layout is adjusted a little.
        report_picture = ReportPicture(drawn.svg(), drawn.caption, drawn.numbers, picture.name)
        if folder is not None:
            write_picture(drawn.figure, drawn.numbers, folder / picture.name, ("svg", "pdf"))
        by_item.setdefault(entry.item.name, []).append(
            DrawnPicture(picture.title, report_picture, picture.folded)
        )
        rows.append((picture.name, picture.title, drawn.caption, command_of(made.settings, entry.item.name)))
        progress((done + 1) / len(todo))
    if folder is not None:
        schema = dict.fromkeys(("name", "title", "caption", "command"), pl.String)
        (folder / MARKER).write_bytes(csv_bytes(pl.DataFrame(rows, schema=schema, orient="row")))
    return by_item


def report_of(
    made: Reproduction, decided: Sequence[Decided], pictures: dict[str, list[DrawnPicture]]
) -> Report:
    """Build the page: the verdicts, then a section for each item.

    Args:
        made: results of the reproduction. decided: verdicts on all claims. pictures: drawn pictures, by item name.
    """
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
    """Return a text for each column of the reproduction with the numbers of claims and checks by verdict."""
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
            before = f"{words.pop()} " if verdicts else ""  # the sentence about the claims of this column
            words.append(f"{before}Checks: {counted}.")
    return words


def few_runs(decided: Sequence[Decided], settings: Settings) -> list[str]:
    """Return the advice to use more runs, as a list of one sentence.

    The list is empty if no verdict is inconclusive, or if the reproduction has ``ENOUGH`` runs already.
    """
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
"""Results of checks, without repetitions."""
_TONES: Final = {
    "reproduced": "good", "in part": "fair", "not reproduced": "bad", "inconclusive": "open", CANNOT: "open",
    "passed": "good", "failed": "bad", "open": "open",
}  # fmt: skip
_CAPTIONS: Final = {
    "claim": "Command: `{}`",
    "check": "Checks, which do not count as verdicts: constants of a preset, two numbers of the paper, one search, or "
    "ours against ours. Command: `{}`",
}
"""Captions of the tables of verdicts, by kind of claim; {} becomes the command of the reproduction."""
_CLAIMS: Final = {"says": Column(prose=True), "measured": Column(prose=True)} | {
    column: Column(tones=_TONES) for column in COLUMNS
}
"""How the columns of tables of claims are shown."""


def _typeset(column: str) -> pl.Expr:
    """Return an expression that prepares a text column of a table of claims for the page.

    Hyphens before numbers become minus signs. In a column of verdicts, the counts in brackets move to a line of their
    own, without the brackets. In the column "holds if", spaces become spaces at which lines do not break.
    """
    text = pl.col(column).str.replace_all(r"(^|\s|\[)-(\d)", "${1}\u2212${2}")
    if column in COLUMNS:
        return text.str.replace(r" \((.*)\)", "\n${1}")
    return text.str.replace_all(" ", "\u00a0") if column == "holds if" else text


_CELLS: Final = {
    "level": Column("level", digits=6), "low": Column("from"), "high": Column("to"),
    "holds": Column("value", tones={"holds": "good", "fails": "bad", "open": "open", CANNOT: "open"}),
    "why": Column("why not", prose=True),
}  # fmt: skip
"""How the columns of the table of measured values are shown."""


def _item(
    one: ItemResult, decided: Sequence[Decided], pictures: Sequence[DrawnPicture], settings: Settings
) -> Section:
    """Return the section of one item: text, claims, short tables, pictures, then folded tables and pictures.

    Args:
        one: the item with its tables. decided: verdicts on all claims. pictures: drawn pictures of this item.
        settings: options of the reproduction, for the commands.
    """
    title = f"{one.item.number}. {one.item.title}"
    if one.skipped:
        return Section(title, text=(*one.item.about, f"Skipped: {one.skipped}"))
    command = f"Command: `{command_of(settings, one.item.name)}`."
    parts: list[ReportTable | ReportPicture] = []
    verdicts = claims_table(decided, [one.item.name])
    if not verdicts.is_empty():
        # The columns of the reproduction in which a claim of this item has a verdict.
        columns = [column for column in COLUMNS if verdicts[column].null_count() < verdicts.height]
        # A cell of the table has the verdict, and below it the measured value.
        cells = [pl.format("{}\n{}", column, f"{column}: ours").alias(column) for column in columns]
        shown_claims = verdicts.select("says", "measured", "holds if", *cells)
        shown_claims = shown_claims.select(*(_typeset(name) for name in shown_claims.columns))
        caption = (
            f"Claims, with the measured value and its corrected interval, or the range of several. {command}"
        )
        parts.append(ReportTable(shown_claims, _CLAIMS, caption, f"{one.item.name}-claims"))
    long_tables: list[ReportTable] = []
    in_sight = ROWS_IN_SIGHT if pictures else ROWS_WITHOUT_PICTURES
    for place, view in enumerate(one.item.shown):
        table = _table(one, view, f"{one.item.name}-{place + 1}", command)
        if table is not None:
            (long_tables if table.frame.height > in_sight else parts).append(table)
    below = [Section(drawn.title, parts=(drawn.picture,)) for drawn in pictures if not drawn.folded]
    folded = tuple(Section(drawn.title, parts=(drawn.picture,)) for drawn in pictures if drawn.folded)
    if long_tables:
        below.append(Section("All numbers", parts=tuple(long_tables), folded=True))
    if folded:
        below.append(
            Section("Pictures of the other presets", sections=folded, folded=True, side_by_side=True)
        )
    return Section(
        title,
        text=one.item.about,
        parts=tuple(parts),
        sections=tuple(below),
        side_by_side=len(pictures) > 1,
    )


def _table(one: ItemResult, shown: TableView, name: str, command: str) -> ReportTable | None:
    """Return a table of an item for the page, with commands in its caption; None if it has no rows or does not exist.

    An item does not make a table of a column (preset) that was not requested.

    Args:
        one: the item with its tables. shown: the table to show, with its caption and columns.
        name: file name, without suffix, of the CSV that the page's link saves; not a file in ``tables/``.
        command: sentence with the command that makes the item.
    """
    frame = one.tables.get(shown.table)
    if frame is None or frame.is_empty():
        return None
    caption = f"{shown.caption} {command}"
    if "command" in frame.columns:
        caption += f" First row: `{frame['command'][0]}`."
    # Not every table of cells has every column of a form: "printed_s", for example, exists only in some.
    columns = [column for column in shown.columns if column in frame.columns]
    return ReportTable(frame.select(columns), shown.columns, caption, name)
