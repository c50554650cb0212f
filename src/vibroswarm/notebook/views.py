"""What a notebook shows of each public object: a title, its most important values, and pictures and pages in place."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import is_dataclass
from functools import singledispatch
from typing import TYPE_CHECKING, Any, Final

import polars as pl

from vibroswarm.analysis.verdict import (
    OPINION_NOTE,
    RobotVerdict,
    Verdict,
    confidence,
    headline,
    holds_opinions,
    robot_row,
    verdict,
)
from vibroswarm.core.notebook_view import public_values, short_text, short_value
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
from vibroswarm.study.spec import Study
from vibroswarm.study.study_outputs import Comparison, ReportFile
from vibroswarm.study.study_result import StudyResult

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PLAYER_PX: Final = 760
REPORT_PX: Final = 900
MOST_ROWS: Final = 20
"""Robots, runs, cells and other rows that are listed."""
MOST_COLUMNS: Final = 12
MOST_LETTERS: Final = 80
"""Of a text in a table."""

LAZY: Final = ("optimize", "league", "calibrate", "paper")
"""Packages that take long to import; their views are in ``lazy_views``."""


def html_of(value: object) -> str:
    """Return the view of an object as HTML; by default its values."""
    if type(value).__module__.split(".")[1] in LAZY:
        from vibroswarm.notebook.lazy_views import lazy_view_of

        if (view := lazy_view_of(value)) is not None:
            return view(value)
    return view_of(value)


@singledispatch
def view_of(value: object) -> str:
    """Return the view of an object; one function for each class, registered below."""
    return record(value)


@view_of.register
def _scenario(value: Scenario) -> str:
    """Show what is simulated, and all fields of the sections that matter most."""
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
    with MATPLOTLIB_LOCK:
        return image(_png(floor_figure(floor.tiles)), "png", f"{floor!r}", 280)


@view_of.register
def _floor_design(value: FloorDesign) -> str:
    """Show the floor and its measures."""
    measures = value.difficulty
    with MATPLOTLIB_LOCK:
        picture = image(_png(floor_figure(value.tiles)), "png", value.words, 280)
    numbers = {
        "fill ratio": f"{measures.fill_ratio:.3f} ({measures.ones} of {value.tiles.size} tiles)",
        "Moran index": f"{measures.moran_index:.3f}",
        "entropy": f"{measures.entropy:.3f}",
        "clusters": f"{measures.clusters}; the largest has {measures.largest_cluster} tiles",
    }
    return card("Designed floor", paragraph(value.words), rows(numbers), picture)


def _png(figure: Figure) -> bytes:
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=110)
    return stream.getvalue()


@view_of.register
def _robot(value: RobotVerdict) -> str:
    return card(f"Robot {value.robot}", paragraph(repr(value)))


@view_of.register
def _verdict(value: Verdict) -> str:
    return card("Verdict", *_verdict_parts(value, "posterior mean"))


def _verdict_parts(found: Verdict, posterior: str) -> list[str]:
    """Return the headline and the table of robots.

    Args:
        posterior: what the posterior's mean is: without the scenario it is not known whether it is an opinion.
    """
    heads = ("robot", "decision", "at, s", "confidence, %", f"{posterior} (95 %)", "own", "heard")
    parts = [paragraph(headline(found)), paragraph(confidence(found))]
    body = [robot_row(robot, found.answers) for robot in found.robots[:MOST_ROWS]]
    parts.append(table(heads, body, texts=2))
    if len(found.robots) > MOST_ROWS:
        parts.append(paragraph(f"The first {MOST_ROWS} of {len(found.robots)} robots."))
    return parts


@view_of.register
def _result(value: Result) -> str:
    """Show verdict, picture and player of the first run, and the outcomes of all."""
    if value.runs.is_empty():
        return card(type(value).__name__, paragraph(repr(value)))
    run = int(value.runs["run"][0])
    parts = [paragraph(repr(value))]
    if value.runs.height > 1:
        parts += [_runs_table(value), paragraph(f"Below: run {run}.")]
    opinions = holds_opinions(value.scenario)
    parts += _verdict_parts(verdict(value, run), "opinion" if opinions else "share of ones")
    parts += [paragraph(OPINION_NOTE)] if opinions else []
    with MATPLOTLIB_LOCK:
        picture = _png(run_figure(value, run))
    parts.append(image(picture, "png", f"Floor, paths and samples of run {run}", 520))
    if value.segments is None:
        parts.append(paragraph("No player: simulate with segments=True to keep the paths."))
    else:
        parts.append(page(page_html(record_of(value, run)), f"Replay of run {run}", PLAYER_PX))
    return card(type(value).__name__, *parts)


def _runs_table(result: Result) -> str:
    names = ("run", "consensus", "consensus_time_s", "right", "wrong", "undecided")
    heads = ("run", "consensus", "at, s", "right", "wrong", "undecided")
    body = [
        ["-" if value is None else f"{value:.1f}" if isinstance(value, float) else value for value in row]
        for row in result.runs.select(names).head(MOST_ROWS).iter_rows()
    ]
    left = result.runs.height - len(body)
    return table(heads, body, texts=2) + (paragraph(f"... and {left:,} more runs") if left else "")


def picture_image(value: Picture, width_px: int) -> str:
    """Return a picture as an image element."""
    return image(picture_bytes(value.figure, "svg"), "svg+xml", value.caption, width_px)


@view_of.register
def _picture(value: Picture) -> str:
    return card("", picture_image(value, 640), paragraph(value.caption))


@view_of.register
def _study(value: Study) -> str:
    names = value.varied or ["strategy.name"]
    body = [
        [cell.number, *(cell.words.get(name, cell.name) for name in names)]
        for cell in value.cells[:MOST_ROWS]
    ]
    left = len(value.cells) - len(body)
    return card(
        f"Study {shown(value.name)}" if value.name else "Study",
        paragraph(repr(value)),
        table(["cell", *names], body, texts=1 + len(names)),
        paragraph(f"... and {left:,} more cells") if left else "",
    )


@view_of.register
def _study_result(value: StudyResult) -> str:
    cells = value.cells.select("cell", "name", "wanted", "there")
    body = cells.head(MOST_ROWS).rows()
    left = cells.height - len(body)
    return card(
        "Study result",
        paragraph(repr(value)),
        table(["cell", "name", "runs wanted", "runs saved"], body, texts=2),
        paragraph(f"... and {left:,} more cells") if left else "",
        paragraph("Next: .summary(), .compare(), .plot(), .report()"),
    )


@view_of.register
def _comparison(value: Comparison) -> str:
    return card(value.outcome.question, *(paragraph(line) for line in value.sentences))


@view_of.register
def _report(value: ReportFile) -> str:
    document = value.path.read_text(encoding="utf-8")
    return card(f"Report in {value.path}", page(document, "Report of a study", REPORT_PX))


@view_of.register
def _field_names(value: FieldNames) -> str:
    return card("Fields", paragraph("Complete a name with the Tab key."), paragraph(", ".join(dir(value))))


def record(value: object) -> str:
    """Show an object: the first line of its class's docstring, its values, and its tables and lists of objects."""
    values = public_values(value)
    tables = {name: content for name, content in values.items() if _is_table(content)}
    plain = {name: short_value(content) for name, content in values.items() if name not in tables}
    parts = [paragraph(_first_line(value)), rows(plain) if plain else ""]
    for name, content in tables.items():
        parts += [paragraph(f"{name}:"), frame(_frame_of(content))]
    return card(type(value).__name__, *parts) if values else card(short_text(value), *parts)


def _first_line(value: object) -> str:
    """Return what the class says of itself; a dataclass without a docstring has its signature there."""
    text = (type(value).__doc__ or "").strip()
    if text.startswith(f"{type(value).__name__}("):
        return ""
    return text.split("\n\n")[0].replace("``", "").replace(", see the head of this module", "")


def _is_table(content: object) -> bool:
    """Return whether values are shown as a table: a frame, or objects of one class."""
    if isinstance(content, pl.DataFrame):
        return True
    if not isinstance(content, Sequence) or isinstance(content, str) or not content:
        return False
    kind = type(content[0])
    return (is_dataclass(kind) or hasattr(kind, "_fields")) and all(type(one) is kind for one in content)


def _frame_of(content: Any) -> pl.DataFrame:
    """Tabulate objects of one class, their values as short texts."""
    if isinstance(content, pl.DataFrame):
        return content
    listed = content[:MOST_ROWS]
    return pl.DataFrame(
        [{name: _cell(part) for name, part in public_values(one).items()} for one in listed],
        infer_schema_length=None,
    )


def frame(content: pl.DataFrame, names: Mapping[str, str] | None = None) -> str:
    """Return the first rows of a frame as a table.

    Args:
        names: columns to show with their headings; by default the first ones under their own names.
    """
    shown = names or {name: name for name in content.columns[:MOST_COLUMNS]}
    chosen = content.select(list(shown))
    texts = next(
        (place for place, kind in enumerate(chosen.dtypes) if kind.is_numeric()), len(chosen.columns)
    )
    body = [[_cell(value) for value in row] for row in chosen.head(MOST_ROWS).iter_rows()]
    left = [f"{content.height - MOST_ROWS:,} more rows"] if content.height > MOST_ROWS else []
    left += (
        [f"{content.width - MOST_COLUMNS} more columns"] if not names and content.width > MOST_COLUMNS else []
    )
    return table(list(shown.values()), body, texts=texts) + (
        paragraph(f"... and {', '.join(left)}") if left else ""
    )


def _cell(value: Any) -> str:
    if value is None:
        return "-"
    return value[:MOST_LETTERS] if isinstance(value, str) else short_value(value)
