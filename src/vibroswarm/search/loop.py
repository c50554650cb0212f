"""Run a search: its stages request runs, workers simulate them, and the results go to the archive and the folder.

A step is one set of requests with its results. After the method, the best candidates (finalists) compete in a race on
further runs (see ``race``); with several objectives there is no race, and the result is a Pareto front.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from contextlib import nullcontext, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Never

import numpy as np
import polars as pl

from vibroswarm.core.user_code import errors_in
from vibroswarm.errors import CodeError, RunError, check_kind, shown
from vibroswarm.search.archive import Archive
from vibroswarm.search.evaluate import AS_RAN, Evaluator, Piece, do_asks
from vibroswarm.search.methods import Ask, Iteration, SearchProgress, Stage, method
from vibroswarm.search.race import Race
from vibroswarm.search.response_surface import optima
from vibroswarm.search.space import Values
from vibroswarm.search.spec import Search
from vibroswarm.search.steps import REQUEST, STEPS, RecordedRun, SearchFolder, results_in, step_table
from vibroswarm.study.run import Pool, pool_for


def stage_of(search: Search, archive: Archive) -> Stage:
    """Begin the method that a search names; it will add its candidates to ``archive``.

    Raises:
        InputError: the method's file is not loaded, needs a library that is not installed, or the method cannot search
            over these fields.
    """
    chosen = method(search.settings.method)
    with errors_in(chosen.code):
        return chosen.begin(archive, search)


def requests_of(stage: Stage, code: str) -> list[Ask]:
    """Return the requests of a stage's next step.

    Args:
        code: of a method in a user's file; else empty.
    Raises:
        CodeError: the method failed, or does not request runs of candidates, at most once of each.
    """
    with errors_in(code):
        asks = stage.ask()
        keys, known = [ask.key for ask in asks], range(len(stage.archive))
        for ask in asks:
            are_whole = all(isinstance(value, int | np.integer) for value in ask)
            if not are_whole or ask.key not in known or ask.runs < 1 or keys.count(ask.key) > 1:
                raise CodeError(
                    f"{stage.name} requests {ask.runs} runs of candidate {ask.key}; request 1 or more, at most once a "
                    "step, of a candidate of the archive"
                )
    return asks


def check_ready(search: Search) -> None:
    """Check that a search can begin, with its code and the installed libraries; called before anything is written.

    Raises:
        InputError: as of ``stage_of``.
    """
    stage_of(search, Archive(search.space, search.objectives))  # made only for its checks


Progress = Callable[[SearchProgress], None]


@dataclass(frozen=True)
class Found:
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
        folder: where its steps are saved. By default they are not saved, and the search cannot be continued. A search
            whose cost is a function cannot be saved.
        executor, workers: see ``study.run.pool_for``.
        mixed: whether to continue a search that other versions of vibroswarm or its libraries began. By default this is
            refused, since no single version could repeat such a search.
        progress: called as runs finish, with the state of the search.
    Raises:
        InputError: the folder is refused (see ``SearchFolder``) or in use, code is not loaded, a library is missing, or
            a cost returns no number.
        CodeError: a user's method failed.
        RunError: every run of the first step failed, the workers are gone, the folder cannot be written, or it holds
            other requests than the method makes; finished steps are saved.
    """
    check_kind(search, Search, "search", "a Search; make one with Search.read(file)")
    check_ready(search)
    place = None if folder is None else SearchFolder(folder, search, mixed=mixed)
    with pool_for(executor, workers) as pool, nullcontext() if place is None else place.alone():
        return _Loop(search, place, pool, progress).run()


class _Loop:
    """A running search. A step that the folder has is replayed: the stage gets the recorded results."""

    def __init__(
        self, search: Search, folder: SearchFolder | None, pool: Pool | None, progress: Progress
    ) -> None:
        """Prepare the search: an archive without candidates."""
        self.search, self.folder, self.pool, self.progress = search, folder, pool, progress
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
        self.steps = 0
        """Number of steps so far."""
        self.best = math.inf
        """The best score so far, for progress."""

    def run(self) -> Found:
        """Run the method, then the race of the finalists if there is one, and return the result."""
        search = self.search
        first = stage_of(search, self.archive)
        self._run_stage(first, "search", search.search_runs)
        race: Stage | None = None
        if search.final_runs and len(search.objectives) == 1:
            race = Race(self.archive, self._finalists(first), search.final_runs)
            self._run_stage(race, "race", search.search_runs + search.final_runs)
        last = race or first
        # With several objectives, the finalists are the candidates on the Pareto front. All are requested: the number
        # is larger than that of the candidates.
        ranked = [] if race else self._ranked(first, 10**9)
        return Found(
            search=search,
            archive=self.archive,
            best=last.best(),
            history=first.history,
            race=race.history if race else [],
            front=tuple(ranked) if len(search.objectives) > 1 else (),
        )

    def _finalists(self, first: Stage) -> list[int]:
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
        best = self._ranked(first, count - len(added))
        return [*best, *(self.archive.new(point, origin) for point, origin in added)]

    def _ranked(self, stage: Stage, count: int) -> list[int]:
        """Return the keys of up to ``count`` candidates that a method names as its best, the best first, each once.

        Raises:
            CodeError: the method failed, or named what is no candidate.
        """
        chosen, known = method(self.search.settings.method), range(len(self.archive))
        with errors_in(chosen.code):
            keys = list(dict.fromkeys(stage.finalists(count)))
            if not all(key in known for key in (*keys, stage.best())):
                raise CodeError(
                    f"{chosen.name}: finalists are {shown(keys)}, and the best is {shown(stage.best())}; return keys "
                    f"of candidates, from 0 to {len(known) - 1}"
                )
        return keys[:count]

    def _run_stage(self, stage: Stage, name: str, wanted: int) -> None:
        """Run a stage, step by step, until it makes no further requests.

        Args:
            stage: the search's method, or the race. name: "search" or "race", for the progress report.
            wanted: number of runs from the beginning of the search to the end of this stage, for the progress report.
        """
        code = method(self.search.settings.method).code
        while True:
            asks = requests_of(stage, code)
            if not asks:
                return
            self._run_step(asks, lambda done: self._report_progress(stage, name, wanted, done))
            with errors_in(code):
                stage.tell()
            if stage.history:
                self.best = stage.history[-1].best
            self._report_progress(stage, name, wanted, done=0)  # the archive has all runs of the step now

    def _run_step(self, asks: Sequence[Ask], progress: Callable[[int], None]) -> None:
        """Do one step: add the results of the requests ``asks`` to the archive, from the folder if it has the step.

        Raises:
            RunError: every run of the first step failed, or the recorded step has other requests.
        """
        self.steps += 1
        # Also of a recorded step: the numbers of its runs count as used from now on.
        pieces = [(ask, self.evaluator.pieces(ask)) for ask in asks]
        table = None if self.folder is None else self.folder.read(self.steps)
        if table is None:
            table = self._new_step(pieces, progress)
        elif not self._is_of(asks, table):
            raise RunError(
                "the method requests other runs than this folder holds, which another version made, or the method does "
                "not repeat (vibroswarm check); take a new folder"
            )
        self._collect(pieces, table)
        for found in results_in(table, len(self.search.cases)):
            self.archive.add_runs(*found)

    def _new_step(
        self, asks: Sequence[tuple[Ask, Sequence[Piece]]], progress: Callable[[int], None]
    ) -> pl.DataFrame:
        """Simulate a step, and save and return its table.

        Args:
            asks: the requests with their pieces. progress: called with the number of finished runs.
        Raises:
            RunError: every run of the first step failed. It is not saved, so that it can be tried again.
        """
        assert self.pool is not None  # only a replay has none
        results = do_asks(asks, self.archive.objectives, self.pool, progress)
        table = step_table(self.search, {ask.key: self.archive[ask.key].origin for ask, _ in asks}, results)
        if self.steps == 1 and not table["failed"].null_count():
            raise RunError(
                f"all of the first {sum(ask.runs for ask, _ in asks)} runs failed: {table['failed'][0]}"
            )
        if self.folder is not None:
            self.folder.add(self.steps, table)
        return table

    def _collect(self, asks: Sequence[tuple[Ask, Sequence[Piece]]], table: pl.DataFrame) -> None:
        """Note the runs of a finished step; only a replay does."""

    def _is_of(self, asks: Sequence[Ask], table: pl.DataFrame) -> bool:
        """Return whether a recorded step has exactly the runs of these requests, and their candidates these origins."""
        cases = len(self.search.cases)
        expected = [(ask.key, run, case) for ask in asks for run in range(ask.runs) for case in range(cases)]
        origins = {(ask.key, self.archive[ask.key].origin) for ask in asks}
        found = set(table.select("candidate", "origin").unique().rows())
        return table.select(REQUEST).rows() == expected and found == origins

    def _report_progress(self, stage: Stage, name: str, wanted: int, done: int) -> None:
        """Report the state of the search to the caller.

        Args:
            stage, name, wanted: see ``_run_stage``.
            done: number of finished runs of the current step, which are not in the archive yet.
        """
        self.progress(
            SearchProgress(
                method=stage.name,
                iteration=len(stage.history),
                iterations=stage.iterations,
                runs=self.archive.runs + done,
                wanted=wanted,
                best=self.best,
                failed=self.archive.failed,
                stage=name,
            )
        )


class _EndOfSteps(Exception):  # noqa: N818  (nothing went wrong)
    """The next step is not recorded."""


class _Replay(_Loop):
    """A search of which only the recorded steps are replayed; it collects their runs, without those that failed."""

    def __init__(self, search: Search, folder: SearchFolder) -> None:
        self.collected: list[RecordedRun] = []
        super().__init__(search, folder, None, lambda state: None)

    def _new_step(
        self, asks: Sequence[tuple[Ask, Sequence[Piece]]], progress: Callable[[int], None]
    ) -> Never:
        raise _EndOfSteps

    def _collect(self, asks: Sequence[tuple[Ask, Sequence[Piece]]], table: pl.DataFrame) -> None:
        for ask, pieces in asks:
            runs = [replace(piece, first=n, last=n + 1) for piece in pieces for n in piece.numbers]
            rows = table.filter(pl.col("candidate") == ask.key)
            figures = rows.select(r"^figure_\d+$").to_numpy().reshape(len(runs), len(self.search.cases), -1)
            good = rows.filter(pl.col("case") == 0)["failed"].is_null()
            self.collected += [
                RecordedRun(STEPS, f"candidate {ask.key}", piece, of_run)
                for piece, of_run, is_good in zip(runs, figures, good, strict=True)
                if is_good
            ]


def recorded_runs(search: Search, folder: Path) -> list[RecordedRun]:
    """Return the runs that the steps in the folder of a search have recorded, up to the first step that is missing.

    Raises:
        InputError: the folder holds another search, or code is not loaded. RunError: it holds other requests than the
            method makes.
    """
    replay = _Replay(search, SearchFolder(folder, search, mixed=True))
    with suppress(_EndOfSteps):
        replay.run()
    return replay.collected
