"""A search is run: its method asks, executors do, the archive keeps, the journal remembers."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import nullcontext
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from vibroswarm.errors import InputError, RunError
from vibroswarm.optimize.archive import Archive
from vibroswarm.optimize.evaluate import Evaluator, do_pieces
from vibroswarm.optimize.journal import JOURNAL, Journal, Step
from vibroswarm.optimize.method import Ask, Iteration, Method, Told
from vibroswarm.optimize.methods import check_libraries, method_of
from vibroswarm.optimize.race import Race
from vibroswarm.optimize.space import Values
from vibroswarm.optimize.spec import Search
from vibroswarm.optimize.surface import optima
from vibroswarm.study.executors import Workers, workers_for

Tell = Callable[[Told], None]


@dataclass(frozen=True)
class Found:
    """What a search believes; what is true is another matter, see ``truth``.

    Args:
        search: what was searched. archive: all candidates with their runs. best, front: see below.
        history, race: the iterations of the method, and of the race of the finalists.
    """

    search: Search
    archive: Archive
    best: int
    """Key of the winner."""
    history: list[Iteration]
    race: list[Iteration]
    front: tuple[int, ...] = ()
    """With several objectives, the candidates that none beats in all of them."""

    @property
    def values(self) -> Values:
        """The winner's values."""
        return dict(self.archive[self.best].values)

    @property
    def believed(self) -> float:
        """The winner's score as the search has it: the paper's search kept the luckiest, the race frees of bias."""
        if self.race or self.search.settings.method != "pso" or self.search.pso.noise != "fixed":
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
    tell: Tell = lambda told: None,
) -> Found:
    """Run a search, or go on with the one in ``folder``; may be stopped and called again at any moment.

    Args:
        folder: where its journal is kept; without, nothing is. executor, workers: see ``study.executors``.
        mixed: also go on where other versions began. tell: called as runs come back.
    Raises:
        InputError: another search is there or another process is at it, a library is not there, or a cost gives no
            number.
        RunError: every run of the first step failed, or the workers are gone; what was done is kept.
    """
    check_libraries(search)
    journal = None if folder is None else Journal(folder, search, mixed=mixed)
    with workers_for(executor, workers) as hands, nullcontext() if journal is None else journal.alone():
        return _Loop(search, journal, hands, tell).run()


class _Loop:
    def __init__(self, search: Search, journal: Journal | None, hands: Workers, tell: Tell) -> None:
        self.search, self.journal, self.hands, self.tell = search, journal, hands, tell
        self.archive = Archive(search.space, search.objectives)
        self.evaluator = Evaluator(
            self.archive,
            [cell.scenario for cell in search.cases],
            search.seed,
            motion=search.study.motion,
            numbers=search.settings.numbers,
        )
        self.before: Iterator[Step] = iter(()) if journal is None else journal.steps()
        self.replaying = journal is not None
        self.show: Callable[[], None] = lambda: None
        if journal is not None and search.has_dashboard:
            from vibroswarm.optimize.dashboard import Dashboard

            self.show = Dashboard(journal.folder, self.archive, search.study.name).show
        self.best = math.inf

    def run(self) -> Found:
        """The method, then the race of the finalists."""
        search = self.search
        method: Method = method_of(search, self.archive)
        self._drive(method, "search", search.search_runs)
        race: Method | None = None
        if search.final_runs and len(search.objectives) == 1:
            race = Race(self.archive, self._finalists(method), search.final_runs)
            self._drive(race, "race", search.search_runs + search.final_runs)
        if self.replaying and self.journal is not None:
            self.journal.cut()
        self.show()
        last = race or method
        front = tuple(method.finalists(10**9)) if len(search.objectives) > 1 else ()
        return Found(search, self.archive, last.best(), method.history, race.history if race else [], front)

    def _finalists(self, method: Method) -> list[int]:
        """The method's best, the optima of the surfaces through all candidates, and the starts."""
        count = min(self.search.settings.finalists, max(self.search.final_runs // 20, 1))
        keys = range(len(self.archive))
        points = optima(self.archive, keys, self.search.seed) if self.search.settings.surface else []
        named = [*((p, "surface") for p in points), *((p, "start") for p in self.search.starts)]
        named = named[: max(count - 1, 0)]
        best = method.finalists(count - len(named))
        return [*best, *(self.archive.new(point, origin) for point, origin in named)]

    def _drive(self, method: Method, stage: str, wanted: int) -> None:
        while asks := method.ask():
            self._do(asks, method, stage, wanted)
            method.tell()
            if not self.replaying:
                self.show()
            if method.history:
                self.best = method.history[-1].best
            self._say(method, stage, wanted, 0)

    def _do(self, asks: Sequence[Ask], method: Method, stage: str, wanted: int) -> None:
        step = next(self.before, None) if self.replaying else None
        if step is not None:
            self._repeat(step, asks)
            return
        if self.replaying and self.journal is not None:
            self.journal.cut()
        self.replaying = False
        pieces = [(ask, piece) for ask in asks for piece in self.evaluator.pieces(ask)]
        found = do_pieces(
            [piece for _, piece in pieces],
            self.archive.objectives,
            self.hands,
            lambda done: self._say(method, stage, wanted, done),
        )
        by_ask: dict[int, list[Any]] = {ask.key: [] for ask in asks}
        for (ask, piece), rows in zip(pieces, found, strict=True):
            by_ask[ask.key].append(rows if not isinstance(rows, str) else (rows, piece.last - piece.first))
        self._take_in(asks, [by_ask[ask.key] for ask in asks])
        if self.journal is not None:
            self.journal.add(self.archive, asks, [by_ask[ask.key] for ask in asks])

    def _repeat(self, step: Step, asks: Sequence[Ask]) -> None:
        if list(asks) != step.asks or [self.archive[a.key].origin for a in asks] != step.origins:
            raise RunError(
                "the method asks for something else than the journal holds: another version of it made that; "
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
        self._take_in(asks, step.found)

    def _take_in(self, asks: Sequence[Ask], found: Sequence[Sequence[Any]]) -> None:
        first = not self.archive.columns
        for ask, pieces in zip(asks, found, strict=True):
            for piece in pieces:
                rows, count = (piece, piece.shape[0]) if isinstance(piece, np.ndarray) else piece
                self.archive.take_in(ask.key, rows, count)
        if first:
            self._name_columns(asks)

    def _name_columns(self, asks: Sequence[Ask]) -> None:
        rows = [self.archive[ask.key].rows[0] for ask in asks if self.archive[ask.key].rows]
        if not rows:
            why = next((self.archive[a.key].why for a in asks if self.archive[a.key].why), "")
            raise RunError(f"none of the first {sum(a.runs for a in asks)} runs could be done: {why}")
        total = rows[0].shape[2]
        each = [_width(objective.name) for objective in self.archive.objectives]
        if len(each) == 1:
            each = [total]
        bounds = np.concatenate([[0], np.cumsum(each)]).tolist()
        self.archive.columns = [slice(a, b) for a, b in pairwise(bounds)]

    def _say(self, method: Method, stage: str, wanted: int, done: int) -> None:
        self.tell(
            Told(
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


def _width(name: str) -> int:
    """Columns of an objective's figures."""
    return {"time_at_error": 5, "expected_time_to_right": 2}.get(name, 1)
