"""What is true of a search's winner: scored on fresh runs, beside what the search believed.

Of many candidates the one that looks best was partly lucky (the winner's curse), so a search believes too little. Fresh
runs played no part in any choice. The starts are scored on the same runs, so that they are compared in pairs.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.analysis.intervals import Interval, cluster_share, mean_interval, plain
from vibroswarm.errors import InputError
from vibroswarm.optimize.evaluate import derived_seed, figures_of
from vibroswarm.optimize.loop import Found
from vibroswarm.optimize.objective import Objective, Rows, bootstrap
from vibroswarm.optimize.space import Values
from vibroswarm.optimize.spec import Search
from vibroswarm.study.executors import workers_for

TELLING: Final = 0.1
"""Share of the true score: an interval that holds a difference larger than this is too wide to tell of luck."""
LUCK: Final = ("none to be seen", "lucky", "unlucky", "inconclusive", "not defined")
"""What the difference between believed and true may be."""


@dataclass(frozen=True)
class Scored:
    """One set of values on fresh runs."""

    name: str
    values: Values
    score: Interval
    rows: Rows
    runs: NDArray[np.int64]
    """Numbers of the runs of the rows."""
    failed: int
    cases: tuple[Interval, ...] = ()
    """The score in each case by itself, where there are several."""
    parts: Mapping[str, Interval] | None = None
    """What the score is made of: errors and undecided of ``time_at_error``, in the worst case of each."""
    limits: Mapping[str, float] = field(default_factory=dict)
    """Of these parts, what is allowed."""

    @property
    def near(self) -> dict[str, str]:
        """How near the limits are, in words, by part: a limit may be out of reach."""
        return {name: _beyond((self.parts or {})[name], limit) for name, limit in self.limits.items()}

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
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
class Truth:
    """What the search ``believed`` of its ``winner`` and what is true."""

    believed: float
    winner: Scored
    others: tuple[Scored, ...]
    """The starts, and what else was asked for, on the same runs."""
    against: tuple[Interval, ...]
    """Score of the winner less that of each other, run by run."""

    @property
    def difference(self) -> float:
        """By which share of the true score the search believed too little; below 0: too much. Of a score of 0: none."""
        true = self.winner.score.estimate
        if true == 0:
            return 0.0 if self.believed == 0 else math.nan
        return (true - self.believed) / abs(true)

    @property
    def luck(self) -> str:
        """What the difference is, of ``LUCK``."""
        share, score = self.difference, self.winner.score
        if not math.isfinite(share):
            return "not defined"
        if score.low <= self.believed <= score.high:
            return "inconclusive" if abs(share) > TELLING else "none to be seen"
        return "lucky" if share > 0 else "unlucky"

    @property
    def words(self) -> str:
        """The difference, named for what it is."""
        share = self.difference
        return {
            "not defined": "The difference between what the search believed and what is true is not defined.",
            "inconclusive": (
                f"What the search believed is {abs(100 * share):.0f} % too {'little' if share > 0 else 'much'}, but "
                "the interval of what is true is as wide: so few fresh runs do not tell whether it was luck."
            ),
            "none to be seen": (
                f"What the search believed lies inside the interval of what is true ({100 * share:+.1f} %): "
                "no luck of the choice is to be seen."
            ),
            "lucky": (
                f"The search believed {100 * share:.0f} % too little: its winner was chosen for looking good on few "
                "runs, and was partly lucky on them."
            ),
            "unlucky": (
                f"The search believed {-100 * share:.0f} % too much: its winner was unlucky in the search."
            ),
        }[self.luck]

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
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
    tell: Callable[[int], None] = lambda done: None,
) -> Truth:
    """Score the winner, the starts of the search and ``others`` on fresh runs.

    Args:
        found: the search. runs: fresh runs of each; without, as the search says.
        others: further values of the space's fields, by name.
        executor, workers: see ``study.executors``. tell: called as runs come back.
    """
    search = found.search
    count = search.settings.fresh if runs is None else runs
    starts = [(f"start {k + 1}" if len(search.starts) > 1 else "start", search.space.values(point))
              for k, point in enumerate(search.starts)]  # fmt: skip
    named = [("winner", found.values), *starts, *((name, dict(values)) for name, values in others)]
    scored = score_fresh(search, named, count, executor=executor, workers=workers, tell=tell)
    objective = search.objectives[0]
    against = tuple(paired_score(objective, scored[0], other) for other in scored[1:])
    return Truth(found.believed, scored[0], tuple(scored[1:]), against)


def score_fresh(
    search: Search,
    named: Sequence[tuple[str, Mapping[str, Any]]],
    runs: int,
    *,
    purpose: str = "fresh runs",
    executor: str | Executor = "threads",
    workers: int | None = None,
    tell: Callable[[int], None] = lambda done: None,
) -> list[Scored]:
    """Score sets of values on the same fresh runs."""
    if runs < 2:
        raise InputError(f"{runs} is too few; at least 2", field="runs")
    cases, seed = [cell.scenario for cell in search.cases], derived_seed(search.seed, purpose)
    scored: list[Scored] = []
    with workers_for(executor, workers) as hands:
        for name, values in named:
            told = after(tell, len(scored) * runs)
            many = figures_of(
                cases, values, search.objectives[:1], runs, seed, hands, motion=search.study.motion, tell=told
            )
            scored.append(
                scored_of(name, dict(values), search.objectives[0], many.rows, many.runs, many.failed)
            )
    return scored


def after(tell: Callable[[int], None], before: int) -> Callable[[int], None]:
    """``tell`` for a part of the work, before which so many runs were done."""
    return lambda done: tell(before + done)


def scored_of(
    name: str, values: Values, objective: Objective, rows: Rows, runs: NDArray[np.int64], failed: int = 0
) -> Scored:
    """Rows with what they say."""
    cases = tuple(objective.interval(rows[:, k : k + 1]) for k in range(rows.shape[1]))
    whole = cases[0] if len(cases) == 1 else objective.interval(rows)
    parts = _parts(rows) if objective.name == "time_at_error" else None
    several = cases if len(cases) > 1 else ()
    return Scored(name, values, whole, rows, runs, failed, several, parts, objective.limits)


def paired_score(objective: Objective, first: Scored, second: Scored) -> Interval:
    """Score of the first less that of the second: a bootstrap over runs, the same ones of both."""
    width = first.rows.shape[2]
    _, of_first, of_second = np.intersect1d(first.runs, second.runs, return_indices=True)
    both = np.concatenate([first.rows[of_first], second.rows[of_second]], axis=2)

    def difference(rows: NDArray[np.float64]) -> float:
        return objective.score(rows[:, :, :width]) - objective.score(rows[:, :, width:])

    return bootstrap(difference, both)


def _beyond(share: Interval, limit: float) -> str:
    if share.low > limit:
        return f"beyond the limit of {100 * limit:g} % by {100 * (share.estimate - limit):.1f} points"
    if share.high <= limit:
        return f"within the limit of {100 * limit:g} %"
    return f"not told from the limit of {100 * limit:g} %"


def _parts(rows: Rows) -> dict[str, Interval]:
    """Time, errors of those who decide, undecided: each in the case where it is worst."""
    found: dict[str, Interval] = {}
    for case in range(rows.shape[1]):
        time_s, wrong, decided, robots = (rows[:, case, k] for k in range(4))
        parts = {
            "decision_time_s": mean_interval(time_s),
            "robot_error": cluster_share(wrong, decided),
            "robots_undecided": cluster_share(robots - decided, robots),
        }
        for name, value in parts.items():
            if name not in found or value.estimate > found[name].estimate:
                found[name] = value
    return found
