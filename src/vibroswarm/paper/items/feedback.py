"""Items 4 and 13: soft feedback over eta and kappa, whether the best values depend on the task, and positive feedback
without loss.

A case is a swarm size and a floor. The paper's search found the best eta and kappa in one case; the question is what is
lost if they are used in another case.

| name | symbol | equation |
|---|---|---|
| cost of a run | c | mean time of its robots / T_end + 4 x its share of robots wrong |
| choice of a case | - | the eta and kappa of least mean cost over one half of the case's runs |
| regret of a run | - | its cost with the choice of the other case - its cost with the choice of its own case |

Choices are made on one half of the runs and evaluated on the other half, and vice versa, so that no choice profits from
the luck of the runs it was made on. The paper's search counts a wrong robot as 5 instead of its time / T_end, which is
at most 1. A wrong robot thus adds 4 to 5 to the cost; here it adds 4.

A column is a preset of the reproduction. The measured values of the claims are rows of ``claims.MEASURED``;
``Work.change`` makes one from the difference of two cells (first - second), paired by run.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.numbers import stated
from vibroswarm.paper.cell_tables import FIGURES, both_forms, two_forms
from vibroswarm.paper.claim_values import Row, frame, mean
from vibroswarm.paper.columns import STRATEGIES, fills, published, sizes
from vibroswarm.paper.item import (
    CLAIMS,
    Cells,
    Item,
    Picture,
    Settings,
    Tables,
    TableView,
    Work,
    cells_and_claims,
    picture,
)
from vibroswarm.plots import draw_error_bars
from vibroswarm.show.document import Column
from vibroswarm.statistics.intervals import mean_interval, plain

HERE: Final = "random:0.48"
"""Floor of the paper's search, and of its grid of eta and kappa: random floors of fill ratio 0.48."""
GRID_ETAS: Final[list[int]] = published("parameters.soft_feedback_grid.eta")
GRID_KAPPAS: Final[list[int]] = published("parameters.soft_feedback_grid.kappa")
"""Values of eta and kappa in the paper's grid."""


def cells_of_grid(settings: Settings) -> Cells:
    """Return the cells of the grid by (column, strategy, eta, kappa).

    Without soft feedback, eta and kappa do not exist; they are None in the key.
    """
    soft = [("soft", eta, kappa) for eta, kappa in product(GRID_ETAS, GRID_KAPPAS)]
    return {
        (column, *key): settings.cell(column, {"floor.source": HERE, **_fields_of(*key)})
        for column in settings.columns
        for key in (("none", None, None), ("positive", None, None), *soft)
    }


def _fields_of(strategy: str, eta: float | None, kappa: float | None) -> dict[str, Any]:
    """Return the fields of a strategy; ``eta`` and ``kappa`` are None unless it is soft feedback."""
    if eta is None or kappa is None:
        return {"strategy.name": strategy}
    return {"strategy.name": strategy, "strategy.soft.eta": float(eta), "strategy.soft.kappa": float(kappa)}


def _measured_grid(work: Work, column: str) -> Iterator[Row]:
    """Yield the measured values of the claims about eta and kappa: differences between cells, paired by run.

    Each is a difference (first - second) of time, belief or share of wrong robots between two keys of cells.
    """
    time, belief, wrong = "decision_time_s", "belief_in_truth", "wrong_share"
    none = (column, "none", None, None)
    least_eta, most_eta, most_kappa = min(GRID_ETAS), max(GRID_ETAS), max(GRID_KAPPAS)
    most = (column, "soft", most_eta, most_kappa)
    yield work.change(
        "time-weakest-soft-less-none", column, f"eta {most_eta}, kappa {most_kappa}", time, most, none
    )
    for eta in GRID_ETAS:
        kappa_1, kappa_2, kappa_4 = ((column, "soft", eta, kappa) for kappa in (1, 2, 4))
        yield work.change("time-kappa-4-less-none", column, f"eta {eta}", time, kappa_4, none)
        yield from work.changes(
            {"time-kappa-1-less-2": time, "belief-kappa-1-less-2": belief, "wrong-kappa-1-less-2": wrong},
            column, f"eta {eta}", kappa_1, kappa_2,
        )  # fmt: skip
    for kappa in GRID_KAPPAS:
        low, high = (column, "soft", least_eta, kappa), (column, "soft", most_eta, kappa)
        label = f"kappa {kappa}, eta {least_eta} less {most_eta}"
        figures = {"time-low-eta-less-high": time, "belief-low-eta-less-high": belief}
        yield from work.changes(figures, column, label, low, high)


def pictures_of_grid(tables: Tables, settings: Settings) -> Iterator[Picture]:
    """Yield pictures of the grid: a line over eta (η) for each kappa (κ) of soft feedback.

    As in the paper, no feedback and positive feedback, which have no eta, are horizontal lines.
    """
    table = tables["cells"]
    soft = table.filter(pl.col("strategy") == "soft").with_columns(series=pl.format("κ {}", pl.col("kappa")))
    others = table.filter(pl.col("strategy") != "soft").drop("eta").rename({"strategy": "series"})
    horizontal = others.join(pl.DataFrame({"eta": GRID_ETAS}), how="cross")  # the same value at every eta
    names = [name for name in soft.columns if name != "strategy"]
    together = pl.concat([soft.select(names), horizontal.select(names)]).sort("series", maintain_order=True)
    yield from both_forms(
        "feedback-grid",
        together,
        settings.columns,
        x="eta",
        x_label="η",
        series="series",
        figures=FIGURES[:5],  # without undecided robots
        constant=("none", "positive"),
    )


GRID_KEYS: Final = ("column", "strategy", "eta", "kappa")
"""Parts of the keys of the grid's cells."""
GRID: Final = Item(
    number=4,
    name="feedback-grid",
    title="Soft feedback over eta and kappa",
    about=(
        "The second stage of the paper's optimisation: five robots with P* at a fill ratio of 0.48. No "
        "feedback and positive feedback, which know neither eta nor kappa, are drawn across. All cells of a "
        "column share their motion.",
    ),
    cells=cells_of_grid,
    compute=cells_and_claims(GRID_KEYS, _measured_grid),
    pictures=pictures_of_grid,
    shown=two_forms(GRID_KEYS),
)

WRONG: Final = 4.0
"""Cost of a wrong robot, added to its time / T_end."""
ETAS: Final = (750.0, 1500.0, 2500.0)
"""Values of eta that are tried in each case."""
CHOICES: Final = tuple(product(ETAS, (1.0, 2.0, 3.0, 4.0)))
"""Pairs of eta and kappa that are tried in each case."""
CASES: Final = {"as searched": (5, HERE), "ten robots": (10, HERE), "easier floor": (5, "random:0.44")}
"""Robots and floor of each case; the paper optimised eta and kappa in the first. The easier floor has a fill ratio that
is farther from one half."""
COLUMN: Final = "paper"
"""Preset in which the cases are simulated."""


def cells(settings: Settings) -> Cells:
    """Return the cells of item 13.

    Cells of no feedback and of positive feedback have the keys (column, robots, floor, strategy). Cells of the cases,
    with soft feedback, have the keys (case, eta, kappa).
    """
    by_key: Cells = {
        (column, robots, floor, strategy): settings.cell(
            column,
            {
                "floor.source": floor,
                "strategy.name": strategy,
                "swarm.robots": robots,
                "network.name": "ideal",  # preset `calibrated` has message loss
            },
        )
        for column in settings.columns
        for robots, floor in _where()
        for strategy in STRATEGIES[:2]
    }
    if COLUMN in settings.columns:
        by_key |= {
            (case, eta, kappa): settings.cell(
                COLUMN, {"floor.source": floor, "swarm.robots": robots, **_fields_of("soft", eta, kappa)}
            )
            for (case, (robots, floor)), (eta, kappa) in product(CASES.items(), CHOICES)
        }
    return by_key


def _where() -> list[tuple[int, str]]:
    """Return the pairs of swarm size and floor with which positive feedback is compared with no feedback.

    They are all floors with the paper's swarm size, then the other swarm sizes on the floor ``HERE``.
    """
    few = int(published("simulation.robots"))
    return [(few, f"random:{fill}") for fill in fills()] + [(n, HERE) for n in sizes() if n != few]


def compute(work: Work) -> Tables:
    """Return the tables of item 13, and the claims' measured values.

    The tables are the cells of no and of positive feedback, the gaps between the two in time, and the costs of each eta
    and kappa. The claims about eta and kappa are about the regret of the choice made in the paper's case.
    """
    columns = work.settings.columns
    measured = [row for column in columns for row in _positive(work, column)]
    keys = [(c, robots, floor, s) for c in columns for robots, floor in _where() for s in STRATEGIES[:2]]
    tables = {"cells": work.rows(("column", "robots", "floor", "strategy"), keys), "gaps": _gaps(measured)}
    if COLUMN in columns:
        costs = {case: _costs(work, case) for case in CASES}
        tables["costs"] = _cost_table(costs)
        for value_name, case in (
            ("regret-of-other-size", "ten robots"),
            ("regret-of-other-floor", "easier floor"),
        ):
            measured.append(mean(value_name, COLUMN, case, regrets(costs["as searched"], costs[case])))
    return tables | {CLAIMS: frame(measured)}


def _positive(work: Work, column: str) -> Iterator[Row]:
    """Yield the measured values of the claims about positive feedback without loss in a column.

    A gap is the time with positive feedback minus the time without feedback, run by run. The values are the gaps with
    each swarm size and floor, and the gap in the largest swarm minus the gap in the paper's swarm.
    """
    gaps = {}
    for robots, floor in _where():
        pair = (column, robots, floor, "positive"), (column, robots, floor, "none")
        gaps[robots, floor] = work.difference("decision_time_s", *pair)
        words, cannot = f"{robots} robots, {floor}", work.cannot(pair[1])
        yield mean("time-positive-less-none", column, words, gaps[robots, floor], cannot=cannot)
    few, many = int(published("simulation.robots")), max(sizes())
    grown = gaps[many, HERE] - gaps[few, HERE]
    cannot = work.cannot((column, many, HERE, "none"))  # the same for both: the swarm's size does not matter
    yield mean("lead-many-less-few", column, f"{many} less {few} robots", grown, cannot=cannot)


def _gaps(measured: list[Row]) -> pl.DataFrame:
    """Return the mean gaps with 95 % intervals, one row per column and cell.

    Args:
        measured: rows of ``_positive``; the rows of other claims are skipped.
    """
    rows = [row for row in measured if row["value"] == "time-positive-less-none"]
    table = frame(rows).rename({"estimate": "gap_s"})
    half = 1.96 * pl.col("standard_error")
    return table.select("column", "cell", "gap_s", low=pl.col("gap_s") - half, high=pl.col("gap_s") + half)


def _costs(work: Work, case: str) -> NDArray[np.float64]:
    """Return the cost of each run of a case with each eta and kappa, (choices, runs), in the order of ``CHOICES``."""
    t_end_s = work.cells[case, *CHOICES[0]].scenario.run.t_end_s
    return np.array(
        [
            work.values((case, eta, kappa), "decision_time_s") / t_end_s
            + WRONG * work.values((case, eta, kappa), "wrong_share")
            for eta, kappa in CHOICES
        ]
    )


def regrets(there: NDArray[np.float64], here: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the regret of each run of a case with the choice of another case, (runs,).

    Runs with even numbers are evaluated with the choices made on runs with odd numbers, and vice versa.

    Args:
        there: costs of the other case, (choices, runs). here: costs of the case itself, (choices, runs). At least two
            runs, so that neither half is empty.
    """
    regret = np.empty(here.shape[1])
    for half in (0, 1):  # half 0: runs 0, 2, 4, ...; the choices are made on the other half, 1 - half
        choice_there, choice_here = (
            int(costs[:, 1 - half :: 2].mean(axis=1).argmin()) for costs in (there, here)
        )
        regret[half::2] = here[choice_there, half::2] - here[choice_here, half::2]
    return regret


def _cost_table(costs: dict[str, NDArray[np.float64]]) -> pl.DataFrame:
    """Return the mean cost of each case with each eta and kappa, with its interval, one row each.

    The column ``least`` is True in the row of least mean cost of each case.

    Args:
        costs: costs of each run by case, (choices, runs) each.
    """
    rows = []
    for case, values in costs.items():
        least = int(values.mean(axis=1).argmin())
        for place, (eta, kappa) in enumerate(CHOICES):
            cost = mean_interval(values[place])
            rows.append(
                {
                    "case": case, "robots": CASES[case][0], "floor": CASES[case][1], "eta": eta, "kappa": kappa,
                    "cost": cost.estimate, "low": plain(cost.low), "high": plain(cost.high),
                    "least": place == least,
                }
            )  # fmt: skip
    return pl.DataFrame(rows)


def pictures(tables: Tables, settings: Settings) -> Iterator[Picture]:
    """Yield a picture of the gaps without loss, and a picture of the costs over kappa with the middle eta."""
    gaps = tables["gaps"].select("low", "high", estimate="gap_s", x="cell", series="column")
    title = "Difference in time (positive - none) without loss"
    label = "difference in time, positive - none (s)"
    yield picture("sharing-positive", title, draw_error_bars, gaps, label=label)
    if "costs" in tables:
        chosen = tables["costs"].filter(pl.col("eta") == ETAS[1])
        costs = chosen.select("low", "high", estimate="cost", x="kappa", series="case")
        yield picture(
            "sharing-costs", "Cost over kappa, eta 1500", draw_error_bars, costs, x_label="κ",
            label="cost (time / T_end + 4 × share wrong)",
        )  # fmt: skip


SHARING: Final = Item(
    number=13,
    name="sharing",
    title="Positive feedback without loss, and the best eta and kappa",
    about=(
        "Without message loss the robots of a swarm have nearly the same belief so that, according to the paper, "
        "positive feedback has little effect: tested on random floors at the four fill ratios with five robots, and at "
        "0.48 with 6 to 10.",
        "Do the best eta and kappa depend on the swarm's size and the floor, as the paper says? Each is chosen on one "
        f"half of the runs and evaluated on the other, by time / T_end + {stated(WRONG)} x share wrong, which is "
        f"close to "
        "the cost of the paper's search.",
    ),
    cells=cells,
    compute=compute,
    pictures=pictures,
    shown=(
        TableView(
            "gaps",
            "Difference in decision time (positive - none); 95 % intervals over runs, paired.",
            {
                "column": Column("column"), "cell": Column("swarm and floor"),
                "gap_s": Column("difference", "s", limits=("low", "high")),
            },
        ),
        TableView(
            "costs",
            "Costs of eta and kappa, 95 % intervals over runs; the least of each case is marked, partly by chance.",
            {
                "case": Column("case"), "robots": Column("robots"), "floor": Column("floor"),
                "eta": Column("eta"), "kappa": Column("kappa"), "cost": Column("cost", limits=("low", "high")),
                "least": Column("least"),
            },
        ),
    ),
)  # fmt: skip
