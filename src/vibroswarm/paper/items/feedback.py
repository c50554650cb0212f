"""Items 4 and 13: soft feedback over eta and kappa, whether the best depend on the task; positive without loss.

| name | symbol | equation |
|---|---|---|
| cost of a run | c | mean time of its robots / T_end + 4 x its share of robots wrong |
| choice on half of the runs | - | the eta and kappa of least mean cost there |
| regret of a run | - | its cost with what was chosen elsewhere - that with what was chosen here |

The choice on one half is evaluated on the other, and vice versa, so that neither profits from a lucky choice. The
paper's search counts a wrong robot as 5 in place of its time, so as 4 to 5 more.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from itertools import product
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.analysis.intervals import mean_interval, plain
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
)
from vibroswarm.plots import draw_error_bars
from vibroswarm.report.html import Column

FILL: Final = "random:0.48"


def _etas() -> list[int]:
    return [int(eta) for eta in published("parameters.soft_feedback_grid.eta")]


def _kappas() -> list[int]:
    return [int(kappa) for kappa in published("parameters.soft_feedback_grid.kappa")]


def cells_of_grid(settings: Settings) -> Cells:
    """Return the cells by (column, strategy, eta, kappa)."""
    by_key: Cells = {}
    for column in settings.columns:
        for strategy in ("none", "positive"):
            values = {"floor.source": FILL, "strategy.name": strategy}
            by_key[column, strategy, None, None] = settings.cell(column, values)
        for eta in _etas():
            for kappa in _kappas():
                values = {"floor.source": FILL, "strategy.name": "soft"}
                values |= {"strategy.soft.eta": float(eta), "strategy.soft.kappa": float(kappa)}  # type: ignore[dict-item]
                by_key[column, "soft", eta, kappa] = settings.cell(column, values)
    return by_key


def _measured_grid(work: Work, column: str) -> Iterator[Row]:
    """Yield the rows of the claims about eta and kappa."""
    time, belief, wrong = "decision_time_s", "belief_in_truth", "wrong_share"
    none = (column, "none", None, None)
    most = (column, "soft", max(_etas()), max(_kappas()))
    label = f"eta {most[2]}, kappa {most[3]}"
    yield work.change("grid-approaches-none", column, label, time, most, none)
    for eta in _etas():
        kappa_1, kappa_2, kappa_4 = ((column, "soft", eta, kappa) for kappa in (1, 2, 4))
        for claim, name, first, second in (
            ("grid-kappa-4", time, kappa_4, none),
            ("grid-kappa-1-fast", time, kappa_1, kappa_2),
            ("grid-kappa-1-belief", belief, kappa_1, kappa_2),
            ("grid-kappa-1-wrong", wrong, kappa_1, kappa_2),
        ):
            yield work.change(claim, column, f"eta {eta}", name, first, second)
    for kappa in _kappas():
        low, high = ((column, "soft", eta, kappa) for eta in (min(_etas()), max(_etas())))
        for claim, name in (("grid-eta-fast", time), ("grid-eta-belief", belief)):
            yield work.change(claim, column, f"kappa {kappa}, eta {low[2]} less {high[2]}", name, low, high)


def pictures_of_grid(tables: Tables, settings: Settings) -> Iterator[Picture]:
    """Yield a line for each kappa (κ) over eta (η), with no feedback and positive feedback across, as in the paper."""
    table = tables["cells"]
    soft = table.filter(pl.col("strategy") == "soft").with_columns(series=pl.format("κ {}", pl.col("kappa")))
    across = table.filter(pl.col("strategy") != "soft").drop("eta").rename({"strategy": "series"})
    lines = across.join(pl.DataFrame({"eta": _etas()}), how="cross")
    names = [name for name in soft.columns if name != "strategy"]
    together = pl.concat([soft.select(names), lines.select(names)]).sort("series", maintain_order=True)
    flat = ("none", "positive")
    yield from both_forms(
        "feedback-grid", together, settings.columns, "eta", "η", "series", FIGURES[:5], flat
    )


GRID_KEYS: Final = ("column", "strategy", "eta", "kappa")
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
    shown=two_forms("cells", GRID_KEYS),
)

HERE: Final = "random:0.48"
EASIER: Final = "random:0.44"
WRONG: Final = 4.0
ETAS: Final = (750.0, 1500.0, 2500.0)
KAPPAS: Final = (1.0, 2.0, 3.0, 4.0)
CHOICES: Final = tuple(product(ETAS, KAPPAS))
CASES: Final = {"as searched": (5, HERE), "ten robots": (10, HERE), "easier floor": (5, EASIER)}
"""Robots and floor; eta and kappa were optimised in the first case."""
COLUMN: Final = "paper"


def cells(settings: Settings) -> Cells:
    """Return the cells by (column, robots, floor, strategy), and those of the grid by (case, eta, kappa)."""
    by_key: Cells = {}
    for column in settings.columns:
        for robots, floor in _where():
            for strategy in STRATEGIES[:2]:
                values: dict[str, Any] = {"floor.source": floor, "strategy.name": strategy}
                values |= {
                    "swarm.robots": robots,
                    "network.name": "ideal",
                }  # preset `calibrated` has message loss
                by_key[column, robots, floor, strategy] = settings.cell(column, values)
    if COLUMN in settings.columns:
        for (case, (robots, floor)), (eta, kappa) in product(CASES.items(), CHOICES):
            values = {"floor.source": floor, "swarm.robots": robots, "strategy.name": "soft"}
            by_key[case, eta, kappa] = settings.cell(
                COLUMN, values | {"strategy.soft.eta": eta, "strategy.soft.kappa": kappa}
            )
    return by_key


def _where() -> list[tuple[int, str]]:
    """Swarm sizes and floors on which positive feedback is compared."""
    few = int(published("simulation.robots"))
    return [(few, f"random:{fill}") for fill in fills()] + [(n, HERE) for n in sizes() if n != few]


def compute(work: Work) -> Tables:
    """Compute cells with both strategies, their differences, the costs of eta and kappa, and claims."""
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
    """Yield rows of the claims about positive feedback without loss."""
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
    table = frame(rows).rename({"estimate": "gap_s"})
    half = 1.96 * pl.col("standard_error")
    return table.select("column", "cell", "gap_s", low=pl.col("gap_s") - half, high=pl.col("gap_s") + half)


def _costs(work: Work, case: str) -> NDArray[np.float64]:
    """Return the cost of each run with each eta and kappa, (choices, runs)."""
    t_end_s = work.cells[case, *CHOICES[0]].scenario.run.t_end_s
    return np.array(
        [
            work.values((case, eta, kappa), "decision_time_s") / t_end_s
            + WRONG * work.values((case, eta, kappa), "wrong_share")
            for eta, kappa in CHOICES
        ]
    )


def regrets(there: NDArray[np.float64], here: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the cost of each run with what was chosen there, minus that with what was chosen here, (runs,).

    Args:
        there, here: (choices, runs). Odd runs are evaluated with the choice on even ones, and vice versa.
    """
    regret = np.empty(here.shape[1])
    for half in (0, 1):
        chosen = [int(costs[:, 1 - half :: 2].mean(axis=1).argmin()) for costs in (there, here)]
        regret[half::2] = here[chosen[0], half::2] - here[chosen[1], half::2]
    return regret


def _cost_table(costs: dict[str, NDArray[np.float64]]) -> pl.DataFrame:
    """Return the mean cost of each case with each eta and kappa."""
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
    """Yield gain of positive feedback without loss; costs over kappa."""
    gaps = tables["gaps"].select("low", "high", estimate="gap_s", x="cell", series="column")
    draw = partial(draw_error_bars, gaps, label="difference in time, positive - none (s)")
    yield Picture("sharing-positive", "Difference in time (positive - none) without loss", draw)
    if "costs" in tables:
        chosen = tables["costs"].filter(pl.col("eta") == ETAS[1])
        costs = chosen.select("low", "high", estimate="cost", x="kappa", series="case")
        draw = partial(draw_error_bars, costs, x_label="κ", label="cost (time / T_end + 4 × share wrong)")
        yield Picture("sharing-costs", "Cost over kappa, eta 1500", draw)


SHARING: Final = Item(
    number=13,
    name="sharing",
    title="Positive feedback without loss, and the best eta and kappa",
    about=(
        "Without message loss the robots of a swarm have nearly the same belief so that, according to the paper, "
        "positive feedback has little effect: tested on random floors at the four fill ratios with five robots, and at "
        "0.48 with 6 to 10.",
        "Do the best eta and kappa depend on the swarm's size and the floor, as the paper says? Each is chosen on one "
        f"half of the runs and evaluated on the other, by time / T_end + {WRONG:g} x share wrong, which is close to "
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
                "gap_s": Column("difference", "s"), "low": Column("from", "s"), "high": Column("to", "s"),
            },
        ),
        TableView(
            "costs",
            "Costs of eta and kappa, 95 % intervals over runs; the least of each case is marked, partly by chance.",
            {
                "case": Column("case"), "robots": Column("robots"), "floor": Column("floor"),
                "eta": Column("eta"), "kappa": Column("kappa"), "cost": Column("cost"), "low": Column("from"),
                "high": Column("to"), "least": Column("least"),
            },
        ),
    ),
)  # fmt: skip
