"""Item 13: positive feedback where all hear all, and whether the best eta and kappa depend on the task.

| name | symbol | equation |
|---|---|---|
| cost of a run | c | mean time of its robots / T_end + 4 x its share of robots wrong |
| chosen on half of the runs | - | the eta and kappa of least mean cost there |
| regret of a run | - | its cost with what was chosen elsewhere, less that with what was chosen here |

What is chosen on one half is judged on the other, and the other way round: the luck of the choice is in neither.
The paper's search counts a wrong robot as 5 in place of its time, so as 4 to 5 more.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.analysis.intervals import mean_interval, plain
from vibroswarm.page.report import Column
from vibroswarm.paper.columns import STRATEGIES, fills, sizes
from vibroswarm.paper.item import CLAIMS, Cells, Drawn, Item, Picture, Settings, Shown, Tables, Work
from vibroswarm.paper.measure import Row, frame, mean
from vibroswarm.paper.published import published
from vibroswarm.plots import draw_error_bars

HERE: Final = "random:0.48"
EASIER: Final = "random:0.44"
WRONG: Final = 4.0
ETAS: Final = (750.0, 1500.0, 2500.0)
KAPPAS: Final = (1.0, 2.0, 3.0, 4.0)
CHOICES: Final = tuple(product(ETAS, KAPPAS))
CASES: Final = {"as searched": (5, HERE), "ten robots": (10, HERE), "easier floor": (5, EASIER)}
"""Robots and floor; in the first eta and kappa were chosen."""
COLUMN: Final = "paper"


def cells(settings: Settings) -> Cells:
    """column, robots, floor, strategy; case, eta, kappa."""
    found: Cells = {}
    for column in settings.columns:
        for robots, floor in _where():
            for strategy in STRATEGIES[:2]:
                values: dict[str, Any] = {"floor.source": floor, "strategy.name": strategy}
                values |= {
                    "swarm.robots": robots,
                    "network.name": "ideal",
                }  # preset `calibrated` loses some
                found[column, robots, floor, strategy] = settings.cell(column, values)
    if COLUMN in settings.columns:
        for (case, (robots, floor)), (eta, kappa) in product(CASES.items(), CHOICES):
            values = {"floor.source": floor, "swarm.robots": robots, "strategy.name": "soft"}
            found[case, eta, kappa] = settings.cell(
                COLUMN, values | {"strategy.soft.eta": eta, "strategy.soft.kappa": kappa}
            )
    return found


def _where() -> list[tuple[int, str]]:
    few = int(published("simulation.robots"))
    return [(few, f"random:{fill}") for fill in fills()] + [(n, HERE) for n in sizes() if n != few]


def compute(work: Work) -> Tables:
    """Cells with both strategies, their differences, the costs of eta and kappa, claims."""
    columns = work.settings.columns
    measured = [row for column in columns for row in _positive(work, column)]
    keys = [(c, robots, floor, s) for c in columns for robots, floor in _where() for s in STRATEGIES[:2]]
    tables = {"cells": work.rows(("column", "robots", "floor", "strategy"), keys), "gaps": _gaps(measured)}
    if COLUMN in columns:
        costs = {case: _costs(work, case) for case in CASES}
        tables["costs"] = _cost_table(costs)
        for claim, case in (("soft-optimum-size", "ten robots"), ("soft-optimum-difficulty", "easier floor")):
            measured.append(mean(claim, COLUMN, case, regrets(costs["as searched"], costs[case])))
    return tables | {CLAIMS: frame(measured)}


def _positive(work: Work, column: str) -> Iterator[Row]:
    gaps = {}
    for robots, floor in _where():
        pair = (column, robots, floor, "positive"), (column, robots, floor, "none")
        gaps[robots, floor] = work.difference("decision_time_s", *pair)
        words, cannot = f"{robots} robots, {floor}", work.cannot(pair[1])
        yield mean("positive-all-to-all", column, words, gaps[robots, floor], cannot=cannot)
    few, many = int(published("simulation.robots")), max(sizes())
    grown = gaps[many, HERE] - gaps[few, HERE]
    cannot = work.cannot((column, many, HERE, "none"))
    yield mean("positive-lead-grows", column, f"{many} less {few} robots", grown, cannot=cannot)


def _gaps(measured: list[Row]) -> pl.DataFrame:
    rows = [row for row in measured if row["claim"] == "positive-all-to-all"]
    whole = frame(rows).rename({"estimate": "gap_s"})
    half = 1.96 * pl.col("standard_error")
    return whole.select("column", "cell", "gap_s", low=pl.col("gap_s") - half, high=pl.col("gap_s") + half)


def _costs(work: Work, case: str) -> NDArray[np.float64]:
    """Cost of each run with each eta and kappa, (choices, runs)."""
    t_end_s = work.cells[case, *CHOICES[0]].scenario.run.t_end_s
    return np.array(
        [
            work.values((case, eta, kappa), "decision_time_s") / t_end_s
            + WRONG * work.values((case, eta, kappa), "wrong_share")
            for eta, kappa in CHOICES
        ]
    )


def regrets(there: NDArray[np.float64], here: NDArray[np.float64]) -> NDArray[np.float64]:
    """What each run costs more with what was chosen there than with what was chosen here, (runs,).

    Args:
        there, here: (choices, runs). Odd runs are judged by what even ones chose, and the other way round.
    """
    found = np.empty(here.shape[1])
    for half in (0, 1):
        chosen = [int(costs[:, 1 - half :: 2].mean(axis=1).argmin()) for costs in (there, here)]
        found[half::2] = here[chosen[0], half::2] - here[chosen[1], half::2]
    return found


def _cost_table(costs: dict[str, NDArray[np.float64]]) -> pl.DataFrame:
    rows = []
    for case, values in costs.items():
        least = int(values.mean(axis=1).argmin())
        for place, (eta, kappa) in enumerate(CHOICES):
            found = mean_interval(values[place])
            rows.append(
                {
                    "case": case, "robots": CASES[case][0], "floor": CASES[case][1], "eta": eta, "kappa": kappa,
                    "cost": found.estimate, "low": plain(found.low), "high": plain(found.high),
                    "least": place == least,
                }
            )  # fmt: skip
    return pl.DataFrame(rows)


def pictures(tables: Tables, settings: Settings) -> Iterator[Picture]:
    """What positive feedback gains where nothing is lost; costs over kappa."""
    yield Picture(
        "sharing-positive", "Time of positive less no feedback, nothing lost", lambda: _draw(tables)
    )
    if "costs" in tables:
        yield Picture("sharing-costs", "Cost over kappa, eta 1500", lambda: _draw_costs(tables["costs"]))


def _draw(tables: Tables) -> Drawn:
    made = tables["gaps"].select("low", "high", estimate="gap_s", x="cell", series="column")
    return draw_error_bars(made, label="time of positive less none (s)")


def _draw_costs(table: pl.DataFrame) -> Drawn:
    chosen = table.filter(pl.col("eta") == ETAS[1])
    made = chosen.select("low", "high", estimate="cost", x="kappa", series="case")
    return draw_error_bars(made, x_label="kappa", label="cost (time / T_end + 4 x share wrong)")


ITEM: Final = Item(
    number=13,
    name="sharing",
    title="What is shared: positive feedback without loss, and the best eta and kappa",
    about=(
        "Where all hear all, robots of a swarm believe much the same, so that, the paper says, positive feedback has "
        "little to push: on random floors at the four fill ratios with five robots, and at 0.48 with 6 to 10.",
        "Do the best eta and kappa depend on the swarm's size and the floor, as the paper says? Each is chosen on one "
        f"half of the runs and judged on the other, by time / T_end + {WRONG:g} x share wrong, which is close to the "
        "cost of the paper's search.",
    ),
    cells=cells,
    compute=compute,
    pictures=pictures,
    shown=(
        Shown(
            "gaps",
            "Decision time of positive less no feedback; 95 % intervals over runs, paired.",
            {
                "column": Column("column"), "cell": Column("swarm and floor"),
                "gap_s": Column("difference", "s"), "low": Column("from", "s"), "high": Column("to", "s"),
            },
        ),
        Shown(
            "costs",
            "Costs of eta and kappa, 95 % intervals over runs; the least of each case is marked. Which is least is "
            "in part luck.",
            {
                "case": Column("case"), "robots": Column("robots"), "floor": Column("floor"),
                "eta": Column("eta"), "kappa": Column("kappa"), "cost": Column("cost"), "low": Column("from"),
                "high": Column("to"), "least": Column("least"),
            },
        ),
    ),
)  # fmt: skip
