"""Headline cells a second time: by the engine that steps through every control period, and on other seeds."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.analysis.intervals import mean_interval
from vibroswarm.page.report import Column
from vibroswarm.paper.cells import Figures
from vibroswarm.paper.columns import EMPIRICAL, OPTIMISED, STRATEGIES
from vibroswarm.paper.item import CLAIMS, Cells, Drawn, Item, Picture, Settings, Shown, Tables, Work
from vibroswarm.paper.measure import Row, exact, frame, mean
from vibroswarm.plots import draw_error_bars

STEPPED_RUNS: Final = 100
"""Runs by the fixed-step engine, which takes twelve times as long; each is compared run by run with the first."""
COLUMN: Final = "paper"
BOTH: Final = (OPTIMISED, EMPIRICAL)


def cells(settings: Settings) -> Cells:
    """parameters, strategy, and which time: first, other seeds, fixed-step."""
    found: Cells = {}
    for parameters in BOTH:
        for strategy in STRATEGIES:
            values = {"floor.source": "random:0.48", "strategy.name": strategy}
            first = settings.cell(COLUMN, values, with_=parameters)
            found[parameters, strategy, "first"] = first
            found[parameters, strategy, "other seeds"] = replace(first, block=1)
            stepped = replace(first, motion="fixed-step", runs=STEPPED_RUNS)
            found[parameters, strategy, "fixed-step"] = stepped
    return found


def compute(work: Work) -> Tables:
    """Both comparisons, and claims."""
    keys = [(parameters, strategy) for parameters in BOTH for strategy in STRATEGIES]
    measured = [row for key in keys for row in _measured(work, key)]
    table = pl.DataFrame([_row(work, key) for key in keys], infer_schema_length=None)
    return {"headline": table, CLAIMS: frame(measured)}


def _row(work: Work, key: tuple[str, str]) -> dict[str, Any]:
    row: dict[str, Any] = dict(zip(("parameters", "strategy"), key, strict=True))
    row |= {
        name: work.came.row(work.cells[(*key, "first")])[name]
        for name in ("runs", "decision_time_s", "command")
    }
    again = work.came.row(work.cells[(*key, "other seeds")])
    row |= {"other_s": again["decision_time_s"], "other_command": again["command"]}
    change = mean_interval(_against(work, key, "other seeds"))
    row |= dict(zip(("change_s", "change_low", "change_high"), change[:3], strict=True))
    row["holds_zero"] = not change.excludes(0.0)
    stepped = work.cells[(*key, "fixed-step")]
    here, there = (work.came[work.cells[(*key, name)]].figures for name in ("first", "fixed-step"))
    alike = _alike(here, there)
    row |= {"stepped_runs": alike.size, "stepped_alike": int(alike.sum())}
    return row | {"stepped_command": stepped.command(work.came.runs, work.came.seed)}


def _alike(first: Figures, second: Figures) -> NDArray[np.bool_]:
    """Which runs of the second, which may be fewer, have the same decisions at the same times, (runs,)."""
    names = ("decision_time_s", "right_share", "wrong_share", "swarm_time_s")
    pairs = [(first[name][: second[name].size], second[name]) for name in names]
    same = [np.isclose(one, other, rtol=0.0, atol=1e-6, equal_nan=True) for one, other in pairs]
    alike: NDArray[np.bool_] = np.all(same, axis=0)
    return alike


def _against(work: Work, key: tuple[str, str], which: str) -> Any:
    """Decision times of another computation less those of the first, run by run."""
    here, there = (work.values((*key, name), "decision_time_s") for name in ("first", which))
    return there - here[: there.size]


def _measured(work: Work, key: tuple[str, str]) -> Iterator[Row]:
    words = f"{key[0]}, {key[1]}"
    yield mean("headline-seeds", COLUMN, words, _against(work, key, "other seeds"))
    apart = float(np.abs(_against(work, key, "fixed-step")).max())
    yield exact("headline-engine", COLUMN, words, apart)


def pictures(tables: Tables, settings: Settings) -> Iterator[Picture]:
    """The change on other seeds."""
    yield Picture(
        "headline-seeds",
        "Decision time on other seeds less that on the first",
        lambda: _draw(tables["headline"]),
    )


def _draw(table: pl.DataFrame) -> Drawn:
    made = table.select(
        "runs",
        x=pl.format("{}, {}", "parameters", "strategy"),
        estimate="change_s",
        low="change_low",
        high="change_high",
    )
    return draw_error_bars(made, label="decision time on other seeds less that on the first (s)")


ITEM: Final = Item(
    number=12,
    name="headline",
    title="Headline cells, a second time",
    about=(
        "Five robots at a fill ratio of 0.48, computed again on other seeds (fresh motion, floors and noise), "
        "and for preset `paper` by the engine that steps through every control period, run by run. This is "
        "about the software, not the paper.",
    ),
    cells=cells,
    compute=compute,
    pictures=pictures,
    shown=(
        Shown(
            "headline",
            "Restricted mean decision times; the change has a 95 % interval, which holds 0 in 19 of 20 where "
            "nothing is wrong.",
            {
                "parameters": Column("parameters"), "strategy": Column("strategy"),
                "runs": Column("runs"), "decision_time_s": Column("time", "s"),
                "other_s": Column("on other seeds", "s"),
                "change_s": Column("change", "s"), "change_low": Column("from", "s"), "change_high": Column("to", "s"),
                "holds_zero": Column("holds 0"), "stepped_runs": Column("runs by fixed-step"),
                "stepped_alike": Column("of them the same, event by event"),
            },
        ),
    ),
)  # fmt: skip
