"""Score sets of values on fresh runs: the winner and the starts of a search, its Pareto front, and cells of a study.

The candidate that looks best of many was partly lucky (the winner's curse), so a search underestimates its cost. That
estimate is the believed score. The true score comes from fresh runs, which played no part in any choice. The starts are
scored on the same runs, so that the winner is compared with them in pairs.

| name | equation |
|---|---|
| bias | true - believed; its limits are those of two independent estimates (Zou and Donner 2008) |
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.errors import RunError
from vibroswarm.inference.outcomes import Array
from vibroswarm.search.evaluate import Figures, derived_seed, evaluator_for
from vibroswarm.search.loop import Found
from vibroswarm.search.objective import (
    LEAST_DIFFERING,
    Objective,
    Rows,
    bootstrap,
    drawn_scores,
    without_limits,
    worst_case,
)
from vibroswarm.search.outcomes import from_tables
from vibroswarm.search.space import Values
from vibroswarm.search.spec import Search
from vibroswarm.statistics.best_group import best_group, pareto_front
from vibroswarm.statistics.intervals import Interval, bounded_mean, cluster_share, columns_of, plain
from vibroswarm.study.cells import Cell
from vibroswarm.study.run import run
from vibroswarm.study.runs import Runs

MIN_FRESH_RUNS: Final = 200
"""Fewest fresh runs of each candidate of a front."""
Z: Final = 1.959964
"""Standard errors of a 95 % interval."""


@dataclass(frozen=True)
class Scored:
    """One set of values with its score and the figures of its runs."""

    name: str
    """Such as "winner" or "start"."""
    values: Values
    score: Interval
    """The score over all cases."""
    figures: Figures
    parts: Mapping[str, Interval]
    """Parts of the score of ``time_at_error``: time, errors and undecided, each in the case where it is worst."""


@dataclass(frozen=True)
class Truth:
    """The score of a search's winner as the search believed it, and on fresh runs."""

    believed: float
    winner: Scored
    others: tuple[Scored, ...]
    """The starts and other requested values, on the same runs."""
    against: tuple[Interval, ...]
    """Score of the winner minus the score of each of ``others``, paired by run."""
    bias: Interval
    """True minus believed score: above 0, the winner was partly lucky."""


def truth_of(
    found: Found,
    *,
    runs: int | None = None,
    others: Sequence[tuple[str, Mapping[str, Any]]] = (),
    **where: Any,
) -> Truth:
    """Score the winner, the starts of the search and ``others`` on the same fresh runs, under the first objective.

    Args:
        runs: number of fresh runs; by default that of the search's settings.
        others: further sets of values of the space's fields, each with its name.
        where: ``folder``, ``executor``, ``workers``, ``progress`` (given the number of finished runs).
    """
    search = found.search
    starts = [(f"start {k + 1}" if len(search.starts) > 1 else "start", search.space.values(point))
              for k, point in enumerate(search.starts)]  # fmt: skip
    named = [("winner", found.values), *starts, *others]
    winner, *rest = score_fresh(search, named, runs or search.settings.fresh, **where)
    _, error = found.archive.estimate(found.best)
    return Truth(
        believed=found.believed,
        winner=winner,
        others=tuple(rest),
        against=tuple(paired_score(search.objectives[0], winner, other) for other in rest),
        bias=bias_of(winner.score, found.believed, error),
    )


def bias_of(true: Interval, believed: float, error: float) -> Interval:
    """Return true minus believed score, with limits from those of the true one and the other's standard error."""
    difference = true.estimate - believed
    low = difference - math.hypot(true.estimate - true.low, Z * error)
    high = difference + math.hypot(true.high - true.estimate, Z * error)
    return Interval(difference, low, high, 0.95, true.n, "two estimates")


def score_fresh(
    search: Search, named: Sequence[tuple[str, Mapping[str, Any]]], runs: int, **where: Any
) -> list[Scored]:
    """Score named sets of values on the same fresh runs, under the first objective; ``where``: see ``truth_of``."""
    objective = search.objectives[0]
    fresh = _fresh_figures(search, [values for _, values in named], runs, **where)
    return [
        scored_of(name, dict(values), objective, one._replace(rows=one.rows[:, :, : objective.width]))
        for (name, values), one in zip(named, fresh, strict=True)
    ]


def _fresh_figures(
    search: Search,
    sets: Sequence[Mapping[str, Any]],
    runs: int,
    progress: Callable[[int], None] = lambda done: None,
    **where: Any,
) -> list[Figures]:
    with evaluator_for(search, **where) as evaluator:
        found = evaluator.figures("fresh runs", [(values, range(runs)) for values in sets], progress)
    for one in found:
        if not one.runs.size:
            raise RunError(f"all {runs} fresh runs failed: {one.why}")
    return found


def scored_of(name: str, values: Values, objective: Objective, figures: Figures) -> Scored:
    """Compute the score of one set of values from the figures of its runs."""
    parts = _parts(figures.rows) if objective.name == "time_at_error" else {}
    return Scored(name, values, objective.interval(figures.rows), figures, parts)


def paired_score(objective: Objective, first: Scored, second: Scored) -> Interval:
    """Estimate the difference of two scores, first - second, with a bootstrap over the runs that both have.

    Each resample takes the same runs for both scores, so that noise that is common to both cancels. The limits are
    infinite if fewer than ``LEAST_DIFFERING`` runs differ, or if a score of so many runs has no limits.
    """
    width = first.figures.rows.shape[2]
    _, of_first, of_second = np.intersect1d(first.figures.runs, second.figures.runs, return_indices=True)
    # ``bootstrap`` resamples one array along the runs: so the columns of both are put side by side
    both = np.concatenate([first.figures.rows[of_first], second.figures.rows[of_second]], axis=2)
    differing = int((both[:, :, :width] != both[:, :, width:]).any(axis=(1, 2)).sum())

    def difference(rows: Rows) -> float:
        return objective.score(rows[:, :, :width]) - objective.score(rows[:, :, width:])

    found = bootstrap(difference, both)
    too_few = differing < LEAST_DIFFERING or objective.are_too_few(of_first.size)
    return without_limits(found) if too_few else found


def _parts(rows: Rows) -> dict[str, Interval]:
    """Compute the parts of ``time_at_error``; each run is a cluster of robots, which are not independent."""
    time_s, wrong, decided, robots, t_end_s = np.moveaxis(rows, 2, 0)  # (runs, cases) each
    of_cases: dict[str, Callable[[int, float], Interval]] = {
        "decision_time_s": lambda k, at: bounded_mean(time_s[:, k], 0.0, float(t_end_s[0, k]), at),
        # nan in a case in which no robot decided; ``robots_undecided`` covers such a case
        "robot_error": lambda k, at: cluster_share(wrong[:, k], decided[:, k], at),
        "robots_undecided": lambda k, at: cluster_share(robots[:, k] - decided[:, k], robots[:, k], at),
    }
    return {name: worst_case(of_case, rows.shape[1]) for name, of_case in of_cases.items()}


def front_of(found: Found, **where: Any) -> pl.DataFrame | None:
    """Score all candidates on the Pareto front of a search on the same fresh runs, under every objective.

    A row has key, values, of each objective the believed score and the true one with limits, runs and failed runs, and
    whether the candidate stays on the front. None: no candidate has a score. ``where``: see ``truth_of``.
    """
    search, archive = found.search, found.archive
    if not (front := archive.front()):
        return None
    runs = max(search.settings.fresh // len(front), MIN_FRESH_RUNS)
    words = [objective.words for objective in search.objectives]
    names = [f"{one} ({k + 1})" if words.count(one) > 1 else one for k, one in enumerate(words)]
    fresh = _fresh_figures(search, [archive[key].values for key in front], runs, **where)
    rows = []
    for key, figures in zip(front, fresh, strict=True):
        row: dict[str, Any] = {"key": key, **archive[key].values}
        scored = zip(names, search.objectives, archive.columns, archive.scores(key), strict=True)
        for name, objective, columns, believed in scored:
            true = objective.interval(figures.rows[:, :, columns])
            row |= {f"{name} believed": plain(believed), **columns_of(name, true)}
        rows.append(row | {"runs": figures.runs.size, "failed": figures.failed})
    table = pl.DataFrame(rows, infer_schema_length=None)
    return table.with_columns(stays=pl.Series(pareto_front(*(table[name] for name in names))))


@dataclass(frozen=True)
class CellScores:
    """Scores of the cells of a study.

    Every cell that does not differ significantly from the one with the lowest score is in the best group, since the
    runs do not show which of them is best; all differences hold together (``statistics.best_group``).
    """

    objective: Objective
    table: pl.DataFrame
    """A row for each cell: number, varied fields, name; score and above_best with limits; best_group, runs."""
    best: Cell
    """The cell with the lowest score."""
    fresh: Interval
    """Its score on as many fresh runs, since the lowest of many scores is partly luck."""


def scores_of(runs: Runs, objective: Objective, **how: Any) -> CellScores:
    """Score the cells of a finished study, run by run where they share motion, and the best on fresh runs.

    The costs use the robots' estimates at the end of each run as it was simulated. A search uses those soon after the
    last decision, or at T_end if a robot is undecided (``outcomes.end_s``). ``how``: arguments of ``study.run.run``.
    """
    runs.check_complete()
    rows = np.concatenate([_figures(runs, cell, objective) for cell in runs.cells], axis=1)
    by_cell = [slice(k, k + 1) for k in range(len(runs.cells))]

    def scores(some: Rows) -> list[float]:
        return [objective.score(some[:, cell]) for cell in by_cell]

    draws: Array = np.vstack([scores(rows), drawn_scores(scores, rows)]).T
    group = best_group(draws, len(rows))
    scored = [objective.interval(rows[:, cell]) for cell in by_cell]
    columns = [
        {**columns_of("score", score), **columns_of("above_best", above), "best_group": tie, "runs": score.n}
        for score, above, tie in zip(scored, group.difference.tolist(), group.member.tolist(), strict=True)
    ]
    table = runs.cell_table.drop("scenario_hash", "wanted", "there").hstack(pl.DataFrame(columns))
    best, seed = runs.cells[group.best], derived_seed(runs.seed, "fresh runs")
    fresh = run([best], runs.runs, seed, motion=runs.motion, folder=runs.folder, **how)
    return CellScores(objective, table, best, objective.interval(_figures(fresh, best, objective)))


def _figures(runs: Runs, cell: Cell, objective: Objective) -> Rows:
    """Return the figures of the runs of a cell, (runs, 1 case, columns)."""
    tiles = cell.scenario.floor_for(runs.seed, 0).tiles.size  # the same in all runs
    return objective.figures(from_tables(cell.scenario, *runs.tables(cell), tiles))[:, None, :]
