"""Validate the winner or the Pareto front of a search on fresh runs.

The candidate that looks best of many was partly lucky (the winner's curse), so a search underestimates its cost. Fresh
runs played no part in any choice. The starts are scored on the same runs, so that they are compared in pairs.

Candidates of a front were also selected on few runs: fresh runs show their scores under every objective, and whether
they are still on the front.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.analysis.intervals import Interval, cluster_share, mean_interval, plain
from vibroswarm.analysis.tradeoff import pareto_front
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.errors import InputError
from vibroswarm.optimize.evaluate import derived_seed, figures_of
from vibroswarm.optimize.loop import Found
from vibroswarm.optimize.objective import Objective, Rows, bootstrap
from vibroswarm.optimize.space import Values
from vibroswarm.optimize.spec import Search
from vibroswarm.study.executors import workers_for

TELLING: Final = 0.1
"""Relative difference above which an interval that contains it is too wide to judge luck."""
LEAST_ITERATIONS: Final = 2
"""With fewer, particles have never moved."""
LUCK: Final = ("not significant", "lucky", "unlucky", "inconclusive", "not defined", "too short")
"""Explanations of the difference between believed and true score."""


@dataclass(frozen=True)
class Scored(NotebookView):
    """One set of values, scored on fresh runs."""

    name: str
    values: Values
    score: Interval
    rows: Rows
    runs: NDArray[np.int64]
    """Run numbers of the rows."""
    failed: int
    cases: tuple[Interval, ...] = ()
    """The score in each case, if there are several."""
    parts: Mapping[str, Interval] | None = None
    """Parts of the score of ``time_at_error``: time, errors and undecided, each in its worst case."""
    limits: Mapping[str, float] = field(default_factory=dict)
    """Limits of these parts."""

    @property
    def near(self) -> dict[str, str]:
        """Compare the parts with their limits, in words."""
        return {name: _beyond((self.parts or {})[name], limit) for name, limit in self.limits.items()}

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {
            "name": self.name,
            "values": self.values,
            "score": self.score.as_dict(),
            "cases": [case.as_dict() for case in self.cases],
            "parts": {k: v.as_dict() for k, v in (self.parts or {}).items()},
            "limits": {k: {"limit": v, "says": self.near[k]} for k, v in self.limits.items()},
            "runs_failed": self.failed,
        }


@dataclass(frozen=True)
class Truth(NotebookView):
    """The score of a search's ``winner`` as the search ``believed`` it, and on fresh runs."""

    believed: float
    winner: Scored
    others: tuple[Scored, ...]
    """The starts and other requested values, on the same runs."""
    against: tuple[Interval, ...]
    """Score of the winner minus that of each other, paired by run."""
    too_short: bool = False
    """Whether the search had fewer than ``LEAST_ITERATIONS``, so that its winner says nothing about searches."""

    def __repr__(self) -> str:
        score = self.winner.score
        return (
            f"Truth(believed score {self.believed:.4g}, true {score.estimate:.4g} "
            f"[{score.low:.4g}, {score.high:.4g}], {score.n:,} fresh runs)"
        )

    @property
    def difference(self) -> float:
        """(true - believed) / abs(true); above 0 the search underestimated the cost.

        If the true score is 0 it is 0 if the believed one is too, else nan.
        """
        true = self.winner.score.estimate
        if true == 0:
            return 0.0 if self.believed == 0 else math.nan
        return (true - self.believed) / abs(true)

    @property
    def luck(self) -> str:
        """The explanation of the difference, one of ``LUCK``."""
        share, score = self.difference, self.winner.score
        if self.too_short:
            return "too short"
        if not math.isfinite(share):
            return "not defined"
        if score.low <= self.believed <= score.high:
            return "inconclusive" if abs(share) > TELLING else "not significant"
        return "lucky" if share > 0 else "unlucky"

    @property
    def words(self) -> str:
        """The explanation in words."""
        share = self.difference
        return {
            "too short": (
                "No verdict: the swarm made no move, so that its winner is the best of random points; raise --budget."
            ),
            "not defined": "The difference between the believed and the true score is not defined.",
            "inconclusive": (
                f"The believed score is {abs(100 * share):.0f} % too {'low' if share > 0 else 'high'}, but the "
                "interval of the true score is as wide: too few validation runs; raise --fresh."
            ),
            "not significant": (
                f"The believed score lies inside the interval of the true score ({100 * share:+.1f} %): "
                "no sign of a lucky choice."
            ),
            "lucky": (
                f"The believed score is {100 * share:.0f} % too low: the winner was chosen by its score on few runs, "
                "and was partly lucky."
            ),
            "unlucky": (
                f"The believed score is {-100 * share:.0f} % too high: the winner was unlucky in the search."
            ),
        }[self.luck]

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {
            "believed": plain(self.believed),
            "true": self.winner.as_dict(),
            "difference_share": plain(self.difference),
            "says": self.words,
            "others": [
                {**other.as_dict(), "winner_less_this": paired.as_dict()}
                for other, paired in zip(self.others, self.against, strict=True)
            ],
        }


def truth_of(
    found: Found,
    *,
    runs: int | None = None,
    others: Sequence[tuple[str, Mapping[str, Any]]] = (),
    executor: str | Executor = "threads",
    workers: int | None = None,
    progress: Callable[[int], None] = lambda done: None,
) -> Truth:
    """Score the winner, the starts of the search and ``others`` on fresh runs.

    Args:
        found: the search. runs: fresh runs of each; by default those of the search's settings.
        others: further values of the space's fields, by name.
        executor, workers: see ``study.executors``. progress: called as runs finish.
    """
    search = found.search
    count = search.settings.fresh if runs is None else runs
    starts = [(f"start {k + 1}" if len(search.starts) > 1 else "start", search.space.values(point))
              for k, point in enumerate(search.starts)]  # fmt: skip
    named = [("winner", found.values), *starts, *((name, dict(values)) for name, values in others)]
    scored = score_fresh(search, named, count, executor=executor, workers=workers, progress=progress)
    objective = search.objectives[0]
    against = tuple(paired_score(objective, scored[0], other) for other in scored[1:])
    return Truth(found.believed, scored[0], tuple(scored[1:]), against, is_too_short(found))


def is_too_short(found: Found) -> bool:
    """Return whether a swarm had fewer than ``LEAST_ITERATIONS`` iterations; other methods are never too short."""
    return found.search.settings.method == "pso" and len(found.history) < LEAST_ITERATIONS


def score_fresh(
    search: Search,
    named: Sequence[tuple[str, Mapping[str, Any]]],
    runs: int,
    *,
    purpose: str = "fresh runs",
    executor: str | Executor = "threads",
    workers: int | None = None,
    progress: Callable[[int], None] = lambda done: None,
) -> list[Scored]:
    """Score sets of values on the same fresh runs.

    Raises:
        InputError: fewer than 2 runs. RunError: all runs of a set failed.
    """
    if runs < 2:
        raise InputError(f"{runs} is too few; at least 2", field="runs")
    cases, seed = [cell.scenario for cell in search.cases], derived_seed(search.seed, purpose)
    scored: list[Scored] = []
    with workers_for(executor, workers) as pool:
        for name, values in named:
            shifted = shifted_progress(progress, len(scored) * runs)
            many = figures_of(
                cases,
                values,
                search.objectives[:1],
                runs,
                seed,
                pool,
                motion=search.study.motion,
                progress=shifted,
            )
            scored.append(
                scored_of(name, dict(values), search.objectives[0], many.rows, many.runs, many.failed)
            )
    return scored


def shifted_progress(progress: Callable[[int], None], before: int) -> Callable[[int], None]:
    """Offset the runs that are reported to ``progress`` by those done before."""
    return lambda done: progress(before + done)


def scored_of(
    name: str, values: Values, objective: Objective, rows: Rows, runs: NDArray[np.int64], failed: int = 0
) -> Scored:
    """Score the rows of one set of values."""
    cases = tuple(objective.interval(rows[:, k : k + 1]) for k in range(rows.shape[1]))
    score = cases[0] if len(cases) == 1 else objective.interval(rows)
    parts = _parts(rows) if objective.name == "time_at_error" else None
    several = cases if len(cases) > 1 else ()
    return Scored(name, values, score, rows, runs, failed, several, parts, objective.limits)


def paired_score(objective: Objective, first: Scored, second: Scored) -> Interval:
    """Estimate the difference of two scores, first - second, with a bootstrap over the runs that both have."""
    width = first.rows.shape[2]
    _, of_first, of_second = np.intersect1d(first.runs, second.runs, return_indices=True)
    both = np.concatenate([first.rows[of_first], second.rows[of_second]], axis=2)

    def difference(rows: NDArray[np.float64]) -> float:
        return objective.score(rows[:, :, :width]) - objective.score(rows[:, :, width:])

    return bootstrap(difference, both)


def _beyond(share: Interval, limit: float) -> str:
    """Write whether a share is within its limit."""
    if share.low > limit:
        return f"beyond the limit of {100 * limit:g} % by {100 * (share.estimate - limit):.1f} points"
    if share.high <= limit:
        return f"within the limit of {100 * limit:g} %"
    return f"not significantly different from the limit of {100 * limit:g} %"


def _parts(rows: Rows) -> dict[str, Interval]:
    """Compute time, error of deciding robots, and undecided robots, each in its worst case."""
    worst: dict[str, Interval] = {}
    for case in range(rows.shape[1]):
        time_s, wrong, decided, robots = (rows[:, case, k] for k in range(4))
        parts = {
            "decision_time_s": mean_interval(time_s),
            "robot_error": cluster_share(wrong, decided),
            "robots_undecided": cluster_share(robots - decided, robots),
        }
        for name, value in parts.items():
            if name not in worst or value.estimate > worst[name].estimate:
                worst[name] = value
    return worst


MIN_FRESH_RUNS: Final = 200
"""Fewest fresh runs of each candidate of a front."""


@dataclass(frozen=True)
class Member(NotebookView):
    """A candidate of a front; scores are in the order of the objectives."""

    key: int
    values: Values
    believed: tuple[float, ...]
    true: tuple[Interval, ...]
    stays: bool
    """Whether it is also on the front of the fresh runs."""
    failed: int


@dataclass(frozen=True)
class Front(NotebookView):
    """A Pareto front, scored on fresh runs."""

    names: tuple[str, ...]
    """The objectives in words."""
    units: tuple[str, ...]
    """Of the objectives, in the same order."""
    members: tuple[Member, ...]
    """Its candidates."""
    runs: int
    """Fresh runs of each."""

    @property
    def too_little(self) -> list[float]:
        """Median over the front of (true - believed) / abs(true), by objective."""
        shares = [
            [_too_little(believed, true) for believed, true in zip(m.believed, m.true, strict=True)]
            for m in self.members
        ]
        return [float(share) for share in np.median(np.array(shares), axis=0)]

    @property
    def words(self) -> str:
        """A summary of the front in words."""
        stay, count = sum(m.stays for m in self.members), len(self.members)
        shares = ", ".join(
            f"{abs(100 * share):.0f} % too {'low' if share >= 0 else 'high'} for {name}"
            for name, share in zip(self.names, self.too_little, strict=True)
        )
        return (
            f"On {self.runs:,} fresh runs each, {stay} of {count} are still on the front; the believed scores were "
            f"{shares} (medians)."
        )

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

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {
            "says": self.words,
            "fresh_runs_each": self.runs,
            "members": [
                {
                    "values": member.values,
                    "believed": [plain(score) for score in member.believed],
                    "true": [score.as_dict() for score in member.true],
                    "stays": member.stays,
                    "runs_failed": member.failed,
                }
                for member in self.members
            ],
        }


def fresh_runs(found: Found) -> int:
    """Return the number of fresh runs of each candidate of the front: its part of all, at least ``MIN_FRESH_RUNS``."""
    return max(found.search.settings.fresh // max(len(found.front), 1), MIN_FRESH_RUNS)


def front_of(
    found: Found,
    *,
    executor: str | Executor = "threads",
    workers: int | None = None,
    progress: Callable[[int], None] = lambda done: None,
) -> Front:
    """Score the front of a search on fresh runs, the same for all its candidates.

    Args:
        found: the search. executor, workers: as ``run_search`` takes them.
        progress: called with the number of finished runs.
    Raises:
        RunError: all runs of a candidate failed.
    """
    search, archive, runs = found.search, found.archive, fresh_runs(found)
    cases, seed = [cell.scenario for cell in search.cases], derived_seed(search.seed, "fresh runs")
    scored: list[tuple[tuple[Interval, ...], int]] = []
    with workers_for(executor, workers) as pool:
        for key in found.front:
            many = figures_of(
                cases, archive[key].values, search.objectives, runs, seed, pool,
                motion=search.study.motion, progress=shifted_progress(progress, len(scored) * runs),
            )  # fmt: skip
            true = tuple(
                objective.interval(many.rows[:, :, columns])
                for objective, columns in zip(search.objectives, archive.columns, strict=True)
            )
            scored.append((true, many.failed))
    estimates = zip(*([score.estimate for score in true] for true, _ in scored), strict=True)
    stays = pareto_front(*estimates).tolist() if scored else []
    return Front(
        names=_names([objective.words for objective in search.objectives]),
        units=tuple(objective.unit for objective in search.objectives),
        members=tuple(
            Member(key, dict(archive[key].values), tuple(archive.scores(key)), true, stay, failed)
            for key, (true, failed), stay in zip(found.front, scored, stays, strict=True)
        ),
        runs=runs,
    )


def _too_little(believed: float, true: Interval) -> float:
    return (true.estimate - believed) / abs(true.estimate) if true.estimate else math.nan


def _names(words: Sequence[str]) -> tuple[str, ...]:
    """Number objectives that have the same name."""
    return tuple(f"{word} ({k + 1})" if words.count(word) > 1 else word for k, word in enumerate(words))
