"""Validate the winner or the Pareto front of a search on fresh runs.

The candidate that looks best of many was partly lucky (the winner's curse), so a search underestimates its cost. That
estimate is the believed score. The true score comes from fresh runs, which played no part in any choice. The starts,
the given points that the search began with, are scored on the same runs, so that the winner is compared with them in
pairs.

Candidates of a Pareto front were also selected on few runs: fresh runs show their scores under every objective, and
whether they are still on the front.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.numbers import count, number, percent, stated_percent, verb
from vibroswarm.errors import InputError, whole_number_of
from vibroswarm.search.evaluate import RunFigures, derived_seed, figures_of
from vibroswarm.search.loop import Found
from vibroswarm.search.objective import (
    LEAST_DIFFERING,
    Objective,
    Rows,
    bootstrap,
    without_limits,
    worst_case,
)
from vibroswarm.search.space import Values
from vibroswarm.search.spec import Search
from vibroswarm.search.steps import FreshFolder
from vibroswarm.statistics.fronts import pareto_front
from vibroswarm.statistics.intervals import Interval, bounded_mean, cluster_share, plain
from vibroswarm.study.run import pool_for

TELLING: Final = 0.1
"""Share of the true score. A believed score that differs from the true score by more than this share differs much.

Single objective: if the scores differ much, but not significantly, the interval of the true score is too wide to judge
luck. Pareto front: if the median difference over the candidates is larger, the page of the search shows a warning."""
LEAST_ITERATIONS: Final = 2
"""With fewer iterations, particles have never moved."""
LUCK: Final = ("not significant", "lucky", "unlucky", "inconclusive", "not defined", "too short")
"""Explanations of the difference between believed and true score."""


@dataclass(frozen=True)
class Scored:
    """One set of values with its score and the figures of its runs."""

    name: str
    """Such as "winner" or "start"."""
    values: Values
    """The values by field."""
    score: Interval
    """The score over all cases, with its confidence interval."""
    rows: Rows
    """Figures of the runs, (runs, cases, columns)."""
    runs: NDArray[np.int64]
    """Run numbers of the rows, (runs,)."""
    failed: int
    """Number of failed runs, which have no rows."""
    cases: tuple[Interval, ...] = ()
    """The score in each case, if there are several."""
    parts: Mapping[str, Interval] | None = None
    """Parts of the score of ``time_at_error``: time, errors and undecided, each in the case where it is worst."""
    limits: Mapping[str, float] = field(default_factory=dict)
    """Limits of the parts of ``time_at_error``, by name; the time has none. Empty for other costs."""

    @property
    def near(self) -> dict[str, str]:
        """Each part that has a limit, compared with it in words: within, beyond, or not significantly different."""
        return {name: _beyond((self.parts or {})[name], limit) for name, limit in self.limits.items()}


@dataclass(frozen=True)
class Truth:
    """The score of a search's ``winner`` as the search ``believed`` it, and on fresh runs."""

    believed: float
    """The winner's score as the search estimated it."""
    winner: Scored
    """The winner with its true score, that on fresh runs."""
    others: tuple[Scored, ...]
    """The starts and other requested values, on the same runs."""
    against: tuple[Interval, ...]
    """Score of the winner minus the score of each of ``others``, paired by run."""
    too_short: bool = False
    """Whether the search was a swarm whose particles never moved, see ``is_too_short``."""

    @property
    def difference(self) -> float:
        """The relative difference (true - believed) / abs(true); above 0 the search underestimated the cost.

        If the true score is 0, the difference is 0 if the believed score is 0 as well, else nan.
        """
        score = self.winner.score
        return 0.0 if score.estimate == self.believed == 0 else _too_little(self.believed, score)

    @property
    def luck(self) -> str:
        """How the difference between the believed and the true score is explained, one of ``LUCK``.

        "too short": see the field ``too_short``. "not defined": the relative difference is not finite. "lucky" or
        "unlucky": the true score is significantly higher (worse) or lower than the believed score, which then lies
        outside the interval of the true score. "inconclusive": not significant, but larger than ``TELLING``, or the
        true score has no limits. "not significant": neither significant nor large.
        """
        relative, score = self.difference, self.winner.score
        if self.too_short:
            return "too short"
        if not math.isfinite(relative):
            return "not defined"
        if score.low <= self.believed <= score.high:
            is_open = abs(relative) > TELLING or (relative != 0.0 and math.isinf(score.high))
            return "inconclusive" if is_open else "not significant"
        return "lucky" if relative > 0 else "unlucky"

    @property
    def words(self) -> str:
        """The explanation of the difference between the believed and the true score, as a sentence."""
        share = self.difference
        off = percent(abs(share), None, digits=2)
        return {
            "too short": (
                "No verdict: the swarm made no move, so that its winner is the best of random points; raise --budget."
            ),
            "not defined": "The difference between the believed and the true score is not a share of the true one.",
            "inconclusive": (
                f"The believed score is {off} too {'low' if share > 0 else 'high'}, but the "
                f"true score has {'no limits' if math.isinf(self.winner.score.high) else 'limits as wide'}: too few "
                "validation runs; raise --fresh."
            ),
            "not significant": (
                f"The believed score lies inside the interval of the true score ({percent(share, sign=True)}): "
                "no sign of selection bias."
            ),
            "lucky": (
                f"The believed score is {off} too low: the winner was chosen by its score on few runs, "
                "and was partly lucky."
            ),
            "unlucky": (f"The believed score is {off} too high: the winner was unlucky in the search."),
        }[self.luck]


def truth_of(
    found: Found,
    *,
    runs: int | None = None,
    others: Sequence[tuple[str, Mapping[str, Any]]] = (),
    folder: str | Path | None = None,
    executor: str | Executor = "threads",
    workers: int | None = None,
    progress: Callable[[int], None] = lambda done: None,
) -> Truth:
    """Score the winner, the starts of the search and ``others`` on the same fresh runs, under the first objective.

    A search with several objectives is validated by ``front_of`` instead.

    Args:
        found: the result of the search. runs: number of fresh runs; by default that of the search's settings.
        others: further sets of values of the space's fields, each with its name.
        folder: of the search, which saves the fresh runs; None: they are not saved.
        executor, workers: see ``study.run.pool_for``. progress: called as runs finish, with the number done so far.
    Raises:
        InputError: fewer than 2 runs. RunError: all runs of a set of values failed.
    """
    search = found.search
    count = search.settings.fresh if runs is None else runs
    starts = [(f"start {k + 1}" if len(search.starts) > 1 else "start", search.space.values(point))
              for k, point in enumerate(search.starts)]  # fmt: skip
    named = [("winner", found.values), *starts, *((name, dict(values)) for name, values in others)]
    winner, *scored_others = score_fresh(
        search, named, count, folder=folder, executor=executor, workers=workers, progress=progress
    )
    objective = search.objectives[0]
    return Truth(
        believed=found.believed,
        winner=winner,
        others=tuple(scored_others),
        against=tuple(paired_score(objective, winner, other) for other in scored_others),
        too_short=is_too_short(found),
    )


def is_too_short(found: Found) -> bool:
    """Return whether the search was a swarm whose particles never moved.

    A swarm with fewer than ``LEAST_ITERATIONS`` iterations only scores its first points, which are random or given.
    Searches with other methods are never too short.
    """
    return found.search.settings.method == "pso" and len(found.history) < LEAST_ITERATIONS


def score_fresh(
    search: Search,
    named: Sequence[tuple[str, Mapping[str, Any]]],
    runs: int,
    *,
    folder: str | Path | None = None,
    executor: str | Executor = "threads",
    workers: int | None = None,
    progress: Callable[[int], None] = lambda done: None,
) -> list[Scored]:
    """Score sets of values on the same fresh runs, under the first objective; return them in the order of ``named``.

    Args:
        search: defines scenarios, objective and seed. named: sets of values of the space's fields, each with its name.
        runs: number of runs of each set.
        folder: of the search, which saves the fresh runs; None: they are not saved.
        executor, workers: see ``study.run.pool_for``. progress: called as runs finish, with the number done so far.
    Raises:
        InputError: fewer than 2 runs. RunError: all runs of a set failed.
    """
    runs = whole_number_of(runs, "runs", 2, 10**9)
    sets, first = [dict(values) for _, values in named], search.objectives[:1]
    fresh = _fresh_figures(search, sets, first, runs, folder, executor, workers, progress)
    return [
        scored_of(name, values, first[0], simulated.rows, simulated.runs, simulated.failed)
        for (name, _), values, simulated in zip(named, sets, fresh, strict=True)
    ]


def _fresh_figures(
    search: Search,
    sets: Sequence[Values],
    objectives: tuple[Objective, ...],
    runs: int,
    folder: str | Path | None,
    executor: str | Executor,
    workers: int | None,
    progress: Callable[[int], None],
) -> list[RunFigures]:
    """Simulate sets of values on the same fresh runs; the arguments are those of ``score_fresh``."""
    cases, seed = [cell.scenario for cell in search.cases], derived_seed(search.seed, "fresh runs")
    width = sum(objective.width for objective in objectives)
    saved = None if folder is None else FreshFolder(folder, search)
    fresh: list[RunFigures] = []
    with pool_for(executor, workers) as pool:
        for k, values in enumerate(sets):
            done = None if saved is None else saved.read(values, runs, seed, width)
            if done is None:
                done = figures_of(
                    cases, values, objectives, runs, seed, pool,
                    motion=search.study.motion, progress=shifted_progress(progress, k * runs),
                )  # fmt: skip
                if saved is not None:
                    saved.add(values, runs, seed, done)
            progress((k + 1) * runs)
            fresh.append(done)
    return fresh


def shifted_progress(progress: Callable[[int], None], before: int) -> Callable[[int], None]:
    """Return a function that adds ``before``, the runs done before, to its argument and passes it to ``progress``."""
    return lambda done: progress(before + done)


def scored_of(
    name: str, values: Values, objective: Objective, rows: Rows, runs: NDArray[np.int64], failed: int = 0
) -> Scored:
    """Compute the score of one set of values, over all cases and in each case, from the figures of its runs.

    Args:
        name: of the set. values: by field. objective: computes the score.
        rows: figures, (runs, cases, columns). runs: run numbers of the rows. failed: number of runs without rows.
    """
    cases = tuple(objective.interval(rows[:, k : k + 1]) for k in range(rows.shape[1]))
    return Scored(
        name=name,
        values=values,
        score=cases[0] if len(cases) == 1 else objective.interval(rows),
        rows=rows,
        runs=runs,
        failed=failed,
        cases=cases if len(cases) > 1 else (),
        parts=_parts(rows) if objective.name == "time_at_error" else None,
        limits=objective.limits,
    )


def paired_score(objective: Objective, first: Scored, second: Scored) -> Interval:
    """Estimate the difference of two scores, first - second, with a bootstrap over the runs that both have.

    Runs with the same number are paired. Each resample takes the same runs for both scores, so that noise that is
    common to both cancels. The limits are infinite if fewer than ``LEAST_DIFFERING`` runs differ, or if a score of so
    many runs has no limits, but a score does not differ from itself; without a run in both, the difference is nan.

    Args:
        objective: of the search. first, second: scored sets, such as those of ``Truth.others``.
    """
    width = first.rows.shape[2]
    # the indices, in each score's rows, of the runs that both have
    _, of_first, of_second = np.intersect1d(first.runs, second.runs, return_indices=True)
    # ``bootstrap`` resamples one array along the runs: so the columns of both are put side by side
    both = np.concatenate([first.rows[of_first], second.rows[of_second]], axis=2)
    differing = int((both[:, :, :width] != both[:, :, width:]).any(axis=(1, 2)).sum())

    def difference(rows: NDArray[np.float64]) -> float:
        return objective.score(rows[:, :, :width]) - objective.score(rows[:, :, width:])

    found = bootstrap(difference, both)
    if first is second:
        return found._replace(low=0.0, high=0.0)
    too_few = differing < LEAST_DIFFERING or objective.are_too_few(of_first.size)
    return without_limits(found) if too_few else found


def _median_of_known(values: list[float]) -> float:
    known = [value for value in values if not math.isnan(value)]
    return float(np.median(known)) if known else math.nan


def _beyond(share: Interval, limit: float) -> str:
    """Write whether a share is significantly beyond its limit, within it, or neither."""
    if math.isnan(share.estimate):
        return "not defined, as no robot decided"
    if share.low > limit:
        beyond = number(100 * (share.estimate - limit), 1)
        return f"beyond the limit of {stated_percent(limit)} by {beyond} points"
    if share.high <= limit:
        return f"within the limit of {stated_percent(limit)}"
    return f"not significantly different from the limit of {stated_percent(limit)}"


def _parts(rows: Rows) -> dict[str, Interval]:
    """Compute the parts of ``time_at_error`` from its figures, (runs, cases, columns).

    These are the mean decision time, s, the share of wrong robots among those that decided, and the share of undecided
    robots. Of several cases, each part is that of the case in which this part is worst (``worst_case``). The intervals
    of the shares treat each run as a cluster of robots, since robots of a run are not independent.
    """
    time_s, wrong, decided, robots, t_end_s = np.moveaxis(rows, 2, 0)  # (runs, cases) each
    of_cases: dict[str, Callable[[int, float], Interval]] = {
        "decision_time_s": lambda k, at: bounded_mean(time_s[:, k], 0.0, float(t_end_s[0, k]), at),
        # nan in a case in which no robot decided; ``robots_undecided`` covers such a case
        "robot_error": lambda k, at: cluster_share(wrong[:, k], decided[:, k], at),
        "robots_undecided": lambda k, at: cluster_share(robots[:, k] - decided[:, k], robots[:, k], at),
    }
    return {name: worst_case(of_case, rows.shape[1]) for name, of_case in of_cases.items()}


MIN_FRESH_RUNS: Final = 200
"""Fewest fresh runs of each candidate of a front."""


@dataclass(frozen=True)
class Member:
    """A candidate of a front; scores are in the order of the objectives."""

    key: int
    """Key of the candidate in the search's archive."""
    values: Values
    believed: tuple[float, ...]
    """Scores in the search."""
    true: tuple[Interval, ...]
    """Scores on fresh runs."""
    stays: bool
    """Whether the candidate is also on the front that the scores on fresh runs make."""
    failed: int
    """Fresh runs that failed."""


@dataclass(frozen=True)
class Front:
    """A Pareto front, scored on fresh runs."""

    names: tuple[str, ...]
    """The objectives in words, each different."""
    units: tuple[str, ...]
    """Units of the scores, in the order of ``names``."""
    members: tuple[Member, ...]
    """The candidates of the front, at least one."""
    runs: int
    """Fresh runs of each candidate."""

    @property
    def too_little(self) -> list[float]:
        """Median over the candidates of (true - believed) / abs(true), for each objective; nan if no share is defined.

        It is the share by which the believed scores are too low: above 0 the search underestimated the cost. It is not
        defined for candidates whose true score is 0.
        """
        shares = [  # (candidates, objectives)
            [_too_little(believed, true) for believed, true in zip(m.believed, m.true, strict=True)]
            for m in self.members
        ]
        return [_median_of_known([share[k] for share in shares]) for k in range(len(self.names))]

    @property
    def words(self) -> str:
        """A summary of the front in words."""
        stay = sum(m.stays for m in self.members)
        shares = ", ".join(
            f"{percent(abs(share), None, digits=2)} too {'low' if share >= 0 else 'high'} for {name}"
            for name, share in zip(self.names, self.too_little, strict=True)
            if not math.isnan(share)
        )
        believed = f"; the believed scores were {shares} (medians)" if shares else ""
        runs = count(self.runs, "fresh run")
        return f"On {runs} each, {stay} of {len(self.members)} {verb(stay, 'are', 'is')} still on the front{believed}."

    @property
    def table(self) -> pl.DataFrame:
        """One row per candidate: its values, its believed scores, and its true scores with limits."""
        rows = []
        for member in self.members:
            row: dict[str, Any] = {"key": member.key, **member.values, "stays": member.stays}
            for name, believed, true in zip(self.names, member.believed, member.true, strict=True):
                row |= {f"{name}, believed": plain(believed), f"{name}, true": plain(true.estimate)}
                row |= {f"{name}, true low": plain(true.low), f"{name}, true high": plain(true.high)}
            rows.append(row | {"fresh runs": self.runs - member.failed, "failed": member.failed})
        return pl.DataFrame(rows, infer_schema_length=None)


def validated(
    found: Found,
    folder: str | Path | None,
    stage: Callable[[str, int], AbstractContextManager[Callable[[int], None]]],
    **where: Any,
) -> tuple[Truth | None, Front | None]:
    """Score the winner of a search, or its Pareto front, on fresh runs: those of the search favour what it chose.

    With several objectives there is no winner; the front is empty if no candidate has finite scores.

    Args:
        folder: of the search, which saves the fresh runs; None: they are not saved. stage: returns the context of a
            stage by its name and its number of runs, whose value is called with the number done. where: executor and
            workers.
    """
    search, what = found.search, "scoring on fresh runs"
    if found.front:
        with stage(what, fresh_runs(found) * len(found.front)) as progress:
            return None, front_of(found, folder=folder, progress=progress, **where)
    if len(search.objectives) > 1:
        return None, None
    with stage(what, search.settings.fresh * (1 + len(search.starts))) as progress:
        return truth_of(found, folder=folder, progress=progress, **where), None


def fresh_runs(found: Found) -> int:
    """Return the number of fresh runs of each candidate of the front.

    The fresh runs of the search's settings are divided among the candidates, but each gets at least ``MIN_FRESH_RUNS``.
    """
    members = max(len(found.front), 1)  # a divisor; an empty front has no candidate to run
    return max(found.search.settings.fresh // members, MIN_FRESH_RUNS)


def front_of(
    found: Found,
    *,
    folder: str | Path | None = None,
    executor: str | Executor = "threads",
    workers: int | None = None,
    progress: Callable[[int], None] = lambda done: None,
) -> Front:
    """Score all candidates on the Pareto front of a search on the same fresh runs, under every objective.

    Args:
        found: the result of the search; ``found.front`` must not be empty. folder: of the search, which saves the fresh
            runs; None: they are not saved. executor, workers: see ``study.run.pool_for``.
        progress: called as runs finish, with the number done so far.
    Raises:
        InputError: the search has no Pareto front. RunError: all runs of a candidate failed.
    """
    if not found.front:
        raise InputError(
            "has no Pareto front; give a search with several objectives, or use truth_of", field="found"
        )
    search, archive, runs = found.search, found.archive, fresh_runs(found)
    sets = [archive[key].values for key in found.front]
    fresh = _fresh_figures(search, sets, search.objectives, runs, folder, executor, workers, progress)
    scored = [
        (
            tuple(
                objective.interval(simulated.rows[:, :, columns])
                for objective, columns in zip(search.objectives, archive.columns, strict=True)
            ),
            simulated.failed,
        )
        for simulated in fresh
    ]
    # ``pareto_front`` takes one sequence per objective, with the true scores of all candidates
    estimates = zip(*([score.estimate for score in true] for true, _ in scored), strict=True)
    stays = pareto_front(*estimates).tolist()
    return Front(
        names=_names([objective.words for objective in search.objectives]),
        units=tuple(objective.unit for objective in search.objectives),
        members=tuple(
            Member(
                key=key,
                values=dict(archive[key].values),
                believed=tuple(archive.scores(key)),
                true=true,
                stays=stay,
                failed=failed,
            )
            for key, (true, failed), stay in zip(found.front, scored, stays, strict=True)
        ),
        runs=runs,
    )


def _too_little(believed: float, true: Interval) -> float:
    """Return by which share of the true score the believed one is too low; nan if the true score is 0."""
    return (true.estimate - believed) / abs(true.estimate) if true.estimate else math.nan


def _names(words: Sequence[str]) -> tuple[str, ...]:
    """Return the objectives' names; those that occur more than once get their number in parentheses."""
    return tuple(f"{word} ({k + 1})" if words.count(word) > 1 else word for k, word in enumerate(words))
