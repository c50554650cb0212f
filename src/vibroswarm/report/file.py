"""The reports of what is on disk: folders that commands wrote, files, and saved runs that were simulated again."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import polars as pl

from vibroswarm.core.folders import kind_of
from vibroswarm.core.numbers import count
from vibroswarm.core.tables import read_frame
from vibroswarm.errors import InputError
from vibroswarm.report.report import Report, Table, report
from vibroswarm.report.save import DATA, read
from vibroswarm.scenario.scenario import Scenario, preset
from vibroswarm.simulation import versions
from vibroswarm.study.store import Verified


@report.register
def of_scenario(scenario: Scenario) -> Report:
    """Return the fields of a scenario that differ from those of the preset ``paper``."""
    here, paper = scenario.model_dump(mode="json"), preset("paper").model_dump(mode="json")
    rows = [
        (f"{section}.{name}", _text(value), _text(paper[section].get(name)))
        for section, fields in here.items()
        for name, value in fields.items()
        if value != paper[section].get(name)
    ]
    frame = pl.DataFrame(rows, schema=dict.fromkeys(("field", "here", "paper"), pl.String), orient="row")
    fields = Table(frame, "Fields")
    answer = f"{count(frame.height, 'field')} differ from preset paper." if rows else "As preset paper."
    return Report("Scenario", (answer,), {"fields": fields}, made_by={"hash": scenario.hash})


def of_path(path: Path) -> Report:
    """Return the report of what a command has written, or of a file of a scenario or table."""
    if path.is_dir():
        return _of_folder(path)
    if path.suffix == ".toml":
        return report(Scenario.read(path))
    if path.suffix == ".json":
        return read(path)
    frame = pl.read_csv(path) if path.suffix == ".csv" else read_frame(path, path.stem)
    return Report(path.name, (f"{count(frame.height, 'row')}.",), {"table": Table(frame)})


def _of_folder(folder: Path) -> Report:
    if (folder / DATA).is_file():
        return read(folder / DATA)
    kind = kind_of(folder)
    if kind == "study":
        from vibroswarm.study.spec import Study

        return report(Study.open(folder)[1])
    if kind in ("result", "recording"):
        from vibroswarm.recordings.recording import read_result

        return report(read_result(folder))
    raise InputError("holds no results of a command that has ended", field=str(folder))


def _text(value: Any) -> str:
    return "-" if value is None else " ".join(map(str, value)) if isinstance(value, list) else str(value)


@report.register
def of_verified(verified: Verified) -> Report:
    """Return how many runs came out the same, and which did not."""
    again = verified.runs.height
    answer = (
        f"{'Verified' if verified.holds else 'NOT VERIFIED'}: {verified.runs['same'].sum()} of "
        f"{count(again, 'run')}, of {verified.saved}, came out the same again, bit by bit.",
    )
    return Report(
        f"Runs of {verified.folder} simulated again",
        answer,
        {"differing": Table(verified.runs.filter(~verified.runs["same"]).drop("same"), "Differing runs")},
        warnings=tuple(f"damaged: {path}" for path in verified.damaged),
        made_by=versions(),
    )
