"""Items 3 and 13: the paper's search by particle swarm; whether the best eta and kappa depend on size and floor.

| name | equation |
|---|---|
| cost of a run | mean time of its robots / T_end + 4 x its share of robots wrong |
| choice of a case | the eta and kappa of least mean cost over one half of its runs |
| regret of a run | its cost with the choice of the other case - its cost with that of its own, both of the other half |

A wrong robot adds 4 to 5 to the cost of the paper's search, here 4.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.paper.cells import Cells
from vibroswarm.paper.claims import constant, estimated, mean
from vibroswarm.paper.columns import parameters, published, scenario_of
from vibroswarm.paper.item import Drawn, Made, Settings, Work
from vibroswarm.plots import draw_error_bars, draw_parameters, draw_search
from vibroswarm.scenario.scenario import preset
from vibroswarm.search import (
    Objective,
    PsoSettings,
    Search,
    Truth,
    history_table,
    paired_score,
    run_search,
    truth_of,
)
from vibroswarm.simulation import versions
from vibroswarm.statistics.intervals import Interval, columns_of, mean_interval
from vibroswarm.study.spec import Study

COLUMN: Final = "paper"
ELSEWHERE: Final = "optimised-cost"
"""A preset found by another search; its robots wait longer before they decide."""
RUNS_AN_ITERATION: Final = 20
"""Runs per cell of the reproduction for which the search gets one iteration, up to the paper's 50."""
LEAST_SHARE: Final = 0.5
"""Share of the paper's iterations from which the final score has a verdict."""


def search_of(settings: Settings) -> Search:
    """Return the paper's search from P0, in which scores of personal bests are never computed again."""
    swarm = published("parameters.pso")
    iterations = min(swarm["iterations"], max(2, settings.runs // RUNS_AN_ITERATION))
    return Search(
        study=Study(scenario_of(COLUMN, {"floor.source": f"random:{swarm['fill_ratio']}"}), seed=settings.seed),
        objectives=(Objective("authors_code"),),
        pso=PsoSettings(
            particles=swarm["particles"],
            iterations=iterations,
            evaluations=swarm["evaluations"],
            extra=swarm["extra_evaluations_top_20_percent"],
            inertia_first=swarm["omega_first"],
            inertia_last=swarm["omega_last"],
            weight_personal=swarm["omega_p"],
            weight_global=swarm["omega_g"],
            noise="fixed",
        ),
        start=("paper-empirical",),
    )  # fmt: skip


def compute(work: Work, made: Made) -> None:
    """Search, and compare the winner and other parameters on fresh runs."""
    search, workers = search_of(work.settings), work.settings.workers
    found = run_search(search, work.folder / f"search-{versions()['code']}", workers=workers)
    others = [("P*", parameters("P_star")), (ELSEWHERE, search.space.values_of(preset(ELSEWHERE)))]
    truth = truth_of(found, runs=work.settings.runs, others=others, workers=workers)
    scored = {one.name: one for one in truth.others}
    for claim, name in (("search-beats-start", "start"), ("search-is-best", ELSEWHERE)):
        difference = paired_score(search.objectives[0], scored[name], scored["P*"])
        made.values.append(estimated(claim, COLUMN, f"{name} - P*", difference))
    means = {one.number: one.mean_point for one in found.history}
    last, whole = max(means), published("parameters.pso.iterations")
    short = f"the search took {last} of {whole} iterations"
    ratio = _ratio(truth.believed, truth.winner.score)
    too_short = "" if last >= LEAST_SHARE * whole else short
    made.values.append(estimated("search-score-holds", COLUMN, "this search", ratio, too_short))
    settles_at = published("parameters.pso.stabilises_at_iteration") * last / whole
    settled = min(means, key=lambda number: abs(number - settles_at))
    for place, name in enumerate(search.space.names):
        moved = means[last][place] - means[settled][place]
        cannot = "" if last >= whole else short
        made.values.append(constant("search-settles", COLUMN, name.rpartition(".")[2], moved, cannot))
    history = history_table(found).filter(pl.col("stage") == "search")
    made.tables |= {"truth": _truth_table(truth), "history": history}
    made.pictures["search-scores"] = Drawn("Costs over the iterations", partial(_scores, history, truth))
    shares = pl.DataFrame(
        [
            (number, name, point[place])
            for number, point in means.items()
            for place, name in enumerate(search.space.names)
        ],
        schema={"iteration": pl.Int64, "series": pl.String, "share": pl.Float64},
        orient="row",
    )
    made.pictures["search-parameters"] = Drawn("Mean of the parameters", partial(draw_parameters, shares))


def _ratio(believed: float, true: Interval) -> Interval:
    ends = sorted(believed / end - 1.0 if end else math.inf for end in (true.low, true.high))
    return true._replace(estimate=believed / true.estimate - 1.0, low=ends[0], high=ends[1])


def _truth_table(truth: Truth) -> pl.DataFrame:
    rows: list[dict[str, Any]] = []
    for one, difference in zip((truth.winner, *truth.others), (None, *truth.against), strict=True):
        values = {name.rpartition(".")[2]: value for name, value in one.values.items()}
        row = {"parameters": "P0" if one.name == "start" else one.name, **values}
        row |= {"believed": truth.believed if difference is None else None}
        row |= columns_of("cost", one.score) | columns_of("winner_difference", difference or [None] * 3)
        rows.append(row | {"runs": one.score.n})
    return pl.DataFrame(rows, infer_schema_length=None)


def _scores(history: pl.DataFrame, truth: Truth) -> Any:
    personal = [name for name in history.columns if name.startswith("personal ")]
    by_particle = history.select("iteration", *personal).unpivot(index="iteration", value_name="score")
    by_particle = by_particle.with_columns(
        particle=pl.col("variable").str.strip_prefix("personal ").cast(pl.Int64)
    ).drop("variable")
    scores = history.select(pl.col("iteration").cast(pl.Int64), "best", "mean")
    true = truth.winner.score.estimate
    return draw_search(scores, by_particle, label="cost (mean + sd)", true=true)


WRONG: Final = 4.0
SEARCHED: Final = "as searched"
CLAIMS: Final = {"soft-optimum-size": "ten robots", "soft-optimum-difficulty": "easier floor"}


def sharing(work: Work, made: Made) -> None:
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
