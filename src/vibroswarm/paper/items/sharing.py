"""Item 13: whether the best eta and kappa depend on the swarm's size and on the floor.

| name | equation |
|---|---|
| cost of a run | mean time of its robots / T_end + 4 x its share of robots wrong |
| choice of a case | the eta and kappa of least mean cost over one half of its runs |
| regret of a run | its cost with the choice of the other case - its cost with that of its own, both of the other half |

A wrong robot adds 4 to 5 to the cost of the paper's search, here 4.
"""

from __future__ import annotations

from functools import partial
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.paper.cells import Cells
from vibroswarm.paper.claims import mean
from vibroswarm.paper.item import Drawn, Made, Work
from vibroswarm.plots import draw_error_bars
from vibroswarm.statistics.intervals import columns_of, mean_interval

WRONG: Final = 4.0
SEARCHED: Final = "as searched"
CLAIMS: Final = {"soft-optimum-size": "ten robots", "soft-optimum-difficulty": "easier floor"}


def compute(work: Work, made: Made) -> None:
    """Compare the choices of other cases with that of the paper's search."""
    if ("feedback-cases", "paper") not in work.cells:
        return
    cells = work.cells["feedback-cases", "paper"]
    costs = {label: _costs(cells, label) for label in (SEARCHED, *CLAIMS.values())}
    for claim, label in CLAIMS.items():
        made.values.append(mean(claim, "paper", label, regrets(costs[SEARCHED], costs[label])))
    rows = [
        {**cells.cells[place].point, **columns_of("cost", mean_interval(cost))}
        for label in costs
        for place, cost in zip(cells.where({"label": label}), costs[label], strict=True)
    ]
    table = pl.DataFrame(rows)
    made.tables["costs"] = table
    points = table.filter(pl.col("strategy.soft.eta") == 1500.0).select(
        x="strategy.soft.kappa", series="label", estimate="cost", low="cost_low", high="cost_high"
    )
    draw = partial(draw_error_bars, points, x_label="κ", label="cost")
    made.pictures["sharing-costs"] = Drawn("Cost over kappa, eta 1500", draw)


def _costs(cells: Cells, label: str) -> NDArray[np.float64]:
    return np.array(
        [
            cells.by_run(place, "decision_time_s") / cells.cells[place].scenario.run.t_end_s
            + WRONG * cells.by_run(place, "wrong_share")
            for place in cells.where({"label": label})
        ]
    )


def regrets(there: NDArray[np.float64], here: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the regret of each run with the choice of another case, (runs,), at least two."""
    regret = np.empty(here.shape[1])
    for half in (0, 1):  # even runs are judged by the choice of odd runs, and the other way round
        other, own = (int(costs[:, 1 - half :: 2].mean(axis=1).argmin()) for costs in (there, here))
        regret[half::2] = here[other, half::2] - here[own, half::2]
    return regret
