"""What the robots of a run reported over time, as a table, and how its values are called."""

from __future__ import annotations

from collections.abc import Iterable

import polars as pl

from vibroswarm.inference.agents import strategy_used
from vibroswarm.inference.outcomes import number_over_time
from vibroswarm.result import Result
from vibroswarm.strategies.base import arrays_of


def reports_over_time(result: Result, run: int = 0) -> pl.DataFrame:
    """Return what the robots of a run reported over time: name, robot, time_s, value; null values are left out.

    Places of an array have names such as ``trust 3``. Arrays that are reported at the end of a run only are left out.
    """
    columns = ("name", "robot", "time_s", "value")
    if result.reports is None:
        return pl.DataFrame(
            schema=dict(zip(columns, (pl.String, pl.UInt16, pl.Float64, pl.Float64), strict=True))
        )
    strategy = strategy_used(result.scenario)
    once = [name for name in arrays_of(strategy.arrays) if name not in (strategy.state_type.names or ())]
    told = result.reports.filter(
        pl.col("run") == run, pl.col("value").is_not_null(), ~pl.col("name").is_in(once)
    )
    places = pl.format("{} {}", "name", "index")
    is_array = pl.col("index").max().over("name") > 0
    told = told.with_columns(pl.when(is_array).then(places).otherwise("name").alias("name"))
    times = result.motion.select("run", "robot", "sample", "time_s")
    return told.join(times, on=["run", "robot", "sample"], maintain_order="left").select(columns)


def report_headings(result: Result, names: Iterable[str]) -> dict[str, str]:
    """Return names and units in words, by names as in ``reports_over_time``."""
    reported = strategy_used(result.scenario).reported
    parts = {name: name.partition(" ") for name in names}
    return {
        name: report_heading(field, place, reported[field].unit if field in reported else "")
        for name, (field, _, place) in parts.items()
    }


def report_heading(name: str, place: int | str = "", unit: str = "") -> str:
    """Return a report and its unit in words, such as "trust 3 (m)"; ``place`` is that of a value in an array."""
    words = name.removesuffix(f"_{unit}").replace("_", " ")
    return " ".join(filter(None, (words, str(place), f"({unit})" if unit else "")))


def estimates_of(result: Result) -> list[str]:
    """Return the names of the reports that estimate the number that the task asks for."""
    reported = strategy_used(result.scenario).reported.values()
    return ["estimate", *(one.name for one in reported if one.estimates)]


def true_number_over_time(result: Result, run: int) -> list[tuple[float, float]]:
    """Return from when on (s), 0 first, the number that such reports estimate is which."""
    floor, (row,) = result.floor(run), result.runs.filter(run=run).to_dicts()
    if not floor.is_changing:
        return [(0.0, row["fill_ratio"])]
    return number_over_time(result.scenario, floor, row["end_s"])
