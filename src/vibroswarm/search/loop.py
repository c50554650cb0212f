"""Run a search: its method requests runs, workers simulate them, and the archive gets the results.

After the method, its best candidates (finalists) share the final runs in three rounds; after each the better half goes
on. These runs played no part in choosing the finalists. With several objectives there are none: the result is a Pareto
front.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np

from vibroswarm.core.user_code import errors_in
from vibroswarm.errors import RunError
from vibroswarm.search.evaluate import Evaluator, evaluator_for
from vibroswarm.search.methods import Archive, Ask, Iteration, Stage, chance, iteration_of, method
from vibroswarm.search.pso import KEEPING, Pso, shared_run
from vibroswarm.search.space import Values
from vibroswarm.search.spec import Search

ROUNDS: Final = 3
"""Rounds of the finalists."""
LEAST_RUNS: Final = 20
"""Final runs for each finalist; with fewer the standard error of a mean + sd would exceed a third of it."""


Progress = Callable[[int, float], None]
"""Takes the number of finished runs, and the best score so far, which is infinite in the first iteration."""


@dataclass(frozen=True)
class Found:
    """The result of a search, as the search itself estimates it; see ``validation`` for estimates on fresh runs."""

    search: Search
    archive: Archive
    """All candidates with their runs."""
    best: int
    """Key of the winner; with several objectives, of the best candidate under the first one."""
    history: list[Iteration]
    """The iterations of the method."""
    race: list[Iteration]
    """The rounds of the finalists; empty without final runs."""

    @property
    def values(self) -> Values:
        """The winner's values."""
        return dict(self.archive[self.best].values)

    @property
    def believed(self) -> float:
        """The winner's score under the first objective; of the paper's swarm that with which it became the best."""
        if self.search.noise in KEEPING and not self.race:
            return self.history[-1].best
        return self.archive.estimate(self.best)[0]


def run_search(
    search: Search,
    folder: str | Path | None = None,
    *,
    executor: str | Executor = "threads",
    workers: int | None = None,
    progress: Progress = lambda runs, best: None,
) -> Found:
    """Run a search, or continue the one in ``folder``, which may have had a smaller budget.

    Args:
        folder: where runs are saved after each step; None: nowhere.
        executor, workers: see ``study.run.pool_for``. progress: called as runs finish.
    """
    with evaluator_for(search, folder, executor, workers) as evaluator:
        return _Loop(search, evaluator, progress).run()


class _Loop:
    def __init__(self, search: Search, evaluator: Evaluator, progress: Progress) -> None:
        self.search, self.evaluator, self.progress = search, evaluator, progress
        # Like the paper's program, an as-ran search drops failed runs from scores, and numbers runs in its own way.
        self.archive = Archive(search.space, search.objectives, drops_failed=search.noise == "as-ran")
        self.next_run = 0

    def run(self) -> Found:
        search, chosen = self.search, method(self.search.settings.method)
        with errors_in(chosen.code):
            stage = chosen.begin(self.archive, search)
            if isinstance(stage, Pso):  # continued with a larger budget, it keeps the inertia of the first
                stage.falls_over = int(self.evaluator.about["iterations"])
            while asks := stage.ask():
                self._step(asks, stage.history, "evaluations")
                stage.tell()
        if not search.final_runs:
            return Found(search, self.archive, stage.best(), stage.history, [])
        step = partial(self._step, purpose="final runs")
        rounds = race(self.archive, self._finalists(stage), search.final_runs, step)
        return Found(search, self.archive, rounds[-1].best_key, stage.history, rounds)

    def _finalists(self, stage: Stage) -> list[int]:
        """Choose the finalists: the best candidates of the method, and the starts."""
        count = min(self.search.settings.finalists, max(self.search.final_runs // LEAST_RUNS, 1))
        starts = self.search.starts[: count - 1]
        best = stage.finalists(count - len(starts))
        return [*best, *(self.archive.new(point, "start") for point in starts)]

    def _step(self, asks: Sequence[Ask], history: Sequence[Iteration], purpose: str) -> None:
        before, best = self.archive.runs, history[-1].best if history else math.inf

        def progress(done: int) -> None:
            self.progress(before + done, best)

        numbered = [self._numbers(ask, purpose) for ask in asks]
        wanted = [(self.archive[ask.key].values, runs) for ask, (runs, _) in zip(asks, numbered, strict=True)]
        found = self.evaluator.figures(purpose, wanted, progress)
        for ask, (_, crashed), figures in zip(asks, numbered, found, strict=True):
            why = figures.why or ("taken to crash (pso.crash_share)" if crashed else "")
            self.archive.add(ask.key, figures.rows, figures.failed + crashed, why)
        if not before and self.archive.failed == self.archive.runs:
            raise RunError(f"all of the first {self.archive.runs} runs failed: {found[0].why}")

    def _numbers(self, ask: Ask, purpose: str) -> tuple[Sequence[int], int]:
        """Return the numbers of the runs of a request, and how many more count as crashed: other candidates have the
        numbers of final runs too."""
        candidate = self.archive[ask.key]
        if purpose == "final runs":
            return range(candidate.count, candidate.count + ask.runs), 0
        if self.search.noise == "as-ran":
            runs = [shared_run(candidate.count + e, candidate.iteration) for e in range(ask.runs)]
            chances = chance(self.search.study.seed, f"crashes {ask.key} {candidate.count}").random(ask.runs)
            kept = [run for run, u in zip(runs, chances, strict=True) if u >= self.search.pso.crash_share]
            return kept, ask.runs - len(kept)
        self.next_run += ask.runs
        return range(self.next_run - ask.runs, self.next_run), 0


def race(
    archive: Archive,
    finalists: Sequence[int],
    runs: int,
    step: Callable[[list[Ask], list[Iteration]], None],
) -> list[Iteration]:
    """Let finalists begin again: each round has a third of the runs, which are shared; the better half goes on.

    ``step`` adds the requested runs to the archive.
    """
    left = [archive.new(archive[key].point, f"finalist {key}") for key in finalists]
    history: list[Iteration] = []
    for number in range(1, ROUNDS + 1):
        total = _part(runs, number - 1, ROUNDS)
        shares = [_part(total, k, len(left)) for k in range(len(left))]
        step([Ask(key, share) for key, share in zip(left, shares, strict=True) if share], history)
        ranked = sorted(left, key=lambda key: (archive.estimate(key)[0], key))
        best, points = ranked[0], np.array([archive[ranked[0]].point])
        history.append(iteration_of(archive, number, left, (best, archive.estimate(best)[0]), points))
        left = ranked[: math.ceil(len(ranked) / 2)]
    return history


def _part(total: int, k: int, of: int) -> int:
    """Return the size of part k of ``of`` nearly equal parts."""
    return total * (k + 1) // of - total * k // of
