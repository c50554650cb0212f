"""The documents of scenarios, floors, pictures and studies that have not run, which a notebook shows."""

from __future__ import annotations

from typing import Any, Final

import polars as pl
from numpy.typing import NDArray

from vibroswarm.analysis.verdict import RobotVerdict
from vibroswarm.errors import shown
from vibroswarm.floors.design import FloorDesign
from vibroswarm.floors.floor import Floor
from vibroswarm.plots.picture import Picture
from vibroswarm.plots.run import floor_figure
from vibroswarm.plots.style import MATPLOTLIB_LOCK
from vibroswarm.scenario.scenario import FieldNames, Scenario
from vibroswarm.show.document import Document, Figure, Section, Table, Text
from vibroswarm.show.numbers import number
from vibroswarm.study.factors import LABEL, PRESET
from vibroswarm.study.spec import Cell, Study
from vibroswarm.study.study_outputs import ReportFile
from vibroswarm.study.study_result import StudyResult

MOST_CELLS: Final = 500
"""Most cells of a study that are listed."""


def scenario_document(scenario: Scenario) -> Document:
    """Return the document of a scenario: its most important fields, and all of them as TOML."""
    values = {
        "robots": scenario.swarm.robots,
        "strategy": scenario.strategy.name,
        "floor": shown(scenario.floor.source),
        "arena": f"{scenario.arena.width_m:g} m x {scenario.arena.height_m:g} m",
        "network": scenario.network.name,
        "task": scenario.task.name,
        "up to": f"{scenario.run.t_end_s:g} s",
        "hash": scenario.hash,
    }
    toml = Section("All fields (TOML)", (Text(scenario.to_toml(), "code"),), folded=True)
    return Document("Scenario", (), parts=(_values(values), toml))


def floor_document(floor: Floor) -> Document:
    """Return the document of a floor: a picture."""
    return Document(f"Floor {shown(floor.name)}", (repr(floor),), parts=(_floor(floor.tiles, repr(floor)),))


def design_document(design: FloorDesign) -> Document:
    """Return the document of a designed floor: the measures of its difficulty, and a picture."""
    measures = design.difficulty
    values = {
        "fill ratio": f"{number(measures.fill_ratio, 3)} ({measures.ones} of {design.tiles.size} tiles)",
        "Moran index": number(measures.moran_index, 3),
        "entropy": number(measures.entropy, 3),
        "clusters": f"{measures.clusters}; the largest has {measures.largest_cluster} tiles",
    }
    return Document(
        "Designed floor", (design.words,), parts=(_values(values), _floor(design.tiles, design.words))
    )


def _floor(tiles: NDArray[Any], caption: str) -> Figure:
    def draw(style: str) -> Picture:
        rows, columns = tiles.nonzero()
        with MATPLOTLIB_LOCK:
            return Picture(floor_figure(tiles), pl.DataFrame({"row": rows, "column": columns}), caption)

    return Figure("floor", draw)


def picture_document(picture: Picture) -> Document:
    """Return the document of a picture."""
    return Document("", (picture.caption,), parts=(Figure("picture", lambda style: picture),))


def robot_document(robot: RobotVerdict) -> Document:
    """Return the document of the verdict of one robot."""
    return Document(f"Robot {robot.robot}", (repr(robot),))


def study_document(study: Study) -> Document:
    """Return the document of a study before it runs: its cells, with their values of the fields that are varied."""
    names = study.varied or ["strategy.name"]
    rows = [
        {"cell": str(cell.number)} | {name: str(_varied_value(cell, name)) for name in names}
        for cell in study.cells[:MOST_CELLS]
    ]
    title = f"Study {shown(study.name)}" if study.name else "Study"
    return Document(title, (repr(study),), parts=(Table(pl.DataFrame(rows), name="cells"),))


def _varied_value(cell: Cell, name: str) -> Any:
    """Return a cell's value of a varied field; a dash if the cell lacks a label or a preset."""
    if name in cell.words:
        return cell.words[name]
    # A cell need not set every field that others set. Label and preset are no fields of a scenario.
    return "-" if name in (LABEL, PRESET) else cell.scenario[name]


def study_result_document(result: StudyResult) -> Document:
    """Return the document of a study's result before it is summarised: its cells, and how many runs each has."""
    cells = result.cells.select(
        pl.col("cell").cast(pl.String), "name", runs_wanted="wanted", runs_saved="there"
    )
    then = Text("Next: .summary(), .compare(), .plot(), .report()")
    return Document("Study result", (repr(result),), parts=(Table(cells, name="cells", names=2), then))


def report_document(report: ReportFile) -> Document:
    """Return the document of a report that was written, which says where."""
    return Document(f"Report in {report.path}", ())


def field_names_document(names: FieldNames) -> Document:
    """Return the document of the names of fields."""
    return Document("Fields", ("Complete a name with the Tab key.",), parts=(Text(", ".join(dir(names))),))


def _values(values: dict[str, Any]) -> Table:
    """Return a table of values by name."""
    return Table(
        pl.DataFrame({"field": list(values), "value": list(map(str, values.values()))}), name="values"
    )
