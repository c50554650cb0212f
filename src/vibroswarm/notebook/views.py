"""Notebook views of public objects: HTML with a title, the most important values, pictures and whole pages."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import is_dataclass
from functools import singledispatch
from typing import TYPE_CHECKING, Any, Final

import polars as pl

from vibroswarm.analysis.verdict import RobotVerdict
from vibroswarm.core.notebook_view import public_values, short_text, short_value
from vibroswarm.documents import document_of
from vibroswarm.documents.run import result_document, run_document
from vibroswarm.errors import shown
from vibroswarm.floors.design import FloorDesign
from vibroswarm.floors.floor import Floor
from vibroswarm.notebook.elements import card, details, image, page, paragraph, rows, table
from vibroswarm.plots.picture import Picture, picture_bytes
from vibroswarm.plots.run import floor_figure, run_figure
from vibroswarm.plots.style import MATPLOTLIB_LOCK
from vibroswarm.result import Result
from vibroswarm.run_page.write import page_html, record_of
from vibroswarm.scenario.scenario import FieldNames, Scenario
from vibroswarm.show.page import fragment_html
from vibroswarm.study.factors import LABEL, PRESET
from vibroswarm.study.spec import Cell, Study
from vibroswarm.study.study_outputs import Comparison, ReportFile
from vibroswarm.study.study_result import StudyResult

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PLAYER_PX: Final = 760
"""Height of the frame with a run's page."""
REPORT_PX: Final = 900
"""Height of the frame with a report."""
MOST_ROWS: Final = 20
"""Largest number of robots, runs, cells or other rows that are listed."""
MOST_COLUMNS: Final = 12
"""Largest number of columns that are listed."""
MOST_LETTERS: Final = 80
"""Longest text in a table."""

LAZY: Final = ("optimize", "league", "calibrate", "paper")
"""Packages that take long to import; their views are in ``lazy_views``."""


def html_of(value: object) -> str:
    """Return the view of an object as HTML: that of its class or nearest base class, or else a table of its values."""
    if not isinstance(value, Result) and (document := document_of(value)) is not None:
        return fragment_html(document)
    # All base classes are tried, as the class may be defined outside of this package. The final dots keep a longer name
    # with the same beginning from matching. ``lazy_views`` imports this module, so it is imported only here.
    lazy = tuple(f"vibroswarm.{package}." for package in LAZY)
    if any(f"{kind.__module__}.".startswith(lazy) for kind in type(value).__mro__):
        from vibroswarm.notebook.lazy_views import lazy_view_of

        if (view := lazy_view_of(value)) is not None:
            return view(value)
    return view_of(value)


@singledispatch
def view_of(value: object) -> str:
    """Return the view of an object; the functions below are registered for one class each."""
    return record(value)


@view_of.register
def _scenario(value: Scenario) -> str:
    """Show the most important fields of a scenario, and all fields as TOML behind a click."""
    return card(
        "Scenario",
        rows(
            {
                "robots": value.swarm.robots,
                "strategy": value.strategy.name,
                "floor": shown(value.floor.source),
                "arena": f"{value.arena.width_m:g} m x {value.arena.height_m:g} m",
                "network": value.network.name,
                "task": value.task.name,
                "up to": f"{value.run.t_end_s:g} s",
                "hash": value.hash,
            }
        ),
        details("All fields (TOML)", value.to_toml()),
    )


@view_of.register
def _floor(value: Floor) -> str:
    return card(
        f"Floor {shown(value.name)}" if value.name else "Floor", paragraph(repr(value)), _floor_image(value)
    )


def _floor_image(floor: Floor) -> str:
    """Return a picture of a floor as an image element."""
    with MATPLOTLIB_LOCK:
        return image(_png(floor_figure(floor.tiles)), "png", f"{floor!r}", 280)


@view_of.register
def _floor_design(value: FloorDesign) -> str:
    """Show a designed floor as a picture, with the measures of its difficulty."""
    measures = value.difficulty
    with MATPLOTLIB_LOCK:
        picture = image(_png(floor_figure(value.tiles)), kind="png", words=value.words, width_px=280)
    numbers = {
        "fill ratio": f"{measures.fill_ratio:.3f} ({measures.ones} of {value.tiles.size} tiles)",
        "Moran index": f"{measures.moran_index:.3f}",
        "entropy": f"{measures.entropy:.3f}",
        "clusters": f"{measures.clusters}; the largest has {measures.largest_cluster} tiles",
    }
    return card("Designed floor", paragraph(value.words), rows(numbers), picture)


def _png(figure: Figure) -> bytes:
    """Return a Matplotlib figure as PNG."""
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=110)
    return stream.getvalue()


@view_of.register
def _robot(value: RobotVerdict) -> str:
    return card(f"Robot {value.robot}", paragraph(repr(value)))


@view_of.register
def _result(value: Result) -> str:
    """Show the outcomes of all runs, and verdict, picture and player of the first run."""
    if value.runs.is_empty():
        return card(type(value).__name__, paragraph(repr(value)))
    run = int(value.runs["run"][0])
    parts = [fragment_html(result_document(value))]
    if value.runs.height > 1:
        parts += [paragraph(f"Below: run {run}."), fragment_html(run_document(value, run))]
    with MATPLOTLIB_LOCK:
        picture = _png(run_figure(value, run))
    parts.append(image(picture, kind="png", words=f"Floor, paths and samples of run {run}", width_px=520))
    if value.segments is None:
        parts.append(paragraph("No player: simulate with segments=True to keep the paths."))
    else:
        parts.append(
            page(page_html(record_of(value, run)), title=f"Replay of run {run}", height_px=PLAYER_PX)
        )
    return card(type(value).__name__, *parts)


def picture_image(value: Picture, width_px: int) -> str:
    """Return a picture as an image element of at most this width."""
    return image(picture_bytes(value.figure, "svg"), "svg+xml", value.caption, width_px)


@view_of.register
def _picture(value: Picture) -> str:
    return card("", picture_image(value, 640), paragraph(value.caption))


@view_of.register
def _study(value: Study) -> str:
    """Show the first cells of a study, with their values of the fields that are varied."""
    names = value.varied or ["strategy.name"]
    body = [[cell.number, *(_varied_value(cell, name) for name in names)] for cell in value.cells[:MOST_ROWS]]
    left = len(value.cells) - len(body)
    return card(
        f"Study {shown(value.name)}" if value.name else "Study",
        paragraph(repr(value)),
        table(["cell", *names], body, texts=1 + len(names)),  # all columns are text
        paragraph(f"... and {left:,} more cells") if left else "",
    )


def _varied_value(cell: Cell, name: str) -> Any:
    """Return a cell's value of a varied field; a dash if the cell lacks a label or a preset."""
    if name in cell.words:
        return cell.words[name]
    # A cell need not set every field that others set. Label and preset are no fields of a scenario.
    return "-" if name in (LABEL, PRESET) else cell.scenario[name]


@view_of.register
def _study_result(value: StudyResult) -> str:
    """Show the first cells of a study, with the number of runs that are wanted and saved."""
    cells = value.cells.select("cell", "name", "wanted", "there")
    body = cells.head(MOST_ROWS).rows()
    left = cells.height - len(body)
    return card(
        "Study result",
        paragraph(repr(value)),
        table(["cell", "name", "runs wanted", "runs saved"], body, texts=2),  # cell and name are text
        paragraph(f"... and {left:,} more cells") if left else "",
        paragraph("Next: .summary(), .compare(), .plot(), .report()"),
    )


@view_of.register
def _comparison(value: Comparison) -> str:
    return card(value.outcome.question, *map(paragraph, [*value.outcome.notes, *value.sentences]))


@view_of.register
def _report(value: ReportFile) -> str:
    document = value.path.read_text(encoding="utf-8")
    return card(f"Report in {value.path}", page(document, "Report of a study", REPORT_PX))


@view_of.register
def _field_names(value: FieldNames) -> str:
    return card("Fields", paragraph("Complete a name with the Tab key."), paragraph(", ".join(dir(value))))


def record(value: object) -> str:
    """Return the view of an object whose class has no view of its own.

    It shows the first paragraph of the class's docstring, and the values of the public fields. A value that is a data
    frame, or a list of dataclass objects or named tuples of one class, is shown as a table below. An object without
    public fields is shown as a short text and that paragraph.
    """
    values = public_values(value)
    tables = {name: content for name, content in values.items() if _is_table(content)}
    plain = {name: short_value(content) for name, content in values.items() if name not in tables}
    parts = [paragraph(_first_paragraph(value)), rows(plain) if plain else ""]
    for name, content in tables.items():
        parts += [paragraph(f"{name}:"), frame(_frame_of(content))]
    return card(type(value).__name__, *parts) if values else card(short_text(value), *parts)


def _first_paragraph(value: object) -> str:
    """Return the first paragraph of the docstring of an object's class; empty if it has none."""
    text = (type(value).__doc__ or "").strip()
    # Python gives a dataclass without a docstring its signature as one.
    if text.startswith(f"{type(value).__name__}("):
        return ""
    # A reference to the module's docstring would be of no use in a notebook.
    return text.split("\n\n")[0].replace("``", "").replace(", see the module's docstring", "")


def _is_table(content: object) -> bool:
    """Return whether a value is shown as a table: a data frame, or dataclass objects or named tuples of one class."""
    if isinstance(content, pl.DataFrame):
        return True
    if not isinstance(content, Sequence) or isinstance(content, str) or not content:
        return False
    kind = type(content[0])
    return (is_dataclass(kind) or hasattr(kind, "_fields")) and all(type(one) is kind for one in content)


def _frame_of(content: Any) -> pl.DataFrame:
    """Return a value as a data frame: a data frame as it is; a list with one object per row.

    The columns of a list are the public fields of its objects, written as short texts.
    """
    if isinstance(content, pl.DataFrame):
        return content
    # infer_schema_length: None takes the columns from all rows, not only from the first ones.
    return pl.DataFrame(
        [{name: _cell(part) for name, part in public_values(one).items()} for one in content],
        infer_schema_length=None,
    )


def frame(content: pl.DataFrame, names: Mapping[str, str] | None = None) -> str:
    """Return the first ``MOST_ROWS`` rows of a data frame as an HTML table.

    A line below says how many rows are omitted and, unless ``names`` chooses the columns, how many columns.

    Args:
        names: headings of the columns to show, by column; by default the first ``MOST_COLUMNS`` with their own names.
    """
    headings = names or {name: name for name in content.columns[:MOST_COLUMNS]}
    chosen = content.select(list(headings))
    # Columns before the first numeric one are aligned as text.
    texts = next(
        (place for place, kind in enumerate(chosen.dtypes) if kind.is_numeric()), len(chosen.columns)
    )
    body = [[_cell(value) for value in row] for row in chosen.head(MOST_ROWS).iter_rows()]
    left = []
    if content.height > MOST_ROWS:
        left.append(f"{content.height - MOST_ROWS:,} more rows")
    if not names and content.width > MOST_COLUMNS:
        left.append(f"{content.width - MOST_COLUMNS} more columns")
    return table(list(headings.values()), body, texts=texts) + (
        paragraph(f"... and {', '.join(left)}") if left else ""
    )


def _cell(value: Any) -> str:
    """Write a value for a cell of a table: short, and a dash for None."""
    if value is None:
        return "-"
    return value[:MOST_LETTERS] if isinstance(value, str) else short_value(value)
