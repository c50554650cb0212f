"""The documents of scenarios, pictures and studies that have not run, which a notebook shows."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import polars as pl

from vibroswarm.analysis.verdict import RobotVerdict
from vibroswarm.core.numbers import size, stated
from vibroswarm.errors import shown
from vibroswarm.plots.picture import Picture
from vibroswarm.scenario.scenario import FieldNames, Scenario
from vibroswarm.show.document import Document, Figure, Section, Table, Text
from vibroswarm.study.evaluation import ReportFile
from vibroswarm.study.factors import LABEL, PRESET
from vibroswarm.study.spec import Cell, Study
from vibroswarm.study.study_result import StudyResult

MOST_CELLS: Final = 500
"""Most cells of a study that are listed."""


def scenario_document(scenario: Scenario) -> Document:
    """Return the document of a scenario: its most important fields, and all of them as TOML."""
    values = {
        "robots": scenario.swarm.robots,
        "strategy": scenario.strategy.name,
        "floor": shown(scenario.floor.source),
        "arena": size(scenario.arena.width_m, scenario.arena.height_m),
        "network": scenario.network.name,
        "task": scenario.task.name,
        "up to": f"{stated(scenario.run.t_end_s)} s",
        "hash": scenario.hash,
    }
    toml = Section("All fields (TOML)", (Text(scenario.to_toml(), "code"),), folded=True)
    return Document("Scenario", (), parts=(values_table(values), toml))


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


def values_table(values: Mapping[str, object]) -> Table:
    """Return a table of values by name."""
    return Table(
        pl.DataFrame({"field": list(values), "value": list(map(str, values.values()))}), name="values"
    )
