"""The document of the reproduction: a verdict on each claim of the paper, then its figures and tables.

A column of the reproduction is a preset.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

import polars as pl

from vibroswarm.core.numbers import count, verb
from vibroswarm.documents.knowledge import told
from vibroswarm.paper.claims import CANNOT, CHECKED, VERDICTS, Decided
from vibroswarm.paper.columns import COLUMNS
from vibroswarm.paper.item import Settings, TableView
from vibroswarm.paper.reproduce import ItemResult, Reproduction
from vibroswarm.paper.reproduction_tables import cells_table, claims_table, command_of, command_of_all
from vibroswarm.show.document import Column, Document, Part, Section, Table, Text, Tone
from vibroswarm.simulation import versions

ROWS_IN_SIGHT: Final = 12
"""Tables with more rows are folded, below the pictures of the same item."""
ROWS_WITHOUT_PICTURES: Final = 40
"""In items without pictures, tables with more rows are folded."""
ENOUGH: Final = 1000
"""Number of runs that the claims' margins were set for."""


def reproduction_document(made: Reproduction) -> Document:
    """Return what a reproduction says: how many claims hold, the verdict on each, and a section for each item."""
    settings, decided = made.settings, made.decided
    return Document(
        title="The paper, reproduced",
        answer=(*_verdict_counts(decided), _few_runs(decided, settings)),
        knew=told(cell.scenario for cell in made.cells.values()),
        warnings=_warnings(made),
        parts=(
            Text(
                "Does the paper's own model give what the paper says? "
                f"{count(settings.runs, 'run')} per cell, seed {settings.seed}."
            ),
            _verdicts(decided, settings, command_of_all(made)),
            *(_item(one, decided, settings) for one in made.made),
        ),
        made_by={"command": command_of_all(made), "seed": str(settings.seed), **versions()},
        data={"claims": claims_table(decided), "claims-measured": cells_table(decided)},
    )


def _verdict_counts(decided: Sequence[Decided]) -> list[str]:
    sentences = []
    for column in COLUMNS:
        parts = []
        for kind, words in (("claim", VERDICTS), ("check", CHECKED.values())):
            found = [one.verdict for one in decided if one.column == column and one.claim.kind == kind]
            parts += [f"of {count(len(found), kind)} {_counted(found, words)}"] if found else []
        sentences += [f"Preset {column}: {'; '.join(parts)}."] if parts else []
    return sentences


def _counted(found: Sequence[str], words: Iterable[str]) -> str:
    """Write how often each word was found, in the order of ``words``: ``3 reproduced, 1 inconclusive``."""
    return ", ".join(f"{found.count(word)} {word}" for word in dict.fromkeys(words) if word in found)


def _few_runs(decided: Sequence[Decided], settings: Settings) -> str:
    """Return the advice to use more runs, if verdicts are inconclusive and there are fewer runs than ``ENOUGH``."""
    unsure = sum(one.verdict == "inconclusive" for one in decided)
    if not unsure or settings.runs >= ENOUGH:
        return ""
    verdicts = f"{count(unsure, 'verdict')} {verb(unsure, 'are', 'is')} inconclusive"
    return f"{verdicts}: {count(settings.runs, 'run')} are too few to decide; use --runs {ENOUGH}."


def _warnings(made: Reproduction) -> tuple[str, ...]:
    return tuple(f"{one.item.name}: skipped. {one.skipped}" for one in made.made if one.skipped)


def _verdicts(decided: Sequence[Decided], settings: Settings, command: str) -> Section:
    """Return the section with the verdicts on all claims and checks."""
    tables = []
    for kind, caption in _CAPTIONS.items():
        frame = _claims_in_words(decided, settings, kind=kind)
        if frame is not None:
            caption = caption.format(command)
            tables.append(Table(frame.drop("measured"), _CLAIMS, caption, f"{kind}s"))
    if not tables:
        return Section("Verdicts", (Text("No claim was measured."),))
    measured = Table(cells_table(decided), _CELLS, name="claims-measured", names=3)
    return Section(
        "Verdicts",
        (
            *tables,
            Section("How verdicts are found", (Text(_RULE), Text(_PRINTED)), wide=True),
            Section("Measured values of each claim", (measured,), folded=True),
        ),
    )


_RULE: Final = (
    "A claim is reproduced if the whole interval of each of its values lies within the bounds set beforehand; not "
    "reproduced if none does and at least one lies wholly outside; in part if at least one lies within and at least "
    "one outside. It cannot be asked where the preset's floors or sensor do not allow the question, where evenly "
    "scattered points would hold as well, or where the published values are too uncertain. Otherwise it is "
    "inconclusive: more runs may settle it. Intervals are corrected for the number of claims of a preset (Holm) and, "
    "except for 'reproduced', for the number of values of a claim."
)
_PRINTED: Final = (
    "Every number here was computed, except those called printed or published, which are the paper's. The caption of "
    "each table has the command that makes it; rows of cells have their own command in the CSV."
)
_CAPTIONS: Final = {
    "claim": "Claims of the paper, with the measured value and its corrected interval, or the range of several. "
    "Command: `{}`",
    "check": "Checks, which do not count as verdicts: constants of a preset, two numbers of the paper, or one search. "
    "Command: `{}`",
}
"""Captions of the tables of verdicts, by kind of claim; {} becomes the command of the reproduction."""
_TONES: Final[dict[str, Tone]] = {
    "reproduced": "good", "in part": "fair", "not reproduced": "bad", "inconclusive": "open", CANNOT: "open",
    "passed": "good", "failed": "bad", "open": "open",
}  # fmt: skip
_CLAIMS: Final = {
    "claim": Column(prose=True),
    "measured": Column(prose=True),
    "holds if": Column(wide=True),
    "id": Column(wide=True),
    "why not": Column(prose=True, wide=True),
} | {column: Column(tones=_TONES) for column in COLUMNS}
_CELLS: Final = {
    "estimate": Column("value", limits=("low", "high")),
    "level": Column("level", decimals=6),
    "holds": Column("state", tones={"holds": "good", "fails": "bad", "open": "open", CANNOT: "open"}),
    "why": Column("why not", prose=True),
}  # fmt: skip


def _claims_in_words(
    decided: Sequence[Decided],
    settings: Settings,
    items: Sequence[str] | None = None,
    kind: str | None = None,
) -> pl.DataFrame | None:
    """Return a table of claims with a column for each preset that has verdicts: the verdict, and below it the value.

    Args:
        items, kind: which claims, as for ``claims_table``.
    Returns: None if there is no such claim.
    """
    claims = claims_table(decided, items, kind)
    if claims.is_empty():
        return None
    shown = [column for column in settings.columns if claims[column].null_count() < claims.height]
    reasons = [pl.format("{}: {}", pl.lit(column), f"{column}: why not") for column in shown]
    frame = claims.select(
        pl.col("says").alias("claim"),
        "measured",
        "holds if",
        *(pl.format("{}:\n{}", column, f"{column}: ours").alias(column) for column in shown),
        pl.col("claim").alias("id"),
        pl.concat_str(reasons, separator="\n", ignore_nulls=True).replace("", None).alias("why not"),
    )
    return frame.drop("why not") if frame["why not"].null_count() == frame.height else frame


def _item(one: ItemResult, decided: Sequence[Decided], settings: Settings) -> Section:
    """Return the section of one item: text, claims, short tables, pictures, then folded tables and pictures."""
    title, about = f"{one.item.number}. {one.item.title}", tuple(map(Text, one.item.about))
    if one.skipped:
        return Section(title, (*about, Text(f"Skipped: {one.skipped}")), wide=True)
    pictures = list(one.item.pictures(one.tables, settings))
    in_sight = ROWS_IN_SIGHT if pictures else ROWS_WITHOUT_PICTURES
    tables = _tables(one, settings)
    long = tuple(table for table in tables if table.frame.height > in_sight)
    others = tuple(picture.figure for picture in pictures if picture.folded)
    parts: tuple[Part, ...] = (
        *about,
        *_claims_of_item(one, decided, settings),
        *(table for table in tables if table.frame.height <= in_sight),
        *(picture.figure for picture in pictures if not picture.folded),
        Section("All numbers", long, folded=True),
        Section("Pictures of the other presets", others, folded=True, side_by_side=True),
    )
    return Section(title, parts, wide=True, side_by_side=len(pictures) > 1)


def _claims_of_item(one: ItemResult, decided: Sequence[Decided], settings: Settings) -> list[Table]:
    frame = _claims_in_words(decided, settings, [one.item.name])
    words = "Claims, with the measured value and its corrected interval, or the range of several."
    caption = f"{words} {_command(one, settings)}"
    return [] if frame is None else [Table(frame.drop("id"), _CLAIMS, caption, f"{one.item.name}-claims")]


def _command(one: ItemResult, settings: Settings) -> str:
    return f"Command: `{command_of(settings, one.item.name)}`."


def _tables(one: ItemResult, settings: Settings) -> list[Table]:
    """Return the tables of an item that have rows: some are not made for presets that were not requested."""
    return [
        _table(one.tables[view.table], view, f"{one.item.name}-{place}", _command(one, settings))
        for place, view in enumerate(one.item.shown, start=1)
        if view.table in one.tables and not one.tables[view.table].is_empty()
    ]


def _table(frame: pl.DataFrame, view: TableView, name: str, command: str) -> Table:
    """Return a table of an item, with commands in its caption.

    Args:
        name: file name, without suffix, of the CSV that the page's link saves; not a file in ``tables/``.
        command: sentence with the command that makes the item.
    """
    caption = f"{view.caption} {command}"
    if "command" in frame.columns:
        caption += f" First row: `{frame['command'][0]}`."
    # not every table of cells has every column of a form: "printed_s", for example, exists only in some
    columns = {title: column for title, column in view.columns.items() if title in frame.columns}
    limits = [end for column in columns.values() for end in column.limits or ()]
    return Table(frame.select(*columns, *limits), columns, caption, name)
