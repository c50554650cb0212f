"""Item 12: headline cells recomputed by the fixed-step engine and on other seeds.

A headline cell is a parameter set (P* or P0) and a strategy. It is run in three variants: "first" (event engine, the
seed of the reproduction), "other seeds" (the event engine with a second seed), and "fixed-step" (the fixed-step engine
with the first seed, which must give the same results run by run). The measured values of the claims are rows of
``claims.MEASURED``.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.analysis.intervals import columns_of, mean_interval
from vibroswarm.paper.cells import Figures
from vibroswarm.paper.claim_values import Row, exact, frame, mean
from vibroswarm.paper.columns import EMPIRICAL, OPTIMISED, STRATEGIES
from vibroswarm.paper.item import CLAIMS, Cells, Item, Picture, Settings, Tables, TableView, Work, picture
from vibroswarm.plots import draw_error_bars
from vibroswarm.show.document import Column

STEPPED_RUNS: Final = 100
"""Runs by the fixed-step engine, which takes twelve times as long."""
COLUMN: Final = "paper"
"""Preset in which the cells are simulated, also if it is not among the requested columns."""
CELLS: Final = tuple(product((OPTIMISED, EMPIRICAL), STRATEGIES))
"""Parameter set and strategy of each headline cell."""


def cells(settings: Settings) -> Cells:
    """Return the cells by (parameter set, strategy, variant)."""
    by_key: Cells = {}
    for parameters, strategy in CELLS:
        values = {"floor.source": "random:0.48", "strategy.name": strategy}
        first = settings.cell(COLUMN, values, parameter_set=parameters)
        by_key |= {
            (parameters, strategy, "first"): first,
            (parameters, strategy, "other seeds"): replace(first, block=1),  # block 1: the second seed
            (parameters, strategy, "fixed-step"): replace(first, motion="fixed-step", runs=STEPPED_RUNS),
        }
    return by_key


def compute(work: Work) -> Tables:
    """Return the table of headline cells, compared with other seeds and with fixed steps, and the claims' values."""
    measured = [row for key in CELLS for row in _measured(work, key)]
    table = pl.DataFrame([_row(work, key) for key in CELLS], infer_schema_length=None)
    return {"headline": table, CLAIMS: frame(measured)}


def _row(work: Work, key: tuple[str, str]) -> dict[str, Any]:
    """Return the row of one headline cell: its time, and the comparisons with other seeds and with fixed steps.

    change_s is the mean time with other seeds minus that with the first seed, with its limits; holds_zero says whether
    0 lies between the limits. stepped_alike is the number of runs with fixed steps, of stepped_runs in all, that equal
    those of the event engine (``_equal_runs``). Each of the three commands runs one variant alone.

    Args:
        key: parameter set and strategy.
    """
    row: dict[str, Any] = dict(zip(("parameters", "strategy"), key, strict=True))
    first = work.results.row(work.cells[(*key, "first")])
    row |= {name: first[name] for name in ("runs", "decision_time_s", "command")}
    other = work.results.row(work.cells[(*key, "other seeds")])
    row |= {"other_s": other["decision_time_s"], "other_command": other["command"]}
    change = mean_interval(_against(work, key, "other seeds"))
    row |= columns_of("change_s", change)
    row["holds_zero"] = not change.excludes(0.0)
    stepped = work.cells[(*key, "fixed-step")]
    first_figures, stepped_figures = (
        work.results[work.cells[(*key, name)]].figures for name in ("first", "fixed-step")
    )
    equal = _equal_runs(first_figures, stepped_figures)
    row |= {"stepped_runs": equal.size, "stepped_alike": int(equal.sum())}
    return row | {"stepped_command": stepped.command(work.results.runs, work.results.seed)}


def _equal_runs(first: Figures, second: Figures) -> NDArray[np.bool_]:
    """Return for each run of ``second`` whether its figures of decisions are the same in ``first``, (runs,).

    Compared are the mean decision time, the shares of robots right and wrong, and the capped consensus time, not the
    decisions of single robots.
    ``first`` may have more runs, which are not compared.

    Args:
        first, second: figures of each run by name, (runs,) each.
    """
    names = ("decision_time_s", "right_share", "wrong_share", "swarm_time_s")
    # 1e-6: the engines may differ by rounding errors; times that differ by a tick (20 ms) are not equal.
    same = [
        np.isclose(first[name][: second[name].size], second[name], rtol=0.0, atol=1e-6, equal_nan=True)
        for name in names
    ]
    equal: NDArray[np.bool_] = np.all(same, axis=0)
    return equal


def _against(work: Work, key: tuple[str, str], which: str) -> Any:
    """Return the decision time of a variant minus that of the variant "first", run by run, s, (runs of the variant,).

    Runs with other seeds have nothing in common with the first ones. Their differences are independent all the same, so
    an interval of their mean is valid.

    Args:
        key: parameter set and strategy. which: name of the variant, which may have fewer runs than "first".
    """
    first_s, variant_s = (work.values((*key, name), "decision_time_s") for name in ("first", which))
    return variant_s - first_s[: variant_s.size]


def _measured(work: Work, key: tuple[str, str]) -> Iterator[Row]:
    """Yield the measured values of the claims about other seeds and the other engine, for one headline cell.

    The value for the engine is the largest difference of any run in the mean decision time, without sign; it has no
    sampling error, because runs with the same seed must be equal.
    """
    words = f"{key[0]}, {key[1]}"
    yield mean("time-on-other-seeds-less-first", COLUMN, words, _against(work, key, "other seeds"))
    largest_s = float(np.abs(_against(work, key, "fixed-step")).max())
    yield exact("largest-time-between-engines", COLUMN, words, largest_s)


def pictures(tables: Tables, settings: Settings) -> Iterator[Picture]:
    """Yield the picture of the differences between other seeds and the first seed."""
    points = tables["headline"].select(
        "runs",
        x=pl.format("{}, {}", "parameters", "strategy"),
        estimate="change_s",
        low="change_s_low",
        high="change_s_high",
    )
    yield picture(
        "headline-seeds", "Difference in decision time (other seeds - first)", draw_error_bars, points,
        label="difference in decision time, other seeds - first (s)",
    )  # fmt: skip


ITEM: Final = Item(
    number=12,
    name="headline",
    title="Headline cells, recomputed",
    about=(
        "Five robots at a fill ratio of 0.48, recomputed on other seeds (fresh motion, floors and noise) "
        "and, for preset `paper`, run by run with the fixed-step engine. This is a test of the software, not of "
        "the paper.",
    ),
    cells=cells,
    compute=compute,
    pictures=pictures,
    shown=(
        TableView(
            "headline",
            "Restricted mean decision times; the 95 % interval of the difference contains 0 in 19 of 20 cases if "
            "nothing is wrong.",
            {
                "parameters": Column("parameters"), "strategy": Column("strategy"),
                "runs": Column("runs"), "decision_time_s": Column("time", "s"),
                "other_s": Column("on other seeds", "s"),
                "change_s": Column("difference", "s", limits=("change_s_low", "change_s_high")),
                "holds_zero": Column("contains 0"),
                "stepped_runs": Column("runs by fixed-step"), "stepped_alike": Column("of them with equal figures"),
            },
        ),
    ),
)  # fmt: skip
