"""What is true of a front: its candidates scored again on fresh runs, under every objective.

A candidate is on the front for what it scored in the search, on few runs, and so partly for its luck: fresh runs say
what its scores are, and whether it still belongs there.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.analysis.intervals import Interval, plain
from vibroswarm.optimize.archive import unbeaten
from vibroswarm.optimize.evaluate import derived_seed, figures_of
from vibroswarm.optimize.loop import Found
from vibroswarm.optimize.space import Values
from vibroswarm.optimize.truth import after
from vibroswarm.study.executors import workers_for

FEWEST: Final = 200
"""Fresh runs of each candidate, however many share those of the search."""


@dataclass(frozen=True)
class Member:
    """One candidate of a front; scores in the order of the objectives."""

    key: int
    values: Values
    believed: tuple[float, ...]
    true: tuple[Interval, ...]
    stays: bool
    """Whether on the fresh runs, too, no other beats it in all objectives."""
    failed: int


@dataclass(frozen=True)
class Front:
    """A front with what is true of it."""

    names: tuple[str, ...]
    """The objectives in words."""
    units: tuple[str, ...]
    """Of the objectives, in the same order."""
    members: tuple[Member, ...]
    """The candidates that no other is better than in everything."""
    runs: int
    """Fresh runs of each."""

    @property
    def too_little(self) -> list[float]:
        """By which share of the true score the search believed too little: the median over the front, by objective."""
        shares = [
            [_too_little(believed, true) for believed, true in zip(m.believed, m.true, strict=True)]
            for m in self.members
        ]
        return [float(share) for share in np.median(np.array(shares), axis=0)]

    @property
    def words(self) -> str:
        """What became of the front."""
        stay, count = sum(m.stays for m in self.members), len(self.members)
        shares = ", ".join(
            f"{abs(100 * share):.0f} % too {'little' if share >= 0 else 'much'} of {name}"
            for name, share in zip(self.names, self.too_little, strict=True)
        )
        return (
            f"On {self.runs:,} fresh runs each, {stay} of {count} are still beaten by none; the search believed "
            f"{shares} (medians)."
        )

    @property
    def table(self) -> pl.DataFrame:
        """One row a candidate: its values, and believed and true scores with limits."""
        rows = []
        for member in self.members:
            row: dict[str, Any] = {"key": member.key, **member.values, "stays": member.stays}
            for name, believed, true in zip(self.names, member.believed, member.true, strict=True):
                row |= {f"{name}, believed": plain(believed), f"{name}, true": plain(true.estimate)}
                row |= {f"{name}, true low": plain(true.low), f"{name}, true high": plain(true.high)}
            rows.append(row | {"fresh runs": self.runs - member.failed, "failed": member.failed})
        return pl.DataFrame(rows, infer_schema_length=None)

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
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
    """Fresh runs of each candidate of the front: those of the search, shared."""
    return max(found.search.settings.fresh // max(len(found.front), 1), FEWEST)


def front_of(
    found: Found,
    *,
    executor: str | Executor = "threads",
    workers: int | None = None,
    tell: Callable[[int], None] = lambda done: None,
) -> Front:
    """Score the front of a search with several objectives on fresh runs, the same for all its candidates.

    Args:
        found: the search. executor, workers: as ``run_search`` takes them.
        tell: is told how many runs are done.
    Raises:
        RunError: none of the runs of a candidate could be done.
    """
    search, archive, runs = found.search, found.archive, fresh_runs(found)
    cases, seed = [cell.scenario for cell in search.cases], derived_seed(search.seed, "fresh runs")
    scored: list[tuple[tuple[Interval, ...], int]] = []
    with workers_for(executor, workers) as hands:
        for key in found.front:
            many = figures_of(
                cases, archive[key].values, search.objectives, runs, seed, hands,
                motion=search.study.motion, tell=after(tell, len(scored) * runs),
            )  # fmt: skip
            true = tuple(
                objective.interval(many.rows[:, :, columns])
                for objective, columns in zip(search.objectives, archive.columns, strict=True)
            )
            scored.append((true, many.failed))
    stays = unbeaten([[score.estimate for score in true] for true, _ in scored])
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
    """Objectives in words, numbered where two are called alike."""
    return tuple(f"{word} ({k + 1})" if words.count(word) > 1 else word for k, word in enumerate(words))
