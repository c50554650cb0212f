"""The pictures of a study, drawn from its runs when a page needs them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache, partial
from typing import Any, Final

import polars as pl

from vibroswarm.inference.outcomes import CONSENSUS
from vibroswarm.plots.curves import draw_incidence
from vibroswarm.plots.distributions import draw_boxes, draw_outcomes
from vibroswarm.plots.error_bars import draw_error_bars
from vibroswarm.plots.front import draw_front
from vibroswarm.plots.heat import draw_heat
from vibroswarm.plots.labels import label_of
from vibroswarm.plots.picture import Picture
from vibroswarm.report.report import Figure
from vibroswarm.statistics.figures import BY_NAME
from vibroswarm.statistics.incidence import robot_incidence, swarm_incidence
from vibroswarm.study.cells import Cell
from vibroswarm.study.spec import SOURCE
from vibroswarm.study.summary import CellOutcome, Outcome

INCIDENCE: Final = {"robot": robot_incidence, "swarm": swarm_incidence}
"""What is drawn over time, by its unit."""
FEW_CELLS: Final = 4
"""Most cells of curves over time."""
MOST_CELLS: Final = 24
"""Most rows of a picture."""
MOST_SERIES: Final = 8
"""Most lines of a picture."""
MOST_MAPS: Final = 3
"""Most maps of a figure."""
DRAWN: Final = ("decision_time_s", "swarm_right", "robots_wrong", "estimate_error", "right_time_share")
"""Figures that are drawn along a numeric field."""
MAPPED: Final = ("decision_time_s", "swarm_right", "estimate_error")
"""Figures that are drawn over two numeric fields."""


def pictures(outcome: Outcome) -> Iterator[tuple[str, Figure]]:
    """Yield the pictures of a study by name."""
    table = outcome.table
    known = {name for name in DRAWN if table[name].null_count() < table.height}
    if all(one.cell.scenario.task.asks_number for one in outcome.cells):
        known &= {"estimate_error"}
    else:
        known -= {"estimate_error"}
        if len(outcome.cells) <= MOST_CELLS:
            yield "outcomes", Figure(partial(_outcomes, outcome), "Outcomes of the swarms")
    yield from _along_a_field(outcome, [name for name in DRAWN if name in known])
    yield from _over_two_fields(outcome, [name for name in MAPPED if name in known])
    if "swarm_right" in known:
        yield from _over_time(outcome)
        yield from _fronts(outcome)


def numeric_fields(cells: Sequence[Cell]) -> dict[str, list[float]]:
    """Return the varied fields whose values are numbers, by cell, the one with most values first."""
    fields = {}
    for field in dict.fromkeys(name for cell in cells for name in cell.point):
        values = [cell.point.get(field) for cell in cells]
        if field == SOURCE:
            values = _fill_ratios([str(value) for value in values])
        numbers = [float(v) for v in values if isinstance(v, int | float) and not isinstance(v, bool)]
        if len(numbers) == len(cells) and len(set(numbers)) > 1 and all(map(math.isfinite, numbers)):
            fields[field] = numbers
    return dict(sorted(fields.items(), key=lambda item: -len(set(item[1]))))


def _fill_ratios(sources: Sequence[str]) -> list[Any]:
    patterns = {source.rpartition(":")[0] for source in sources}
    texts = [source.rpartition(":")[2] for source in sources]
    is_one = len(patterns) == 1 and all(text.replace(".", "", 1).isdecimal() for text in texts)
    return [float(text) for text in texts] if is_one else []


def _outcomes(outcome: Outcome) -> Picture:
    rows = []
    for one in outcome.cells:
        shares = {kind: one.figures[f"swarm_{kind}"] for kind in CONSENSUS}
        counted = {kind: round(share.estimate * share.n) if share.n else 0 for kind, share in shares.items()}
        right = shares["right"]
        limits = {"right_low": right.low, "right_high": right.high} if right.n == one.runs else {}
        rows.append({"cell": one.cell.name, **counted, **limits})
    frame = pl.DataFrame(rows, infer_schema_length=None)
    return draw_outcomes(frame, interval="95 % Wilson interval", style="page")


def _along_a_field(outcome: Outcome, names: Sequence[str]) -> Iterator[tuple[str, Figure]]:
    cells = [one.cell for one in outcome.cells]
    fields = numeric_fields(cells)
    field = next(iter(fields), None)
    if field is None:
        return
    series = [_other_values(cell, field) for cell in cells]
    points = set(zip(series, fields[field], strict=True))
    if len(set(series)) <= MOST_SERIES and len(points) == len(cells):
        for name in names:
            draw = partial(_along, outcome.table, field, fields[field], series, name)
            yield f"{name}_along", Figure(draw, _title(name))


def _along(table: pl.DataFrame, field: str, x: Sequence[float], series: Sequence[str], name: str) -> Picture:
    ends = {"estimate": name, "low": f"{name}_low", "high": f"{name}_high"}
    frame = table.select("runs", x=pl.Series(x), **{new: pl.col(old) for new, old in ends.items()})
    if len(set(series)) > 1:
        frame = frame.with_columns(series=pl.Series(series))
    figure = BY_NAME[name]
    return draw_error_bars(
        frame,
        x_label=label_of(field).text,
        label=f"{figure.title} ({figure.unit})" if figure.unit else figure.title,
        log=min(x) > 0 and max(x) >= 1000 * min(x),
        percent=figure.is_share,
    )


def _over_two_fields(outcome: Outcome, names: Sequence[str]) -> Iterator[tuple[str, Figure]]:
    cells = [one.cell for one in outcome.cells]
    fields = {name: values for name, values in numeric_fields(cells).items() if len(set(values)) > 2}
    if len(fields) != 2:
        return
    others = [_other_values(cell, *fields) for cell in cells]
    (x, y), labels = fields.values(), [label_of(field).text for field in fields]
    table = outcome.table.with_columns(x=pl.Series(x), y=pl.Series(y), other=pl.Series(others))
    for place, other in enumerate(list(dict.fromkeys(others))[:MOST_MAPS]):
        for name in names:
            title = f"{_title(name)}{f': {other}' if other else ''}"
            draw = partial(_map, table.filter(other=other), labels, name)
            yield f"{name}_map_{place}", Figure(draw, title)


def _map(table: pl.DataFrame, labels: Sequence[str], name: str) -> Picture:
    figure = BY_NAME[name]
    return draw_heat(
        table.select("runs", "x", "y", value=name),
        x_label=labels[0],
        y_label=labels[1],
        label=f"{figure.title} ({figure.unit})" if figure.unit else figure.title,
        best="low" if figure.better < 0 else "high",
        percent=figure.is_share,
    )


def _over_time(outcome: Outcome) -> Iterator[tuple[str, Figure]]:
    with_truth = [one for one in outcome.cells if one.figures["swarm_right"].n]
    if len(with_truth) <= FEW_CELLS:
        computed = cache(lambda: [_incidences(outcome, one) for one in with_truth])
        for unit in INCIDENCE:
            draw = partial(_incidence, computed, with_truth, unit)
            yield f"{unit}s_over_time", Figure(draw, f"Decisions of {unit}s over time")
    if len(outcome.cells) <= MOST_CELLS:
        yield "consensus", Figure(partial(_consensus, outcome), "Consensus time, run by run")


def _incidences(outcome: Outcome, one: CellOutcome) -> dict[str, pl.DataFrame]:
    tables, series = outcome.runs.tables(one.cell), pl.lit(one.cell.name)
    return {unit: f(*tables, one.t_end_s).with_columns(series=series) for unit, f in INCIDENCE.items()}


def _incidence(
    computed: Callable[[], list[dict[str, pl.DataFrame]]], cells: Sequence[CellOutcome], unit: str
) -> Picture:
    return draw_incidence(
        pl.concat(frames[unit] for frames in computed()),
        runs=min(one.runs for one in cells),
        unit="robot" if unit == "robot" else "run",
        t_end=max(one.t_end_s for one in cells),
    )


def _consensus(outcome: Outcome) -> Picture:
    names = {one.cell.number: one.cell.name for one in outcome.cells}
    rows = outcome.runs.rows("consensus_time_s").select(
        cell=pl.col("cell").replace_strict(names, return_dtype=pl.String), value="consensus_time_s"
    )
    return draw_boxes(
        rows,
        label="consensus time (s)",
        t_end=max(one.t_end_s for one in outcome.cells),
        missing="without consensus",
        style="page",
    )


def _fronts(outcome: Outcome) -> Iterator[tuple[str, Figure]]:
    """Yield time against error for each floor with several cells: the floor cannot be chosen, settings can."""
    floors: dict[str, list[int]] = {}
    for one in outcome.cells:
        if one.figures["forced_error"].n:
            floors.setdefault(str(one.cell.point.get(SOURCE, "")), []).append(one.cell.number)
    for place, (floor, cells) in enumerate(list(floors.items())[:MOST_MAPS]):
        if len(cells) > 2:
            title = f"Time against error{f': {floor}' if floor else ''}"
            yield f"front_{place}", Figure(partial(_front, outcome.table, cells), title)


def _front(table: pl.DataFrame, cells: Sequence[int]) -> Picture:
    axes = {"time": "decision_time_s", "error": "forced_error"}
    columns: Mapping[str, str] = {
        f"{new}{end}": f"{old}{end}" for new, old in axes.items() for end in ("", "_low", "_high")
    }
    frame = table.filter(pl.col("cell").is_in(cells)).select("runs", "name", **columns)
    return draw_front(frame, error_label="forced error", percent=True)


def _title(name: str) -> str:
    title = BY_NAME[name].title
    return title[:1].upper() + title[1:]


def _other_values(cell: Cell, *without: str) -> str:
    return cell.text_of(name for name in cell.point if name not in without)
