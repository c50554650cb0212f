"""Run a search: its method requests runs, workers simulate them, and archive and journal record the results."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import nullcontext
from dataclasses import dataclass
from itertools import accumulate, pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np

from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.errors import InputError, RunError
from vibroswarm.optimize.archive import Archive
from vibroswarm.optimize.evaluate import AS_RAN, Evaluator, do_pieces
from vibroswarm.optimize.journal import JOURNAL, Journal, Step
from vibroswarm.optimize.methods import Ask, Iteration, Method, Random, SearchProgress, Sobol
from vibroswarm.optimize.pso import Pso
from vibroswarm.optimize.race import Race
from vibroswarm.optimize.response_surface import optima
from vibroswarm.optimize.space import Values
from vibroswarm.optimize.spec import Search
from vibroswarm.study.executors import Workers, workers_for


def method_of(search: Search, archive: Archive) -> Method:
    """Create the method that a search names.

    Raises:
        InputError: it needs a library that is not there.
    """
    name, starts = search.settings.method, list(search.starts)
    if name == "pso":
        return Pso(archive, search.seed, search.pso_settings, starts)
    seed, budget, evaluations = search.seed, search.search_budget, search.settings.evaluations
    if name == "random":
        return Random(archive, seed, budget, evaluations, starts)
    if name == "sobol":
        return Sobol(archive, seed, budget, evaluations, starts)
    from vibroswarm.optimize.optuna_samplers import Cmaes, OptunaSampler

    if name == "cmaes":
        return Cmaes(archive, seed, budget, evaluations, starts)
    return OptunaSampler(archive, seed, budget, evaluations, starts, name)


def check_libraries(search: Search) -> None:
    """Check that the libraries of a method are installed, before a folder is made.

    Raises:
        InputError: the method or Optuna's storage needs a library that is not there, or the method other fields.
    """
    method_of(search, Archive(search.space, search.objectives))
    if search.has_dashboard:
        from vibroswarm.optimize.optuna_samplers import optuna

        optuna("search.dashboard")


Progress = Callable[[SearchProgress], None]

WIDTHS: Final = {"time_at_error": 5, "expected_time_to_right": 2}
"""Columns of the figures of objectives that have more than one."""


@dataclass(frozen=True)
class Found(NotebookView):
    """The result of a search, as the search itself estimates it; see ``validation`` for estimates on fresh runs.

    Args:
        search: its definition. archive: all candidates with their runs. best, front: see below.
        history, race: the iterations of the method, and of the race of the finalists.
    """

    search: Search
    archive: Archive
    best: int
    """Key of the winner."""
    history: list[Iteration]
    race: list[Iteration]
    front: tuple[int, ...] = ()
    """With several objectives, the candidates on the Pareto front."""

    def __repr__(self) -> str:
        objective = self.search.objectives[0]
        return (
            f"Found({self.search.settings.method}, {len(self.archive):,} candidates in {self.runs:,} runs; "
            f"believed score {f'{self.believed:.4g} {objective.unit}'.rstrip()}, {objective.words})"
        )

    @property
    def values(self) -> Values:
        """The winner's values."""
        return dict(self.archive[self.best].values)

    @property
    def believed(self) -> float:
        """The winner's score as the search estimates it.

        By the paper's method, without a race, it is the score with which the winner became the best, which is too low
        since the luckiest wins; else it is the estimate from all of its runs, corrected for
        small-sample bias.
        """
        if self.race or self.search.settings.method != "pso" or not self.search.pso.keeps_scores:
            return self.archive.estimate(self.best)[0]
        return self.history[-1].best

    @property
    def runs(self) -> int:
        """Runs that the search took."""
        return self.archive.runs


def run_search(
    search: Search,
    folder: str | Path | None = None,
    *,
    executor: str | Executor = "threads",
    workers: int | None = None,
    mixed: bool = False,
    progress: Progress = lambda told: None,
) -> Found:
    """Run a search, or continue the one in ``folder``; may be interrupted and called again at any time.

    Args:
        folder: where its journal is saved; by default nowhere. executor, workers: see ``study.executors``.
        mixed: continue even if other versions began. progress: called as runs finish.
    Raises:
        InputError: the folder holds another search or is in use, a library is missing, or a cost returns no number.
        RunError: every run of the first step failed, or the workers are gone; finished steps are saved.
    """
    check_libraries(search)
    journal = None if folder is None else Journal(folder, search, mixed=mixed)
    with workers_for(executor, workers) as pool, nullcontext() if journal is None else journal.alone():
        return _Loop(search, journal, pool, progress).run()


class _Loop:
    def __init__(self, search: Search, journal: Journal | None, pool: Workers, progress: Progress) -> None:
        self.search, self.journal, self.pool, self.progress = search, journal, pool, progress
        as_ran = search.is_as_ran
        self.archive = Archive(search.space, search.objectives, drops_failed=as_ran)
        self.evaluator = Evaluator(
            self.archive,
            [cell.scenario for cell in search.cases],
            search.seed,
            motion=search.study.motion,
            numbers=AS_RAN if as_ran else search.settings.numbers,
            crash_share=search.pso.crash_share if as_ran else 0.0,
        )
        self.before: Iterator[Step] = iter(()) if journal is None else journal.steps()
        self.replaying = journal is not None
        self.show: Callable[[], None] = lambda: None
        if journal is not None and search.has_dashboard:
            from vibroswarm.optimize.optuna_samplers import Dashboard

            self.show = Dashboard(journal.folder, self.archive, search.study.name).show
        self.best = math.inf

    def run(self) -> Found:
        """Run the method, then the race of the finalists."""
        search = self.search
        method: Method = method_of(search, self.archive)
        self._run_method(method, "search", search.search_runs)
        race: Method | None = None
        if search.final_runs and len(search.objectives) == 1:
            race = Race(self.archive, self._finalists(method), search.final_runs)
            self._run_method(race, "race", search.search_runs + search.final_runs)
        if self.replaying and self.journal is not None:
            self.journal.cut()
        self.show()
        last = race or method
        front = tuple(method.finalists(10**9)) if len(search.objectives) > 1 else ()
        return Found(search, self.archive, last.best(), method.history, race.history if race else [], front)

    def _finalists(self, method: Method) -> list[int]:
        """Choose the method's best candidates, the optima of the response surfaces, and the starts."""
        count = min(self.search.settings.finalists, max(self.search.final_runs // 20, 1))
        keys = range(len(self.archive))
        points = optima(self.archive, keys, self.search.seed) if self.search.settings.surface else []
        named = [*((p, "surface") for p in points), *((p, "start") for p in self.search.starts)]
        named = named[: max(count - 1, 0)]
        best = method.finalists(count - len(named))
        return [*best, *(self.archive.new(point, origin) for point, origin in named)]

    def _run_method(self, method: Method, stage: str, wanted: int) -> None:
        """Run a method until it makes no further requests."""
        while asks := method.ask():
            self._run_step(asks, method, stage, wanted)
            method.tell()
            if not self.replaying:
                self.show()
            if method.history:
                self.best = method.history[-1].best
            self._report_progress(method, stage, wanted, 0)

    def _run_step(self, asks: Sequence[Ask], method: Method, stage: str, wanted: int) -> None:
        """Run one set of requests, or replay it from the journal."""
        step = next(self.before, None) if self.replaying else None
        if step is not None:
            self._replay_step(step, asks)
            return
        if self.replaying and self.journal is not None:
            self.journal.cut()
        self.replaying = False
        pieces = [(ask, piece) for ask in asks for piece in self.evaluator.pieces(ask)]
        results = do_pieces(
            [piece for _, piece in pieces],
            self.archive.objectives,
            self.pool,
            lambda done: self._report_progress(method, stage, wanted, done),
        )
        by_ask: dict[int, list[Any]] = {ask.key: [] for ask in asks}
        for (ask, piece), rows in zip(pieces, results, strict=True):
            by_ask[ask.key].append(rows if not isinstance(rows, str) else (rows, piece.last - piece.first))
        self._add_runs(asks, [by_ask[ask.key] for ask in asks])
        if self.journal is not None:
            self.journal.add(self.archive, asks, [by_ask[ask.key] for ask in asks])

    def _replay_step(self, step: Step, asks: Sequence[Ask]) -> None:
        """Add the runs of a step from the journal; refuse it if the requests differ."""
        if list(asks) != step.asks or [self.archive[a.key].origin for a in asks] != step.origins:
            raise RunError(
                "the method requests other runs than the journal holds, which another version made; "
                "take a new folder"
            )
        shape = (len(self.search.cases), sum(slice_.stop - slice_.start for slice_ in self.archive.columns))
        for pieces in step.found:
            for rows in pieces:
                if isinstance(rows, np.ndarray) and (
                    rows.shape[1] != shape[0] or (self.archive.columns and rows.shape[2] != shape[1])
                ):
                    raise InputError(
                        f"holds rows of {rows.shape[1]} cases and {rows.shape[2]} figures, where the search has others",
                        field=JOURNAL,
                    )
        for ask in asks:
            self.evaluator.pieces(ask)  # counts the runs off
        self._add_runs(asks, step.found)

    def _add_runs(self, asks: Sequence[Ask], found: Sequence[Sequence[Any]]) -> None:
        """Add the runs of each request to the archive."""
        first = not self.archive.columns
        for ask, pieces in zip(asks, found, strict=True):
            for piece in pieces:
                rows, count = (piece, piece.shape[0]) if isinstance(piece, np.ndarray) else piece
                self.archive.add_runs(ask.key, rows, count)
        if first:
            self._name_columns(asks)

    def _name_columns(self, asks: Sequence[Ask]) -> None:
        """Assign the columns of figures to objectives after the first runs."""
        rows = [self.archive[ask.key].rows[0] for ask in asks if self.archive[ask.key].rows]
        if not rows:
            cause = next((self.archive[a.key].why for a in asks if self.archive[a.key].why), "")
            raise RunError(f"all of the first {sum(a.runs for a in asks)} runs failed: {cause}")
        widths = [WIDTHS.get(objective.name, 1) for objective in self.archive.objectives]
        bounds = [0, *accumulate(widths if len(widths) > 1 else [rows[0].shape[2]])]
        self.archive.columns = [slice(first, end) for first, end in pairwise(bounds)]

    def _report_progress(self, method: Method, stage: str, wanted: int, done: int) -> None:
        """Report the state of the search to the caller."""
        self.progress(
            SearchProgress(
                method=method.name,
                iteration=len(method.history),
                iterations=method.iterations,
                runs=self.archive.runs + done,
                wanted=wanted,
                best=self.best,
                failed=self.archive.failed,
                stage=stage,
            )
        )
