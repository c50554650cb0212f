"""Run a search: its method requests runs, workers simulate them, and archive and journal record the results.

A step is one set of requests with its results. After the method, the best candidates (finalists) compete in a race on
further runs (see ``race``); with several objectives there is no race, and the result is a Pareto front.
"""

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
    """Create the method that a search names; the method will add its candidates to ``archive``.

    Raises:
        InputError: the method needs a library that is not installed, or cannot search over these fields.
    """
    name, starts = search.settings.method, list(search.starts)
    if name == "pso":
        return Pso(archive, search.seed, search.pso_settings, starts)
    # ``budget``: runs of the method in all; ``evaluations``: runs of each candidate
    seed, budget, evaluations = search.seed, search.search_budget, search.settings.evaluations
    if name == "random":
        return Random(archive, seed, budget, evaluations, starts)
    if name == "sobol":
        return Sobol(archive, seed, budget, evaluations, starts)
    # imported only here, since these methods need libraries that may not be installed
    from vibroswarm.optimize.optuna_samplers import Cmaes, OptunaSampler

    if name == "cmaes":
        return Cmaes(archive, seed, budget, evaluations, starts)
    return OptunaSampler(archive, seed, budget, evaluations, starts, name)


def check_libraries(search: Search) -> None:
    """Check that a search can begin with the installed libraries; called before anything is written.

    Raises:
        InputError: the method needs a library that is not installed, or cannot search over these fields.
    """
    method_of(search, Archive(search.space, search.objectives))  # made only for its checks


Progress = Callable[[SearchProgress], None]

WIDTHS: Final = {"time_at_error": 5, "expected_time_to_right": 2}
"""Numbers of columns of the figures of these objectives, see ``Objective.figures``; every other cost has one."""


@dataclass(frozen=True)
class Found(NotebookView):
    """The result of a search, as the search itself estimates it; see ``validation`` for estimates on fresh runs."""

    search: Search
    """The definition of the search."""
    archive: Archive
    """All candidates with their runs."""
    best: int
    """Key of the winner; with several objectives, of the best candidate under the first one."""
    history: list[Iteration]
    """The iterations of the method."""
    race: list[Iteration]
    """The iterations of the race, in which the best candidates (finalists) are compared on further runs; empty without
    a race."""
    front: tuple[int, ...] = ()
    """With several objectives, the keys of the candidates on the Pareto front; empty if no candidate has finite scores.
    With one objective, it is always empty."""

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
        """The winner's score as the search estimates it; with several objectives, the score under the first one.

        It is ``Archive.estimate``, from all runs of the winner. Only the paper's swarm (pso with the noise ``fixed`` or
        ``as-ran``) without a race does not estimate again: there it is the score with which the winner became a
        personal best. That score is too low on average, since the luckiest candidate wins.
        """
        if self.race or self.search.settings.method != "pso" or not self.search.pso.keeps_scores:
            score, _ = self.archive.estimate(self.best)  # with its standard error
            return score
        return self.history[-1].best

    @property
    def runs(self) -> int:
        """Number of runs of the search, including the race and failed runs."""
        return self.archive.runs


def run_search(
    search: Search,
    folder: str | Path | None = None,
    *,
    executor: str | Executor = "threads",
    workers: int | None = None,
    mixed: bool = False,
    progress: Progress = lambda state: None,
) -> Found:
    """Run a search, or continue the one in ``folder``; a call that was interrupted can be repeated to continue.

    Args:
        search: its definition.
        folder: where its journal is saved. By default it is not saved, and the search cannot be continued. A search
            whose cost is a function cannot be saved.
        executor, workers: see ``study.executors``.
        mixed: whether to continue a search that other versions of vibroswarm or its libraries began. By default this is
            refused, since no single version could repeat such a search.
        progress: called as runs finish, with the state of the search.
    Raises:
        InputError: the folder is refused (see ``Journal``) or in use, its journal is damaged, a library is missing, or
            a cost returns no number.
        RunError: every run of the first step failed, the workers are gone, the folder cannot be written, or its journal
            holds other requests than the method makes; finished steps are saved.
    """
    check_libraries(search)
    journal = None if folder is None else Journal(folder, search, mixed=mixed)
    with workers_for(executor, workers) as pool, nullcontext() if journal is None else journal.alone():
        return _Loop(search, journal, pool, progress).run()


class _Loop:
    """A running search. It first replays the steps in the journal, then runs new steps and appends them to the journal.

    To replay a step is to give the method its recorded results, so that the method reaches the state in which the
    search was interrupted.
    """

    def __init__(self, search: Search, journal: Journal | None, pool: Workers, progress: Progress) -> None:
        """Prepare the search: an archive without candidates, and the recorded steps, which ``run`` replays."""
        self.search, self.journal, self.pool, self.progress = search, journal, pool, progress
        # Like the paper's program, an as-ran search drops failed runs from scores, and numbers runs in its own way.
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
        self.recorded: Iterator[Step] = iter(()) if journal is None else journal.steps()
        self.replaying = journal is not None
        """Whether steps of the journal may still have to be replayed; false from the first step that is run."""
        self.best = math.inf
        """The best score so far, for progress."""

    def run(self) -> Found:
        """Run the method, then the race of the finalists if there is one, and return the result."""
        search = self.search
        method: Method = method_of(search, self.archive)
        self._run_method(method, "search", search.search_runs)
        race: Method | None = None
        if search.final_runs and len(search.objectives) == 1:
            race = Race(self.archive, self._finalists(method), search.final_runs)
            self._run_method(race, "race", search.search_runs + search.final_runs)
        if self.replaying and self.journal is not None:
            # Every step was in the journal. So ``_run_step`` has run no new step, before which it would have cut off
            # an incomplete last line.
            self.journal.cut()
        last = race or method
        # With several objectives, the finalists are the candidates on the Pareto front. All are requested: the number
        # is larger than that of the candidates.
        front = tuple(method.finalists(10**9)) if len(search.objectives) > 1 else ()
        return Found(
            search=search,
            archive=self.archive,
            best=last.best(),
            history=method.history,
            race=race.history if race else [],
            front=front,
        )

    def _finalists(self, method: Method) -> list[int]:
        """Choose the candidates of the race, and return their keys.

        They are, in this order of preference, the best candidate of the method, the minima of the response surfaces
        (functions of the point that are fitted to the scores), the starts, and further good candidates of the method.
        Surface minima and starts are added to the archive as new candidates, without runs.
        """
        # At most ``settings.finalists``, and fewer if the runs of the race are too few for 20 runs of each: with fewer
        # runs, the standard error of a score (mean + sd) would be more than a third of the score.
        count = min(self.search.settings.finalists, max(self.search.final_runs // 20, 1))
        keys = range(len(self.archive))
        points = optima(self.archive, keys, self.search.seed) if self.search.settings.surface else []
        added = [*((p, "surface") for p in points), *((p, "start") for p in self.search.starts)]
        added = added[: count - 1]  # one place is left for the method's best candidate
        best = method.finalists(count - len(added))
        return [*best, *(self.archive.new(point, origin) for point, origin in added)]

    def _run_method(self, method: Method, stage: str, wanted: int) -> None:
        """Run a method, step by step, until it makes no further requests.

        Args:
            method: the search's method, or the race. stage: "search" or "race", for the progress report.
            wanted: number of runs from the beginning of the search to the end of this stage, for the progress report.
        """
        while asks := method.ask():
            self._run_step(asks, method, stage, wanted)
            method.tell()
            if method.history:
                self.best = method.history[-1].best
            self._report_progress(method, stage, wanted, done=0)  # the archive has all runs of the step now

    def _run_step(self, asks: Sequence[Ask], method: Method, stage: str, wanted: int) -> None:
        """Do one step: add the results of the requests ``asks`` to the archive.

        If the journal has this step, its results are taken from there. Otherwise the requested runs are simulated, and
        the step is appended to the journal. ``stage`` and ``wanted`` are for the progress report, see ``_run_method``.
        """
        step = next(self.recorded, None) if self.replaying else None
        if step is not None:
            self._replay_step(step, asks)
            return
        if self.replaying and self.journal is not None:
            self.journal.cut()  # a new line must not be appended to an incomplete one
        self.replaying = False
        pieces = [(ask, piece) for ask in asks for piece in self.evaluator.pieces(ask)]
        results = do_pieces(
            [piece for _, piece in pieces],
            self.archive.objectives,
            self.pool,
            lambda done: self._report_progress(method, stage, wanted, done),
        )
        # The results of the pieces of each request, by the key of its candidate: figures, or (reason, number of runs)
        # of a failed piece.
        by_ask: dict[int, list[Any]] = {ask.key: [] for ask in asks}
        for (ask, piece), rows in zip(pieces, results, strict=True):
            by_ask[ask.key].append(rows if not isinstance(rows, str) else (rows, piece.last - piece.first))
        # This raises if all runs of the first step failed. Such a step is not recorded, so that it can be tried again.
        self._add_runs(asks, [by_ask[ask.key] for ask in asks])
        if self.journal is not None:
            self.journal.add(self.archive, asks, [by_ask[ask.key] for ask in asks])

    def _replay_step(self, step: Step, asks: Sequence[Ask]) -> None:
        """Add the runs of a recorded step to the archive, as if they had just been simulated for the requests ``asks``.

        Raises:
            RunError: the recorded requests, or the origins of their candidates, differ from those of the method.
            InputError: the recorded figures do not have the cases and columns of this search.
        """
        if list(asks) != step.asks or [self.archive[a.key].origin for a in asks] != step.origins:
            raise RunError(
                "the method requests other runs than the journal holds, which another version made; "
                "take a new folder"
            )
        cases = len(self.search.cases)
        # The archive has no columns before its first figures, so that the first step may have any number of columns.
        columns = sum(slice_.stop - slice_.start for slice_ in self.archive.columns)
        for pieces in step.found:
            for rows in pieces:
                if isinstance(rows, np.ndarray) and (
                    rows.shape[1] != cases or (self.archive.columns and rows.shape[2] != columns)
                ):
                    raise InputError(
                        f"holds figures of {rows.shape[1]} cases in {rows.shape[2]} columns, which do not fit this "
                        f"search ({cases} cases); take a new folder",
                        field=JOURNAL,
                    )
        # The pieces are not needed, but the call marks their run numbers as used, so that later runs get other numbers.
        for ask in asks:
            self.evaluator.pieces(ask)
        self._add_runs(asks, step.found)

    def _add_runs(self, asks: Sequence[Ask], found: Sequence[Sequence[Any]]) -> None:
        """Add results to the archive: ``found`` has, for each request, the results of its pieces (see ``Step.found``).

        The first call also sets the columns of the archive.
        """
        is_first = not self.archive.columns
        for ask, pieces in zip(asks, found, strict=True):
            for piece in pieces:  # an array of figures, or (reason, number of runs) of a failed piece
                rows_or_reason, count = (piece, piece.shape[0]) if isinstance(piece, np.ndarray) else piece
                self.archive.add_runs(ask.key, rows_or_reason, count)
        if is_first:
            self._set_columns(asks)

    def _set_columns(self, asks: Sequence[Ask]) -> None:
        """Set which columns of the figures belong to each objective; called once, after the first step.

        ``asks`` are the requests of that step; their figures are in the archive.

        Raises:
            RunError: all runs of the first step failed.
        """
        # Figures of the first piece of each request that has any, (runs, cases, columns).
        rows = [self.archive[ask.key].rows[0] for ask in asks if self.archive[ask.key].rows]
        if not rows:
            cause = next((self.archive[a.key].why for a in asks if self.archive[a.key].why), "")
            raise RunError(f"all of the first {sum(a.runs for a in asks)} runs failed: {cause}")
        widths = [WIDTHS.get(objective.name, 1) for objective in self.archive.objectives]
        # The columns of the objectives stand side by side (``evaluate.rows_of``). A single objective has all columns.
        bounds = [0, *accumulate(widths if len(widths) > 1 else [rows[0].shape[2]])]
        self.archive.columns = [slice(first, end) for first, end in pairwise(bounds)]

    def _report_progress(self, method: Method, stage: str, wanted: int, done: int) -> None:
        """Report the state of the search to the caller.

        Args:
            method: the search's method, or the race. stage, wanted: see ``_run_method``.
            done: number of finished runs of the current step, which are not in the archive yet.
        """
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
